"""A machine driven along a path, without sensors: rolling wheels, speed loop and steering servo.

The equations are those of the levels `motion: kinematic` and `steering: actuator` (without its dead band), in
plain numbers, and the law that of `steer: station`: with e the distance to the path on the left and theta its
direction against the machine, both as they will be when the steering answers,

    curvature = kappa + e / d^2 + 1.8 theta / d.
"""

import copy
import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

from swath.job.path import Path, Pose, ahead_of
from swath.machine.loops import SpeedLoop, approach
from swath.machine.machine_sheet import MachineSheet, dynamics_of

DAMPING = 0.9
STEEPEST = math.sin(math.radians(30.0))  # towards a path far aside
LOOKAHEAD = (3.0, 1.5)  # m, s: an error dies out over the greater of the two
SLANT, SLANT_ON_WAY = 0.1, 0.25  # sideways per way, over to a line beside a path; of one on its way elsewhere
MARGIN = 1.15  # curvature beyond that of the tightest turn, to come back to a path


class DrivenMachine:
    """A machine's pose, speed and steering angle, moved by curvature and speed commands."""

    def __init__(self, sheet: MachineSheet, start: Pose, dt: float) -> None:
        dynamics = dynamics_of(sheet)
        self.sheet, self.dt = sheet, dt
        self.x, self.y, self.heading = start
        self.speed, self.angle, self.distance = 0.0, 0.0, 0.0
        self._loop = SpeedLoop(dynamics)
        self._rate, self._lag = dynamics.steer_rate, dynamics.steer_lag
        late = round(dynamics.steer_dead_time / dt)
        self.delay = late * dt + self._lag
        self._queue: deque[float] = deque([0.0] * late)
        trailer = sheet.trailer
        self._drawbar = trailer.drawbar if trailer else 0.0
        self._hitch = trailer.hitch_x if trailer else 0.0
        self.trailer = start.heading
        self._pin = self._pin_now()

    @property
    def pose(self) -> Pose:
        """Where it stands: the middle of its fixed axle."""
        return Pose(self.x, self.y, self.heading)

    @property
    def curvature(self) -> float:
        """Of the path that it drives now [1/m]."""
        return math.tan(self.angle) / self.sheet.wheelbase

    def copied(self) -> "DrivenMachine":
        """Another one that is where this one is."""
        made = copy.copy(self)
        made._queue = self._queue.copy()
        return made

    def set_down(self, pose: Pose, trailer: float) -> None:
        """At rest at a pose, wheels straight. trailer: its heading [rad]"""
        self.x, self.y, self.heading = pose
        self.speed, self.angle, self.trailer = 0.0, 0.0, trailer
        self._queue = deque([0.0] * len(self._queue))
        self._pin = self._pin_now()

    def pull_to(self, pose: Pose) -> None:
        """Moved to a pose near by, the trailer behind it."""
        self.x, self.y, self.heading = pose
        if self._drawbar > 0.0:
            self._pull()

    def step(self, curvature: float, speed: float) -> None:
        """Drive one step towards a curvature [1/m] and a speed [m/s]."""
        dt, base = self.dt, self.sheet.wheelbase
        most = self.sheet.max_steer
        self._queue.append(min(max(math.atan(base * curvature), -most), most))
        self.angle, _ = approach(self.angle, self._queue.popleft(), dt, lag=self._lag, limit=self._rate)
        self.speed, way = self._loop.advance(self.speed, speed, dt)
        turn = way * math.tan(self.angle) / base
        half = 0.5 * turn
        chord = way * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
        self.x += chord * math.cos(self.heading + half)
        self.y += chord * math.sin(self.heading + half)
        self.heading += turn
        self.distance += way
        if self._drawbar > 0.0:
            self._pull()

    def _pin_now(self) -> tuple[float, float]:
        return self.x + self._hitch * math.cos(self.heading), self.y + self._hitch * math.sin(self.heading)

    def _pull(self) -> None:
        """The trailer follows its pin (tractrix, see `machine.towing`)."""
        px, py = self._pin_now()
        dx, dy = px - self._pin[0], py - self._pin[1]
        way = math.hypot(dx, dy)
        self._pin = px, py
        if way > 0.0:
            bend = self.trailer - math.atan2(dy, dx)
            bend = math.atan2(math.sin(bend), math.cos(bend))
            left = 2.0 * math.atan(math.tan(0.5 * bend) * math.exp(-way / self._drawbar))
            self.trailer += left - bend


@dataclass
class Follower:
    """Keeps a machine on a path. tightest: curvature it may command [1/m]; at: how far it has come [m]

    heading: of the path there [rad]; aside: how far left of the path it is to drive [m], and does, shifted;
    slant: sideways per way, over to there
    """

    path: Path
    tightest: float
    at: float = 0.0
    heading: float = 0.0
    aside: float = 0.0
    shifted: float = 0.0
    slant: float = SLANT
    _index: int = 0

    def __post_init__(self) -> None:
        """Plain lists are looked up some times faster than arrays."""
        p = self.path
        self._x, self._y = p.points[:, 0].tolist(), p.points[:, 1].tolist()
        self._h: list[float] = p.heading.tolist()
        self._k: list[float] = p.curvature.tolist()
        self._s: list[float] = p.distance.tolist()

    @property
    def index(self) -> int:
        """Of the piece of the path that it is on."""
        return self._index

    @property
    def is_done(self) -> bool:
        """True at the end of the path."""
        return self.at >= self._s[-1] - 1e-6

    def back(self, way: float) -> None:
        """So far back along the path [m]."""
        self.at = max(0.0, self.at - way)
        self._index = max(0, min(bisect_right(self._s, self.at) - 1, len(self._s) - 2))

    def curvature(self, machine: DrivenMachine) -> float:
        """The command for now [1/m]; moves on along the path."""
        speed = machine.speed
        way = speed * machine.delay
        bend = machine.curvature * way
        x = machine.x + way * math.cos(machine.heading + 0.5 * bend)
        y = machine.y + way * math.sin(machine.heading + 0.5 * bend)
        i, along = self._nearest(x, y)
        before, self.at = self.at, max(self.at, min(self._s[i] + along - way, self._s[-1]))
        most = self.slant * (self.at - before)
        self.shifted += min(max(self.aside - self.shifted, -most), most)
        span = max(self._s[i + 1] - self._s[i], 1e-9)
        share = min(max(along / span, 0.0), 1.0)
        heading: float = self._h[i] + share * (self._h[i + 1] - self._h[i])
        self.heading = heading
        kappa = self._k[i] + share * (self._k[i + 1] - self._k[i])
        px, py = self._x[i] + along * math.cos(heading), self._y[i] + along * math.sin(heading)
        left = (py - y) * math.cos(heading) - (px - x) * math.sin(heading) + self.shifted
        theta = heading - machine.heading - bend
        theta = math.atan2(math.sin(theta), math.cos(theta))
        d = max(LOOKAHEAD[0], LOOKAHEAD[1] * speed)
        steep = 2.0 * DAMPING * d * STEEPEST
        left = min(max(left, -steep), steep)
        wanted = kappa + left / (d * d) + 2.0 * DAMPING * theta / d
        return float(min(max(wanted, -self.tightest), self.tightest))

    def _nearest(self, x: float, y: float) -> tuple[int, float]:
        """Index of the piece of the path abreast of a place, searched onward, and how far along it [m]."""
        i = self._index
        last = len(self._s) - 2
        while True:
            ax, ay = self._x[i], self._y[i]
            dx, dy = self._x[i + 1] - ax, self._y[i + 1] - ay
            span = math.hypot(dx, dy)
            along = ((x - ax) * dx + (y - ay) * dy) / max(span, 1e-9)
            if along <= span or i >= last:
                break
            i += 1
        self._index = i
        return i, along


def knife_pose(machine: DrivenMachine, ahead: float) -> Pose:
    """Where a knife is that is so far ahead of the fixed axle [m]."""
    return ahead_of(machine.pose, ahead)


def first_cut(machine: DrivenMachine, ahead: float, start: Pose) -> Pose:
    """Where a knife begins to cut: at the start of its pass where the last step led beyond it."""
    x, y, heading = knife_pose(machine, ahead)
    c, s = math.cos(heading), math.sin(heading)
    back = min(max((x - start.x) * c + (y - start.y) * s, 0.0), machine.speed * machine.dt)
    return Pose(x - back * c, y - back * s, heading)
