"""A kinematic rear-steered machine with an actuator and a stamped, noisy, late edge: the law's test bench."""

import math
from dataclasses import dataclass, field

import numpy as np

from swath.control.steer.preview import Params, Preview
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry
from swath.signals.setup import ControlSetup, MachineGeometry

MACHINE = MachineGeometry(
    wheelbase=3.9,
    front_track=2.95,
    rear_track=2.8,
    max_steer=np.deg2rad(42),
    header_width=12.0,
    knife_x=4.0,
    header_y=0.0,
    header_height=0.9,
    header_depth=1.2,
    body=(-5.0, 1.5, 1.6, 0.5, 3.9),
)


def setup_of(side="left", period=0.04, mounting=None):
    return ControlSetup(MACHINE, {"scan": mounting or Pose.identity()}, side, period)


class Course:
    """An edge in the world: straight along +x, from `bend_at` on a circle of `radius` (> 0 left)."""

    def __init__(self, radius=np.inf, bend_at=0.0, y=0.0):
        self.radius, self.bend_at, self.y = radius, bend_at, y

    def frame(self, x, y):
        """(signed distance to the left of the edge, heading, curvature, s) at the nearest edge point."""
        if not math.isfinite(self.radius) or x < self.bend_at:
            return y - self.y, 0.0, 0.0, x
        dx, dy = x - self.bend_at, y - self.y - self.radius
        r, sign = abs(self.radius), math.copysign(1.0, self.radius)
        angle = math.atan2(dx, -sign * dy)
        return sign * (r - math.hypot(dx, dy)), sign * angle, 1.0 / self.radius, self.bend_at + r * angle

    def left_of(self, x, y):
        """Signed distances [m] to the left of the edge, for arrays."""
        straight = y - self.y
        if not np.isfinite(self.radius):
            return straight
        r, sign = abs(self.radius), np.sign(self.radius)
        bent = sign * (r - np.hypot(x - self.bend_at, y - self.y - self.radius))
        return np.where(x < self.bend_at, straight, bent)

    def seen_from(self, pose, reference_x):
        """(offset, heading, curvature) in the machine frame at reference_x."""
        x, y, psi = pose
        c, s = math.cos(psi), math.sin(psi)
        offset = 0.0
        for _ in range(60):
            wx, wy = x + c * reference_x - s * offset, y + s * reference_x + c * offset
            left, heading, curvature, _ = self.frame(wx, wy)
            offset -= left / max(0.3, math.cos(heading - psi))
            if abs(left) < 1e-7:
                break
        return offset, heading - psi, curvature


@dataclass
class Loop:
    speed: float = 7 / 3.6
    side: str = "left"
    course: Course = field(default_factory=Course)
    params: Params = field(default_factory=Params)
    start_error: float = 0.0
    noise: float = 0.03
    heading_noise: float = 0.003
    delay: float = 0.1
    crab: float = 0.0
    curvature_known: bool = True
    edge_lost: tuple = (1e9, 1e9)
    reference_x: float = 8.0
    seed: int = 1
    sense: object = None
    law_params: object = None
    law: object = Preview

    def run(self, distance):
        """Rows (travelled [m], error of the header end to its target [m], curvature command, engaged)."""
        period, fine, wheelbase, most = 0.04, 0.005, MACHINE.wheelbase, math.radians(15)
        setup = setup_of(self.side, period)
        law = self.law(self.law_params or self.params, setup)
        law.reset(Stream(1, "steer"))
        a, b = setup.machine.header_end(self.side)
        out = 1.0 if self.side == "left" else -1.0
        target = out * self.params.overlap_m
        x, y, psi = 0.0, self.course.y - b + target + self.start_error, 0.0
        angle, travelled, t = 0.0, 0.0, 0
        commands = [0.0] * round(0.15 / fine)
        poses, rows = [], []
        rng = np.random.default_rng(self.seed)
        command, yaw_rate = 0.0, 0.0
        while travelled < distance:
            poses.append((x, y, psi))
            if self.sense is None:
                edge = self._edge(t, poses, period, travelled, rng)
            else:
                edge = self.sense(t, (x, y, psi), self.speed, yaw_rate)
            odometry = Odometry(t, self.speed, yaw_rate, angle)
            output = law.step(
                t - round(period * 1e9), round(period * 1e9), {"edge": edge, "odometry": odometry}
            )
            command = output["command"].curvature
            for _ in range(round(period / fine)):
                commands.append(math.atan(command * wheelbase))
                angle += min(max((commands.pop(0) - angle) / 0.2, -most), most) * fine
                yaw_rate = self.speed * math.tan(angle) / wheelbase
                psi += yaw_rate * fine
                x += self.speed * math.cos(psi + self.crab) * fine
                y += self.speed * math.sin(psi + self.crab) * fine
            t += round(period * 1e9)
            travelled += self.speed * period
            c, s = math.cos(psi), math.sin(psi)
            end = x + c * a - s * b, y + s * a + c * b
            left = self.course.frame(*end)[0]
            rows.append((travelled, left - target, command, output["command"].is_engaged))
        return np.array(rows, dtype=float)

    def _edge(self, t, poses, period, travelled, rng):
        late = round(self.delay / period)
        old = poses[max(0, len(poses) - 1 - late)]
        offset, heading, curvature = self.course.seen_from(old, self.reference_x)
        lost = self.edge_lost[0] < travelled < self.edge_lost[1]
        return CropEdge(
            t=max(0, t - round(late * period * 1e9)),
            offset=np.nan if lost else offset + self.noise * rng.standard_normal(),
            heading=np.nan if lost else heading + self.heading_noise * rng.standard_normal(),
            curvature=curvature if self.curvature_known else 0.0,
            reference_x=self.reference_x,
            confidence=0.0 if lost else 0.9,
            crop_height=0.85,
            stubble_height=0.15,
        )
