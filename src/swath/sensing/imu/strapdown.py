"""Angular rate and specific force at a point of a machine, from its true poses.

Over the time from one sample to the next, as a unit reports that adds up its own fast readings:

    rate  = log(R0^T R1) / (t1 - t0)
    force = R^T ((v1 - v0) / (s1 - s0) + g up)

R0, R1: attitude of the sensor; v: last difference of two of its positions, valid half a state before, at s;
R: the attitude half way from s0 to s1; log: rotation vector of a rotation matrix. So turn rates add up to the
turn and accelerations to the speed; as a mean over T, a frequency f comes through with sinc(f T).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, hypot
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.portable import product
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.signals import F64, Inertial, MachineState

GRAVITY = 9.81  # [m/s2]
Length = Annotated[float, Ge(-30), Le(30)]
Angle = Annotated[float, Ge(-180), Le(180)]


@dataclass(frozen=True)
class Place:
    """Place of the unit on its machine. x_m: ahead of the fixed axle; y_m: leftward; z_m: above ground

    roll_deg: > 0 left side up; pitch_deg: > 0 nose down; yaw_deg: > 0 to the left
    """

    x_m: Length = 0.0
    y_m: Length = 0.0
    z_m: Length = 1.5
    roll_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    yaw_deg: Angle = 0.0

    def pose(self) -> Pose:
        """pose_machine_sensor."""
        angles = self.roll_deg * DEG, self.pitch_deg * DEG, self.yaw_deg * DEG
        return Pose.from_euler((self.x_m, self.y_m, self.z_m), *angles)


class Strapdown(KeepsState):
    """Watches the states go by. mounting: pose_machine_sensor."""

    kept = ("_last", "_velocity", "_reading")

    def __init__(self, mounting: Pose) -> None:
        self.mounting = mounting
        self.reset(Pose.identity())

    def reset(self, start: Pose) -> tuple[F64, F64]:
        """Forget what was; rate [rad/s] and force [m/s2] of a machine that rests at `start`."""
        self._last: MachineState | None = None
        self._velocity: tuple[float, F64] | None = None  # its time [s], value [m/s]
        self._reading = np.zeros(3), self._force(start.rotation, np.zeros(3))
        return self._reading

    def take(self, states: Sequence[MachineState]) -> tuple[F64, F64]:
        """(rate, force) (3,) each, in the sensor's frame, from the last state taken before to the newest.

        Without a newer one the reading stays; from a single one, that of rest.
        """
        path = [s for s in states if self._last is None or s.t > self._last.t]
        if self._last is not None:
            path.insert(0, self._last)
        if len(path) == 1 and self._last is None:
            self._reading = np.zeros(3), self._force(path[0].pose.rotation, np.zeros(3))
        if len(path) > 1:
            self._reading = self._between(path)
        self._last = path[-1] if path else None
        return self._reading

    def _between(self, path: Sequence[MachineState]) -> tuple[F64, F64]:
        first, last = path[0].pose.rotation, path[-1].pose.rotation
        begin, span = path[0].t / NS, (path[-1].t - path[0].t) / NS
        turn = rotation_vector(product(first.T, last))
        s0, v0 = self._velocity or self._velocity_of(path[0], path[1])
        s1, v1 = self._velocity = self._velocity_of(path[-2], path[-1])
        gained = (v1 - v0) / (s1 - s0) if s1 > s0 else np.zeros(3)
        half_way = product(first, rotation_of(turn * ((0.5 * (s0 + s1) - begin) / span)))
        return product(self.mounting.rotation.T, turn) / span, self._force(half_way, gained)

    def _velocity_of(self, a: MachineState, b: MachineState) -> tuple[float, F64]:
        at = self.mounting.position
        return 0.5 * (a.t + b.t) / NS, (b.pose.apply(at) - a.pose.apply(at)) * (NS / (b.t - a.t))

    def _force(self, rotation: F64, acceleration: F64) -> F64:
        up = np.array([0.0, 0.0, GRAVITY])
        return np.asarray(product(product(rotation, self.mounting.rotation).T, acceleration + up))


def rotation_vector(rotation: F64) -> F64:
    """Axis times angle [rad], (3,), of a rotation (3, 3) by less than half a turn."""
    skew = 0.5 * (rotation - rotation.T)
    vector = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])  # axis times sine
    sine = hypot(*vector)
    angle = atan2(sine, 0.5 * (np.trace(rotation) - 1.0))
    return vector * (angle / sine if sine > 1e-12 else 1.0)


def rotation_of(vector: F64) -> F64:
    """Rotation (3, 3) about an axis by its length [rad] (Rodrigues)."""
    angle = hypot(*vector)
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + a * cross + b * (product(cross, cross)), dtype=np.float64)


def sample_of(t: int, rate: F64, force: F64, rate_sd: float = 0.0, force_sd: float = 0.0) -> Inertial:
    """The sample of three rates [rad/s] and forces [m/s2]."""
    p, q, r = rate.tolist()
    x, y, z = force.tolist()
    return Inertial(t, p, q, r, x, y, z, rate_sd, force_sd)
