"""Machines that are driven in steps along their paths: rolling wheels, steering servo, speed loop, trailers.

A combine drives its pass, turns along the clothoid path, slows down and speeds up as its drive can. A cart
drives over the headland to the start of the combine's pass and catches up on its left, under the pipe. No
sensors: places are the true ones. Corners of opening rounds, where a combine reverses, take their time
standing, and the machine is set on the next side.
"""

import numpy as np
from numpy.typing import NDArray

from swath.job import truck, ways
from swath.job.cart_ways import (
    IN_PLACE,
    NEAR,
    RADIUS,
    WayBeside,
    corner_way,
    rounded,
    speed_beside,
    speed_limits,
    speed_to_end,
)
from swath.job.combine_ways import axle_pose, corner_angle, is_far
from swath.job.combine_ways import speed_limits as combine_limits
from swath.job.contact import ContactWatch
from swath.job.corner import Corner, corner_of
from swath.job.drive import MARGIN, SLANT_ON_WAY, DrivenMachine, first_cut, knife_pose
from swath.job.driver import Driver, Manoeuvre
from swath.job.engine import Job
from swath.job.footprint import footprint_of
from swath.job.give_way import GiveWay, room_for
from swath.job.hand_over import hand_over
from swath.job.leave import leave
from swath.job.machines import REVERSE
from swath.job.path import Path, Pose, ahead_of, polyline
from swath.job.settle import Settle, waits_for
from swath.job.standoff import Standoff
from swath.job.states import DONE, CartState, CombineState, ahead_of_start
from swath.job.traffic import LOOKS, Mover, look, steer_aside

Array = NDArray[np.float64]
STEP = 0.2  # s
STOPS, CREEP = 0.25, 0.1  # 1/s, m/s: to the start of a pass whose leader in echelon is too near ahead
OFF = 1.0  # m before the line beside its combine, from where a cart is not held against that
STRAIGHT = 10.0  # m along that line, after which its trailer is there, too
SOON_OVER = 30.0  # m before the end of a pass, from where a cart that is not in place yet is held against it
THERE = 0.05  # m before the end of a combine's way, where it is done
AGAIN = 10  # steps after which one who made room looks again whether the other one is past
LONGEST_WAIT = 60.0  # s that it waits for that
RECORD = 5  # steps between two points of a combine's track


class Kinematic:
    """The motion of the level without sensors. tracks: of knives while cutting, (x, y, heading) rows."""

    def __init__(self) -> None:
        self._drivers: dict[str, Driver] = {}
        self._corners: dict[str, Corner] = {}
        self._left: set[str] = set()
        self._beside: dict[str, WayBeside] = {}
        self._count = 0
        self.tracks: list[list[tuple[float, float, float]]] = []
        self._track: dict[str, list[tuple[float, float, float]]] = {}
        self.largest_error = 0.0
        self.watch, self.give_way, self.settle = ContactWatch(), GiveWay(), Settle()

    def combine_way(self, job: Job, combine: CombineState) -> None:
        """A corner, or a driven turn."""
        task, spec = combine.task, combine.spec
        assert task is not None
        name, knife = spec.name, spec.sheet.knife_x
        if job.time <= 0.0:
            self._begin(job, combine)
            return
        driver = self._drivers[name]
        path, turned = ways.planned_way(job, combine), corner_angle(combine.place, task)
        if path is None and turned is not None:
            self._corners[name] = corner_of(driver, spec, turned, task.start)
            combine.left, combine.pace = spec.corner_path(turned), 0.0
            return
        far = is_far(combine.place, task.start)
        combine.state = "transport" if far else "turn"
        combine.pace = spec.transport if far else spec.turn_speed
        combine.place = knife_pose(driver.machine, knife)
        path = path or ways.way_to_pass(job, combine, driver.machine.pose)
        driver.take(path, MARGIN / spec.limits.radius, combine_limits(spec, path, far=far).tolist())
        combine.left = path.length
        job.ways.append(path.points)

    def _begin(self, job: Job, combine: CombineState) -> None:
        """Set down before its first pass."""
        assert combine.task is not None
        spec, knife = combine.spec, combine.spec.sheet.knife_x
        combine.left = job.start_behind(combine)
        here, goal = (axle_pose(combine.task.start, knife + back) for back in (combine.left, 0.0))
        driver = self._drivers[spec.name] = Driver(spec.sheet, here, STEP)
        if combine.left > 0.0:
            combine.pace = spec.turn_speed
            path = polyline(np.array([here[:2], goal[:2]]))
            driver.take(path, MARGIN / spec.limits.radius, [combine.pace] * len(path.distance))

    def begin_cut(self, job: Job, combine: CombineState) -> None:
        """Along the pass, and its cart to it."""
        task, name = combine.task, combine.spec.name
        assert task is not None
        driver, knife = self._drivers[name], combine.spec.sheet.knife_x
        if name in self._corners:
            driver.put(self._corners.pop(name).goal)
        start, end = axle_pose(task.start, knife), task.end
        path = polyline(
            np.array([start[:2], *task.line[:-1].tolist(), end[:2], ahead_of(end, 20.0)[:2]]), 5.0
        )
        driver.take(path, MARGIN / combine.spec.limits.radius)
        self._track[name] = [first_cut(driver.machine, knife, task.start)]
        self.tracks.append(self._track[name])

    def combine_to(self, job: Job, combine: CombineState, goal: Pose) -> None:
        """Without carts: to the truck or back, along straight lines over headland and passes."""
        driver = self._drivers[combine.spec.name]
        here = driver.machine.pose
        path = rounded(corner_way(here, Pose(goal.x, goal.y, here.heading)), here, 8.0)
        driver.take(path, MARGIN / combine.spec.limits.radius)
        combine.left, combine.pace = path.length, combine.spec.transport

    def cart_to_combine(self, job: Job, cart: CartState) -> None:
        """To beside the combine, and along its pass on the left."""
        assert cart.combine is not None
        way = self._beside[cart.spec.name] = ways.way_to_combine(job, cart, self._cart(cart).machine.pose)
        self._set_out(cart, way.path)
        cart.left = max(abs(self._gap(cart, cart.combine)), IN_PLACE)

    def cart_to_truck(self, job: Job, cart: CartState) -> None:
        """Back over pass and headland."""
        path = ways.way_to_truck(job, cart, self._cart(cart).machine.pose)
        self._set_out(cart, path)
        cart.left, cart.place = path.length, path.end

    def _set_out(self, cart: CartState, path: Path) -> None:
        self._cart(cart).take(path, MARGIN / RADIUS, speed_limits(path, cart.spec).tolist())

    def _cart(self, cart: CartState) -> Driver:
        name = cart.spec.name
        if name not in self._drivers:
            self._drivers[name] = Driver(cart.spec.sheet, cart.place, STEP)
        return self._drivers[name]

    def move(self, job: Job) -> float:
        """One step of all machines."""
        self._count += 1
        self._watch(job)
        if self._count % LOOKS == 1 or any(d.is_new for d in self._drivers.values()):
            self._look(job)
        for c in job.combines:
            self._drive_combine(job, c)
        for k in job.carts:
            self._drive_cart(job, k)
        return STEP

    @property
    def standoffs(self) -> list[Standoff]:
        """Of all machines, in order."""
        return self.give_way.standoffs

    def _watch(self, job: Job) -> None:
        """Hold the bodies of all machines against each other."""
        for k in job.carts:
            self._cart(k)
        places = {name: d.place for name, d in self._drivers.items()}
        for name, driver in self._drivers.items():
            if name not in self.watch:
                self.watch.add(name, driver.footprint)
        if job.carts and job.away <= DONE:
            places[truck.NAME] = truck.standing(job.places[0], job.fleet.truck)
            if truck.NAME not in self.watch:
                self.watch.add(truck.NAME, footprint_of(job.fleet.truck))
        self.watch.look(job.time, STEP, places)

    def _look(self, job: Job) -> None:
        """Who may drive on."""
        movers = [self._mover_of_combine(job, c) for c in self._in_order(job.combines) if c.phase != "done"]
        movers += [self._mover_of_cart(job, k) for k in sorted(job.carts, key=lambda k: k.phase != "beside")]
        movers += [self._mover_of_combine(job, c) for c in job.combines if c.phase == "done"]
        fixed = truck.bodies(job)
        steer_aside(movers, fixed)
        look(movers, fixed)
        machines: list[CombineState | CartState] = [*job.combines, *job.carts]
        states = {m.spec.name: m for m in machines}
        self.give_way.standoffs += self.settle.look(job.time, movers, states, fixed)
        self.give_way.look(
            job.time, movers, states, fixed, lambda name, pose: self._way_from(job, states[name], pose)
        )
        self.settle.check(job, self.standoffs)
        hand_over(job, self._drivers, self.give_way)

    def _in_order(self, combines: list[CombineState]) -> list[CombineState]:
        """Those that turn first: they stand in the way while they wait."""
        return sorted(combines, key=lambda c: (c.phase != "way" or c.spec.name in self._corners, c.number))

    def _way_from(self, job: Job, m: CombineState | CartState, pose: Pose) -> Path | None:
        """The way that a machine would drive from a place; None for one that has nothing to do."""
        if isinstance(m, CombineState):
            return ways.way_to_pass(job, m, pose) if m.phase == "way" else None
        if m.phase in ("to_combine", "beside"):
            return ways.way_to_combine(job, m, pose).path
        return ways.way_to_truck(job, m, pose) if m.phase == "to_truck" else None

    def _is_making_room(self, job: Job, m: CombineState | CartState, driver: Driver) -> bool:
        """One step of a manoeuvre; behind it on along the own way. False without one."""
        made = driver.manoeuvre
        if made is None:
            return False
        if isinstance(m, CartState) and m.phase == "beside":
            m.phase, m.left = "to_combine", 1.0
        before = m.way
        m.way += driver.make_room(REVERSE * STEP)
        m.speed = (m.way - before) / STEP
        if made.is_there and (not made.waits or self._count % AGAIN == 0):
            self._go_on(job, m, driver, made)
        return True

    def _go_on(self, job: Job, m: CombineState | CartState, driver: Driver, made: Manoeuvre) -> None:
        """Behind a manoeuvre: along the own way from where it is, when the other one is past."""
        here, waited = driver.machine.pose, job.time - made.since
        way, other = self._way_from(job, m, here), self._drivers.get(made.other)
        is_cutting = isinstance(m, CombineState) and m.phase == "cut"
        may_wait = made.waits and other is not None and waited < LONGEST_WAIT and (way or is_cutting)
        if may_wait and other is not None and not room_for(driver, way, other):
            return
        if is_cutting:
            driver.manoeuvre = None
        elif way is None:
            if driver.left > 1.0:
                self._left.discard(m.spec.name)
            driver.manoeuvre = driver.follower = None
            m.place = here
            if isinstance(m, CombineState):
                self._is_there(job, m)
        elif isinstance(m, CombineState):
            assert m.task is not None
            far = is_far(m.place, m.task.start)
            driver.take(way, MARGIN / m.spec.limits.radius, combine_limits(m.spec, way, far=far).tolist())
            m.left = way.length
        elif m.phase == "to_truck":
            self.cart_to_truck(job, m)
        else:
            self.cart_to_combine(job, m)

    def _is_there(self, job: Job, c: CombineState) -> None:
        """A combine stands at another place behind its last pass: its cart comes there."""
        c.place = knife_pose(self._drivers[c.spec.name].machine, c.spec.sheet.knife_x)
        if c.cart is not None and c.cart.phase == "to_combine":
            self.cart_to_combine(job, c.cart)

    def _mover(self, job: Job, m: CombineState | CartState, wanted: float) -> Mover:
        name = m.spec.name
        made = Mover(name, self._drivers[name], wanted, ignores=self.settle.ignores.get(name, ()))
        made.reserved = made.wished = made.driver.room_ground
        manoeuvre = made.driver.manoeuvre
        made.waits_for = waits_for(job, m, wanted) if manoeuvre is None else manoeuvre.other
        return made

    def _mover_of_combine(self, job: Job, c: CombineState) -> Mover:
        name = c.spec.name
        made = self._mover(job, c, self._wanted_of_combine(job, c))
        corner = self._corners.get(name)
        made.turns = c.phase == "way" and not (corner or made.driver.manoeuvre or job.held(c).is_held)
        if corner is not None:
            leader = job.leader_of(c)
            if leader is None or ahead_of_start(leader, c) >= job.file.team.lag_m:
                others = self._others(name, made.ignores)
                corner.ask(list(others.values()))
                made.waits_for = corner.held_by(others)
            made.wished, made.reserved = corner.wished, corner.reserved
            made.waits = corner.time <= DONE and not corner.is_granted
        return made

    def _mover_of_cart(self, job: Job, k: CartState) -> Mover:
        c, beside = k.combine, ""
        together = k.phase == "beside" and c is not None and c.phase in ("cut", "stand")
        if c is not None and c.phase in ("cut", "stand") and k.phase in ("beside", "to_combine"):
            on_line = self._to_line(k) < (OFF if together else -STRAIGHT) and (together or c.left > SOON_OVER)
            beside = c.spec.name if on_line and self._drivers[c.spec.name].manoeuvre is None else ""
        made = self._mover(job, k, self._wanted_of_cart(k))
        made.beside, made.gives_way = beside, not together
        if k.phase in ("to_combine", "to_truck"):
            made.left = k.left
        if c is not None:
            made.to, first = c.spec.name, job.held(c).by
            made.after = job.combines[first].spec.name if first >= 0 else ""
        return made

    def _wanted_of_combine(self, job: Job, c: CombineState) -> float:
        """Speed [m/s]."""
        name = c.spec.name
        driver, leader = self._drivers[name], job.leader_of(c)
        if driver.manoeuvre is not None:
            return driver.room_speed
        pace = c.pace if c.phase in ("way", "cut", "haul", "back") else 0.0
        if name in self._corners or driver.follower is None:
            return 0.0
        if c.is_pouring and c.cart is not None and self._cart(c.cart).blocked:
            return 0.0
        if leader is not None and c.phase == "cut":
            pace = min(pace, max(leader.speed + 0.2 * (job.gap(leader, c) - job.file.team.lag_m), 0.0))
        if c.phase == "way" and leader is not None and ahead_of_start(leader, c) < job.file.team.lag_m:
            pace = min(pace, max(STOPS * driver.left, CREEP))
        pace = min(pace, job.held(c).limit)
        if c.phase in ("haul", "back") and c.left < 12.0:
            pace = min(pace, max(0.25 * c.left, 0.3))
        return pace

    def _drive_combine(self, job: Job, c: CombineState) -> None:
        driver, corner = self._drivers[c.spec.name], self._corners.get(c.spec.name)
        if corner is not None and c.phase in ("way", "hold"):
            corner.step(driver, [*self._others(c.spec.name).values()], STEP)
            c.speed, c.left = 0.0, 0.0 if corner.is_over else c.left
            return
        if self._is_making_room(job, c, driver):
            return
        may_leave = self._count % AGAIN == 0 and c.spec.name not in self._left
        if may_leave and leave(job, c, self._drivers, [*truck.bodies(job).values()]) and c.phase == "done":
            self._left.add(c.spec.name)
        if driver.follower is None or (c.phase == "done" and driver.machine.speed < 0.01):
            c.speed = driver.machine.speed = 0.0
            return
        before = max(driver.follower.at, driver.farthest)
        driver.step(self._wanted_of_combine(job, c))
        c.speed, way = driver.machine.speed, max(0.0, driver.follower.at - before)
        c.way += c.speed * STEP
        if c.phase in ("cut", "stand") and c.task is not None and c.left > 0.0 and not c.hauling:
            cut = min(way, c.left)
            job.cut_now[c.number] = cut
            c.left = max(0.0, c.left - cut)
            self._note(c, driver.machine)
        elif c.phase in ("way", "haul", "back"):
            c.left = 0.0 if driver.left < (THERE if c.phase == "way" else NEAR) else driver.left
        if c.phase == "hold":
            c.speed = 0.0

    def _others(self, name: str, ignored: tuple[str, ...] = ()) -> dict[str, Array]:
        """Ground that all others hold."""
        return {n: d.held for n, d in self._drivers.items() if n != name and n not in ignored}

    def _note(self, c: CombineState, machine: DrivenMachine) -> None:
        """Remember where the knife cuts."""
        if self._count % RECORD == 0 or c.left <= 0.0:
            x, y, heading = knife_pose(machine, c.spec.sheet.knife_x)
            self._track[c.spec.name].append((x, y, heading))

    def _wanted_of_cart(self, k: CartState) -> float:
        """Speed [m/s]."""
        driver = self._cart(k)
        if driver.manoeuvre is not None or driver.follower is None:
            return driver.room_speed
        if k.phase == "to_truck":
            return speed_to_end(k.left, k.spec)
        if k.phase in ("to_combine", "beside") and k.combine is not None:
            gap, is_cutting = self._gap(k, k.combine), k.combine.phase == "cut"
            if k.phase == "to_combine":  # onto the line first, also where that leads ahead of its place
                gap = max(gap, self._to_line(k) + (2.0 * STRAIGHT if gap < -IN_PLACE and is_cutting else 0.0))
            return speed_beside(gap, k.combine.speed, k.combine.pace if is_cutting else 0.0, k.spec)
        return 0.0

    def _drive_cart(self, job: Job, k: CartState) -> None:
        driver = self._cart(k)
        machine, follower, wanted = driver.machine, driver.follower, self._wanted_of_cart(k)
        if k.phase == "beside" and k.combine is not None and k.combine.is_pouring:
            self.largest_error = max(self.largest_error, abs(self._gap(k, k.combine)))
        if self._is_making_room(job, k, driver):
            return
        if follower is None or (wanted <= 0.0 and machine.speed < 0.01):
            k.speed = machine.speed = 0.0
            if k.phase == "to_combine" and k.combine is not None and k.combine.phase == "stand":
                self.cart_to_combine(job, k)  # ahead of its place: from behind
            return
        driver.step(wanted)
        k.speed = machine.speed
        k.way += k.speed * STEP
        if k.phase == "to_truck":
            k.left = 0.0 if driver.left < NEAR or follower.is_done else driver.left
        elif k.phase == "to_combine" and k.combine is not None:
            gap = self._gap(k, k.combine)
            is_there = (abs(gap) < IN_PLACE and self._to_line(k) < OFF) or follower.is_done
            moves = self._drivers[k.combine.spec.name].manoeuvre is not None
            k.left = 0.0 if is_there and not moves else max(abs(gap), IN_PLACE)

    def _gap(self, cart: CartState, combine: CombineState) -> float:
        """How far a cart's box is behind the pipe, along its path [m]."""
        follower = self._cart(cart).follower
        assert follower is not None
        return self._beside[cart.spec.name].place(combine) - follower.at

    def _to_line(self, cart: CartState) -> float:
        """How far it still is onto the line beside its combine [m]: <= 0 there."""
        follower = self._cart(cart).follower
        assert follower is not None
        return self._beside[cart.spec.name].onto - follower.at + abs(follower.shifted) / SLANT_ON_WAY
