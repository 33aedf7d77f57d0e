"""A driven machine with its path, its bodies, and where it has come from."""

import copy
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.job.drive import DrivenMachine, Follower
from swath.job.footprint import footprint_of
from swath.job.path import Path, Pose
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import MachineSheet, dynamics_of

Array = NDArray[np.float64]
Place = tuple[Pose, float]  # of the fixed axle, heading of the trailer [rad]
SHARP = 0.35  # rad between a path and a machine, beyond which it drives slowly
SLOW = 2.0  # m/s
SPACING = 0.25  # m between two places of a trail
TRAIL = 240  # places of a trail
APART, CLOSER, SLOWLY = 0.6, 0.15, 1.0  # m between two places of a braking way; below so many m/s
CRAWL = 0.3  # m/s, below which the rest of a braking way is straight on
MOST = 200  # steps of a braking way
STANDS = 50  # steps after which a manoeuvre is over that the traffic does not let go on


@dataclass
class Manoeuvre:
    """How a machine makes room. back: way that it still backs up [m]; path: that it drives then; other: for
    whom; since: time [s]; ground: that it needs for that, boxes; waits: until that one is past

    drives: along the path; is_there: at its end; tightest: curvature [1/m]; stands: steps, while it drives
    apart: places on the path whose boxes the ground begins with [m]
    """

    back: float
    path: Path | None
    other: str
    since: float
    ground: Array
    waits: bool = True
    is_there: bool = False
    drives: bool = False
    tightest: float = 0.14
    stands: int = 0
    apart: float = 1.5

    def give_up(self) -> None:
        """On along the own way from here."""
        self.back, self.path, self.drives, self.waits, self.is_there = 0.0, None, False, False, True


class Driver:
    """A machine on its path. limits: highest speed at each point of the path [m/s]; cap: that the traffic
    lets it drive [m/s]; blocked: by whom it is stopped; held: ground that it needs to come to rest, boxes as
    `Footprint.sweep`; is_new: a path that the traffic has not seen; farthest: that it was on it [m];
    tried: when it set out behind its last pass [s]
    """

    def __init__(self, sheet: MachineSheet, start: Pose, dt: float) -> None:
        self.machine, self.footprint = DrivenMachine(sheet, start, dt), footprint_of(sheet)
        self.follower: Follower | None = None
        self.limits: list[float] = []
        self.manoeuvre: Manoeuvre | None = None
        self.farthest, self.is_new, self.tried = 0.0, False, -math.inf
        self._last: Follower | None = None  # the path before, until the traffic lets it drive the new one
        self.cap, self.blocked = math.inf, ""
        self.held: Array = self.footprint.sweep([self.place])
        self._loop = SpeedLoop(dynamics_of(sheet))
        self._trail: deque[tuple[float, float, float, float]] = deque(maxlen=TRAIL)

    @property
    def place(self) -> Place:
        """Where it is."""
        return self.machine.pose, self.machine.trailer

    @property
    def left(self) -> float:
        """Way to the end of its path [m]."""
        return 0.0 if self.follower is None else max(0.0, self.follower.path.length - self.follower.at)

    @property
    def limit(self) -> float:
        """Highest speed at this point of the path [m/s]."""
        return math.inf if self.follower is None else self.limits[self.follower.index]

    def take(self, path: Path, tightest: float, limits: list[float] | None = None) -> None:
        """A path to drive from now on. tightest: curvature that it may steer [1/m]"""
        if self._last is None and self.machine.speed > 0.0:
            self._last = self.follower
        self.is_new, self.follower = True, Follower(path, tightest)
        self.limits = limits if limits is not None else [math.inf] * len(path.distance)
        self.manoeuvre, self.farthest = None, 0.0

    def put(self, pose: Pose) -> None:
        """Set down at rest."""
        self.machine.set_down(pose, pose.heading)
        self._trail.clear()

    def step(self, wanted: float) -> None:
        """One step along the path at a speed [m/s] that limits and traffic allow."""
        follower, machine = self.follower, self.machine
        assert follower is not None
        if self.cap <= 0.0 and self._last is not None:
            follower = self._last
        self._drive(machine, follower, min(wanted, self.cap))
        last = self._trail[-1] if self._trail else (math.inf, 0.0)
        if math.hypot(machine.x - last[0], machine.y - last[1]) >= SPACING:
            self._trail.append((machine.x, machine.y, machine.heading, machine.trailer))

    def _drive(self, machine: DrivenMachine, follower: Follower, wanted: float) -> None:
        curvature = follower.curvature(machine)
        if follower is self.follower:
            wanted = min(wanted, self.limits[follower.index])
        off = math.remainder(follower.heading - machine.heading, 2.0 * math.pi)
        machine.step(curvature, min(wanted, SLOW) if abs(off) > SHARP else wanted)

    def let(self, cap: float, by: str = "") -> None:
        """What the traffic allows: the highest speed [m/s], and who stops it."""
        self.cap, self.blocked, self.is_new = cap, by, False
        if not by:
            self._last = None

    def braking_way(self, speed: float) -> float:
        """Way from a speed [m/s] to rest [m]."""
        return self._loop.advance(speed, 0.0, 100.0)[1]

    def until_rest(self, wanted: float, steps: int) -> list[Place]:
        """Its places when it drives at a wanted speed [m/s] for so many steps and brakes then."""
        machine = self.machine
        found = [(machine.pose, machine.trailer)]
        if self.follower is None or (wanted <= 0.0 and machine.speed < 0.01):
            return found
        along = self._last if wanted <= 0.0 and self._last is not None else self.follower
        machine, follower = machine.copied(), copy.copy(along)
        x, y = machine.x, machine.y
        apart = CLOSER if machine.speed < SLOWLY else APART
        for i in range(MOST):
            slow = i >= steps and machine.speed < CRAWL
            if slow:
                machine.dt = 20.0 * machine.dt
            self._drive(machine, follower, wanted if i < steps else 0.0)
            if slow or math.hypot(machine.x - x, machine.y - y) >= apart:
                x, y = machine.x, machine.y
                found.append((machine.pose, machine.trailer))
            if slow:
                break
        return found

    def ahead(self, lengths: list[float]) -> list[Place]:
        """Its places after so many metres of its path, the trailer where the path was."""
        if self.follower is None:
            return []
        path, at, drawbar = self.follower.path, self.follower.at, self.footprint.drawbar
        left, found = self.follower.aside, []
        for s in lengths:
            x, y, h = path.at(at + s)
            if left:
                x, y = x - left * math.sin(h), y + left * math.cos(h)
            found.append(
                (Pose(x, y, h), path.at(at + s - drawbar).heading if s > drawbar else self.machine.trailer)
            )
        return found

    @property
    def room_speed(self) -> float:
        """Speed that it wants forwards in a manoeuvre [m/s]."""
        made = self.manoeuvre
        return 0.0 if made is None or made.back > 0.0 or made.is_there else min(SLOW, 0.3 + 0.4 * self.left)

    def make_room(self, way: float) -> float:
        """One step of its manoeuvre, backwards by a way at most [m]; returns how far it came [m]."""
        made = self.manoeuvre
        assert made is not None
        if made.back > 0.0:
            self.machine.speed = 0.0
            gone = self.back(min(way, made.back))
            made.back = made.back - gone if gone > 0.0 else 0.0
            return gone
        if made.path is not None:
            path, made.path = made.path, None
            made.ground = made.ground[: self.footprint.count * (math.ceil(path.length / made.apart) + 1)]
            self.take(path, made.tightest)
            self.manoeuvre, made.drives = made, True
            return 0.0  # until the traffic lets it
        made.stands = made.stands + 1 if self.machine.speed < 0.02 else 0
        if made.drives and self.left > 0.3 and made.stands < STANDS:
            self.step(self.room_speed)
            return self.machine.speed * self.machine.dt
        made.waits = made.waits and made.stands < STANDS
        self.machine.speed, made.is_there = 0.0, True
        return 0.0

    @property
    def room_ground(self) -> Array | None:
        """Ground of its manoeuvre that is still to be driven over, boxes; None where it drives none."""
        made = self.manoeuvre
        if made is None or made.is_there:
            return None
        if not made.drives or self.follower is None:
            return made.ground
        past = self.footprint.count * max(0, int(self.follower.at / made.apart) - 1)
        return made.ground[past:] if past < len(made.ground) else None

    def behind(self, way: float) -> list[Place]:
        """Its places on the last metres of its way, the latest first; its trailer comes back over them."""
        return [(Pose(x, y, h), t) for x, y, h, t in list(self._trail)[: -1 - round(way / SPACING) : -1]]

    def back(self, way: float) -> float:
        """Back over its own tracks by a way [m]; returns how far it came, 0 at their begin."""
        gone = 0.0
        while self._trail and gone < way:
            x, y, heading, trailer = self._trail.pop()
            gone += math.hypot(self.machine.x - x, self.machine.y - y)
            self.machine.set_down(Pose(x, y, heading), trailer)
        if self.follower is not None:
            self.farthest = max(self.farthest, self.follower.at)
            self.follower.back(gone)
        return gone
