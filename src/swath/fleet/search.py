"""The best of several plans of a job: each is decided whole, the one that ends first is kept.

A plan is the job itself with what is free in it set: machines that stay away, the direction of passes, the
dispatcher, and the draw by which its estimates are off. From the best plan so far the next one is one change
off; one that falls behind the best is given up. All is fixed by the job: the same one has the same plans.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.fleet.dispatcher import BUILT_IN
from swath.fleet.files import JobFile
from swath.fleet.ground import SQUARE_M_PER_HA_T, Ground, shapely_here
from swath.fleet.machines import Machines
from swath.fleet.schedule import Late, Schedule, Scheduler
from swath.fleet.worked import by_events


@dataclass(frozen=True)
class Params:
    """turned_deg: between directions of passes that are compared; side: least length of an outline's side
    that gives one, share of the longest. Estimates.
    """

    turned_deg: float = 8.0
    side: float = 0.3


PARAMS = Params()


def best_of(
    job: JobFile, base: Path | None = None, told: Callable[[str], None] = lambda _: None
) -> tuple[JobFile, Schedule]:
    """The best of at most `fleet.plans` plans: the job as it is worked then, and its schedule.

    told: before each plan what is known. InputError where the field, or a machine on it, cannot be worked, or
    no plan has an end.
    """
    first = Scheduler(job, base)
    bound = least_time(job, first.machines, first.ground)
    best: tuple[JobFile, Schedule] | None = None
    refused: InputError | None = None
    compared: list[tuple[str, float]] = []
    tried = {job.fleet.dispatcher}
    plan: tuple[str, JobFile] | None = ("as the job says", job)
    while plan is not None and len(compared) < job.fleet.plans:
        what, own = plan
        tried.add(what)
        kept = None if best is None else best[1]
        so_far = "" if kept is None else f", best {num(kept.ends / 3600.0)} h, bound {num(bound / 3600.0)} h"
        told(f"plan {len(compared) + 1} of {job.fleet.plans}{so_far}")
        ends = math.inf
        try:
            if kept is None or least_time(own, _those_in(own, first.machines), first.ground) < kept.ends:
                like = first if replace(own, fleet=job.fleet) == job else None
                made = first if own is job else Scheduler(own, base, like=like)
                made.run(kept)
                ends = made.schedule.ends = by_events(made.schedule).ends
                best = (own, made.schedule) if kept is None or ends < kept.ends else best
        except Late:
            pass
        except InputError as error:
            refused = refused or error
        compared.append((what, ends))
        plan = next((p for p in _changed(best[0] if best else job, first) if p[0] not in tried), None)
    if best is None:
        assert refused is not None
        raise refused
    own, schedule = best
    schedule.bound, schedule.compared = bound, compared
    away = [n for n in (*job.combines, *job.carts) if n not in own.combines and n not in own.carts]
    if away:
        why = "of the plans compared none with all machines ends earlier"
        schedule.notes.append(f"not used: {', '.join(away)}; {why}")
    return own, schedule


def _those_in(job: JobFile, machines: Machines) -> Machines:
    """Machines that a plan has."""
    combines = tuple(c for c in machines.combines if c.name in job.combines)
    return replace(machines, combines=combines, carts=tuple(k for k in machines.carts if k.name in job.carts))


def _changed(job: JobFile, first: Scheduler) -> Iterator[tuple[str, JobFile]]:
    """Plans that differ from one in one thing: what that is, and the job."""
    fleet, machines = job.fleet, _those_in(job, first.machines)
    draws = [
        (f"draw {n}", replace(job, fleet=replace(fleet, dispatcher="horizon", draw=n)))
        for n in range(1, fleet.plans + 1)
        if fleet.dispatcher in BUILT_IN
    ]
    yield from draws[:2]
    if len(machines.carts) > 1:
        away = min(machines.carts, key=lambda k: (k.load * k.drive.straight, str(job.carts[k.name]))).name
        yield f"without {away}", replace(job, carts={n: k for n, k in job.carts.items() if n != away})
    if len(machines.combines) > 1:
        away = min(machines.combines, key=lambda c: (c.width * c.speed, str(job.combines[c.name]))).name
        yield f"without {away}", replace(job, combines={n: c for n, c in job.combines.items() if n != away})
    if fleet.dispatcher in BUILT_IN:
        yield from ((name, replace(job, fleet=replace(fleet, dispatcher=name, draw=0))) for name in BUILT_IN)
    if first.job.plan.direction_deg is None and not first.job.plan.passes_m and not first.job.drawn:
        for degrees in directions(first):
            yield f"passes at {num(degrees)} deg", replace(job, plan=replace(job.plan, direction_deg=degrees))
    yield from draws[2:]


def directions(made: Scheduler) -> list[float]:
    """Directions of passes other than that of the frame [deg]: across, and along long sides of the outlines,
    the longest first.
    """
    shapely = shapely_here()
    sides: list[tuple[float, float]] = [(-math.inf, 0.5 * math.pi)]
    for part in shapely.get_parts(made.ground.field):
        d = np.diff(shapely.get_coordinates(part.exterior), axis=0)
        sides += [(-round(math.hypot(x, y), 1), math.atan2(y, x) % math.pi) for x, y in d.tolist()]
    longest = min((far for far, _ in sides[1:]), default=0.0)
    frame, taken, found = made.ground.frame, [0.0], []
    for far, angle in sorted(sides):
        apart = (abs(math.remainder(angle - a, math.pi)) for a in taken)
        if far <= PARAMS.side * longest and min(apart) > math.radians(PARAMS.turned_deg):
            taken.append(angle)
            found.append(frame.side * math.degrees(frame.direction + angle))
    return found


def least_time(job: JobFile, machines: Machines, ground: Ground) -> float:
    """Before which no plan ends [s]: all combines cut all the time, and pour at the truck where there are no
    carts; or the truck takes grain all the time, but for who comes and goes, and while all trucks are away.
    """
    area, grain = ground.field.area, SQUARE_M_PER_HA_T * job.field.yield_t_ha
    mass = grain * area + math.fsum(c.start for c in machines.combines)
    rates = []
    for c in machines.combines:
        cut = 1.0 / (c.width * c.speed_in(grain * c.width))
        rates.append(1.0 / (cut if machines.carts else cut + grain / c.auger))
    loads = [(k.load, k.out) for k in machines.carts] or [(c.tank, c.auger) for c in machines.combines]
    most, out = (max(each) for each in zip(*loads, strict=True))
    pours, docks = mass / out, (math.ceil(mass / most - 1e-9) - 0.5) * job.truck.dock_s
    at_truck = pours + docks
    if job.truck.volume_m3 is not None:
        kg, count = job.truck.volume_m3 * machines.density, job.truck.trucks
        turns, in_turn = divmod(max(math.ceil(mass / kg - 1e-9) - 1, 0), count)  # of the truck that is last
        own = pours - (turns * (count - 1) + in_turn) * kg / out + docks * (count == 1)
        at_truck = max(at_truck, own + 60.0 * job.truck.away_min * turns)
    way = ground.truck_m / max(m.drive.straight for m in machines.carts or machines.combines)
    return float(way + max(area / math.fsum(rates), at_truck))
