"""Compares steering and motion of a machine with a log, and fits them to it, with intervals by bootstrap.

Least squares on what the levels `actuator` and `single_track` make of the log. Each resample of the passes
takes one step of Gauss and Newton from the solution; the interval of a value is Student's t at passes - 1
times the standard deviation over resamples, widened by sqrt(passes / (passes - 1)) for the few of them (Efron
and Tibshirani 1993, An Introduction to the Bootstrap, 5.3), and by what the numbers that are held may be off.
Of each of those is asked whether the log contradicts it (a score test). A value that the log does not show is
left as it was, and the others are fitted again.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from math import atan2, cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import Extra, InputError, near_miss
from swath.core.number_text import num
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG, rounded, split_unit
from swath.documents.data_sheets import Sheet
from swath.field_io.logs.steer_log import SteerLog, read_steer_log
from swath.judge.evaluator import rms
from swath.machine.machine_sheet import MachineSheet, open_machine, read_machine
from swath.scenario.slots import REGISTRY
from swath.signals import F64, I64, Mask, SpeedCommand, SteerCommand, SteerState
from swath.tools.compare_log.no_field import site_of

SETTLE = 3.0  # s: a stretch starts with wheels straight and tyres without slip, as the machine did not
WINDOW = 10.0  # s: positions are compared over such times, place and heading at their start left free
COARSEST = 0.05  # s between the steps of the motion
FINEST = 0.025  # s between the parts of a command that goes in a straight line from record to record


@dataclass(frozen=True)
class PathAlong:
    """Where the machine went on level ground: yaw_rate [rad/s], x, y of its fixed axle [m], yaw [rad]."""

    yaw_rate: F64
    x: F64
    y: F64
    yaw: F64


def run_steering(machine: MachineSheet, log: SteerLog, *, lines: bool = False) -> F64:
    """Angle of the steered axle [rad] at every record, shape (n,), by the level `actuator`.

    A command holds from its record to the next one, or goes there in a straight line (`lines`).
    """
    level = REGISTRY.get("steering", "actuator")
    steering = level.component(level.params(), site_of(machine, 0.01))
    clock = np.round(log.time * NS).astype(np.int64).tolist()
    command, starts = log.command.tolist(), log.starts.tolist()
    count = max(2, round(log.period / FINEST)) if lines else 1
    angle = np.empty(len(log))
    for i, begins in enumerate(starts):
        if begins:
            steering.reset(Stream(0, "log"))
            zero, before, angle[i] = clock[i], 0, 0.0
            continue
        t, change = clock[i] - zero, command[i] - command[i - 1] if lines else 0.0
        edges = [before + (t - before) * k // count for k in range(count + 1)]
        for k, (a, b) in enumerate(pairwise(edges)):
            given = SteerCommand(a, command[i - 1] + (k + 0.5) / count * change, True)
            angle[i] = steering.step(a, b - a, {"command": given})["steering"].angle
        before = t
    return angle


def run_motion(machine: MachineSheet, log: SteerLog, angle: F64) -> PathAlong:
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


def windows(log: SteerLog) -> I64:
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


def off_the_track(path: PathAlong, log: SteerLog, window: I64, antenna: Any) -> F64:
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


def _rows_of(window: I64) -> list[I64]:
    order = np.argsort(window, kind="stable")
    order = order[window[order] >= 0]
    return np.split(order, np.flatnonzero(np.diff(window[order])) + 1) if len(order) else []


FEWEST_BLOCKS = 6
RESAMPLES = 400
CONFIDENCE = 0.95
LEAST_EFFECT = 1e-6  # of a value on all of the log: below, the log does not show it
UNSEEN = 0.25  # of its range: a standard error beyond that says that the log does not show the value
ON_LIMIT = 0.1  # steps of the derivative: a value so near a limit lies on it
HALVINGS = 6  # of what lies between the sheet's number and one that the log bounds on that side only
RELAXATION = "tyres.front_relaxation_m", "tyres.rear_relaxation_m"
OFFSET = "angle offset"  # of the logged angle, in deg: what the sensor shows driving straight


@dataclass(frozen=True)
class Free:
    """A number that may be fitted: limits and step for its derivative in the unit of the sheet.

    known: standard error of a sheet's number where the log does not tell it, estimated
    along: keys of the sheet that go in proportion with it
    default: where the sheet has none
    absent: the limit, +1 the upper or -1 the lower one, that means that the machine has no such effect
    """

    low: float
    high: float
    step: float
    known: float
    along: tuple[str, ...] = ()
    default: float | None = None
    absent: int = 0


STEERING = {
    "steering.dead_time_s": Free(0.0, 2.0, 0.01, 0.03),
    "steering.lag_s": Free(0.01, 3.0, 0.01, 0.05),
    "steering.rate_deg_s": Free(1.0, 100.0, 0.3, 4.0, absent=1),
    "steering.dead_band_percent": Free(0.0, 30.0, 0.2, 2.0),
}
MOTION = {
    "tyres.understeer_deg_per_g": Free(-8.0, 8.0, 0.1, 2.0, default=0.0),
    RELAXATION[0]: Free(0.05, 5.0, 0.05, 0.3, along=RELAXATION[1:], absent=-1),
    "tyres.stiffness_per_rad": Free(0.5, 10.0, 0.1, 1.0, absent=1),  # so stiff allows an understeer of 8
    "chassis.wheelbase_m": Free(0.5, 20.0, 0.02, 0.1),
}
USUAL = {
    "steering": ("steering.dead_time_s", "steering.lag_s", "steering.rate_deg_s"),
    "motion": ("tyres.understeer_deg_per_g", "tyres.front_relaxation_m"),
}


@dataclass(frozen=True)
class FittedWith:
    """A fitted number.

    low, high: of its 95 % interval, without a limit on a side that the log does not bound
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
    notes: which numbers lie on a limit, are bounded on one side, or hang on others that were not fitted
    measured, before, after: series in that unit, shape (n,), nan where nothing is compared
    """

    name: str
    quantity: str
    unit: str
    fitted: tuple[FittedWith, ...]
    block_count: int
    rmse: tuple[float, float, float]
    notes: tuple[str, ...]
    measured: F64
    before: F64
    after: F64


def fit_steering(
    sheet: Sheet, log: SteerLog, keys: Sequence[str], adds: bool = False
) -> tuple[Sheet, PartFit]:
    """Dead time, lag and rate of the steering by commands and angles of a log.

    adds: a number of the sheet that is not among the keys is fitted, too, where the log contradicts it
    """
    counts = settled(log)

    def fitted(lines: bool) -> tuple[Sheet, PartFit]:
        def series(machine: MachineSheet, offset: float) -> F64:
            return run_steering(machine, log, lines=lines) / DEG + offset

        part = _Part("steering", "steering angle", "deg", log, counts, log.angle / DEG, series)
        late = 0.0 if lines else 0.5 * log.period
        return part.fit(sheet, STEERING, keys, adds, ("steering.dead_time_s", starts), late)

    starts = [0.05, 0.15, 0.3, 0.6] if "steering.dead_time_s" in keys else []
    goes_on = np.count_nonzero(np.diff(log.command)) > 0.5 * len(log)
    return min([fitted(lines) for lines in (False, True)[: 1 + goes_on]], key=lambda made: made[1].rmse[1])


def fit_motion(
    sheet: Sheet,
    log: SteerLog,
    keys: Sequence[str],
    on: str,
    antenna: tuple[float, float],
    adds: bool = False,
) -> tuple[Sheet, PartFit]:
    """Understeer and relaxation of the tyres by angles and yaw rates, or positions (`on` = place)."""
    if on == "yaw_rate":

        def rates(machine: MachineSheet, offset: float) -> F64:
            return run_motion(machine, log, log.angle - offset * DEG).yaw_rate / DEG

        counts = settled(log) & np.isfinite(log.yaw_rate)
        part = _Part("motion", "yaw rate", "deg/s", log, counts, log.yaw_rate / DEG, rates)
    else:
        window = windows(log)

        def errors(machine: MachineSheet, offset: float) -> F64:
            path = run_motion(machine, log, log.angle - offset * DEG)
            return 100.0 * off_the_track(path, log, window, antenna)

        zero = np.zeros((len(log), 2))
        part = _Part("motion", "position", "cm", log, window >= 0, zero, errors)
    return part.fit(sheet, MOTION, keys, adds)


class _Part:
    """What is fitted: a series of the model against the measured one, (n,) or (n, 2)."""

    def __init__(
        self, name: str, quantity: str, unit: str, log: SteerLog, counts: Mask, measured: F64,
        series: Callable[[MachineSheet, float], F64],
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
        self, sheet: Sheet, table: dict[str, Free], asked: Sequence[str], adds: bool,
        first: tuple[str, list[float]] = ("", []), late: float = 0.0,
    ) -> tuple[Sheet, PartFit]:  # fmt: skip
        """Least squares over the asked keys and the offset.

        A key that the log does not show goes back to the sheet, and the others are fitted again. A key held
        at the sheet that the log contradicts is fitted, too (`adds`), or widens the intervals of the others.

        first: key whose start is searched, and where; late: by how much its value may come out short
        """
        names = [*table, OFFSET]
        start = np.array([*(_number(sheet, k, f) for k, f in table.items()), 0.0])
        low, high = np.array([*(_limits(sheet, k, f) for k, f in table.items()), (-5.0, 5.0)]).T
        low, high = np.minimum(low, start), np.maximum(high, start)
        step, known = np.array([*((f.step, f.known) for f in table.values()), (0.02, 0.0)]).T

        def residual(values: F64) -> F64:
            made = self._series(read_machine(_changed(sheet, table, values)), float(values[-1]))
            return np.asarray((made - self._measured)[self._counts].reshape(-1))

        absent = np.array([*(f.absent for f in table.values()), 0])
        search = _Search(residual, low, high, step)
        free = np.array([k in asked for k in names[:-1]] + [True])
        at = np.where(free, start.clip(low, high), start)
        for value in first[1]:
            tried = np.where([k == first[0] for k in names], value, at)
            at = min(at, tried, key=lambda v: float((residual(v) ** 2).sum()))
        notes: list[str] = []
        gone, beyond = np.zeros((2, len(names)), bool)
        while True:
            at = search.solved(at, free)
            look = self._look(search, at, free, known)
            against = np.where(free | gone | beyond, 0.0, look.evidence) > 0.0
            if adds and against.any():
                free[np.argmax(against * look.evidence)] = True
                continue
            flat = free & ((search.on_limit(at) & (at != 0.0)) | (look.alone >= UNSEEN * (high - low)))
            weak = flat | (free & (look.error >= UNSEEN * (high - low)))
            weak[-1] = False
            bounds = self._bounds(search, at, look, start, beyond)
            for k in np.flatnonzero(free & (absent != 0) & ~weak).tolist():
                side = int(absent[k])
                if self._may_be_absent(search, at, k, side):
                    bounds[int(side > 0), k] = side * np.inf
                    inner, end = bounds[int(side < 0), k], (search.low if side > 0 else search.high)[k]
                    flat[k] = weak[k] = side * inner <= side * end
            if not weak.any():
                break
            i = int(np.argmax(np.where(weak, look.error / (high - low), -1.0)))
            free[i] = False
            held = search.solved(np.where(np.arange(len(at)) == i, start, at), free)
            if (
                flat[i]
                and absent[i] * (at[i] - start[i]) > 0.0
                and self._is_worse(residual(held), residual(at))
            ):
                beyond[i] = True
            else:
                if search.on_limit(at)[i]:
                    notes.append(f"{names[i]}: the search ended on its limit, {num(at[i])}: left as it was")
                gone[i], at = True, held
        kept = free | beyond
        limited = np.flatnonzero(kept & (search.on_limit(at) | np.isinf(bounds).any(axis=0)))
        notes += [_limit_note(names[i], at[i], bounds[:, i]) for i in limited]
        if against.any():
            every = free | against
            other = search.solved(at, every)
            more = self._bounds(search, other, self._look(search, other, every, known), start, beyond)
            bounds = np.array([np.minimum(bounds[0], more[0]), np.maximum(bounds[1], more[1])])
            notes += [
                f"{names[i]}: the log says {num(other[i])} and not {num(start[i])}, which was held; "
                "the intervals of the others hold both" for i in np.flatnonzero(against)
            ]  # fmt: skip
        notes += [
            f"{names[i]}: fitted, too, as the log contradicts {num(start[i])}"
            for i in np.flatnonzero(free) if names[i] not in (*asked, OFFSET)
        ]  # fmt: skip
        bounds[1] += np.where([k == first[0] for k in names], late, 0.0)
        bounds = np.where(kept, bounds, [[-np.inf], [np.inf]])
        shown = [i for i, k in enumerate(names) if kept[i] or k in asked]
        rows = [
            FittedWith(
                names[i], rounded(start[i], 5), rounded(at[i], 5), rounded(bounds[0, i], 5),
                rounded(bounds[1, i], 5), _unit(names[i]), bool(kept[i]),
            )
            for i in shown
        ]  # fmt: skip
        best = _changed(sheet, {k: table[k] for i, k in enumerate(table) if kept[i]}, at[:-1][kept[:-1]])
        at_start, left = residual(start), residual(at)
        series = [self._shown(r) for r in (np.zeros_like(left), at_start, left)]
        rmse = rms(at_start), rms(left), rms(look.predicted)
        return best, PartFit(
            self.name, self._quantity, self._unit, tuple(rows), self._count, rmse, tuple(notes), *series
        )  # fmt: skip

    def _look(self, search: "_Search", at: F64, free: Mask, known: F64) -> "_Look":
        """How well the log tells each value, and whether it contradicts those that are held.

        What is held is off by `known`, or by what its test would miss; that moves the fitted values.
        """
        residuals, inside = search.residual(at), free & ~search.on_limit(at)
        jacobian = search.jacobian(at, np.ones_like(free))
        spread = np.full(len(at), np.inf)
        spread[inside], _, predicted = self._bootstrap(jacobian[:, inside], residuals)
        square, evidence = np.where(inside, spread**2, 0.0), np.zeros(len(at))
        for i in np.flatnonzero(~inside):
            which = inside.copy()
            which[i] = True
            one = int(np.count_nonzero(which[:i]))
            errors, moved, _ = self._bootstrap(jacobian[:, which], residuals)
            error = spread[i] = errors[one]
            square[i] = error**2
            if np.isfinite(error) and abs(moved[one]) > self._wide * error:
                evidence[i] = (residuals**2).sum() - ((residuals + jacobian[:, which] @ moved) ** 2).sum()
            if np.isfinite(error):
                shift = np.linalg.lstsq(jacobian[:, inside], jacobian[:, i], rcond=None)[0]
                square[inside] += (min(known[i], self._wide * error) * shift) ** 2
        return _Look(spread, np.sqrt(square), evidence, predicted)

    def _may_be_absent(self, search: "_Search", at: F64, i: int, side: int) -> bool:
        """Whether the log is as likely without an effect, at the limit on that side, all else free."""
        without, others = at.copy(), np.ones(len(at), bool)
        without[i], others[i] = (search.high if side > 0 else search.low)[i], False
        left = search.residual(search.solved(without, others))
        return not self._is_worse(left, search.residual(at))

    @property
    def _wide(self) -> float:
        return float(_scipy()[1].ppf(0.5 + 0.5 * CONFIDENCE, self._count - 1))

    def _is_worse(self, left: F64, than: F64) -> bool:
        """Whether squares of one fit exceed those of another, by Student's t over the passes."""
        more = np.bincount(self._block, left**2 - than**2)
        return float(more.mean()) > self._wide * float(more.std(ddof=1)) / sqrt(self._count)

    def _bounds(self, search: "_Search", at: F64, look: "_Look", start: F64, beyond: Mask) -> F64:
        """Ends of the intervals, shape (2, n); of a value `beyond`: where the log begins to bound it."""
        bounds = np.array([at - self._wide * look.error, at + self._wide * look.error])
        bounds[0] = np.where(search.low == 0.0, np.maximum(bounds[0], 0.0), bounds[0])
        for i in np.flatnonzero(beyond):
            best, bad, good = search.residual(at), start[i], at[i]
            for _ in range(HALVINGS):
                tried = at.copy()
                tried[i] = 0.5 * (bad + good)
                worse = self._is_worse(search.residual(tried), best)
                bad, good = (tried[i], good) if worse else (bad, tried[i])
            bounds[:, i] = (bad, np.inf) if at[i] > start[i] else (-np.inf, bad)
        return bounds

    def _bootstrap(self, jacobian: F64, residuals: F64) -> tuple[F64, F64, F64]:
        """Standard deviation of each value over blocks, its step, residuals of each block by the others."""
        width = jacobian.shape[1]
        square, slope = np.zeros((self._count, width, width)), np.zeros((self._count, width))
        rows = [np.flatnonzero(self._block == b) for b in range(self._count)]
        for b, r in enumerate(rows):
            square[b], slope[b] = jacobian[r].T @ jacobian[r], jacobian[r].T @ residuals[r]
        scale = np.sqrt(np.maximum(np.diagonal(square.sum(axis=0)), LEAST_EFFECT**2))
        ridge = 1e-9 * np.diag(scale**2)

        def move(weight: F64) -> F64:
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
        # resamples do not move along what no pass tells: there the classical error of least squares counts
        classical = np.mean(residuals**2) * np.diagonal(np.linalg.inv(square.sum(axis=0) + ridge))
        error = np.sqrt(np.maximum((moved.std(axis=0) * few) ** 2, classical))
        error = np.where(scale > LEAST_EFFECT, error, np.inf)
        return error, move(np.ones(self._count)), predicted

    def _shown(self, residuals: F64) -> F64:
        """Measured plus residual as a series of the log, of positions the distance; nan where none counts."""
        made = np.full(len(self._counts), np.nan)
        if self._measured.ndim == 1:
            made[self._counts] = self._measured[self._counts] + residuals
        else:
            made[self._counts] = np.hypot(*residuals.reshape(-1, 2).T)
        return made


@dataclass(frozen=True)
class _Look:
    """What the log says of each value, shape (n,).

    alone, error: standard errors, without and with that of what is held; evidence: squares that a value that
    is held would explain, 0 where that may be chance (Student's t of its step)
    predicted: residuals of each block by the others
    """

    alone: F64
    error: F64
    evidence: F64
    predicted: F64


@dataclass(frozen=True)
class _Search:
    """Least squares within limits, over some of the values; steps of the derivative are those of `Free`.

    The model is smooth on that scale only.
    """

    residual: Callable[[F64], F64]
    low: F64
    high: F64
    step: F64

    def on_limit(self, at: F64) -> Mask:
        near = ON_LIMIT * self.step
        return np.asarray((at <= self.low + near) | (at >= self.high - near))

    def solved(self, at: F64, free: Mask) -> F64:
        """The values with the best of the free ones; one on a limit lies there exactly."""

        def whole(part: F64) -> F64:
            made = at.copy()
            made[free] = part
            return made

        least_squares, _ = _scipy()
        found = whole(least_squares(
            lambda v: self.residual(whole(v)), at[free], jac=lambda v: self.jacobian(whole(v), free),
            bounds=(self.low[free], self.high[free]), x_scale=self.step[free], xtol=1e-5, ftol=1e-7,
            max_nfev=30, method="dogbox",
        ).x)  # fmt: skip
        ends = np.where(2.0 * found < self.low + self.high, self.low, self.high)
        return np.where(free & self.on_limit(found), ends, found)

    def jacobian(self, at: F64, which: Mask) -> F64:
        """Central differences, one-sided at a limit."""
        columns = []
        for i in np.flatnonzero(which):
            up, down = at.copy(), at.copy()
            up[i] = min(at[i] + self.step[i], self.high[i])
            down[i] = max(at[i] - self.step[i], self.low[i])
            columns.append((self.residual(up) - self.residual(down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)


def _limit_note(key: str, value: float, bounds: F64) -> str:
    if np.isfinite(bounds).all():
        return f"{key}: on its limit of {num(value)}; the log says at most {num(bounds[1])}"
    side, bound = ("most", bounds[1]) if np.isfinite(bounds[1]) else ("least", bounds[0])
    return f"{key}: the log says only that it is at {side} {num(bound)}; {num(value)} was taken"


def _number(sheet: Sheet, key: str, free: Free) -> float:
    try:
        return sheet.number(key)
    except InputError:
        if free.default is None:
            raise
        return free.default


def _limits(sheet: Sheet, key: str, free: Free) -> tuple[float, float]:
    """Limits of a value within which the keys that go along keep theirs, too."""
    along = [sheet.number(k) / sheet.number(key) for k in free.along]
    return free.low / min([1.0, *along]), free.high / max([1.0, *along])


def _changed(sheet: Sheet, free: dict[str, Free], values: F64) -> Sheet:
    """The sheet with the values of the free keys; keys that go along keep their proportion."""
    numbers: dict[str, float] = {}
    for (key, f), value in zip(free.items(), values[: len(free)].tolist(), strict=True):
        along = {k: value * (sheet.number(k) / sheet.number(key)) for k in f.along}
        numbers |= {key: value, **along}
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
        series = ("notes", "measured", "before", "after")
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
        sheet, part = fit_steering(sheet, read, asked["steering"], adds=not fit)
        parts.append(part)
        if read.period > 0.03:
            late = num(500.0 * read.period)
            notes.append(
                f"commands are logged every {num(1e3 * read.period)} ms: steps in between make the dead time "
                f"come out up to {late} ms too short, which the interval of held commands holds"
            )
    elif asked["steering"]:
        notes.append("the log has no commands: dead time, lag and rate of the steering are as they were")
    quantity = on or next(iter(read.measured[1:]), None)
    if quantity is not None and asked["motion"]:
        progress("fitting the motion")
        sheet, part = fit_motion(sheet, read, asked["motion"], quantity, antenna, adds=not fit)
        parts.append(part)
    elif asked["motion"]:
        notes.append("the log has no yaw rate and no positions: the motion is as it was")
    if not parts:
        raise InputError("fit", ", ".join(fit), "expected numbers that this log determines")
    notes += [n for p in parts for n in p.notes]
    notes += [
        f"{f.key}: this log does not show it, left as it was"
        for p in parts
        for f in p.fitted
        if not f.is_seen and not any(n.startswith(f"{f.key}:") for n in p.notes)
    ]
    return SteeringComparison(
        str(sheet.value("name")), Path(log).name, read, tuple(parts), tuple(notes), sheet
    )
