"""Two combines in echelon: which passes each cuts, where it begins, and how far it stays behind."""

import math
from collections.abc import Sequence

import numpy as np

from swath.control.job.abreast import BEFORE, SAME_WAY, begins_ahead, leader_of
from swath.control.job.passes import Pass, way_along
from swath.core.errors import InputError
from swath.job.fleet import FleetFile
from swath.job.machines import Combine
from swath.job.plan import FieldPlan
from swath.tools.fleet.order import NO_ORDER, RUN_UP, Mask, Meeting, Member, Samples, crossings_of, ways_of

LEAST_LAG = 22.0  # m: the tractor beside the second one stays behind the first where that stands
BEHIND = 12.0  # m, that the second one begins behind the first


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
    lag, outs = file.team.lag_m, run_outs(2)
    behind = RUN_UP + BEHIND - begins_ahead(passes[0], passes[1])
    starts = [RUN_UP, max(behind, RUN_UP)]
    crossings = order_of(passes, combines, lag, starts)
    if crossings is None:
        raise InputError("plan", None, NO_ORDER)
    return [
        Member(start, {"number": i, "lag_m": lag, "run_out_m": out, "crossings": crossings}, out)
        for i, (start, out) in enumerate(zip(starts, outs, strict=True))
    ]


def order_of(
    passes: Sequence[Pass], combines: Sequence[Combine], lag: float, starts: Sequence[float]
) -> list[Meeting] | None:
    """`crossings` of two combines, None where there is no such order. lag: of the second [m]; starts:
    how far before its first pass each begins [m].
    """

    def late(_: int, first: Samples, __: int, second: Samples) -> Mask:
        return _late(first, second, passes, lag)

    return crossings_of(ways_of(passes, combines, starts, run_outs(2)), combines, late)


def _check(passes: Sequence[Pass], combines: Sequence[Combine], file: FleetFile) -> None:
    if len(combines) > 2:
        raise InputError(
            "combines", len(combines), "expected 2 at most in echelon, with sensors or --shared-out"
        )
    if len({c.sheet.name for c in combines}) > 1:
        raise InputError("combines", None, "expected machines of one kind with sensors or --shared-out")
    if file.team.lag_m < LEAST_LAG:
        told = f"expected {LEAST_LAG:g} at least with sensors or --shared-out"
        raise InputError("team.lag_m", file.team.lag_m, told)
    if len(passes) < 2 or passes[1].combine != 1:
        told = "expected an even number of opening rounds, and a first pass for each combine"
        raise InputError("plan", None, told)


def run_outs(count: int) -> list[float]:
    """How far each combine drives on behind its last pass [m]: who is ahead leaves room to the next one."""
    return [20.0 * (count - number) for number in range(count)]


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
