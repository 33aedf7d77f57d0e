"""Units of FMU variables: exponents of the SI base units, factor and offset, and how they become swath's.

value in SI base units = factor * value + offset (FMI 2.0.4, section 2.2.2; FMI 3.0, section 2.4.3)
"""

import re
from dataclasses import dataclass
from math import pi
from typing import Any

from swath.core.errors import InputError

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
Exponents = tuple[int, ...]
NONE: Exponents = (0,) * len(BASE)


@dataclass(frozen=True)
class Unit:
    """A unit by its name, exponents over BASE, factor and offset."""

    name: str
    exponents: Exponents = NONE
    factor: float = 1.0
    offset: float = 0.0

    @property
    def per_second(self) -> "Unit":
        """The unit of a rate of this."""
        return Unit(f"{self.name}/s", _plus(self.exponents, _of(s=-1)), self.factor)

    def fits(self, other: "Unit") -> bool:
        """True for the same quantity. A plain number may stand for radians; 1/s may not stand for rad/s."""
        if self.exponents == other.exponents:
            return True
        return {self.exponents, other.exponents} == {NONE, _of(rad=1)}


@dataclass(frozen=True)
class Scale:
    """Conversion of a foreign number to swath's: ours = factor * theirs + offset."""

    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_same(self) -> bool:
        """True when nothing changes."""
        return self.factor == 1.0 and self.offset == 0.0

    def ours(self, value: Any) -> Any:
        """Their number, or array, as ours."""
        return self.factor * value + self.offset

    def theirs(self, value: Any) -> Any:
        """Our number, or array, as theirs."""
        return (value - self.offset) / self.factor


def scale(theirs: Unit, ours: Unit) -> Scale | None:
    """How numbers in `theirs` become numbers in `ours`, None when they are different quantities."""
    if not theirs.fits(ours):
        return None
    return Scale(theirs.factor / ours.factor, (theirs.offset - ours.offset) / ours.factor)


def describe(unit: Unit) -> str:
    """Name and what it is in SI base units, e.g. `rpm = 0.10472 rad/s`."""
    parts = [f"{b}{e}" if e != 1 else b for b, e in zip(BASE, unit.exponents, strict=True) if e]
    base = " ".join(parts) or "1"
    shift = f" + {unit.offset:g}" if unit.offset else ""
    return f"{unit.name or '-'} = {unit.factor:.6g} {base}{shift}"


def _of(**powers: int) -> Exponents:
    return tuple(powers.get(b, 0) for b in BASE)


def _plus(a: Exponents, b: Exponents, times: int = 1) -> Exponents:
    return tuple(x + times * y for x, y in zip(a, b, strict=True))


_FORCE = _of(kg=1, m=1, s=-2)
_PLAIN: dict[str, tuple[float, Exponents]] = {
    "1": (1.0, NONE),
    "%": (0.01, NONE),
    "percent": (0.01, NONE),
    "t": (1000.0, _of(kg=1)),
    "min": (60.0, _of(s=1)),
    "h": (3600.0, _of(s=1)),
    "hr": (3600.0, _of(s=1)),
    "d": (86400.0, _of(s=1)),
    "deg": (pi / 180.0, _of(rad=1)),
    "°": (pi / 180.0, _of(rad=1)),
    "rev": (2.0 * pi, _of(rad=1)),
    "rpm": (pi / 30.0, _of(s=-1, rad=1)),
    "ha": (1e4, _of(m=2)),
    "K": (1.0, _of(K=1)),
    "mol": (1.0, _of(mol=1)),
    "cd": (1.0, _of(cd=1)),
    "kmh": (1 / 3.6, _of(m=1, s=-1)),
    "kph": (1 / 3.6, _of(m=1, s=-1)),
}
_PREFIXED: dict[str, tuple[float, Exponents]] = {
    "g": (1e-3, _of(kg=1)),
    "m": (1.0, _of(m=1)),
    "s": (1.0, _of(s=1)),
    "A": (1.0, _of(A=1)),
    "rad": (1.0, _of(rad=1)),
    "Hz": (1.0, _of(s=-1)),
    "N": (1.0, _FORCE),
    "Pa": (1.0, _of(kg=1, m=-1, s=-2)),
    "bar": (1e5, _of(kg=1, m=-1, s=-2)),
    "J": (1.0, _of(kg=1, m=2, s=-2)),
    "W": (1.0, _of(kg=1, m=2, s=-3)),
    "V": (1.0, _of(kg=1, m=2, s=-3, A=-1)),
    "l": (1e-3, _of(m=3)),
    "L": (1e-3, _of(m=3)),
}
_PREFIX = {
    "": 1.0,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "c": 1e-2,
    "m": 1e-3,
    "u": 1e-6,
    "µ": 1e-6,
    "d": 0.1,
    "h": 100.0,
}
_PART = re.compile(r"([A-Za-zµ%°]+|1)\s*(?:\^|\*\*)?\s*\(?([+-]?\d+)?\)?$")
_SHIFTED = {"degC": 273.15, "°C": 273.15}


def parse_unit(text: str) -> Unit:
    """A unit as people write it: `km/h`, `kg/s`, `kg.m/s2`, `rpm`, `1/min`, `m s^-2`, `%`.

    InputError for one that is not known.
    """
    if text in _SHIFTED:
        return Unit(text, _of(K=1), 1.0, _SHIFTED[text])
    factor, exponents = 1.0, NONE
    top, *below = text.strip().strip("-").split("/")
    for sign, part in [(1, top), *((-1, p) for p in below)]:
        for word in re.split(r"[.·\s]|(?<!\*)\*(?!\*)", part.strip("() ")):
            if word:
                one, powers, power = _symbol(word, text)
                factor *= one ** (sign * power)
                exponents = _plus(exponents, powers, sign * power)
    return Unit(text, exponents, factor)


def known_unit(text: str) -> Unit | None:
    """`parse_unit`, or None for one that is not known."""
    try:
        return parse_unit(text)
    except InputError:
        return None


def _symbol(word: str, text: str) -> tuple[float, Exponents, int]:
    match = _PART.match(word)
    if match is not None:
        name, power = match[1], int(match[2] or 1)
        if name in _PLAIN:
            return (*_PLAIN[name], power)
        for prefix, times in _PREFIX.items():
            symbol = name.removeprefix(prefix)
            if name.startswith(prefix) and symbol in _PREFIXED:
                factor, exponents = _PREFIXED[symbol]
                return factor * times, exponents, power
    raise InputError("unit", text, "expected a unit such as kg/s, km/h, rpm, deg, kN or 1/m")
