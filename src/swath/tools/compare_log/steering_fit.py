"""Compares steering and motion of a machine with a log, and fits them to it, with intervals by bootstrap.

Least squares on what the levels `actuator` and `single_track` make of the log. Each resample of the passes
takes one step of Gauss and Newton from the solution; the interval of a value is Student's t at passes - 1
times the standard deviation over resamples, widened by sqrt(passes / (passes - 1)) for the few of them (Efron
and Tibshirani 1993, An Introduction to the Bootstrap, 5.3). A value that the log does not show is left
as it was.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from math import atan2, cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError
from swath.core.number_text import num
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG, rounded, split_unit
from swath.documents.data_sheets import Sheet
from swath.documents.validation import near_miss
from swath.field_io.logs.steer_log import SteerLog, read_steer_log
from swath.judge.evaluator import rms
from swath.machine.machine_sheet import MachineSheet, open_machine, read_machine
from swath.scenario.slots import REGISTRY
from swath.signals import SpeedCommand, SteerCommand, SteerState
from swath.tools.compare_log.no_field import site_of

Array = NDArray[np.float64]

Mask = NDArray[np.bool_]
SETTLE = 3.0  # s: a stretch starts with wheels straight and tyres without slip, as the machine did not
WINDOW = 10.0  # s: positions are compared over such times, place and heading at their start left free
COARSEST = 0.05  # s between the steps of the motion


@dataclass(frozen=True)
class PathAlong:
    """Where the machine went on level ground: yaw_rate [rad/s], x, y of its fixed axle [m], yaw [rad]."""

    yaw_rate: Array
    x: Array
    y: Array
    yaw: Array


def run_steering(machine: MachineSheet, log: SteerLog) -> Array:
    """Angle of the steered axle [rad] at every record, shape (n,), by the level `actuator`.

    A command holds from its record to the next one.
    """
    level = REGISTRY.get("steering", "actuator")
    steering = level.component(level.params(), site_of(machine, 0.01))
    clock = np.round(log.time * NS).astype(np.int64).tolist()
    command, starts = log.command.tolist(), log.starts.tolist()
    angle = np.empty(len(log))
    for i, begins in enumerate(starts):
        if begins:
            steering.reset(Stream(0, "log"))
            zero, before, angle[i] = clock[i], 0, 0.0
        else:
            t, given = clock[i] - zero, SteerCommand(before, command[i - 1], True)
            angle[i] = steering.step(before, t - before, {"command": given})["steering"].angle
            before = t
    return angle


def run_motion(machine: MachineSheet, log: SteerLog, angle: Array) -> PathAlong:
    """What the level `single_track` makes of a steering angle [rad], shape (n,), at the logged speed.

    Between records angle and speed go in straight lines.
    """
    level = REGISTRY.get("motion", "single_track")
    prompt = replace(machine.dynamics, speed_lag=0.01, accel=10.0, decel=10.0, max_speed=30.0)
    alone = replace(machine, dynamics=prompt, trailer=None, hitch=None)
    motion: Any = None
    clock, starts = np.round(log.time * NS).astype(np.int64).tolist(), log.starts.tolist()
    angles, speeds = angle.tolist(), log.speed.tolist()
    rows = np.zeros((len(log), 4))
    for i, begins in enumerate(starts):
        if begins:
            params = level.params(start_speed_kmh=3.6 * min(max(speeds[i], 0.0), 11.0))
            motion = level.component(params, site_of(alone, 0.01))
            state, zero, t = motion.reset(Stream(0, "log"))["state"], clock[i], 0
        else:
            end = clock[i] - zero
            count = max(1, round((end - t) / NS / COARSEST))
            edges = [t + (end - t) * k // count for k in range(count + 1)]
            for k, (a, b) in enumerate(pairwise(edges)):
                middle, last = (k + 0.5) / count, (k + 1) / count
                wheel = angles[i - 1] + middle * (angles[i] - angles[i - 1])
                speed = speeds[i - 1] + last * (speeds[i] - speeds[i - 1])
                given = {"steering": SteerState(a, wheel, 0.0), "speed": SpeedCommand(a, speed)}
                state = motion.step(a, b - a, given)["state"]
            t = end
        x, y, _ = state.pose.position
        rows[i] = state.yaw_rate, x, y, state.pose.euler()[2]
    return PathAlong(*rows.T)


def settled(log: SteerLog) -> Mask:
    """Records that count, shape (n,): SETTLE and more behind the start of their stretch."""
    start = np.maximum.accumulate(np.where(log.starts, log.time, -np.inf))
    return np.asarray(log.time - start >= SETTLE)


def windows(log: SteerLog) -> NDArray[np.int64]:
    """Number of the window over which positions are compared, shape (n,), -1 = not compared.

    Windows lie within one stretch and one block.
    """
    counts = settled(log) & np.isfinite(log.place).all(axis=1)
    first = np.r_[True, log.starts[1:] | (log.block[1:] != log.block[:-1])]
    start = np.maximum.accumulate(np.where(first, log.time, -np.inf))
    key = np.stack([np.cumsum(first), (log.time - start) // WINDOW], axis=1)[counts]
    number = np.full(len(log), -1, np.int64)
    if len(key):
        _, inverse, size = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        inverse = inverse.reshape(-1)
        number[counts] = np.where(size[inverse] >= 10, inverse, -1)
    return number


def off_the_track(path: PathAlong, log: SteerLog, window: NDArray[np.int64], antenna: Any) -> Array:
    """Simulated minus measured position of the antenna [m] in each window, shape (n, 2); 0 outside of them.

    Each window is moved and turned onto what was measured, by least squares (Umeyama 1991,
    doi:10.1109/34.88573, in the plane, without scale): neither place nor heading is known at its start.
    antenna: ahead of the fixed axle and leftward of it [m].
    """
    ahead, left = antenna
    c, s = np.cos(path.yaw), np.sin(path.yaw)
    made = np.stack([path.x + ahead * c - left * s, path.y + ahead * s + left * c], axis=1)
    error = np.zeros((len(log), 2))
    for rows in _rows_of(window):
        p, q = made[rows], log.place[rows]
        p, middle = p - p.mean(axis=0), q.mean(axis=0)
        q = q - middle
        turn = atan2(float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()), float((p * q).sum()))
        rotation = np.array([[cos(turn), -sin(turn)], [sin(turn), cos(turn)]])
        error[rows] = p @ rotation.T - q
    return error


def _rows_of(window: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    order = np.argsort(window, kind="stable")
    order = order[window[order] >= 0]
    return np.split(order, np.flatnonzero(np.diff(window[order])) + 1) if len(order) else []


FEWEST_BLOCKS = 6
RESAMPLES = 400
CONFIDENCE = 0.95
LEAST_EFFECT = 1e-6  # of a value on all of the log: below, the log does not show it
UNSEEN = 0.25  # of its range: a standard error beyond that says that the log does not show the value
ON_LIMIT = 0.1  # steps of the derivative: a value so near a limit lies on it
RELAXATION = "tyres.front_relaxation_m", "tyres.rear_relaxation_m"
OFFSET = "angle offset"  # of the logged angle, in deg: what the sensor shows driving straight


@dataclass(frozen=True)
class Free:
    """A number that may be fitted: limits and step for its derivative in the unit of the sheet.

    keys: of the sheet that go in proportion with it, itself first
    default: where the sheet has none
    is_open: its limits are those of the sheet, no values: a fit that ends on one says that the log shows none
    """

    low: float
    high: float
    step: float
    keys: tuple[str, ...]
    default: float | None = None
    is_open: bool = False


def _free(key: str, low: float, high: float, step: float, default: float | None = None) -> tuple[str, Free]:
    return key, Free(low, high, step, (key,), default)


STEERING = dict([
    _free("steering.dead_time_s", 0.0, 2.0, 0.01),
    _free("steering.lag_s", 0.01, 3.0, 0.01),
    _free("steering.rate_deg_s", 1.0, 100.0, 0.3),
    _free("steering.dead_band_percent", 0.0, 30.0, 0.2),
])  # fmt: skip
MOTION = dict([
    _free("tyres.understeer_deg_per_g", -8.0, 8.0, 0.1, default=0.0),
    (RELAXATION[0], Free(0.05, 5.0, 0.05, RELAXATION, is_open=True)),
    _free("tyres.stiffness_per_rad", 0.5, 20.0, 0.1),
    _free("chassis.wheelbase_m", 0.5, 20.0, 0.02),
])  # fmt: skip
USUAL = {
    "steering": ("steering.dead_time_s", "steering.lag_s", "steering.rate_deg_s"),
    "motion": ("tyres.understeer_deg_per_g", "tyres.front_relaxation_m"),
}


@dataclass(frozen=True)
class FittedWith:
    """A fitted number.

    low, high: of its 95 % interval
    is_seen: False where the log does not show it, the value is then the start and the interval without limits
    """

    key: str
    start: float
    value: float
    low: float
    high: float
    unit: str
    is_seen: bool = True


@dataclass(frozen=True)
class PartFit:
    """One part, fitted. quantity: what it was fitted to, unit: of it; block_count: passes, or parts of them.

    rmse: of the machine as it was, as fitted, and predicted: each pass by the numbers fitted on the others
    measured, before, after: series in that unit, shape (n,), nan where nothing is compared
    """

    name: str
    quantity: str
    unit: str
    fitted: tuple[FittedWith, ...]
    block_count: int
    rmse: tuple[float, float, float]
    measured: Array
    before: Array
    after: Array


def fit_steering(sheet: Sheet, log: SteerLog, keys: Sequence[str]) -> tuple[Sheet, PartFit]:
    """Dead time, lag and rate of the steering by commands and angles of a log."""
    counts = settled(log)

    def series(machine: MachineSheet, offset: float) -> Array:
        return run_steering(machine, log) / DEG + offset

    part = _Part("steering", "steering angle", "deg", log, counts, log.angle / DEG, series)
    starts = [0.05, 0.15, 0.3, 0.6] if "steering.dead_time_s" in keys else []
    return part.fit(sheet, {k: STEERING[k] for k in keys}, ("steering.dead_time_s", starts))


def fit_motion(
    sheet: Sheet, log: SteerLog, keys: Sequence[str], on: str, antenna: tuple[float, float]
) -> tuple[Sheet, PartFit]:
    """Understeer and relaxation of the tyres by angles and yaw rates, or positions (`on` = place)."""
    free = {k: MOTION[k] for k in keys}
    if on == "yaw_rate":

        def rates(machine: MachineSheet, offset: float) -> Array:
            return run_motion(machine, log, log.angle - offset * DEG).yaw_rate / DEG

        counts = settled(log) & np.isfinite(log.yaw_rate)
        part = _Part("motion", "yaw rate", "deg/s", log, counts, log.yaw_rate / DEG, rates)
    else:
        window = windows(log)

        def errors(machine: MachineSheet, offset: float) -> Array:
            path = run_motion(machine, log, log.angle - offset * DEG)
            return 100.0 * off_the_track(path, log, window, antenna)

        zero = np.zeros((len(log), 2))
        part = _Part("motion", "position", "cm", log, window >= 0, zero, errors)
    return part.fit(sheet, free, ("", []))


class _Part:
    """What is fitted: a series of the model against the measured one, (n,) or (n, 2)."""

    def __init__(
        self, name: str, quantity: str, unit: str, log: SteerLog, counts: NDArray[np.bool_], measured: Array,
        series: Callable[[MachineSheet, float], Array],
    ) -> None:  # fmt: skip
        self.name, self._quantity, self._unit = name, quantity, unit
        self._measured, self._series, self._counts = measured, series, counts
        wide = measured[0].size
        _, block = np.unique(log.block[counts], return_inverse=True)
        self._block = np.repeat(block, wide)
        self._count = int(block.max()) + 1 if len(block) else 0
        if self._count < FEWEST_BLOCKS:
            expected = f"expected at least {FEWEST_BLOCKS} passes, or two minutes, with a {quantity}"
            raise InputError("log", self._count, expected)

    def fit(
        self, sheet: Sheet, free: dict[str, Free], first: tuple[str, list[float]]
    ) -> tuple[Sheet, PartFit]:
        """Least squares over the keys and the offset. first: key whose start is searched, and where."""
        least_squares, student = _scipy()
        start = np.array([*(_number(sheet, k, f) for k, f in free.items()), 0.0])
        low, high = np.array([*(_limits(sheet, f) for f in free.values()), (-5.0, 5.0)]).T
        step = np.array([*(f.step for f in free.values()), 0.02])

        def residual(values: Array) -> Array:
            made = self._series(read_machine(_changed(sheet, free, values)), float(values[-1]))
            return np.asarray((made - self._measured)[self._counts].reshape(-1))

        began = start.clip(low, high)
        for value in first[1]:
            tried = np.where([k == first[0] for k in (*free, OFFSET)], value, start).clip(low, high)
            began = min(began, tried, key=lambda v: float((residual(v) ** 2).sum()))
        at_start = residual(start)
        # steps of the derivative are those of `Free`: the model is smooth on that scale only
        found = least_squares(
            residual, began, jac=lambda v: _jacobian(residual, v, step, low, high), bounds=(low, high),
            x_scale=step, xtol=1e-5, ftol=1e-7, max_nfev=30,
        ).x  # fmt: skip
        residuals, jacobian = residual(found), _jacobian(residual, found, step, low, high)
        error, predicted = self._bootstrap(jacobian, residuals)
        seen = error < UNSEEN * (high - low)
        is_open = np.array([*(f.is_open for f in free.values()), False])
        seen &= ~is_open | ((found > low + ON_LIMIT * step) & (found < high - ON_LIMIT * step))
        wide = float(student.ppf(0.5 + 0.5 * CONFIDENCE, self._count - 1)) * error
        values = np.where(seen, found, start)
        best = _changed(sheet, free, values)
        names = [*free, OFFSET]
        limits = np.where(seen, wide, np.inf)
        rows = [
            FittedWith(
                key, rounded(start[i], 5), rounded(values[i], 5), rounded(values[i] - limits[i], 5),
                rounded(values[i] + limits[i], 5), _unit(key), bool(seen[i]),
            )
            for i, key in enumerate(names)
        ]  # fmt: skip
        rmse = rms(at_start), rms(residuals), rms(predicted)
        shown = [self._shown(r) for r in (at_start, residuals)]
        real = self._shown(np.zeros_like(residuals))
        return best, PartFit(
            self.name, self._quantity, self._unit, tuple(rows), self._count, rmse, real, *shown
        )  # fmt: skip

    def _bootstrap(self, jacobian: Array, residuals: Array) -> tuple[Array, Array]:
        """Standard deviation of each value over resampled blocks; residuals of each block by the others."""
        width = jacobian.shape[1]
        square, slope = np.zeros((self._count, width, width)), np.zeros((self._count, width))
        rows = [np.flatnonzero(self._block == b) for b in range(self._count)]
        for b, r in enumerate(rows):
            square[b], slope[b] = jacobian[r].T @ jacobian[r], jacobian[r].T @ residuals[r]
        scale = np.sqrt(np.maximum(np.diagonal(square.sum(axis=0)), LEAST_EFFECT**2))
        ridge = 1e-9 * np.diag(scale**2)

        def move(weight: Array) -> Array:
            left = np.tensordot(weight, square, 1) + ridge
            return np.asarray(-np.linalg.solve(left, np.tensordot(weight, slope, 1)))

        stream = Stream(0, f"bootstrap {self.name}")
        picked = stream.at().integers(0, self._count, (RESAMPLES, self._count))
        moved = np.array([move(np.bincount(p, minlength=self._count).astype(float)) for p in picked])
        few = sqrt(self._count / (self._count - 1))
        predicted = residuals.copy()
        for b, r in enumerate(rows):
            others = np.ones(self._count)
            others[b] = 0.0
            predicted[r] += jacobian[r] @ move(others)
        error = np.where(scale > LEAST_EFFECT, moved.std(axis=0) * few, np.inf)
        return error, predicted

    def _shown(self, residuals: Array) -> Array:
        """Measured plus residual as a series of the log, of positions the distance; nan where none counts."""
        made = np.full(len(self._counts), np.nan)
        if self._measured.ndim == 1:
            made[self._counts] = self._measured[self._counts] + residuals
        else:
            made[self._counts] = np.hypot(*residuals.reshape(-1, 2).T)
        return made


def _jacobian(residual: Callable[[Array], Array], at: Array, step: Array, low: Array, high: Array) -> Array:
    """Central differences, one-sided at a limit."""
    columns = []
    for i in range(len(at)):
        up, down = at.copy(), at.copy()
        up[i], down[i] = min(at[i] + step[i], high[i]), max(at[i] - step[i], low[i])
        columns.append((residual(up) - residual(down)) / (up[i] - down[i]))
    return np.stack(columns, axis=1)


def _number(sheet: Sheet, key: str, free: Free) -> float:
    try:
        return sheet.number(key)
    except InputError:
        if free.default is None:
            raise
        return free.default


def _limits(sheet: Sheet, free: Free) -> tuple[float, float]:
    """Limits of a value within which the keys that go along keep theirs, too."""
    along = [sheet.number(k) / sheet.number(free.keys[0]) for k in free.keys[1:]]
    return free.low / min([1.0, *along]), free.high / max([1.0, *along])


def _changed(sheet: Sheet, free: dict[str, Free], values: Array) -> Sheet:
    """The sheet with the values of the free keys; keys that go along keep their proportion."""
    numbers: dict[str, float] = {}
    for (key, f), value in zip(free.items(), values[: len(free)].tolist(), strict=True):
        for k in f.keys:
            numbers[k] = value * (1.0 if k == key else sheet.number(k) / sheet.number(key))
    return sheet.changed(numbers, new=[k for k, f in free.items() if f.default is not None])


def _unit(key: str) -> str:
    return "deg" if key == OFFSET else split_unit(key)[1]


def _scipy() -> tuple[Any, Any]:
    with Extra("geo", "fitting a model"):
        from scipy.optimize import least_squares
        from scipy.stats import t
    return least_squares, t


@dataclass(frozen=True)
class SteeringComparison:
    """The result. parts: steering, motion, as far as the log shows them; sheet: with the fitted numbers."""

    model: str
    log_name: str
    log: SteerLog
    parts: tuple[PartFit, ...]
    notes: tuple[str, ...]
    sheet: Sheet

    def to_dict(self) -> dict[str, Any]:
        """All but the series, for JSON."""
        series = ("measured", "before", "after")
        parts = {p.name: {k: v for k, v in asdict(p).items() if k not in series} for p in self.parts}
        return {"model": self.model, "log": self.log_name, "parts": parts, "notes": list(self.notes),
                **self.log.column_map.summary()}  # fmt: skip


def compare_steering(
    model: str,
    log: Path,
    *,
    fit: Sequence[str] = (),
    on: str | None = None,
    antenna: tuple[float, float] = (0.0, 0.0),
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> SteeringComparison:
    """Fit a machine's steering to commands and angles, its motion to angles and yaw rates or positions.

    model: name or path of a machine's data sheet; fit: keys of it, instead of the usual ones
    on: `yaw_rate` or `place`, what the motion is fitted to; None = yaw rates where the log has them
    antenna: of the positions, ahead of the fixed axle and leftward [m]. Raises InputError.
    """
    sheet = open_machine(model)
    machine = read_machine(sheet)
    read = read_steer_log(log, columns, wheelbase=machine.wheelbase)
    for key in fit:
        if key not in {**STEERING, **MOTION}:
            known = (*STEERING, *MOTION)
            raise InputError("fit", key, f"expected one of {', '.join(known)}{near_miss(key, known)}")
    if on is not None and on not in read.measured:
        raise InputError("on", on, f"expected one that the log has: {', '.join(read.measured[1:]) or 'none'}")
    asked = {
        name: [k for k in free if k in fit] if fit else list(USUAL[name])
        for name, free in (("steering", STEERING), ("motion", MOTION))
    }
    parts, notes = [], list(read.notes)
    if read.has_command and asked["steering"]:
        progress("fitting the steering")
        sheet, part = fit_steering(sheet, read, asked["steering"])
        parts.append(part)
        if read.period > 0.03:
            late = num(500.0 * read.period)
            notes.append(
                f"commands are logged every {num(1e3 * read.period)} ms and taken to hold until the next: "
                f"where they change in between, the dead time comes out up to {late} ms too long or short"
            )
    elif asked["steering"]:
        notes.append("the log has no commands: dead time, lag and rate of the steering are as they were")
    quantity = on or next(iter(read.measured[1:]), None)
    if quantity is not None and asked["motion"]:
        progress("fitting the motion")
        sheet, part = fit_motion(sheet, read, asked["motion"], quantity, antenna)
        parts.append(part)
    elif asked["motion"]:
        notes.append("the log has no yaw rate and no positions: the motion is as it was")
    if not parts:
        raise InputError("fit", ", ".join(fit), "expected numbers that this log determines")
    notes += [
        f"{f.key}: this log does not show it, left as it was"
        for p in parts
        for f in p.fitted
        if not f.is_seen
    ]
    return SteeringComparison(
        str(sheet.value("name")), Path(log).name, read, tuple(parts), tuple(notes), sheet
    )
