"""Grain and fuel of a job: over the time that passed, and what is still to come."""

import math
from typing import Any

from swath.job.states import DONE, CartState, CombineState
from swath.machine.fuel import combine_fuel, tractor_fuel


def move_grain(job: Any, dt: float) -> None:
    """Move grain over the time that passed, and count timers down."""
    for c in job.combines:
        grown = job.cut_now.get(c.number, 0.0) * c.per_metre
        c.cut += grown
        c.tank += grown
        if c.is_pouring and c.cart is not None:
            flow = min(c.spec.auger * dt, c.tank, c.cart.spec.load - c.cart.grain)
            c.tank -= flow
            c.poured += flow
            c.cart.grain += flow
        elif c.hauling == "pour" and c.timer <= DONE:
            flow = min(c.spec.auger * dt, c.tank)
            c.tank -= flow
            c.poured += flow
            job.at_truck += flow
        c.timer = max(0.0, c.timer - dt)
        if c.phase != "done":
            cutting = job.cut_now.get(c.number, 0.0) / dt
            c.fuel += dt * combine_fuel(
                c.spec.sheet, c.spec.drivetrain, tank=c.tank, speed=c.speed, grain=cutting * c.per_metre,
                cuts=cutting > 0.0, out=c.spec.auger if c.is_pouring else 0.0,
            )  # fmt: skip
    pours = [k for k in job.carts if job.pours_at_truck(k)]
    for k in pours:
        flow = min(k.spec.out * dt, k.grain, job.room)
        k.grain -= flow
        k.delivered += flow
        job.room -= flow
        job.at_truck += flow
    for k in job.carts:
        k.timer = max(0.0, k.timer - dt)
        k.fuel += tractor_fuel(k.spec.sheet, k.grain, k.speed) * dt
    job.away = max(0.0, job.away - dt)


def leaves(job: Any, k: CartState) -> bool:
    """True for an idle cart that is full enough for the truck, unless it has room for all that is still to
    come, or a combine stands full of whose tank it can take half; behind the last pass for one that nobody
    needs any more, too.
    """
    if any(_stands_full(c) and k.spec.load - k.grain >= 0.5 * c.spec.tank for c in job.combines):
        return False
    if job.passes.left() > 0:
        return k.grain >= k.spec.leave
    rest = math.fsum(_still_to_come(job, c) for c in job.combines)
    return (k.grain >= k.spec.leave and k.grain + rest > k.spec.load) or _is_spare(job, k)


def _stands_full(c: CombineState) -> bool:
    """True for a combine in the middle of its work that stands with a full tank and has no cart."""
    return c.phase == "stand" and not c.is_last and c.cart is None and c.tank >= c.spec.tank - DONE


def _is_spare(job: Any, k: CartState) -> bool:
    """True for an idle cart with grain where others, with more room, can take what is still to come."""
    needs = sorted((n for c in job.combines if (n := _needs(job, c)) > DONE), reverse=True)
    mine = k.spec.load - k.grain, k.spec.name
    rooms = ((o.spec.load - o.grain, o.spec.name) for o in job.carts if o is not k and o.phase == "idle")
    more = sorted((r for r in rooms if r > mine), reverse=True)
    return len(more) >= len(needs) and all(n <= room for n, (room, _) in zip(needs, more, strict=False))


def _needs(job: Any, c: CombineState) -> float:
    """What is still to come of a combine, beyond what the cart takes that it has already [kg]."""
    return _still_to_come(job, c) - (c.cart.spec.load - c.cart.grain if c.cart is not None else 0.0)


def _still_to_come(job: Any, c: CombineState) -> float:
    """Grain in the tank and in what is left of the pass of a combine [kg]."""
    if c.task is None:
        return c.tank
    left = c.task.length if c.phase in ("way", "hold") else c.rest if c.hauling else c.left
    return c.tank + left / c.task.length * c.task.area * float(job.grain_per_m2)
