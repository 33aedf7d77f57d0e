"""A recorded day of one machine: its passes and stops as given, the rest predicted from its first hour.

    python -m benchmarks.recorded_day LOG

Passes are stretches with the header in the crop (`field_io.clean`). What lies between two is a turn or a way,
but for stops: records below 0.3 m/s and gaps of more than 10 s. From the hours before the prediction
come three numbers: speed in the crop, speed between passes, and how much longer than the planned path
(shortest, by steering rate and radius) the way between two passes is driven: out of the crop, over the
headland, back in.

Turns can be predicted from a log whose records go on through them, at least SEEN in most; many logs stop with
the header up, or hold one or two records there: then `unseen` says so, and time between passes is nan.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.control.turns import clothoid, limits_of
from swath.control.turns.dubins import Place
from swath.control.turns.limits import TurnLimits
from swath.core.errors import InputError
from swath.field_io.clean import Cleaned, clean
from swath.field_io.importer import find_log
from swath.field_io.logs.log import Log, read_log
from swath.machine.machine_sheet import dynamics_of, load_machine
from swath.terminal.tables import table, wide_console

Array = NDArray[np.float64]
STANDING = 0.3  # m/s
LONG_GAP = 10.0  # s between two records
NIGHT = 3.0 * 3600.0  # s: a longer pause ends the day
COURSE = 4  # records over which the course at the end of a pass is taken
SEEN = 4  # records between two passes, without which a turn has no shape
FASTEST = 15.0  # m/s, faster than any machine on a field
TURN_SPEED = 2.0  # m/s at which turns are steered: measured ones take 16.4 s for 31.6 m
JUMPS = 0.01  # share of records to which it jumps, above which they are of two machines


@dataclass(frozen=True)
class Between:
    """From one pass to the next: begin [s], way driven and planned [m], time [s] without stops, stop [s].

    hidden: turned over pauses of the record [rad]
    records: between the passes
    """

    begin: float
    way: float
    planned: float
    time: float
    stop: float
    hidden: float = 0.0
    records: int = 0

    @property
    def is_seen(self) -> bool:
        """Whether the log has it, and its turn."""
        return self.records >= SEEN and self.hidden < 0.25 * math.pi


@dataclass(frozen=True)
class Day:
    """passes as lines (n, 2) [m] in the log's system; begin [s], time [s] without stops, length [m] of each.

    stop: within passes [s]
    total: first to last record [s]
    width: of the header [m].
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

    @property
    def unseen(self) -> str:
        """Why time between passes cannot be predicted from this log, "" where it can."""
        seen = [b for b in self.between if b.is_seen]
        if 2 * len(seen) >= len(self.between):
            return ""
        count = f"{len(seen)} of {len(self.between)} ways between passes"
        return f"{count} hold {SEEN} records and the turn: the log does not go on in turns"


@dataclass(frozen=True)
class Prediction:
    """What the first `known` seconds say of the rest [s], beside what was recorded [s].

    speed [m/s] in the crop, turn_speed between passes; longer: driven over planned way there; all between
    passes, and the total, nan where the log does not show turns
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
    first = _first_day(read_log(find_log(log)), machine)
    check_one_machine(first)
    cleaned = clean(first, 0.0)
    found = np.unique(cleaned.pass_id[cleaned.pass_id >= 0])
    if len(found) < 3:
        raise InputError(
            "log", None, f"expected at least three passes in a day, {len(found)} found", file=log
        )
    return _day(cleaned, found, limits)


def check_one_machine(log: Log) -> None:
    """InputError for records between which no machine can have driven."""
    way, dt = np.hypot(*np.diff(log.position, axis=0).T), np.diff(log.time)
    jumps = (way > FASTEST * np.maximum(dt, 1e-3)) & (way > FASTEST)
    if jumps.any() and jumps.mean() > JUMPS:
        many = f"{jumps.sum()} times, by {way[jumps].max():.0f} m"
        raise InputError("log", None, f"expected records of one machine, places jump {many}")


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


def _day(cleaned: Cleaned, found: NDArray[np.int64], limits: TurnLimits) -> Day:
    log = cleaned.log
    time, point = log.time - log.time[0], log.position
    dt = np.diff(time)
    way = np.hypot(*np.diff(point, axis=0).T)
    stands = (way < STANDING * dt) | (dt > LONG_GAP)
    spans = [np.flatnonzero(cleaned.pass_id == i)[[0, -1]].tolist() for i in found.tolist()]
    lines, begin, used, length, stop = [], [], [], [], 0.0
    for a, b in spans:
        lines.append(point[a : b + 1])
        begin.append(time[a])
        used.append(dt[a:b][~stands[a:b]].sum())
        length.append(way[a:b].sum())
        stop += float(dt[a:b][stands[a:b]].sum())
    pauses = np.flatnonzero(dt > LONG_GAP)
    turned = np.array([_turned(point, i) for i in pauses.tolist()])
    between = []
    for (_, a), (b, _) in pairwise(spans):
        moves = ~stands[a:b]
        there = _pose(point, a - COURSE, a, a), _pose(point, b, b + COURSE, b)
        planned = math.fsum(p.length for p in clothoid.plan(*there, limits))
        between.append(
            Between(
                float(time[a]), float(way[a:b].sum()), planned, float(dt[a:b][moves].sum()),
                float(dt[a:b][~moves].sum()), float(turned[(pauses >= a) & (pauses < b)].sum()), b - a - 1,
            )
        )  # fmt: skip
    width = float(np.percentile(log.width, 95))
    return Day(
        tuple(lines), np.array(begin), np.array(used), np.array(length), tuple(between), stop,
        float(time[-1]), width,
    )  # fmt: skip


def _turned(point: Array, i: int) -> float:
    """Angle between the courses before a record and after the next one [rad]."""
    before, after = _pose(point, i - COURSE, i, i), _pose(point, i + 1, i + 1 + COURSE, i + 1)
    return abs(math.remainder(after.heading - before.heading, 2.0 * math.pi))


def _pose(point: Array, a: int, b: int, at: int) -> Place:
    (x, y), (u, v) = point[max(a, 0)].tolist(), point[min(b, len(point) - 1)].tolist()
    px, py = point[at].tolist()
    return Place(px, py, math.atan2(v - y, u - x))


def predict(day: Day, known: float) -> Prediction:
    """The rest of a day from its first `known` seconds. InputError where these hold no pass or no turn."""
    first = day.begin < known
    shown = day.between if not day.unseen else ()
    turns = [b for b in shown if b.begin < known]
    rest = [b for b in shown if b.begin >= known]
    if not first.any() or first.all() or (shown and not (turns and rest)):
        raise InputError("known", known, "expected passes and turns before and behind it")
    speed = float(day.length[first].sum() / day.time[first].sum())
    driven, planned = math.fsum(b.way for b in turns), math.fsum(b.planned for b in turns)
    turn_speed = driven / math.fsum(b.time for b in turns) if turns else math.nan
    longer = driven / planned if turns else math.nan
    cutting = float(day.length[~first].sum()) / speed
    turning = longer * math.fsum(b.planned for b in rest) / turn_speed
    before = float(day.time[first].sum()) + math.fsum(b.time for b in day.between if b not in rest)
    recorded = float(day.time[~first].sum()), math.fsum(b.time for b in rest) if rest else math.nan
    return Prediction(
        speed, turn_speed, longer, cutting, recorded[0], turning, recorded[1],
        total=before + cutting + turning + day.stops, total_recorded=day.total,
    )  # fmt: skip


def main(given: Sequence[str] | None = None) -> None:
    """See above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path, help="yield log (CSV, shapefile, ISOXML)")
    parser.add_argument("--known-h", type=float, default=1.0, help="hours that are known (1)")
    parser.add_argument("--machine", default="lexion-700", help="data sheet: steering, wheelbase")
    parser.add_argument("--radius-m", type=float, default=6.4, help="of its turns [m] (6.4)")
    parser.add_argument("--number", type=int, default=0, help="machine of the log, from 0 (0)")
    args = parser.parse_args(given)
    sheet = load_machine(args.machine)
    limits = limits_of(sheet.wheelbase, args.radius_m, dynamics_of(sheet).steer_rate, TURN_SPEED)
    day = read_day(args.log, limits, args.number)
    made = predict(day, 3600.0 * args.known_h)
    rows = [
        _row("cutting, of the rest", made.cutting, made.cutting_recorded),
        _row("between passes, of the rest", made.turning, made.turning_recorded),
        _row("in all, with the recorded stops", made.total, made.total_recorded),
    ]
    table(f"{args.log.name}: {len(day.lines)} passes", ("", "predicted h", "recorded h", "off %"), rows)
    known = [
        ("speed in the crop", f"{made.speed:.2f} m/s"),
        ("speed between passes", "-" if day.unseen else f"{made.turn_speed:.2f} m/s"),
        ("driven over planned way there", "-" if day.unseen else f"{made.longer:.3f}"),
        ("stops in all", f"{day.stops / 3600.0:.2f} h"),
    ]
    table(f"from the first {args.known_h:g} h", ("", ""), known)
    if day.unseen:
        wide_console().print(f"note: time between passes is not predicted: {day.unseen}", markup=False)


def _row(name: str, found: float, recorded: float) -> tuple[str, str, str, str]:
    if math.isnan(found):
        return name, "-", "-", "-"
    off = 100.0 * (found / recorded - 1.0) if recorded > 0.0 else math.nan
    return name, f"{found / 3600.0:.2f}", f"{recorded / 3600.0:.2f}", f"{off:+.1f}"


if __name__ == "__main__":
    main()
