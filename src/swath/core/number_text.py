"""The one way in which numbers are written for people: on the terminal, on pages, in pictures and messages.

A quantity keeps the unit of its key, so that what is printed, a limit in a scenario and `summary.json` have
the same number: a `lateral_rms_m` is 0.0838 m everywhere. A number that has up to five digits, as what people
write and settings have, stays as it is; one with more was computed and gets three that count. Places before
the point are never rounded away, thousands are set off by blanks (12 346 m), below 0.0001 and from 1e9 on
there is an exponent. Numbers that differ get as many digits more as tell them apart. A difference has a sign
and the places of the numbers that it is of.

What a program reads (CSV, JSON, scenarios, columns) is not written by this.
"""

import re
from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from numbers import Integral, Real
from typing import Any

DIGITS, FEW, MOST = 3, 5, 17  # that count: of what was computed, of what was written at most, of a float
LEAST, LARGEST = 1e-4, 1e9  # without an exponent


def num(value: Any, unit: str = "", *, places: int | None = None, beside: Iterable[Any] = ()) -> str:
    """A number and its unit; `-` for None and nan, other things as they are.

    Parameters
    ----------
    unit : of the number, as people write it; "1" and "" have no text.
    places : behind the point, for what is read along a scale: times of events, places on a map.
    beside : numbers that it must be told from.
    """
    if value is None or value != value:
        return "-"
    if isinstance(value, bool) or not isinstance(value, Real):
        return str(value)
    if isinstance(value, Integral):
        text = _grouped(int(value), 0)
    else:
        size = float(value)
        text = _rounded(size, _digits(size, beside)) if places is None else _grouped(size, places)
    return text if unit in ("", "1") else f"{text} {unit}"


def percent_of(share: Any) -> str:
    """A share of one in %."""
    return num(None if share is None else 100.0 * share, "%")


def signed(value: Any, unit: str = "", *, of: Iterable[Any] = ()) -> str:
    """A difference with its sign. of: the numbers that it is of, whose places it has."""
    numbers = [float(n) for n in of if isinstance(n, Real) and isfinite(n)]
    is_plain = all(n == 0.0 or LEAST <= abs(n) < LARGEST for n in numbers)
    behind = [len(num(n, beside=numbers).partition(".")[2]) for n in numbers]
    text = num(value, unit, places=max(behind) if behind and is_plain else None)
    return f"+{text}" if re.match("[0. ]*[1-9]|inf", text) else text


def span(ends: Sequence[float]) -> str:
    """The ends of a range; one number where both are the same."""
    return " to ".join(num(end) for end in (ends if ends[0] != ends[1] else ends[:1]))


def _digits(value: float, others: Iterable[Any]) -> int:
    """Digits that count, and tell a number from others."""
    if float(f"{value:.{FEW}g}") == value:
        return FEW
    digits, others = DIGITS, [o for o in others if isinstance(o, Real) and o != value]
    while digits < MOST and any(_rounded(value, digits) == _rounded(o, digits) for o in others):
        digits += 1
    return digits


def _places(value: float, digits: int) -> int:
    """Places behind the point for so many digits that count."""
    size = abs(float(f"{value:.{digits - 1}e}"))
    return max(digits - 1 - floor(log10(size)), 0) if size else 0


def _rounded(value: float, digits: int) -> str:
    if not isfinite(value) or not (value == 0 or LEAST <= abs(value) < LARGEST):
        return f"{value:.{digits}g}"
    text = _grouped(value, _places(value, digits))
    return text.rstrip("0").rstrip(".") if "." in text else text


def _grouped(value: Any, places: int) -> str:
    text = f"{value:,.{places}f}".replace(",", " ")
    return text if text.strip("-0.") else "0"
