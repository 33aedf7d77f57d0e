"""A recorded day of one machine: its passes and stops as given, the rest predicted from its first hour.

Passes are stretches with the header in the crop (`field_io.clean`). What lies between two is a turn or a way,
but for stops: records below 0.3 m/s and gaps of more than 10 s. From the hours before the prediction
come three numbers: speed in the crop, speed between passes, and how much longer than the planned path
(shortest, by steering rate and radius) the way between two passes is driven: out of the crop, over the
headland, back in.
"""

import math
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field_io.clean import Cleaned, clean
from swath.field_io.importer import find_log
from swath.field_io.log import Log, read_log
from swath.job.path import Pose
from swath.job.plan import FieldPlan, PlannedPass, shapely_here, with_ground
from swath.job.turns import TurnLimits, clothoid

Array = NDArray[np.float64]
STANDING = 0.3  # m/s
LONG_GAP = 10.0  # s between two records
NIGHT = 3.0 * 3600.0  # s: a longer pause ends the day
COURSE = 4  # records over which the course at the end of a pass is taken
SIMPLE = 0.2  # m, within which a recorded line is kept


@dataclass(frozen=True)
class Between:
    """From one pass to the next: begin [s], way driven and planned [m], time [s] without stops, stop [s]."""

    begin: float
    way: float
    planned: float
    time: float
    stop: float


@dataclass(frozen=True)
class Day:
    """passes as lines (n, 2) [m] in the log's system; begin [s], time [s] without stops, length [m] of each;
    stop: within passes [s]; total: first to last record [s]; width: of the header [m].
    """

    lines: tuple[Array, ...]
    begin: Array
    time: Array
    length: Array
    between: tuple[Between, ...]
    stop: float
    total: float
    width: float

    @property
    def stops(self) -> float:
        """All recorded stops [s]."""
        return self.stop + math.fsum(b.stop for b in self.between)


@dataclass(frozen=True)
class Prediction:
    """What the first `known` seconds say of the rest [s], beside what was recorded [s].

    speed [m/s] in the crop, turn_speed between passes; longer: driven over planned way there
    """

    speed: float
    turn_speed: float
    longer: float
    cutting: float
    cutting_recorded: float
    turning: float
    turning_recorded: float
    total: float
    total_recorded: float


def read_day(log: Path, limits: TurnLimits, machine: int = 0) -> Day:
    """The first day of a log. InputError where it has fewer than three passes."""
    cleaned = clean(_first_day(read_log(find_log(log)), machine))
    rows = np.arange(len(cleaned.log))
    found = np.unique(cleaned.pass_id[rows])
    found = found[found >= 0]
    if len(found) < 3:
        raise InputError(
            "log", None, f"expected at least three passes in a day, {len(found)} found", file=log
        )
    return _day(cleaned, rows, found, limits)


def _first_day(log: Log, machine: int) -> Log:
    """The records of a machine until its first night."""
    rows = np.flatnonzero(log.machine == machine)
    if not len(rows):
        expected = f"expected 0 to {len(log.machine_names) - 1}, the machines of the log"
        raise InputError("--number", machine, expected)
    nights = np.flatnonzero(np.diff(log.time[rows]) > NIGHT)
    rows = rows[: int(nights[0]) + 1] if len(nights) else rows
    part = {f.name: getattr(log, f.name) for f in fields(log)}
    part = {k: v[rows] for k, v in part.items() if isinstance(v, np.ndarray)}
    return replace(log, **part)


def _day(cleaned: Cleaned, rows: NDArray[np.int64], found: NDArray[np.int64], limits: TurnLimits) -> Day:
    log = cleaned.log
    time, point = log.time[rows] - log.time[rows[0]], log.position[rows]
    dt = np.diff(time)
    way = np.hypot(*np.diff(point, axis=0).T)
    stands = (way < STANDING * dt) | (dt > LONG_GAP)
    number = cleaned.pass_id[rows]
    spans = [np.flatnonzero(number == i)[[0, -1]].tolist() for i in found.tolist()]
    lines, begin, used, length, stop = [], [], [], [], 0.0
    for a, b in spans:
        lines.append(point[a : b + 1])
        begin.append(time[a])
        used.append(dt[a:b][~stands[a:b]].sum())
        length.append(way[a:b].sum())
        stop += float(dt[a:b][stands[a:b]].sum())
    between = []
    for (_, a), (b, _) in pairwise(spans):
        moves = ~stands[a:b]
        there = _pose(point, a - COURSE, a, a), _pose(point, b, b + COURSE, b)
        planned = math.fsum(p.length for p in clothoid.plan(*there, limits))
        between.append(
            Between(
                float(time[a]), float(way[a:b].sum()), planned, float(dt[a:b][moves].sum()),
                float(dt[a:b][~moves].sum()),
            )
        )  # fmt: skip
    width = float(np.percentile(log.width[rows], 95))
    return Day(
        tuple(lines), np.array(begin), np.array(used), np.array(length), tuple(between), stop,
        float(time[-1]), width,
    )  # fmt: skip


def _pose(point: Array, a: int, b: int, at: int) -> Pose:
    (x, y), (u, v) = point[max(a, 0)].tolist(), point[min(b, len(point) - 1)].tolist()
    px, py = point[at].tolist()
    return Pose(px, py, math.atan2(v - y, u - x))


def predict(day: Day, known: float) -> Prediction:
    """The rest of a day from its first `known` seconds. InputError where these hold no pass or no turn."""
    first = day.begin < known
    turns = [b for b in day.between if b.begin < known]
    rest = [b for b in day.between if b.begin >= known]
    if not first.any() or not turns or not rest:
        raise InputError("known", known, "expected passes and turns before and behind it")
    speed = float(day.length[first].sum() / day.time[first].sum())
    driven, planned = math.fsum(b.way for b in turns), math.fsum(b.planned for b in turns)
    turn_speed = driven / math.fsum(b.time for b in turns)
    longer = driven / planned
    cutting = float(day.length[~first].sum()) / speed
    turning = longer * math.fsum(b.planned for b in rest) / turn_speed
    cut_before = float(day.time[first].sum())
    turned_before = math.fsum(b.time for b in turns)
    recorded = float(day.time[~first].sum()), math.fsum(b.time for b in rest)
    return Prediction(
        speed, turn_speed, longer, cutting, recorded[0], turning, recorded[1],
        total=cut_before + turned_before + cutting + turning + day.stops, total_recorded=day.total,
    )  # fmt: skip


def recorded_plan(day: Day, pipe: float) -> FieldPlan:
    """The passes of a day as a plan, in local metres from their south-west corner."""
    shapely = shapely_here()
    corner = np.floor(np.min([line.min(axis=0) for line in day.lines], axis=0))
    lines = [np.asarray(shapely.LineString(line - corner).simplify(SIMPLE).coords) for line in day.lines]
    strips = [shapely.LineString(line).buffer(0.5 * day.width, cap_style="flat") for line in lines]
    ground = shapely.union_all(strips).buffer(day.width, join_style="mitre").buffer(-day.width)
    ground = max(getattr(ground, "geoms", [ground]), key=lambda g: g.area)
    ring = np.asarray(ground.exterior.coords)[:-1]
    passes = with_ground([PlannedPass(line) for line in lines], ring, day.width, pipe=pipe)
    passes = tuple(p for p in passes if p.area > 0.02 * day.width * p.length)
    return FieldPlan(ring, passes, day.width, 0.0, math.fsum(p.area for p in passes))
