"""Machines that jump from event to event: straight ways, constant speeds, hours in a fraction of a second.

Turns are as long as their clothoid path and driven at the turning speed. Longer ways lead along headland and
passes, the sum of both directions. A cart closes in on a moving combine with the difference of their speeds.
"""

import math
from dataclasses import dataclass

import numpy as np

from swath.job.cart_ways import NEAR, approach_loss, beside, seconds, way_beside, way_to
from swath.job.engine import Job
from swath.job.path import Path, Pose, path_of
from swath.job.states import DONE, CartState, CombineState, at, way_between
from swath.job.turns import clothoid

FAR = 80.0  # m, beyond which a way is no turn but transport
SLOWEST_APPROACH = 0.3  # of a cart's speed, at which it closes in at least
SHORTEST = 1e-6  # s between two events


@dataclass
class _CartWay:
    """A path, the distance [m] on it up to which time was reckoned, and that time at the cart's speed [m].

    gone: of that time, at its speed [m]; then it drives on along the path
    """

    path: Path
    end: float
    reckoned: float
    before: float
    gone: float = 0.0

    @property
    def distance(self) -> float:
        """How far it has come [m]."""
        if self.gone < self.reckoned:
            return self.end * self.gone / self.reckoned
        return self.end + self.gone - self.reckoned

    def drive(self, cart: CartState, dt: float) -> None:
        """On for dt [s]."""
        self.gone += cart.spec.speed * dt
        cart.way = self.before + self.distance

    def place(self) -> Pose:
        """Where it is."""
        return self.path.at(self.distance)


class Events:
    """The motion of the cheap level.

    What is left of a cart's way is the time for it at its highest speed, so that bends and braking count.
    """

    def __init__(self) -> None:
        self._ways: dict[str, _CartWay] = {}

    def combine_way(self, job: Job, combine: CombineState) -> None:
        """A corner, a turn or a way along the headland."""
        task = combine.task
        assert task is not None
        away = way_between(combine.place, task.start)
        if job.time <= 0.0:
            combine.left = 0.0
            return
        self._bring_cart(job, combine)
        spec = combine.spec
        turned = abs(math.remainder(task.start.heading - combine.place.heading, 2.0 * math.pi))
        if task.is_corner and away < FAR and turned < math.radians(150.0):
            combine.left = spec.corner_path(turned)
            combine.pace = combine.left / spec.corner_time(turned)
        elif away < FAR:
            path = turn_path(combine, task.start)
            combine.left, combine.pace = path.length, spec.turn_speed
            job.ways.append(path.points)
        else:
            combine.left, combine.pace, combine.state = away, spec.transport, "transport"
            job.ways.append(np.array([combine.place[:2], task.start[:2]]))

    def begin_cut(self, job: Job, combine: CombineState) -> None:
        """Nothing but what was decided."""

    def combine_to(self, job: Job, combine: CombineState, goal: Pose) -> None:
        """Along headland and passes."""
        here = combine.place if combine.hauling == "back" else at(combine)
        combine.left = way_between(here, goal)
        combine.pace = combine.spec.transport

    def _bring_cart(self, job: Job, combine: CombineState) -> None:
        """The cart of a combine that turns drives to its next pass."""
        cart = combine.cart
        if cart is None or cart.phase not in ("beside", "to_combine"):
            return
        if cart.phase == "beside":
            cart.place = beside(combine.place, combine.spec)
        else:
            cart.place = self._ways[cart.spec.name].place()
        cart.phase = "to_combine"
        self.cart_to_combine(job, cart)

    def cart_to_combine(self, job: Job, cart: CartState) -> None:
        """To the start of the combine's pass, and after it."""
        combine = cart.combine
        assert combine is not None
        path, begin, length = way_beside(cart.place, combine)
        done = 0.0
        if combine.task is None:
            done = length
        elif combine.phase not in ("way", "hold"):
            done = combine.task.length - combine.left
        closing = max(cart.spec.speed - combine.pace, SLOWEST_APPROACH * cart.spec.speed)
        speed = cart.spec.speed
        way = seconds(path, cart.spec, begin, first=cart.speed, last=speed) * speed
        cart.left = max(way + min(begin, 0.0) + done + approach_loss(closing) * closing, SHORTEST)
        self._ways[cart.spec.name] = _CartWay(path, max(begin, 0.0), way, cart.way)

    def cart_to_truck(self, job: Job, cart: CartState) -> None:
        """Over passes and headland."""
        path = way_to(cart.place, job.truck)
        cart.place = path.end
        cart.left = seconds(path, cart.spec, path.length - NEAR, first=cart.speed) * cart.spec.speed
        self._ways[cart.spec.name] = _CartWay(path, path.length, cart.left, cart.way)

    def move(self, job: Job) -> float:
        """On to the next event."""
        for c in job.combines:
            c.speed = c.pace if c.phase in ("way", "cut", "haul", "back") else 0.0
        for c in job.combines:
            self._keep_behind(job, c)
        for k in job.carts:
            k.speed = self._cart_speed(k)
        dt = min(self._times(job), default=0.0)
        for c in job.combines:
            way = c.speed * dt
            if c.phase in ("way", "cut", "haul", "back"):
                way = min(way, c.left)
                c.left = max(0.0, c.left - way)
                c.left = 0.0 if c.left < DONE else c.left
                c.way += way
            if c.phase == "cut":
                job.cut_now[c.number] = way
        for k in job.carts:
            if k.phase in ("to_combine", "to_truck"):
                k.left = max(0.0, k.left - self._closing(k) * dt)
                k.left = 0.0 if k.left < DONE else k.left
                self._ways[k.spec.name].drive(k, dt)
        return dt

    def _keep_behind(self, job: Job, c: CombineState) -> None:
        """A follower in echelon does not close up to the one ahead."""
        leader = job.leader_of(c)
        if leader is not None and c.phase == "cut" and job.gap(leader, c) <= job.file.team.lag_m + DONE:
            c.speed = min(c.speed, leader.speed)

    def _cart_speed(self, k: CartState) -> float:
        if k.phase in ("to_combine", "to_truck"):
            return k.spec.speed
        return k.combine.speed if k.phase == "beside" and k.combine is not None else 0.0

    def _closing(self, k: CartState) -> float:
        """How fast what is left of a cart's way gets less [m/s]."""
        follows = k.phase == "to_combine" and k.combine is not None and k.combine.phase == "cut"
        ahead = k.combine.speed if follows and k.combine is not None else 0.0
        return max(k.spec.speed - ahead, SLOWEST_APPROACH * k.spec.speed)

    def _times(self, job: Job) -> list[float]:
        """Times until something happens [s]."""
        times: list[float] = []
        for c in job.combines:
            times += self._of_combine(job, c)
        for k in job.carts:
            if k.phase in ("to_combine", "to_truck") and k.left > 0.0:
                times.append(k.left / self._closing(k))
            if k.timer > 0.0:
                times.append(k.timer)
            if job.pours_at_truck(k):
                times += [k.grain / k.spec.out, job.room / k.spec.out]
        if job.away > 0.0:
            times.append(job.away)
        return [max(t, SHORTEST) for t in times if t > 0.0 and math.isfinite(t)]

    def _of_combine(self, job: Job, c: CombineState) -> list[float]:
        times = []
        if c.phase in ("way", "cut", "haul", "back") and c.speed > 0.0:
            times.append(c.left / c.speed)
        if c.timer > 0.0:
            times.append(c.timer)
        leader = job.leader_of(c)
        if leader is not None and c.phase in ("cut", "hold"):
            gap, lag = job.gap(leader, c), job.file.team.lag_m
            closing = c.speed - leader.speed
            if c.phase == "hold" and leader.speed > 0.0 and math.isfinite(gap):
                times.append(max(lag - gap, 0.0) / leader.speed)
            elif c.phase == "cut" and closing > 0.0 and gap > lag:
                times.append((gap - lag) / closing)
        grain = c.speed * c.per_metre if c.phase == "cut" else 0.0
        out = c.spec.auger if c.is_pouring or (c.hauling == "pour" and c.timer <= 0.0) else 0.0
        if grain > out:
            times.append((c.spec.tank - c.tank) / (grain - out))
            if not c.called and c.tank < c.spec.call:
                times.append((c.spec.call - c.tank) / (grain - out))
        if out > grain and c.tank > 0.0:
            times.append(c.tank / (out - grain))
        if c.is_pouring and c.cart is not None:
            times.append((c.cart.spec.load - c.cart.grain) / out)
        return times


def turn_path(combine: CombineState, start: Pose) -> Path:
    """The turn of the fixed axle from the end of a pass, knife there, to the start of the next."""
    knife = combine.spec.sheet.knife_x
    here = axle_pose(combine.place, knife)
    return path_of(clothoid.plan(here, axle_pose(start, knife), combine.spec.limits), here)


def axle_pose(knife: Pose, ahead: float) -> Pose:
    """Where the fixed axle is when the knife is at a pose."""
    return Pose(
        knife.x - ahead * math.cos(knife.heading), knife.y - ahead * math.sin(knife.heading), knife.heading
    )
