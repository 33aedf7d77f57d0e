"""Combines with lands of their own: which passes each cuts, as they come to it when machines go by events."""

import math
import random
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations
from math import inf
from typing import NamedTuple

from swath.control.job.passes import RUN_OUT, Pass
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.machines import Combine, Fleet
from swath.job.plan import FieldPlan, Shared
from swath.job.spread import drawn
from swath.tools.fleet.combine_turns import shared
from swath.tools.fleet.far_ways import far_ways
from swath.tools.fleet.order import RUN_UP, Meeting, Member, crossings_of, ways_of
from swath.tools.fleet.uncut import uncut_before
from swath.tools.fleet.waits import Timing, at_pass_ends

DRAWS = 8  # of speeds
CUTS, CARTS = 0.03, 0.1  # of the speed of combines, and of carts, that it may differ by


class Taken(NamedTuple):
    """plan: passes in the order in which they are begun; by: number of the combine of each; ends: when each
    is cut [s]
    """

    plan: FieldPlan
    by: list[int]
    ends: list[float]


def taken_by_events(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Taken:
    """Who cuts which pass, as combines come to them."""
    job = Job(file, plan, fleet, Events())
    job.run()
    indices, by = zip(*job.passes.taken, strict=True)
    passes = tuple(job.passes[index] for index in indices)
    return Taken(replace(plan, passes=passes), list(by), [job.pass_times[index][1] for index in indices])


def with_turns(of: Taken, combines: Sequence[Combine]) -> Shared:
    """With far ways on ground that is cut then."""
    made = shared(of.plan, of.by, combines)
    return made._replace(turns={**made.turns, **far_ways(of.plan, of.by, combines, of.ends)})


class Team(NamedTuple):
    """members: start and settings of each combine; end: when all are done, with stops now and then; waits:
    for each other, of that; least: if none waited for another one and all had ways of equal length [s]
    """

    members: list[Member]
    end: float
    waits: float
    least: float

    @property
    def crossings(self) -> list[Meeting]:
        """Where their ways meet: the same for all."""
        return self.members[0].job["crossings"] if self.members else []


def hours_of(file: FleetFile, of: Shared, fleet: Fleet) -> float:
    """When the field is empty by events, if each cuts its own passes, turns as if these were not shared out,
    waits for no other one, and stands for carts as long as each other one, and carts drive up to the truck as
    with sensors: the mean of some draws of speeds, since a few seconds send another cart [s]. Which of them
    stands how long is not the same with sensors (docs/how-to/fleet.md).
    """
    draw, found = random.Random(1), []
    for _ in range(DRAWS):
        job = Job(file, of._replace(turns={}, crossings=()), drawn(fleet, draw, CUTS, CARTS), Events())
        job.run()
        lines = [c.timeline for c in job.combines]
        stands = [line.time("wait") + line.time("unload") for line in lines]
        works = max(line.end - stood for line, stood in zip(lines, stands, strict=True))
        last = job.time - max(line.end for line in lines)
        found.append(works + math.fsum(stands) / len(stands) + last)
    return math.fsum(found) / DRAWS


def team_of(passes: Sequence[Pass], combines: Sequence[Combine]) -> Team | None:
    """Who waits for whom, and how far each drives on behind its last pass. None: they cannot keep clear of
    each other.
    """
    count = len(combines)
    for outs in permutations([RUN_OUT * (i + 1) for i in range(count)]):
        ways = ways_of(passes, combines, [RUN_UP] * count, outs)
        found = crossings_of(ways, combines, with_carts=True, uncut=partial(uncut_before, ways, combines))
        if found is not None:
            timing = Timing(ways)
            routes = {task: route for own in ways.routes for task, route in own.items()}
            waits, end = at_pass_ends(found, routes, timing)
            members = [
                Member(RUN_UP, {"number": i, "run_out_m": out, "crossings": waits}, out)
                for i, out in enumerate(outs)
            ]
            if end < inf:
                return Team(members, end, end - timing.end([]), timing.least)
    return None
