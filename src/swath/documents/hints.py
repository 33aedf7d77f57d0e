"""Near misses: which key was meant, in which unit, and what a value should have looked like."""

import difflib
import re
from collections.abc import Iterable
from typing import Any

from swath.core.units import split_unit

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
WIRE_PATTERN = r"^([A-Za-z_][A-Za-z0-9_-]*\.){1,2}[A-Za-z_][A-Za-z0-9_]*$"
PATTERNS = {
    NAME_PATTERN: "at most 64 letters, digits, dots, - and _",
    WIRE_PATTERN: "slot.output or machine.slot.output",
}
_NUMBER_AND_UNIT = re.compile(r"^\s*[-+]?[0-9.,]+(?:[eE][-+]?[0-9]+)?\s*([A-Za-z°%µ].*)?$")


def unknown_key(key: str, known: Iterable[str], what: str = "unknown key", command: str = "") -> str:
    """The text after an unknown key: the nearest known one, and its unit when only the unit differs.

    command: which lists the known ones where they are many
    """
    names = list(known)
    quantity = split_unit(key)[0]
    same = [n for n in names if split_unit(n)[0] == quantity and split_unit(n)[1]]
    if same:
        return f"{what}, did you mean {same[0]!r}? expected in {split_unit(same[0])[1]}"
    near = difflib.get_close_matches(key, names, n=1) or difflib.get_close_matches(
        quantity, [split_unit(n)[0] for n in names], n=1, cutoff=0.75
    )
    if near:
        meant = near[0] if near[0] in names else next(n for n in names if split_unit(n)[0] == near[0])
        return f"{what}, did you mean {meant!r}?"
    if 0 < len(names) <= 16:
        return f"{what}, expected one of {', '.join(names)}"
    return f"{what}, {command} lists them" if command else what


def near_miss(value: Any, names: Iterable[str]) -> str:
    """`, did you mean 'x'?` or nothing."""
    near = difflib.get_close_matches(str(value), list(names), n=1)
    return f", did you mean {near[0]!r}?" if near else ""


def number_form(key: str, value: Any, what: str = "a number") -> str:
    """What a number's key expects; a number with a unit gets told so."""
    unit = split_unit(key)[1]
    text = f"expected {what} in {unit}" if unit else f"expected {what}"
    match = _NUMBER_AND_UNIT.match(value) if isinstance(value, str) else None
    if match is None:
        return text
    return text + (", without the unit" if match.group(1) else ", without quotes")
