"""Twenty made-up fields with their machines, drawn once from a seed."""

import random

from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from swath.tools.fleet.work_plan import share_out
from tests.job.jobs import finished, job_file

CARTS = (1, 2, 3)


def layout(seed):
    """Keys of a job: a quadrangle of 6 to 20 ha, a yield, an order, one to three combines."""
    draw = random.Random(seed)
    long, wide = draw.uniform(300, 600), draw.uniform(180, 350)
    corners = [(0.0, 0.0), (long, draw.uniform(-40, 40)), (long + draw.uniform(-60, 60), wide), (0.0, wide)]
    return {
        "boundary_m": corners,
        "yield_t_ha": draw.uniform(4.0, 11.0),
        "combines": draw.randint(1, 3),
        "plan": {"headland_rounds": draw.randint(2, 3), "order": draw.choice(["lands", "adjacent"])},
        "truck": {"x_m": draw.uniform(0, long), "y_m": -15.0},
    }


def layout_file(seed, carts):
    """The job of a layout with so many carts."""
    return job_file(carts=carts, combine={"call_percent": 40.0}, **layout(seed))


def both_levels(file, is_shared_out=False):
    """Hours by events and by driven machines, seconds over each other by the kinds of the two, and standoffs
    that were not solved. is_shared_out: passes are, before the job, as with sensors
    """
    plan = None
    if is_shared_out:
        fleet = fleet_of(file)
        plan = share_out(file, plan_of(file, fleet, None), fleet)
    driven = finished(file, plan, Kinematic())
    kinds = {c.name: "combine" for c in driven.fleet.combines} | {c.name: "cart" for c in driven.fleet.carts}
    touched = {}
    for p in driven.motion.watch.pairs:
        pair = tuple(sorted((kinds.get(p.first, "truck"), kinds.get(p.second, "truck"))))
        touched[pair] = touched.get(pair, 0.0) + p.touched
    unsolved = sum(bool(s.driven_on) for s in driven.motion.standoffs)
    return finished(file, plan).time / 3600.0, driven.time / 3600.0, touched, unsolved


def same_ranking(cheap, dear, tie=0.02):
    """True where no pair of cart counts is ordered the other way round, ties within 2 % aside."""
    pairs = [(i, j) for i in range(len(cheap)) for j in range(i)]
    return all(
        (cheap[i] - cheap[j]) * (dear[i] - dear[j]) >= 0.0
        or abs(cheap[i] / cheap[j] - 1.0) < tie
        or abs(dear[i] / dear[j] - 1.0) < tie
        for i, j in pairs
    )
