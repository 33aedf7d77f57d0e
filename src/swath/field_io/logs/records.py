"""From columns to records in driven order: which machine, when, how long, how fast."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import percent_of
from swath.field_io.logs.columns import ColumnMap
from swath.field_io.logs.table import Table

Array = NDArray[np.float64]
TOP_SPEED = 15.0  # m/s, of a machine
TOO_FAST = 3.0  # times the usual pace from one record to the next: not driven
PAUSE = 5.0  # s between two records, longer: the machine does something else
PAUSES = 2.5  # usual steps of a log with few records, that are a pause
NEXT = 6  # records ahead among which one of the same machine follows, whichever others are between
NEAR = 25.0  # m, to it
LEAST_FOLLOWED = 0.5  # of the records of a log in driving order
MOST_APART = 0.5  # of their distance in an order drawn by chance


def declared_machines(
    table: Table, found: ColumnMap, rows: Any = slice(None)
) -> tuple[tuple[str, ...], NDArray[np.int64], list[str]]:
    """Names of the machines in some rows, the index of that of each row, (n,), and what was assumed."""
    one = ("1",), np.zeros(len(table.row_number[rows]), dtype=np.int64)
    if "machine" not in found.columns:
        return *one, []
    texts = np.array(table.texts(found.columns["machine"].column))[rows]
    names, machine = np.unique(texts, return_inverse=True)
    if len(names) > 50:
        return *one, [f"unused: {found.columns['machine'].column}: {len(names)} machine names"]
    shown = tuple("".join(c if c.isprintable() else "?" for c in str(n)[:60]) for n in names)
    return shown, machine.astype(np.int64), []


def time_of(
    values: dict[str, Array], found: ColumnMap, machine: NDArray[np.int64], order: NDArray[np.int64]
) -> tuple[Array, str]:
    """Time of each record [s], in file order."""
    if "time" in found.columns:
        return values["time"] - values["time"].min(), ""
    step = np.nan_to_num(values["duration"], nan=1.0)
    sorted_time = np.cumsum(step[order])
    first = np.r_[True, np.diff(machine[order]) != 0]
    start = np.maximum.accumulate(np.where(first, sorted_time, 0.0))
    time = np.empty(len(order))
    time[order] = sorted_time - start
    is_known, key = np.isfinite(values["duration"]).any(), "clock"
    if "grain_flow" in found.columns and "speed" not in found.columns:
        key = "timeline"  # the yield rests on it
    note = "" if is_known else f"{key}: no time: records taken as 1 s apart"
    return time, note or "clock: none: time counts from the first record of each machine"


def longest_step(time: Array, machine: NDArray[np.int64]) -> float:
    """Time [s] from a record to the next one; longer is a pause."""
    step = np.diff(time)[np.diff(machine) == 0]
    return max(PAUSE, PAUSES * float(np.median(step[step > 0.0]))) if (step > 0.0).any() else PAUSE


def duration_of(time: Array, machine: NDArray[np.int64], logged: Array) -> tuple[float, Array]:
    """Nominal period of the log and time since the record before [s]; after a pause one period.

    Logs round their clock (to 1e-5 days = 0.864 s in some), so steps below 1.8 periods count as one.
    """
    step, pause = np.diff(time, prepend=time[:1]), longest_step(time, machine)
    usual = step[(step > 0.0) & (step < 0.5 * pause)]
    period = float(usual.mean()) if len(usual) else 1.0
    period = 1.0 if abs(period - 1.0) < 0.08 else period
    if np.isfinite(logged).mean() > 0.5:
        return period, np.clip(np.nan_to_num(logged, nan=period), 0.05, pause)
    one = (step < 1.8 * period) | (step > pause) | (np.diff(machine, prepend=-1) != 0)
    return period, np.maximum(np.where(one, period, step), period)


def unrounded(time: Array, machine: NDArray[np.int64], period: float) -> Array:
    """Times [s] of a clock whose rounding does not go with its period (1e-5 days), made even within stretches
    without a pause; another clock as it is.
    """
    step = np.diff(time)
    usual = step[(step > 0.0) & (step < 1.8 * period)]
    if not len(usual):
        return time
    ticks, ratio = usual / usual.min(), period / usual.min()
    if (np.abs(ticks - np.rint(ticks)) > 0.02).mean() > 0.02 or abs(ratio - np.rint(ratio)) < 0.05:
        return time
    stretch = np.cumsum(np.r_[True, (step >= 1.8 * period) | (np.diff(machine) != 0)]) - 1
    late = time - period * np.arange(len(time))
    mean = np.bincount(stretch, late) / np.bincount(stretch)
    return np.asarray(period * np.arange(len(time)) + mean[stretch])


def speed_of(
    values: dict[str, Array],
    found: ColumnMap,
    time: Array,
    duration: Array,
    machine: NDArray[np.int64],
    east: Array,
    north: Array,
) -> Array:
    """Ground speed [m/s]: logged, else distance over time, else from the positions before and after."""
    if "speed" in found.columns:
        return values["speed"]
    step = np.hypot(np.diff(east), np.diff(north))
    pace = step / duration[1:]
    goes_on = (
        (np.diff(machine) == 0)
        & (np.diff(time) <= longest_step(time, machine))
        & (pace <= TOO_FAST * np.median(pace))
    )
    driven, took = np.where(goes_on, step, 0.0), np.where(goes_on, duration[1:], 0.0)
    driven, took = np.r_[0.0, driven] + np.r_[driven, 0.0], np.r_[0.0, took] + np.r_[took, 0.0]
    speed = driven / np.where(took > 0.0, took, 1.0)
    if "distance" in found.columns:
        logged = values["distance"] / duration
        speed = np.where(np.isfinite(logged), logged, speed)
    return np.asarray(np.clip(speed, 0.0, TOP_SPEED))


def check_order(time: Array, machine: NDArray[np.int64], east: Array, north: Array) -> None:
    """Raise InputError where the records in the order of their times are no track of any machine."""
    order = np.lexsort((time, machine))
    nearest = _next_of(east[order], north[order])
    by_chance = np.random.default_rng(1).permutation(len(order))
    chance = float(np.median(_next_of(east[by_chance], north[by_chance])))
    followed = float((nearest < min(NEAR, MOST_APART * chance)).mean())
    if followed < LEAST_FOLLOWED:
        raise InputError(
            "timeline",
            f"{percent_of(1 - followed)} of the records are far from those that follow",
            "expected records in driving order; --as map makes stand and yield of them, without passes",
        )


def _next_of(x: Array, y: Array) -> Array:
    """Distance [m] from each place to the nearest of the NEXT ones behind it."""
    nearest = np.full(len(x) - NEXT, np.inf)
    for ahead in range(1, NEXT + 1):
        step = np.hypot(x[ahead:] - x[:-ahead], y[ahead:] - y[:-ahead])
        nearest = np.minimum(nearest, step[: len(nearest)])
    return nearest
