"""Combines with lands of their own: which passes each cuts, as they come to it when machines go by events."""

import math
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
from swath.job.timeline import STANDS
from swath.tools.fleet.combine_turns import Shared, shared
from swath.tools.fleet.far_ways import far_ways
from swath.tools.fleet.order import RUN_UP, Member, crossings_of, ways_of
from swath.tools.fleet.uncut import uncut_before
from swath.tools.fleet.waits import Stops, Timing, at_pass_ends


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
    """members: start and settings of each combine; end: when all are done, with stops for carts; least: if
    none waited for another one and all had ways of equal length [s]
    """

    members: list[Member]
    end: float
    least: float


def stops_of(file: FleetFile, of: Shared, fleet: Fleet) -> Stops:
    """For how long each combine stands for carts, and after which share of its way, when machines go by
    events and each combine cuts its own passes.
    """
    job = Job(file, of.plan, fleet, Events(), of.by)
    job.run()
    found = []
    for combine in job.combines:
        driven = math.fsum(s.end - s.start for s in combine.timeline.spans if s.state not in STANDS)
        found.append([(after / driven, time) for after, time in combine.timeline.stops()])
    return found


def team_of(passes: Sequence[Pass], combines: Sequence[Combine], stops: Stops) -> Team | None:
    """Who waits for whom, and how far each drives on behind its last pass, by the stops of each for carts.
    None: they cannot keep clear of each other.
    """
    count = len(combines)
    for outs in permutations([RUN_OUT * (i + 1) for i in range(count)]):
        ways = ways_of(passes, combines, [RUN_UP] * count, outs)
        found = crossings_of(ways, combines, with_carts=True, uncut=partial(uncut_before, ways, combines))
        if found is not None:
            timing = Timing(ways, stops)
            routes = {task: route for own in ways.routes for task, route in own.items()}
            waits, end = at_pass_ends(found, routes, timing)
            members = [
                Member(RUN_UP, {"number": i, "run_out_m": out, "crossings": waits}, out)
                for i, out in enumerate(outs)
            ]
            if end < math.inf:
                return Team(members, end, timing.least)
    return None
