"""How much the hours of a job differ where the speeds of its machines do by a little.

A few seconds turn over which cart comes to which combine, and how often a cart drives to the truck.
"""

import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import fsum

from swath.core.errors import InputError
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.machines import Fleet
from swath.job.plan import FieldPlan, Shared

DRAWS = 24
MOST = 20.0  # %


@dataclass(frozen=True)
class Spread:
    """percent: that speeds of machines differ by, at most; durations: of the draws, in their order [s]"""

    percent: float
    durations: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Of the durations [s]."""
        return fsum(self.durations) / len(self.durations)


def spread_of(
    file: FleetFile,
    plan: FieldPlan | Shared,
    fleet: Fleet,
    percent: float,
    told: Callable[[str], None] | None = None,
) -> Spread:
    """Of a job by events: each combine and each cart on the field faster or slower by up to so many percent,
    evenly distributed, in each of DRAWS draws. told: of each draw. InputError unless 0 < percent <= MOST
    """
    if not 0.0 < percent <= MOST:
        raise InputError("--spread", percent, f"expected more than 0 and at most {MOST:g} percent")
    draw, durations = random.Random(1), []
    for n in range(DRAWS):
        if told is not None:
            told(f"draw {n + 1} of {DRAWS}")
        job = Job(file, plan, drawn(fleet, draw, percent / 100.0, percent / 100.0), Events())
        job.run()
        durations.append(job.time)
    return Spread(percent, tuple(durations))


def drawn(fleet: Fleet, draw: random.Random, combines: float, carts: float) -> Fleet:
    """Machines whose speeds differ by up to a share."""
    return replace(
        fleet,
        combines=tuple(
            replace(c, speed=c.speed * (1.0 + draw.uniform(-combines, combines))) for c in fleet.combines
        ),
        carts=tuple(replace(k, speed=k.speed * (1.0 + draw.uniform(-carts, carts))) for k in fleet.carts),
    )
