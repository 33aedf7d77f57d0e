"""Numbers, ranges and lists of numbers as people type them, on the command line and in documents.

What has one meaning is read: `5`, `+5`, `.5`, `1e3`, `1_000`, a minus sign, digits of other scripts, a unit
behind it (`12 ft` where metres are wanted). What may mean several things, or none, is refused, with what may
have been meant: `2,5`, `1'000`, `1/3`, `0x10`, `0...8`. No number is infinite.
"""

import re
import unicodedata
from contextlib import suppress
from math import isfinite

from swath.core.errors import InputError
from swath.core.units import SUFFIXES, UNITS, Unit, rounded, split_unit

LONGEST = 80  # characters of a number and its unit, or of each number of a list or range
DASHES = "‐‑‒–—"
_PLAIN = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_UNDERSCORES = re.compile(r"[-+]?[0-9]{1,3}(?:_[0-9]{3})+(?:\.[0-9]*)?")
_BEHIND = re.compile(r"\s*(?:[A-Za-zµ%°]|1\s*/).*", re.DOTALL)
_GROUPS = r"[-+]?[1-9][0-9]{0,2}([ _.,'’\u00a0\u2009\u202f])[0-9]{3}(?:\2[0-9]{3})*"
_GROUPED = re.compile(rf"({_GROUPS})((?!\2)[.,][0-9]+)?")
_COMMA = re.compile(r"([-+]?[0-9]*),([0-9]+)")
_FRACTION = re.compile(r"([-+]?[0-9]+)\s*[/⁄]\s*([0-9]+)")
_HEX = re.compile(r"0x([0-9a-fA-F]{1,8})")
_BETWEEN = re.compile(r"\s*(?:\.{2,}|…|(?<=[^eE])[-‐‑‒–—~:;]|\b(?:to|bis)\b)\s*")
_DASHES = dict.fromkeys(map(ord, DASHES), "-")
_WRITTEN = {"²": "2", "³": "3", "°": "deg", "µ": "u", "μ": "u", "^": ""}
_SPELT = {
    "kph": "kmh",
    "kmph": "kmh",
    "sec": "s",
    "degrees": "deg",
    "foot": "ft",
    "metres": "m",
    "meters": "m",
}


def unit_of(key: str) -> str:
    """The end of a key that says its unit, as in `UNITS`; "" where there is none."""
    return next((s for s in SUFFIXES if key.endswith(f"_{s}") and len(key) > len(s) + 1), "")


def number_in(text: str, unit: str = "", *, is_whole: bool = False) -> float:
    """The number that a text says, in a unit of `UNITS`; "" = no unit may stand there.

    ValueError with what to say behind `expected a number, not 'TEXT'`: nothing, or what may have been meant.
    """
    said = _plain(text)
    digits, behind = _split(said)
    if said.lstrip("+-").casefold() in ("inf", "infinity", "nan", "∞"):
        raise ValueError("; it must be finite")
    if not digits:
        raise ValueError(_meant(said, unit, is_whole))
    if is_whole and not behind and digits.lstrip("-+").isdigit():
        if abs(whole := int(digits)) < 1 << 63:
            return whole
        raise ValueError
    value = float(digits)
    if not isfinite(value) or (value == 0.0 and re.search("[1-9]", re.split("[eE]", digits)[0])):
        raise ValueError("; it is too large or too small")
    if behind:
        if (found := _unit(behind, unit)) is None:
            raise ValueError(_unfit(behind.strip(), unit))
        if (own := UNITS[unit]).factor != found.factor:
            value = rounded(value * found.factor / own.factor, 12)
    if is_whole and not (value.is_integer() and abs(value) < 1 << 53):
        raise ValueError
    return int(value) if is_whole else value


def range_in(text: str, unit: str = "") -> tuple[float, float]:
    """The ends of `LOW..HIGH`, both in the unit. ValueError as of `number_in`."""
    ends = text.split("..")
    try:
        if len(ends) != 2 or "..." in text:
            raise ValueError
        low, high = (number_in(end, unit) for end in ends)
    except ValueError as error:
        raise ValueError(range_meant(text, unit) or str(error)) from None
    one, other = (_split(_plain(end))[1].strip() for end in ends)
    if bool(one) != bool(other) and _unit(one or other, unit) != UNITS[unit]:
        raise ValueError(f"; is {one or other} the unit of both ends?")
    if not low < high:
        raise ValueError("; the lower end first" + (f": {high:.12g}..{low:.12g}?" if high < low else ""))
    return low, high


def range_meant(text: str, unit: str = "") -> str:
    """`; did you mean 2..8?` of `2-8`, `2:8`, `[2,8]`, `2,5..8` or `2...8`, else nothing."""
    ends = _ends(text, unit)
    return f"; did you mean {ends[0]:.12g}..{ends[1]:.12g}?" if ends else ""


def numbers_in(key: str, text: str, units: tuple[str, ...], form: str, *, least: int = 0) -> list[float]:
    """Numbers with commas between them, each in its unit. InputError for others, or another count of them.

    form: what the numbers are, for the error; least: how many there must be (default: all)
    """
    words = {2: "two", 3: "three", 6: "six"}
    expected = f"expected {words[len(units)]} numbers {form}"
    parts = text.split(",")
    if not (least or len(units)) <= len(parts) <= len(units):
        raise InputError(key, text, f"{expected}, commas between them, points in them")
    try:
        return [number_in(part, unit) for part, unit in zip(parts, units, strict=False)]
    except ValueError as error:
        raise InputError(key, text, f"{expected}{error}") from None


def number_form(key: str, value: object, what: str = "a number") -> str:
    """What a number's key expects in a document, the key says the unit; and what may have been meant."""
    symbol = split_unit(key)[1]
    text = f"expected {what} in {symbol}" if symbol else f"expected {what}"
    if not isinstance(value, str):
        return text
    try:
        number = number_in(value, unit_of(key), is_whole=what != "a number")
    except ValueError as error:
        return text + str(error)
    said = _plain(value)
    if _PLAIN.fullmatch(said):
        return f"{text}, without quotes" if said == value else f"{text}, written {number:.12g}"
    digits, behind = _split(said)
    is_same = behind and number == float(digits)
    return text + (", without the unit" if is_same else f", written {number:.12g}")


def list_form(value: object) -> str:
    """`, written [2, 8]` for the text of a range in the place of a list, else nothing."""
    ends = _ends(value) if isinstance(value, str) and "," not in value else None
    return f", written [{ends[0]:.12g}, {ends[1]:.12g}]" if ends else ""


def check_text(flag: str, key: str, text: str, value: object) -> None:
    """InputError where a typed text is taken as text, though it looks like a number: `1_000`, `12 ft`."""
    if value == text.strip() and (expected := number_form(key, value)) != number_form(key, None):
        raise InputError(flag, text, expected)


def _ends(text: str, unit: str = "") -> tuple[float, float] | None:
    """The ends of a range however it is written, the lower one first."""
    said = _plain(text)[: 2 * LONGEST]
    inner = said.strip("[]() ")
    parts = inner.split(",") if inner != said and "," in inner else _BETWEEN.split(inner)
    if ".." in said:
        parts = [part.replace(",", ".") if _COMMA.fullmatch(part) else part for part in parts]
    try:
        ends = [number_in(part, unit) for part in parts]
    except ValueError:
        return None
    return (min(ends[:2]), max(ends[:2])) if len(ends) in (2, 3) else None


def _plain(text: str) -> str:
    """A text with digits of ASCII, the minus of keyboards, and no blanks around it."""
    said = "".join(c if (d := unicodedata.decimal(c, None)) is None else str(d) for c in text)
    return said.strip().replace("−", "-")


def _unit(text: str, wanted: str) -> Unit | None:
    """The unit that a text says, of the kind of the wanted one; None where it is of another, or none."""
    if not wanted:
        return None
    return next((unit for unit in _units(text) if unit.kind == UNITS[wanted].kind), None)


def _units(text: str) -> list[Unit]:
    said = "".join(_WRITTEN.get(c, c) for c in re.sub(r"\s*/\s*", "/", text.strip()))
    known = [(key, unit) for key, unit in UNITS.items() if key]
    exact = [unit for key, unit in known if said in (key, unit.symbol)]
    folded = _SPELT.get(said.casefold(), said.casefold())
    return exact + [unit for key, unit in known if folded in (key, unit.symbol.casefold())]


def _unfit(said: str, unit: str) -> str:
    """Why a unit does not fit; nothing where none may stand there, or it is not known."""
    found = _units(said) if unit else []
    return f"; {said} is a unit of {found[0].kind}, not of {UNITS[unit].kind}" if found else ""


def _split(said: str) -> tuple[str, str]:
    """The number at the start of a text, and the unit behind it; nothing where there is none."""
    match = (_UNDERSCORES.match(said) or _PLAIN.match(said)) if len(said) <= LONGEST else None
    behind = said[match.end() :] if match else ""
    if match is None or (behind and not _BEHIND.fullmatch(behind)) or _HEX.fullmatch(said):
        return "", ""
    return match[0].replace("_", ""), behind


def _meant(said: str, unit: str, is_whole: bool) -> str:
    """`; did you mean 2.5?`: what a text that is no number may have been meant to say."""
    if len(said) > LONGEST:
        return ""
    body = re.split(r"\s*[A-Za-zµ%°]", said, maxsplit=1)[0]
    found = [str(int(m[1], 16)) for m in [_HEX.fullmatch(said)] if m]
    if m := _COMMA.fullmatch(body):
        found.append(f"{m[1]}.{m[2]}")
    if m := _GROUPED.fullmatch(body):
        found.append(m[1].replace(m[2], "") + (m[3] or "").replace(",", "."))
    if (m := _FRACTION.fullmatch(body)) and int(m[2]):
        found.append(str(rounded(int(m[1]) / int(m[2]), 6)))
    if body[:1] in DASHES and _PLAIN.fullmatch(body.translate(_DASHES)):
        found.append(body.translate(_DASHES))
    behind, readable = "" if _HEX.fullmatch(said) else said[len(body) :], []
    for text in found:
        with suppress(ValueError):
            number_in(text + behind, unit, is_whole=is_whole)
            readable.append(text + behind)
    return f"; did you mean {' or '.join(readable)}?" if readable else ""
