"""Two combines in echelon: who goes first where their ways meet.

Both ways are sampled in steps of time as if nothing stopped them. Of all pairs of samples, those are no place
to be at which outlines come near each other, or at which the one behind is nearer than it should be. The
shortest way from both begins to both ends around them, in steps of one, the other, or both, says on which
side each of them is passed. A combine then goes on once the other one is past all that it lets go first. Such
an order cannot come to a standstill: the way that was found stays open (see O'Donnell and Lozano-Perez 1989,
doi:10.1109/ROBOT.1989.100033, on the coordination of two paths).
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.control.job.abreast import BEFORE, SAME_WAY, begins_ahead, leader_of
from swath.control.job.passes import Pass, Route, route_of, way_along
from swath.control.job.right_of_way import LIMITS
from swath.core.errors import InputError
from swath.core.units import KMH
from swath.job.fleet import FleetFile
from swath.job.machines import Combine
from swath.job.plan import FieldPlan, shapely_here
from swath.signals import F64

RUN_UP = 4.0  # m before its first pass, where a combine starts
LEAST_LAG = 22.0  # m: the tractor beside the second one stays behind the first where that stands
BEHIND = 12.0  # m, that the second one begins behind the first
APART = 1.0  # m between the outlines of two combines, at least
STEP = 1.0  # s
TOGETHER = 12  # samples
NEVER = 1_000_000  # steps
MOST = 3000  # samples of a way; more of them are farther apart
Mask = NDArray[np.bool_]


class Member(NamedTuple):
    """A combine in echelon. start: how far before its first pass it begins [m]; job: its settings"""

    start: float
    job: dict[str, Any]


class Samples(NamedTuple):
    """Of a way. task: number of the pass; way: along it and the turn behind it [m]; place: x, y, heading"""

    task: NDArray[np.int64]
    way: F64
    place: F64


def assigned(plan: FieldPlan, count: int) -> list[int]:
    """Number of the combine that cuts each pass: those that are driven side by side in turn, the left one by
    the first.
    """
    made: list[int] = []
    for i, p in enumerate(plan.passes):
        turned = (
            math.remainder(p.start.heading - plan.passes[i - 1].end.heading, 2.0 * math.pi) if i else math.pi
        )
        follows = i > 0 and made[-1] + 1 < count and abs(turned) < SAME_WAY
        made.append(made[-1] + 1 if follows else 0)
    return made


def members(passes: Sequence[Pass], combines: Sequence[Combine], file: FleetFile) -> list[Member]:
    """Start and settings of each of the combines. InputError for what this level cannot do."""
    _check(passes, combines, file)
    lag = file.team.lag_m
    behind = RUN_UP + BEHIND - begins_ahead(passes[0], passes[1])
    starts = [RUN_UP, max(behind, RUN_UP)]
    rules = rules_of(passes, combines, lag, starts)
    settings = zip(starts, run_outs(2), rules, strict=True)
    return [
        Member(start, {"number": i, "lag_m": lag, "run_out_m": out, "gives_way": own})
        for i, (start, out, own) in enumerate(settings)
    ]


def _check(passes: Sequence[Pass], combines: Sequence[Combine], file: FleetFile) -> None:
    if file.team.together != "echelon":
        told = "expected echelon with two combines at the level with sensors"
        raise InputError("team.together", file.team.together, told)
    if len({c.sheet.name for c in combines}) > 1:
        raise InputError("combines", None, "expected machines of one kind at the level with sensors")
    if file.team.lag_m < LEAST_LAG:
        told = f"expected {LEAST_LAG:g} at least at the level with sensors"
        raise InputError("team.lag_m", file.team.lag_m, told)
    if len(passes) < 2 or passes[1].combine != 1:
        told = "expected an even number of opening rounds, and a first pass for each combine"
        raise InputError("plan", None, told)


def run_outs(count: int) -> list[float]:
    """How far each combine drives on behind its last pass [m]: who is ahead leaves room to the next one."""
    return [20.0 * (count - number) for number in range(count)]


def rules_of(
    passes: Sequence[Pass], combines: Sequence[Combine], lag: float, starts: Sequence[float]
) -> list[list[dict[str, float]]]:
    """`gives_way` of each of two combines. lag: of the second [m]; starts: how far before its first pass each
    begins [m]. InputError where there is no such order.
    """
    outs = run_outs(2)
    whole = [_routes(passes, i, combines[i], outs[i]) for i in range(2)]
    step = STEP * max(1.0, *(_time(w, passes, c) / MOST for w, c in zip(whole, combines, strict=True)))
    first, second = (_samples(whole[i], passes, combines[i], starts[i], step) for i in range(2))
    near = _near(first, second, combines)
    late = _late(first, second, passes, lag)
    found = _order(near | late)
    if found is None:
        told = "expected passes on which two combines in echelon keep clear of each other"
        raise InputError("team.together", "echelon", told)
    after = np.arange(near.shape[1])[None, :]
    low, high = found
    goes_first = near & ~late & (after > high[:, None])  # samples of the second that wait for the first
    goes_second = near & (after < low[:, None])
    reached = np.searchsorted(high, np.arange(near.shape[1]))  # of the first, when the second comes there
    return [_rules(goes_second.T, low, second, first), _rules(goes_first, reached, first, second)]


def _routes(passes: Sequence[Pass], number: int, combine: Combine, run_out: float) -> dict[int, Route]:
    own = [i for i, work in enumerate(passes) if work.combine == number]
    mine, sheet = [passes[i] for i in own], combine.sheet
    return {i: route_of(mine, k, sheet.knife_x, LIMITS, sheet.header_y, run_out) for k, i in enumerate(own)}


def _time(routes: dict[int, Route], passes: Sequence[Pass], combine: Combine) -> float:
    """Of the whole way [s]."""
    return sum(
        r.length / (passes[i].speed_kmh * KMH) + r.turn / combine.turn_speed for i, r in routes.items()
    )


def _samples(
    routes: dict[int, Route], passes: Sequence[Pass], combine: Combine, start: float, step: float
) -> Samples:
    rows = []
    way, last = -start, max(routes)
    for i, route in routes.items():
        end = route.length + (route.turn if i != last else way_along(route.points) - route.length - 1.0)
        while way < end:
            x, y = route.line.point(way)
            rows.append((i, way, x, y, route.line.heading(way)))
            way += step * (passes[i].speed_kmh * KMH if way < route.length else combine.turn_speed)
        way -= end
    table = np.array(rows)
    return Samples(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:])


def _near(first: Samples, second: Samples, combines: Sequence[Combine]) -> Mask:
    """Which pairs of samples are nearer than APART."""
    shapely = shapely_here()
    bodies = [_bodies(s.place, c, shapely) for s, c in zip((first, second), combines, strict=True)]
    reach = 2.0 * max(float(np.abs(np.array(c.sheet.outline)).max()) for c in combines) * 1.5 + APART
    near = np.zeros((len(first.way), len(second.way)), dtype=bool)
    for i, (x, y, _) in enumerate(first.place.tolist()):
        close = np.flatnonzero(np.hypot(second.place[:, 0] - x, second.place[:, 1] - y) < reach)
        if len(close):
            near[i, close] = shapely.distance(bodies[0][i], bodies[1][close]) < APART
    return near


def _bodies(place: F64, combine: Combine, shapely: Any) -> Any:
    """Chassis and header at each place."""
    made = []
    for x, y, heading in place.tolist():
        c, s = np.cos(heading), np.sin(heading)
        boxes = [shapely.box(rear, right, front, left) for rear, front, right, left in combine.sheet.outline]
        made.append(shapely.affinity.affine_transform(shapely.union_all(boxes), [c, -s, s, c, x, y]))
    return np.array(made, dtype=object)


def _late(first: Samples, second: Samples, passes: Sequence[Pass], lag: float) -> Mask:
    """Which pairs of samples leave the second nearer behind the first than the lag."""
    late = np.zeros((len(first.way), len(second.way)), dtype=bool)
    for j, (task, way) in enumerate(zip(second.task.tolist(), second.way.tolist(), strict=True)):
        lead = leader_of(passes, task)
        if lead is None or way <= -BEFORE:
            continue
        length = way_along(passes[lead].line_m)
        until = min(way + lag - begins_ahead(passes[lead], passes[task]), length)
        late[:, j] = (first.task < lead) | ((first.task == lead) & (first.way < until))
    return late


def _order(blocked: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """The shortest way through, on which both drive whenever they can: least and greatest sample of the
    second at each of the first; None where there is none.
    """
    rows, columns = blocked.shape
    left = _steps_left(blocked)
    if left[0, 0] >= NEVER:
        return None
    low, high = np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=np.int64)
    here = (0, 0)
    while here != (rows - 1, columns - 1):
        i, j = here
        here = min(((i + 1, j + 1), (i + 1, j), (i, j + 1)), key=lambda to: left[to])
        if here[0] > i:
            low[here[0]] = here[1]
        high[here[0]] = here[1]
    return low, high


def _steps_left(blocked: Mask) -> NDArray[np.int32]:
    """Steps from every pair of samples to the last one, with a row and a column of NEVER beyond that."""
    rows, columns = blocked.shape
    left = np.full((rows + 1, columns + 1), NEVER, dtype=np.int32)
    at = np.arange(columns, dtype=np.int32)
    for i in range(rows - 1, -1, -1):
        best = np.minimum(left[i + 1, :-1], left[i + 1, 1:]) + 1
        if i == rows - 1:
            best[-1] = 0
        ends = np.flatnonzero(np.diff(np.concatenate([[True], blocked[i], [True]]).astype(np.int8)))
        for first, end in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
            free = slice(first, end)  # along it the second drives alone
            reached = np.minimum.accumulate((best[free] + at[free])[::-1])[::-1] - at[free]
            left[i, free] = np.minimum(reached, NEVER)
    return left


def _rules(before: Mask, reached: NDArray[np.int64], other: Samples, own: Samples) -> list[dict[str, float]]:
    """Of a machine that waits. before: rows of the other one, columns of its own: what the other one is past
    first; reached: row of the other one on the way through, when the own one comes to a column

    Where the way through allows it a rule says at once what the next TOGETHER samples want.
    """
    rows, columns = before.shape
    least = np.where(before.any(axis=0), rows - 1 - before[::-1].argmax(axis=0), -1)
    rules, met = [], -1
    for j in range(columns):
        if least[j] <= met:
            continue
        soon = least[j : j + TOGETHER]
        met = int(soon[soon < reached[j]].max())
        k, past = max(j - 1, 0), min(met + 1, rows - 1)
        rules.append(
            {
                "task": int(own.task[k]), "way_m": round(float(own.way[k]), 3),
                "other": int(other.task[past]), "other_m": round(float(other.way[past]), 3),
            }
        )  # fmt: skip
    return rules
