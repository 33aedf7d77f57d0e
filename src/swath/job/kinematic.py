"""Machines that are driven in steps along their paths: rolling wheels, steering servo, speed loop, trailers.

A combine drives its pass, turns along the clothoid path, slows down and speeds up as its drive can. A cart
drives over the headland to the start of the combine's pass and catches up on its left, under the pipe. No
sensors: places are the true ones. Corners of opening rounds, where a combine reverses, take their time
standing, and the machine is set on the next side.
"""

import math

import numpy as np
from numpy.typing import NDArray

from swath.job import truck
from swath.job.cart_ways import (
    IN_PLACE,
    NEAR,
    RADIUS,
    corner_way,
    rounded,
    speed_beside,
    speed_limits,
    speed_to_end,
)
from swath.job.combine_ways import axle_pose, corner_angle, is_far, way_to_pass
from swath.job.combine_ways import speed_limits as combine_limits
from swath.job.contact import ContactWatch
from swath.job.drive import MARGIN, DrivenMachine, Follower
from swath.job.engine import Job
from swath.job.footprint import Footprint, footprint_of
from swath.job.give_way import MOVES, Traffic, must_stop
from swath.job.machines import REVERSE
from swath.job.path import Path, Pose, polyline
from swath.job.states import DONE, CartState, CombineState, at

Array = NDArray[np.float64]
STEP = 0.2  # s
SHARP = 0.35  # rad between a path and a machine, beyond which it drives slowly
SLOW = 2.0  # m/s
STOPS, CREEP = 0.25, 0.1  # 1/s, m/s: to the start of a pass whose leader in echelon is too near ahead
THERE = 0.05  # m before the end of a combine's way, where it is done
LOOKS = 3  # steps after which a cart looks again whether it has to give way
RECORD = 5  # steps between two points of a combine's track


class Kinematic:
    """The motion of the level without sensors. tracks: of knives while cutting, (x, y, heading) rows."""

    def __init__(self) -> None:
        self._machines: dict[str, DrivenMachine] = {}
        self._paths: dict[str, Follower] = {}
        self._wait: dict[str, float] = {}
        self._back: dict[str, float] = {}
        self._stops: dict[str, bool] = {}
        self._base: dict[str, float] = {}
        self._length: dict[str, float] = {}
        self._profiles: dict[str, list[float]] = {}
        self._count = 0
        self.tracks: list[list[tuple[float, float, float]]] = []
        self._track: dict[str, list[tuple[float, float, float]]] = {}
        self.largest_error = 0.0
        self.watch = ContactWatch()
        self._footprints: dict[str, Footprint] = {}

    def combine_way(self, job: Job, combine: CombineState) -> None:
        """A corner, or a driven turn."""
        task, name = combine.task, combine.spec.name
        assert task is not None
        knife = combine.spec.sheet.knife_x
        self._wait.pop(name, None)
        if name not in self._machines:
            self._machines[name] = DrivenMachine(combine.spec.sheet, axle_pose(combine.place, knife), STEP)
        if job.time <= 0.0:
            self._begin(job, combine)
            return
        turned = corner_angle(combine.place, task)
        if turned is not None:
            self._wait[name] = combine.spec.corner_time(turned)
            self._back[name] = combine.spec.corner_back(turned)
            combine.left, combine.pace = combine.spec.corner_path(turned), 0.0
            return
        far = is_far(combine.place, task.start)
        combine.state = "transport" if far else "turn"
        combine.pace = combine.spec.transport if far else combine.spec.turn_speed
        machine = self._machines[name]
        combine.place = _knife(machine, knife)
        path = way_to_pass(combine.spec, machine.pose, task.start)
        self._profiles[name] = combine_limits(combine.spec, path, far=far).tolist()
        self._paths[name] = Follower(path, MARGIN / combine.spec.limits.radius)
        combine.left = path.length
        job.ways.append(path.points)

    def _begin(self, job: Job, combine: CombineState) -> None:
        """Set down before its first pass."""
        assert combine.task is not None
        name, knife = combine.spec.name, combine.spec.sheet.knife_x
        combine.left = job.start_behind(combine)
        self._put(name, axle_pose(combine.task.start, knife + combine.left))
        if combine.left > 0.0:
            combine.pace = combine.spec.turn_speed
            goal = axle_pose(combine.task.start, knife)
            path = polyline(np.array([self._machines[name].pose[:2], goal[:2]]))
            self._profiles[name] = [combine.pace] * len(path.distance)
            self._paths[name] = Follower(path, MARGIN / combine.spec.limits.radius)

    def begin_cut(self, job: Job, combine: CombineState) -> None:
        """Along the pass, and its cart to it."""
        task, name = combine.task, combine.spec.name
        assert task is not None
        knife = combine.spec.sheet.knife_x
        if name in self._wait:
            self._put(name, axle_pose(task.start, knife))
        start, end = axle_pose(task.start, knife), task.end
        beyond = (end.x + 20.0 * math.cos(end.heading), end.y + 20.0 * math.sin(end.heading))
        path = polyline(np.array([start[:2], *task.line[:-1].tolist(), end[:2], beyond]), 5.0)
        self._paths[name] = Follower(path, MARGIN / combine.spec.limits.radius)
        self._track[name] = [_begin(self._machines[name], knife, task.start)]
        self.tracks.append(self._track[name])

    def combine_to(self, job: Job, combine: CombineState, goal: Pose) -> None:
        """Without carts: to the truck or back, along straight lines over headland and passes."""
        machine = self._machines[combine.spec.name]
        path = rounded(corner_way(machine.pose, Pose(goal.x, goal.y, machine.heading)), machine.pose, 8.0)
        self._paths[combine.spec.name] = Follower(path, MARGIN / combine.spec.limits.radius)
        combine.left, combine.pace = path.length, combine.spec.transport

    def cart_to_combine(self, job: Job, cart: CartState) -> None:
        """Over the headland to the start of the pass, and along it on its left."""
        combine = cart.combine
        assert combine is not None
        machine = self._cart(cart)
        path, begin, length = job.way_to_combine(cart, machine.pose)
        name = cart.spec.name
        self._set_out(cart, path)
        self._base[name], self._length[name] = begin, length
        cart.left = self._gap(cart, combine)

    def cart_to_truck(self, job: Job, cart: CartState) -> None:
        """Back over pass and headland."""
        path = job.way_to_truck(cart, self._cart(cart).pose)
        self._set_out(cart, path)
        cart.left, cart.place = path.length, path.end

    def _set_out(self, cart: CartState, path: Path) -> None:
        self._paths[cart.spec.name] = Follower(path, MARGIN / RADIUS)
        self._profiles[cart.spec.name] = speed_limits(path, cart.spec).tolist()

    def move(self, job: Job) -> float:
        """One step of all machines."""
        self._count += 1
        self._look(job)
        for c in job.combines:
            self._drive_combine(job, c)
        for k in job.carts:
            self._drive_cart(job, k)
        return STEP

    def _look(self, job: Job) -> None:
        """Hold the bodies of all machines against each other."""
        sheets = {c.name: c.sheet for c in job.fleet.combines} | {k.name: k.sheet for k in job.fleet.carts}
        places = {name: (m.pose, m.trailer) for name, m in self._machines.items()}
        if job.carts and job.away <= DONE:
            sheets[truck.NAME] = job.fleet.truck
            x, y, course = job.places[0]  # the truck is on the field's side of the first lane
            stands = truck.truck_pose(Pose(x, y, course + math.pi), job.fleet.truck)
            places[truck.NAME] = stands, stands.heading
        for name, sheet in sheets.items():
            if name not in self.watch:
                self._footprints[name] = footprint_of(sheet)
                self.watch.add(name, self._footprints[name])
        self.watch.look(job.time, STEP, places)

    def _drive_combine(self, job: Job, c: CombineState) -> None:
        name = c.spec.name
        machine, follower = self._machines[name], self._paths.get(name)
        if name in self._wait and c.phase in ("way", "hold"):
            self._wait[name] -= STEP
            machine.speed, c.speed = 0.0, 0.0
            self._reverse(name)
            c.left = 0.0 if self._wait[name] <= DONE else c.left
            return
        if follower is None or c.phase == "done":
            c.speed = 0.0
            return
        before = follower.at
        pace = c.pace if c.phase in ("way", "cut", "haul", "back") else 0.0
        leader = job.leader_of(c)
        if leader is not None and c.phase == "cut":
            pace = min(pace, max(leader.speed + 0.2 * (job.gap(leader, c) - job.file.team.lag_m), 0.0))
        if c.phase == "way":
            pace = min(pace, self._profiles[name][follower.index])
            if leader is not None and _ahead_of_start(leader, c) < job.file.team.lag_m:
                pace = min(pace, max(STOPS * (follower.path.length - follower.at), CREEP))
        if c.phase in ("haul", "back") and c.left < 12.0:
            pace = min(pace, max(0.25 * c.left, 0.3))
        machine.step(follower.curvature(machine), pace)
        c.speed, way = machine.speed, follower.at - before
        c.way += machine.speed * STEP
        if c.phase in ("cut", "stand") and c.task is not None and c.left > 0.0 and not c.hauling:
            cut = min(way, c.left)
            job.cut_now[c.number] = cut
            c.left = max(0.0, c.left - cut)
            self._note(c, machine)
        elif c.phase in ("way", "haul", "back"):
            c.left = max(0.0, follower.path.length - follower.at)
            c.left = 0.0 if c.left < (THERE if c.phase == "way" else NEAR) else c.left
        if c.phase == "hold":
            c.speed = 0.0

    def _note(self, c: CombineState, machine: DrivenMachine) -> None:
        """Remember where the knife cuts."""
        if self._count % RECORD == 0 or c.left <= 0.0:
            x, y, heading = _knife(machine, c.spec.sheet.knife_x)
            self._track[c.spec.name].append((x, y, heading))

    def _drive_cart(self, job: Job, k: CartState) -> None:
        name = k.spec.name
        machine, follower = self._cart(k), self._paths.get(name)
        wanted = 0.0
        if follower is not None and k.phase == "to_truck":
            wanted = speed_to_end(k.left, k.spec)
        elif follower is not None and k.phase in ("to_combine", "beside") and k.combine is not None:
            gap = self._gap(k, k.combine)
            pace = k.combine.pace if k.combine.phase == "cut" else 0.0
            wanted = speed_beside(gap, k.combine.speed, pace, k.spec)
            if k.phase == "beside" and k.combine.is_pouring:
                self.largest_error = max(self.largest_error, abs(gap))
        if follower is None or (wanted <= 0.0 and machine.speed < 0.01):
            k.speed = machine.speed = 0.0
            return
        curvature = follower.curvature(machine)
        wanted = min(wanted, self._profiles[name][follower.index])
        if self._count % LOOKS == 0:
            self._stops[name] = self._gives_way(job, k)
        if self._stops.get(name, False):
            wanted = 0.0
        off = math.remainder(follower.heading - machine.heading, 2.0 * math.pi)
        machine.step(curvature, min(wanted, SLOW) if abs(off) > SHARP else wanted)
        k.speed = machine.speed
        k.way += k.speed * STEP
        if k.phase == "to_truck":
            k.left = max(0.0, follower.path.length - follower.at)
            k.left = 0.0 if k.left < NEAR or follower.is_done else k.left
        elif k.phase == "to_combine" and k.combine is not None:
            gap = self._gap(k, k.combine)
            k.left = 0.0 if abs(gap) < IN_PLACE or follower.is_done else abs(gap)

    def _gives_way(self, job: Job, k: CartState) -> bool:
        """Whether a cart stops before what others drive over next; beside its combine it does not."""
        if k.phase == "beside" and k.combine is not None and k.combine.phase in ("cut", "stand"):
            return False
        others = []
        for c in job.combines:
            name = c.spec.name
            if c.phase == "way" and name in self._wait:
                others.append(Traffic(self._machines[name], self._footprints[name], None, 0.0))
            elif c.phase in ("way", "cut") and c.speed > MOVES:
                others.append(
                    Traffic(self._machines[name], self._footprints[name], self._paths[name], c.speed)
                )
        for other in job.carts[: job.carts.index(k)]:
            name = other.spec.name
            if other.speed > MOVES:
                follower = self._paths.get(name)
                others.append(Traffic(self._machines[name], self._footprints[name], follower, other.speed))
        name = k.spec.name
        own = Traffic(self._machines[name], self._footprints[name], self._paths[name], 0.0)
        return must_stop(own, others)

    def _gap(self, cart: CartState, combine: CombineState) -> float:
        """How far a cart's box is behind the pipe, along its path [m]."""
        follower = self._paths[cart.spec.name]
        if combine.task is None:  # at the end of its last pass
            done = self._length[cart.spec.name]
        else:
            done = (combine.task.length - combine.left) * self._length[cart.spec.name] / combine.task.length
        if combine.phase in ("way", "hold"):
            done = 0.0
        return self._base[cart.spec.name] + done - follower.at

    def _cart(self, k: CartState) -> DrivenMachine:
        name = k.spec.name
        if name not in self._machines:
            self._machines[name] = DrivenMachine(k.spec.sheet, k.place, STEP)
        return self._machines[name]

    def _reverse(self, name: str) -> None:
        """Out of the corner: what comes behind stands out of the way of who goes along the next side."""
        machine, way = self._machines[name], min(self._back.get(name, 0.0), REVERSE * STEP)
        machine.x -= way * math.cos(machine.heading)
        machine.y -= way * math.sin(machine.heading)
        self._back[name] = self._back.get(name, 0.0) - way

    def _put(self, name: str, pose: Pose) -> None:
        """Set a machine down at rest."""
        machine = self._machines[name]
        machine.x, machine.y, machine.heading = pose
        machine.speed = machine.angle = 0.0


def _knife(machine: DrivenMachine, ahead: float) -> Pose:
    c, s = math.cos(machine.heading), math.sin(machine.heading)
    return Pose(machine.x + ahead * c, machine.y + ahead * s, machine.heading)


def _ahead_of_start(leader: CombineState, combine: CombineState) -> float:
    """How far a leader is ahead of where the one behind it begins its pass, along that pass [m]."""
    if leader.phase in ("way", "hold") or combine.task is None:
        return -math.inf
    start, place = combine.task.start, at(leader)
    return (place.x - start.x) * math.cos(start.heading) + (place.y - start.y) * math.sin(start.heading)


def _begin(machine: DrivenMachine, ahead: float, start: Pose) -> Pose:
    """Where a knife begins to cut: at the start of its pass where the last step led beyond it."""
    x, y, heading = _knife(machine, ahead)
    c, s = math.cos(heading), math.sin(heading)
    back = min(max((x - start.x) * c + (y - start.y) * s, 0.0), machine.speed * STEP)
    return Pose(x - back * c, y - back * s, heading)
