"""Combines with lands of their own: which passes each cuts, as they come to it when machines go by events."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import NamedTuple

from swath.control.job.passes import RUN_OUT, Pass
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.machines import Combine, Fleet
from swath.job.plan import FieldPlan
from swath.tools.fleet.combine_turns import Shared, shared
from swath.tools.fleet.far_ways import far_ways
from swath.tools.fleet.order import RUN_UP, Member, rules_of, ways_of
from swath.tools.fleet.uncut import uncut_before
from swath.tools.fleet.waits import at_pass_ends, time_of


def shared_out(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Shared:
    """Who cuts which pass, with far ways on ground that is cut then."""
    job = Job(file, plan, fleet, Events())
    job.run()
    taken = job.passes.taken
    plan = replace(plan, passes=tuple(job.passes[index] for index, _ in taken))
    made = shared(plan, [number for _, number in taken], fleet.combines)
    ends = [job.pass_times[index][1] for index, _ in taken]
    return made._replace(turns={**made.turns, **far_ways(plan, made.by, fleet.combines, ends)})


class Team(NamedTuple):
    """members: start and settings of each combine; end: when all are done, as planned; busy: time of their
    ways, in the mean of them [s]
    """

    members: list[Member]
    end: float
    busy: float


def team_of(passes: Sequence[Pass], combines: Sequence[Combine]) -> Team | None:
    """Who waits for whom, and how far each drives on behind its last pass. None: they cannot keep clear of
    each other.
    """
    count = len(combines)
    for outs in permutations([RUN_OUT * (i + 1) for i in range(count)]):
        ways = ways_of(passes, combines, [RUN_UP] * count, outs)
        rules = rules_of(ways, combines, with_carts=True, uncut=partial(uncut_before, ways, combines))
        if rules is not None:
            waits = at_pass_ends(rules, ways)
            members = [
                Member(RUN_UP, {"number": i, "run_out_m": out, "gives_way": own}, out)
                for i, (out, own) in enumerate(zip(outs, waits, strict=True))
            ]
            busy = ways.step * sum(len(way.way) for way in ways.samples) / count
            return Team(members, time_of(waits, ways), busy)
    return None
