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
from swath.tools.fleet.combine_turns import Shared, shared
from swath.tools.fleet.far_ways import far_ways
from swath.tools.fleet.order import NO_ORDER, RUN_UP, Member, rules_of, ways_of
from swath.tools.fleet.waits import at_pass_ends


def shared_out(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Shared:
    """Who cuts which pass, with far ways on ground that is cut then."""
    job = Job(file, plan, fleet, Events())
    job.run()
    taken = job.passes.taken
    plan = replace(plan, passes=tuple(job.passes[index] for index, _ in taken))
    made = shared(plan, [number for _, number in taken], fleet.combines)
    ends = [job.pass_times[index][1] for index, _ in taken]
    return made._replace(turns={**made.turns, **far_ways(plan, made.by, fleet.combines, ends)})


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
