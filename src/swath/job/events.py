"""Machines that jump from event to event: hours in a fraction of a second.

In a pass a combine drives at the speed of its crop, reached as its drive does; tanks, timers and ends of
passes are reckoned from it. On a way machines ride along its path (`swath.job.ride`) until the next event.
Paths, speed limits and drives are those of the driven machines.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from swath.job import ways
from swath.job.cart_ways import (
    IN_PLACE,
    NEAR,
    speed_beside,
    speed_limits,
    speed_to_end,
)
from swath.job.combine_ways import (
    axle_pose,
    corner_angle,
    is_far,
)
from swath.job.combine_ways import speed_limits as combine_limits
from swath.job.engine import Job
from swath.job.path import Path, Pose
from swath.job.ride import Ride, time_over
from swath.job.states import DONE, CartState, CombineState, at, way_between
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import dynamics_of

SHORTEST = 1e-6  # s between two events
LOOKS = 1.0  # s between two looks of a combine that waits for another one
RAMP = 1.0  # s, longest jump while a combine changes its speed
STEADY = 0.02  # m/s, within which it has its speed
LONGEST = 1e5  # s
# s by which a way takes longer than the ride, for each other combine at work, and for each other cart: a turn
# and a far way to the next pass, a cart's to a combine and to the truck. Estimate: driven machines of 20
# layouts (docs/how-to/fleet.md)
TURN_LOSES, FAR_LOSES = (1.0, 1.3, 0.0), (1.0, 4.8, 0.0)
CART_LOSES, BACK_LOSES = (4.7, 2.4, 0.0), (7.0, 1.1, 0.0)
# a cart's to a combine where it searches for it as with sensors. Estimate: 404 ways with sensors (likewise)
FOUND_LOSES = (14.0, 1.0, 4.0)


@dataclass
class _Way:
    """A machine's ride. base: distance on the path [m] at which a cart's box is under the pipe at the start
    of the pass; length: of the pass [m]; noted: of its way so far [m]
    """

    ride: Ride
    base: float = 0.0
    length: float = 0.0
    noted: float = 0.0


class Events:
    """The motion of the cheap level."""

    def __init__(self) -> None:
        self._ways: dict[str, _Way] = {}
        self._loops: dict[str, SpeedLoop] = {}
        self._corners: set[str] = set()

    def combine_way(self, job: Job, combine: CombineState) -> None:
        """A corner, a turn or a way along the headland."""
        task, spec = combine.task, combine.spec
        assert task is not None
        if job.time <= 0.0:
            combine.left, combine.pace = job.start_behind(combine), spec.turn_speed
            return
        path, turned = ways.planned_way(job, combine), corner_angle(combine.place, task)
        if path is None and turned is not None:
            combine.left = spec.corner_path(turned)
            combine.pace = combine.left / spec.corner_time(turned)
            self._corners.add(spec.name)
            return
        far = is_far(combine.place, task.start)
        if path is None:
            path = ways.way_to_pass(job, combine, axle_pose(combine.place, spec.sheet.knife_x))
        lost = _lost(FAR_LOSES if far else TURN_LOSES, job, combine)
        ride = Ride(path, combine_limits(spec, path, far=far), spec.sheet, combine.speed, lost)
        self._ways[spec.name] = _Way(ride)
        combine.left, combine.pace = path.length, spec.transport if far else spec.turn_speed
        combine.state = "transport" if far else "turn"
        job.ways.append(path.points)

    def begin_cut(self, job: Job, combine: CombineState) -> None:
        """Behind a corner from standing."""
        if combine.spec.name in self._corners:
            self._corners.remove(combine.spec.name)
            combine.speed = 0.0

    def combine_to(self, job: Job, combine: CombineState, goal: Pose) -> None:
        """Along headland and passes."""
        here = combine.place if combine.hauling == "back" else at(combine)
        combine.left = way_between(here, goal)
        combine.pace = combine.spec.transport

    def cart_to_combine(self, job: Job, cart: CartState) -> None:
        """To beside the combine, and after it."""
        assert cart.combine is not None
        path, base, length, _ = ways.way_to_combine(job, cart, self._place(cart))
        before = self._ways.get(cart.spec.name)
        loses = CART_LOSES if job.shared_ways is None else FOUND_LOSES
        lost = _lost(loses, job, cart.combine) if before is None else before.ride.lost
        self._ways[cart.spec.name] = _Way(self._on(path, cart, lost), base, length)
        cart.left = path.length

    def cart_to_truck(self, job: Job, cart: CartState) -> None:
        """Over passes and headland."""
        path = ways.way_to_truck(job, cart, self._place(cart))
        self._ways[cart.spec.name] = _Way(self._on(path, cart, _lost(BACK_LOSES, job)))
        cart.place, cart.left = path.end, path.length

    def _on(self, path: Path, cart: CartState, lost: float) -> Ride:
        return Ride(path, speed_limits(path, cart.spec), cart.spec.sheet, cart.speed, lost)

    def _place(self, cart: CartState) -> Pose:
        """Where a cart is."""
        way = self._ways.get(cart.spec.name)
        return cart.place if way is None else way.ride.path.at(way.ride.at)

    def move(self, job: Job) -> float:
        """On to the next event."""
        for c in job.combines:
            if job.held(c).is_held:
                self._stop(c)
        targets = {c.number: self._target(job, c) for c in job.combines}
        times = self._times(job, targets)
        dt = self._ride(job, targets, min(times, default=LONGEST))
        if dt >= LONGEST:
            return 0.0
        for c in job.combines:
            self._advance(job, c, targets[c.number], dt)
        for k in job.carts:
            if k.phase == "beside" and k.combine is not None:
                k.speed = k.combine.speed
            elif k.phase not in ("to_combine", "to_truck"):
                k.speed = 0.0
        return dt

    # combines

    def _stop(self, c: CombineState) -> None:
        """It has to wait for another one."""
        c.speed, way = 0.0, self._ways.get(c.spec.name)
        if way is not None:
            way.ride.speed = 0.0

    def _target(self, job: Job, c: CombineState) -> float:
        """Speed that a combine wants [m/s]; in echelon it does not close up to the one ahead."""
        if c.phase not in ("way", "cut", "haul", "back") or job.held(c).is_held:
            return 0.0
        leader = job.leader_of(c)
        if leader is not None and c.phase == "cut" and job.gap(leader, c) <= job.file.team.lag_m + DONE:
            return min(c.pace, leader.speed)
        return c.pace

    def _drives(self, c: CombineState) -> bool:
        """True in a pass and where it comes to a stand there: with its drive's acceleration."""
        return c.phase in ("cut", "stand") and not c.hauling

    def _loop(self, c: CombineState) -> SpeedLoop:
        name = c.spec.name
        if name not in self._loops:
            self._loops[name] = SpeedLoop(dynamics_of(c.spec.sheet))
        return self._loops[name]

    def _gone(self, c: CombineState, target: float, time: float) -> tuple[float, float]:
        """Speed [m/s] and way [m] in its pass after a time [s]."""
        if not self._drives(c):
            return c.speed, 0.0
        if abs(c.speed - target) < STEADY:
            return target, target * time
        return self._loop(c).advance(c.speed, target, time)

    def _advance(self, job: Job, c: CombineState, target: float, dt: float) -> None:
        way = self._ways.get(c.spec.name)
        if way is not None:
            c.speed, c.way = way.ride.speed, c.way + c.left - way.ride.left
            c.left = way.ride.left
            if c.left <= DONE:
                del self._ways[c.spec.name]
        elif self._drives(c):
            c.speed, gone = self._gone(c, target, dt)
            c.way += gone
            if c.left > 0.0:
                job.cut_now[c.number] = min(gone, c.left)
                c.left = max(0.0, c.left - gone)
        else:
            c.speed = target
            c.way += min(c.speed * dt, c.left)
            c.left = max(0.0, c.left - c.speed * dt)
        c.left = 0.0 if c.left < DONE else c.left

    # ways

    def _ride(self, job: Job, targets: dict[int, float], most: float) -> float:
        """All who are on a way drive on until the first is there, at most so long [s]; returns the time."""
        rides = [self._combine_ride(job, c) for c in job.combines if self._rides(job, c)]
        rides += [self._cart_ride(k, targets) for k in job.carts if k.spec.name in self._ways]
        before = [(r.ride.at, r.ride.speed, r.ride.lost) for r in rides]
        took = []
        for r in rides:
            most = max(r.ride.drive(most, r.wanted, r.left), SHORTEST)
            took.append(most)
        for r, was, time in zip(rides, before, took, strict=True):
            if time > most:
                r.ride.at, r.ride.speed, r.ride.lost = was
                r.ride.drive(most, r.wanted, r.left)
        for k in job.carts:
            way = self._ways.get(k.spec.name)
            if way is not None:
                k.way += way.ride.at - way.noted
                k.speed, way.noted = way.ride.speed, way.ride.at
        for r in rides:
            if r.arrive is not None:
                r.arrive(most)
        return most

    def _rides(self, job: Job, c: CombineState) -> bool:
        return c.spec.name in self._ways and not job.held(c).is_held

    def _combine_ride(self, job: Job, c: CombineState) -> "_Riding":
        ride = self._ways[c.spec.name].ride
        until = ride.at + job.held(c).free
        return _Riding(ride, lambda _: c.pace, lambda _: min(ride.left, until - ride.at), None)

    def _cart_ride(self, k: CartState, targets: dict[int, float]) -> "_Riding":
        way, cart = self._ways[k.spec.name], k.spec
        ride, combine = way.ride, k.combine
        if k.phase == "to_truck" or combine is None:
            return self._truck_ride(k, ride)
        target = targets[combine.number]
        done = way.length if combine.task is None else combine.task.length - combine.left
        if combine.phase in ("way", "hold"):
            done = 0.0
        pace = combine.pace if combine.phase == "cut" else 0.0

        def gap(time: float) -> float:
            return way.base + done + self._gone(combine, target, time)[1] - ride.at

        def left(time: float) -> float:
            return min(abs(gap(time)) - IN_PLACE, ride.left)

        def wanted(time: float) -> float:
            speed, gone = self._gone(combine, target, time)
            return speed_beside(way.base + done + gone - ride.at, speed, pace, cart)

        return _Riding(ride, wanted, left, lambda time: self._arrive(k, left(time)))

    def _truck_ride(self, k: CartState, ride: Ride) -> "_Riding":
        def left(_: float) -> float:
            return ride.left - NEAR

        return _Riding(
            ride, lambda _: speed_to_end(ride.left, k.spec), left, lambda _: self._arrive(k, left(0.0))
        )

    def _arrive(self, k: CartState, left: float) -> None:
        """A cart has so much of its way left [m]."""
        k.left = left if left > DONE else 0.0
        if k.left <= 0.0:
            del self._ways[k.spec.name]

    # events

    def _times(self, job: Job, targets: dict[int, float]) -> list[float]:
        """Times until something happens [s]; those on a way are left out."""
        times: list[float] = []
        for c in job.combines:
            times += self._of_combine(job, c, targets)
        for k in job.carts:
            if k.timer > 0.0:
                times.append(k.timer)
            if job.pours_at_truck(k):
                times += [k.grain / k.spec.out, job.room / k.spec.out]
        if job.away > 0.0:
            times.append(job.away)
        return [max(t, SHORTEST) for t in times if t > 0.0 and math.isfinite(t)]

    def _of_combine(self, job: Job, c: CombineState, targets: dict[int, float]) -> list[float]:
        times, target, held = [], targets[c.number], job.held(c)
        if held.is_held:
            times.append(LOOKS)
        left = min(c.left, held.free)
        speed = c.speed if self._drives(c) else target
        if self._drives(c) and abs(speed - target) >= STEADY:
            times += [RAMP, time_over(left, speed, target, self._loop(c), RAMP)]
        elif c.phase in ("cut", "way", "haul", "back") and target > 0.0 and c.spec.name not in self._ways:
            speed = target
            times.append(left / target)
        if c.timer > 0.0:
            times.append(c.timer)
        leader = job.leader_of(c)
        if leader is not None and c.phase in ("cut", "hold"):
            times += self._behind(job, c, leader, speed)
        grain = speed * c.per_metre if self._drives(c) and c.left > 0.0 else 0.0
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

    def _behind(self, job: Job, c: CombineState, leader: CombineState, speed: float) -> list[float]:
        """Times until a follower in echelon may begin its pass, or has closed up [s]."""
        gap, lag = job.gap(leader, c), job.file.team.lag_m
        if c.phase == "hold":
            moves = leader.speed > 0.0 and math.isfinite(gap)
            return [max(lag - gap, 0.0) / leader.speed] if moves else []
        closing = speed - leader.speed
        return [(gap - lag) / closing] if closing > 0.0 and gap > lag else []


def _lost(loses: tuple[float, float, float], job: Job, combine: CombineState | None = None) -> float:
    """Time that a way takes longer among others [s]. combine: that drives there, or is driven to"""
    alone, by_combine, by_cart = loses
    others = len([c for c in job.combines if c is not combine and c.phase != "done"])
    return alone + by_combine * others + by_cart * max(len(job.carts) - 1, 0)


@dataclass
class _Riding:
    """A ride with what it wants: speed [m/s] and way left [m] at a time from now [s], and what follows."""

    ride: Ride
    wanted: Callable[[float], float]
    left: Callable[[float], float]
    arrive: Callable[[float], None] | None
