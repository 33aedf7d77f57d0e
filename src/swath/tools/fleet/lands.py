"""Combines with lands of their own: which passes each cuts, as they come to it when machines go by events."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

from swath.control.job.passes import RUN_OUT, Pass
from swath.core.errors import InputError
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.machines import Combine, Fleet
from swath.job.plan import FieldPlan
from swath.tools.fleet.order import NO_ORDER, RUN_UP, Member, rules_of, ways_of
from swath.tools.fleet.waits import at_pass_ends


def shared_out(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> tuple[FieldPlan, list[int]]:
    """The plan with its passes in the order in which they are begun; number of the combine of each."""
    job = Job(file, plan, fleet, Events())
    job.run()
    passes = tuple(job.passes[index] for index, _ in job.passes.taken)
    return replace(plan, passes=passes), [number for _, number in job.passes.taken]


def members(passes: Sequence[Pass], combines: Sequence[Combine]) -> list[Member]:
    """Start and settings of each of the combines. InputError for what this level cannot do."""
    missing = set(range(len(combines))) - {p.combine for p in passes}
    if missing:
        told = "expected a pass for every combine at the level with sensors"
        raise InputError("combines", len(combines), told)
    count = len(combines)
    for outs in permutations([RUN_OUT * (i + 1) for i in range(count)]):
        ways = ways_of(passes, combines, [RUN_UP] * count, outs)
        rules = rules_of(ways, combines)
        if rules is not None:
            waits = at_pass_ends(rules, ways)
            return [
                Member(RUN_UP, {"number": i, "run_out_m": out, "gives_way": own}, out)
                for i, (out, own) in enumerate(zip(outs, waits, strict=True))
            ]
    raise InputError("plan", None, NO_ORDER)
