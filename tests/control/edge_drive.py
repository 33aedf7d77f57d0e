"""Drives a detector past a synthetic edge and compares what it says with where the edge is."""

from dataclasses import replace

import numpy as np

from swath.control.edge.otsu import Otsu, Params
from swath.core.random import Stream
from swath.signals import CropFlow, Inertial, Odometry
from tests.control.closed_loop import MACHINE, Course, setup_of
from tests.control.synthetic_edge import Scanner, Stand, mounting

PERIOD, SPEED = 40_000_000, 2.0


class EdgeSensor:
    """Scanner and detector on one machine: call with a pose, get the edge."""

    def __init__(
        self, course, *, level=Otsu, side="left", hz=25, seed=0, roll_sd=0.0, tilt=0.0, outside=0.3,
        stand=None, scanner=None, params=None, every=1, dust=0.0, kind=Params, inertial=0,
    ):  # fmt: skip
        sign = 1.0 if side == "left" else -1.0
        self.mounting = mounting(side, outside=outside)
        world = Stand(lambda x, y: -sign * course.left_of(x, y), **(stand or {}))
        self.scanner = Scanner(world, self.mounting, **(scanner or {}))
        self.period = round(1e9 / hz)
        upright = {"lean_deg": 0.0, "echo_parts": 1} if kind is Params else {}
        self.level = level(kind(**{**upright, **(params or {})}), setup_of(side, 1 / hz, self.mounting))
        self.level.reset(Stream(1, "edge"))
        self.rng = np.random.default_rng(seed)
        self.dust, self.inertial = dust, inertial  # inertial: samples per scan
        self.roll_sd, self.tilt, self.roll, self.pitch = roll_sd, tilt, 0.0, 0.0

    def __call__(self, t, pose, speed, yaw_rate):
        keep, kick = 0.95, np.sqrt(1 - 0.95**2) * self.roll_sd
        self.roll = keep * self.roll + kick * self.rng.standard_normal()
        self.pitch = keep * self.pitch + kick * self.rng.standard_normal()
        scan = self.scanner.scan(t, pose, self.rng, roll=self.roll + self.tilt, pitch=self.pitch)
        if self.dust > 0.0:
            puff = 0.7 + self.rng.standard_exponential(scan.ranges.shape)
            meets = (self.rng.uniform(size=puff.shape) < self.dust) & (puff < scan.ranges)
            scan = replace(scan, ranges=np.where(meets, puff, scan.ranges).astype(np.float32))
        apart = self.period // max(self.inertial, 1)
        unit = tuple(
            Inertial(t - k * apart, 0.0, 0.0, yaw_rate, 0.0, 0.3, 9.8) for k in reversed(range(self.inertial))
        )
        inputs = {"scan": scan, "odometry": Odometry(t, speed, yaw_rate, 0.0), "inertial": unit or None}
        return self.level.step(t - self.period, self.period, inputs)["edge"]


def drive(
    course=None, *, scans=150, speed=2.0, offset=0.0, heading=0.0, side="left", hz=25, crab=0.0, **sensor
):
    """Rows (time, found, offset error, heading error, curvature error, confidence, crop, stubble height)."""
    sign = 1.0 if side == "left" else -1.0
    course = course or Course(y=6.0 * sign)
    sense = EdgeSensor(course, side=side, hz=hz, **sensor)
    x, y, psi, t, rows = 0.0, course.y - 6.0 * sign + 0.1 * sign + offset, heading, 0, []
    dt = 1.0 / hz
    for _ in range(scans):
        yaw_rate = speed / course.radius if x > course.bend_at else 0.0
        psi += yaw_rate * dt
        x, y = x + speed * np.cos(psi + crab) * dt, y + speed * np.sin(psi + crab) * dt
        t += sense.period
        edge = sense(t, (x, y, psi), speed, yaw_rate)
        true = course.seen_from((x, y, psi), edge.reference_x)
        wrong = edge.offset - true[0], edge.heading - true[1], edge.curvature - true[2]
        rows.append((t / 1e9, edge.is_found, *wrong, edge.confidence, edge.crop_height, edge.stubble_height))
    return np.array(rows, dtype=float)


def along(
    level, course=None, *, metres=20.0, side="left", stand=None, speed=SPEED, seed=0, y=0.1, inside=None,
    mounted=None, begin=0, hz=25.0, scanner=None, cut=None, **made,
):  # fmt: skip
    """(edges, their errors [m], > 0 to the left) of a machine that drives along its course.

    level(side, mounted=..., **made) makes the detector; begin: periods that it has behind it; hz: scans per
    second; scanner: what it has otherwise than usual; cut: (bias, noise [m]) of the width that the header
    says it cuts, which is otherwise not known
    """
    sign = 1.0 if side == "left" else -1.0
    course = course or Course(y=6.0 * sign)
    inside = inside or (lambda x, y: -sign * course.left_of(x, y))
    scanner = Scanner(Stand(inside, **(stand or {})), mounted or mounting(side), **(scanner or {}))
    period = round(1e9 / hz)
    detector, rng = level(side, mounted=mounted, **made), np.random.default_rng(seed)
    pose, edges, wrong = [0.0, course.y - 6.0 * sign + y * sign, 0.0], [], []
    for k in range(begin, begin + round(metres / (speed / hz))):
        yaw_rate = speed / (course.radius + course.y) if pose[0] > course.bend_at else 0.0
        pose[2] += yaw_rate / hz
        pose[0] += speed / hz * np.cos(pose[2])
        pose[1] += speed / hz * np.sin(pose[2])
        scan = scanner.scan((k + 1) * period, pose, rng)
        steering = float(np.arctan(3.9 * yaw_rate / speed))
        inputs = {"scan": scan, "odometry": Odometry(0, speed, yaw_rate, steering)}
        if cut is not None:
            (x, end), width = MACHINE.header_end(side), MACHINE.header_width
            missing = max(sign * (end - course.seen_from(pose, x - 0.5)[0]), 0.0)
            missing = max(missing + cut[0] + cut[1] * rng.standard_normal(), 0.0)
            fill = max(1.0 - missing / width, 0.0)
            inputs["flow"] = CropFlow(k * period, 0.0, 0.0, 0.0, 0, fill, 1.0 / hz)
        edge = detector.step(k * period, period, inputs)["edge"]
        edges.append(edge)
        wrong.append(edge.offset - course.seen_from(pose, edge.reference_x)[0])
    return edges, np.array(wrong)


def errors(rows, after=1.0):
    """(availability, offset RMSE [m], offset bias [m], heading RMSE [rad]) after the first seconds."""
    late = rows[rows[:, 0] > after]
    found = late[late[:, 1] > 0]
    if len(found) == 0:
        return 0.0, np.inf, np.inf, np.inf
    rms = np.sqrt(np.mean(found[:, 2:4] ** 2, axis=0))
    return len(found) / len(late), rms[0], found[:, 2].mean(), rms[1]
