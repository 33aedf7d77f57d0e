"""Times of a log: seconds, date-times, or a date and a time of day, as people and monitors write them."""

import re
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.number_text import num

Array = NDArray[np.float64]
EPOCH = datetime(2000, 1, 1)
DAY = 86400.0
MILLISECONDS = 1e11  # a number of seconds above it is in milliseconds: 1e11 s are 3000 years
DIGITS = (("HHMMSS", 1), ("HHMMSS and hundredths", 100), ("HHMMSS and thousandths", 1000))
LEAST_CODED = 0.995  # of the times whose minutes and seconds are below 60: with less it is no such clock
LEAST_SHARE = 0.5  # of the rows with a time: with less the clock is not used
FEWEST_STEPS = 20  # of a clock whose steps are longer than the records'
LEAST_STEPS = 0.2  # different times per row: with less it holds dates only
LEAST_AHEAD = 0.7  # of the way of the records of one time, straight from the first to the next time
_TIME = re.compile(r"(\d{1,2})[:h](\d{2})(?:[:.](\d{2})(?:[.,](\d+))?)?\s*([ap])?\.?m?\.?", re.IGNORECASE)
_DATE = re.compile(r"(\d{1,4})[-/. ](\d{1,2})[-/. ](\d{1,4})")


def seconds_of(cells: Sequence[Any], dates: Sequence[Any] | None = None) -> Array:
    """Seconds since 2000 of cells with a date-time, or of a time of day with the date beside it; nan = none.

    A time of day without any date counts on over midnight. Zones are left out: a log has one.
    """
    texts = [str(c).strip() for c in cells]
    try:
        return np.array([_iso(t) for t in texts])
    except ValueError:
        pass
    of_day = np.array([_time_of_day(t) for t in texts])
    held = [_DATE.search(t) for t in texts]
    if not any(held) and dates is not None:
        held = [_DATE.search(str(d)) for d in dates]
    if any(held):
        return of_day + _days([None if m is None else (m[0], *m.groups()) for m in held])
    return over_midnight(of_day)


def _iso(text: str) -> float:
    if len(text) < 12:
        raise ValueError(text)
    return (datetime.fromisoformat(text).replace(tzinfo=None) - EPOCH).total_seconds()


def _time_of_day(text: str) -> float:
    found = _TIME.search(text)
    if found is None:
        return np.nan
    hour, minute, second = int(found[1]), int(found[2]), int(found[3] or 0)
    if found[5]:
        hour = hour % 12 + (12 if found[5].lower() == "p" else 0)
    if hour > 24 or minute > 59 or second > 60:
        return np.nan
    return 3600.0 * hour + 60.0 * minute + second + float(f"0.{found[4] or 0}")


def _days(dates: Sequence[tuple[str, ...] | None]) -> Array:
    """Seconds of the midnights of (text, first, second, third).

    4 digits first are the year; else the day is first where a first number above 12 or points between them
    say so, else the month.
    """
    known = [d for d in dates if d is not None]
    year_first = any(len(d[1]) == 4 for d in known)
    day_first = any(int(d[1]) > 12 for d in known) or (
        any("." in d[0] for d in known) and not any(int(d[2]) > 12 for d in known)
    )
    made: dict[tuple[str, ...], float] = {}
    for found in set(known):
        a, b, c = (int(part) for part in found[1:])
        year, month, day = (a, b, c) if year_first else (c, b, a) if day_first else (c, a, b)
        try:
            made[found] = (datetime(year + (2000 if year < 100 else 0), month, day) - EPOCH) / timedelta(
                seconds=1
            )
        except ValueError:
            made[found] = np.nan
    return np.array([np.nan if d is None else made[d] for d in dates])


def days_of(cells: Sequence[Any]) -> Array:
    """Seconds since 2000 of the midnight of each date, also of eight digits (20240720); nan = none."""
    texts = [re.sub(r"^(\d{4})(\d{2})(\d{2})(\.0)?$", r"\1-\2-\3", str(cell).strip()) for cell in cells]
    held = [_DATE.search(text) for text in texts]
    return _days([None if m is None else (m[0], *m.groups()) for m in held])


def of_digits(numbers: Array) -> tuple[Array, Array, str] | None:
    """Seconds of the day, and of the midnight (0 where the number has no date), of numbers like 100059
    (HHMMSS) or 20240720100059, and the form; None where they are another clock.

    Such a clock shows by itself: its seconds and minutes stay below 60, over more than a minute.
    """
    known = np.isfinite(numbers)
    for form, scale in DIGITS:
        whole = numbers[known] / scale
        second, minute, hour = whole % 100.0, whole // 100.0 % 100.0, whole // 1e4 % 100.0
        date = whole // 1e6
        month, day = date // 100.0 % 100.0, date % 100.0
        has_date = bool((date > 0.0).all())
        fits = (second < 60.0) & (minute < 60.0) & (hour < 24.0)
        fits &= (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) if has_date else date == 0.0
        if not len(whole) or fits.mean() < LEAST_CODED or len(np.unique(minute)) < 2 or second.max() < 50.0:
            continue
        seconds, midnight = np.full(len(numbers), np.nan), np.zeros(len(numbers))
        seconds[known] = np.where(fits, 3600.0 * hour + 60.0 * minute + second, np.nan)
        if has_date:
            texts = [f"{d:.0f}" for d in (date if date.max() > 1e6 else date + 2e7)]
            midnight[known] = days_of(texts)
        return seconds, midnight, ("date and " if has_date else "") + form
    return None


def over_midnight(of_day: Array) -> Array:
    """Times of day in the order of the rows, counted on over midnight."""
    known = np.flatnonzero(np.isfinite(of_day))
    counted = of_day.copy()
    counted[known] += DAY * np.cumsum(np.diff(of_day[known], prepend=of_day[known[:1]]) < -0.5 * DAY)
    return counted


def spread(time: Array, position: Array) -> tuple[Array, str]:
    """A clock whose steps are several records long, with these spread evenly over them; and a note.

    position [m], shape (n, 2): where a step is few records long, these lie behind each other, or on one place
    """
    first = np.flatnonzero(np.diff(time, prepend=np.nan) != 0.0)
    if len(first) < FEWEST_STEPS:
        return time, ""
    size = np.diff(np.r_[first, len(time)])
    step = np.diff(time[first])
    usual = float(np.median(size))
    if usual < 2.0 or not (step > 0.0).all():
        return time, ""
    if len(first) >= LEAST_STEPS * len(time) and not _is_ahead(position, int(usual)):
        return time, ""
    tick, group = float(np.median(step)), np.repeat(np.arange(len(first)), size)
    behind = (np.arange(len(time)) - first[group]) / np.maximum(usual, size[group])
    note = f"clock: steps of {num(usual)} records, which are spread evenly over them"
    return time + tick * behind, note


def _is_ahead(position: Array, count: int) -> bool:
    """Whether so many records lead straight ahead: machines or parts side by side lead to and fro."""
    driven = np.hypot(*np.diff(position, axis=0).T)
    way = np.convolve(driven, np.ones(count), "valid")
    ahead = np.hypot(*(position[count:] - position[:-count]).T)
    moved = way > 0.0
    return bool(moved.any()) and float(np.median(ahead[moved] / way[moved])) > LEAST_AHEAD


def usable(time: Array) -> tuple[Array | None, str]:
    """A clock whose missing times lie between those of their rows, None for one that is none; and a note."""
    known = np.isfinite(time)
    count = len(time)
    if known.sum() < LEAST_SHARE * count:
        return None, f"clock: not used: {num(count - int(known.sum()))} of {num(count)} rows hold no time"
    different = len(np.unique(time[known]))
    if different < LEAST_STEPS * count:
        return None, f"clock: not used: {num(different)} different times in {num(count)} rows"
    if known.all():
        return time, ""
    row = np.arange(count, dtype=float)
    note = f"clock: {num(count - int(known.sum()))} rows without a time: taken between their neighbours"
    return np.asarray(np.interp(row, row[known], time[known])), note
