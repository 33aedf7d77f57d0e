"""Which way is up, seen from the machine: from an inertial unit, for control.

A complementary filter on the direction of gravity, the vector form of Mahony, Hamel & Pflimlin 2008
(doi:10.1109/TAC.2008.923738): gyroscopes turn the last estimate, the specific force pulls it back over some
seconds, less what driving adds to it: dv/dt forward, v r to the left and -v q upward, with the turn rates q
and r about y and z. What the pull has to undo again and again is the gyroscopes' bias.
"""

from collections.abc import Sequence
from math import fsum, hypot, isfinite

import numpy as np

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.signals import F64, Inertial

SETTLE_S = 3.0  # time constant of the pull of gravity [s]
BIAS_S = 30.0  # the same of the gyroscopes' bias [s]
CRAB = 0.27  # side slip per side force in g: about 1 / the tyres' cornering stiffness over load
GRAVITY = 9.81  # m/s2
LEAST_FORCE = 1.0  # m/s2: a smaller specific force has no direction


class Inclination(KeepsState):
    """The upward direction in the machine frame. mounting: pose_machine_sensor of the inertial unit.

    up: unit vector (3,), the vertical in the machine frame; (0, 0, 1) before the first sample
    is_known: samples came in
    """

    kept = ("_up", "is_known", "_bias", "_t", "_speed")

    def __init__(self, mounting: Pose | None) -> None:
        self._turn = (np.eye(3) if mounting is None else mounting.rotation).tolist()
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._up = [0.0, 0.0, 1.0]
        self.is_known = False
        self._bias = [0.0, 0.0, 0.0]
        self._t, self._speed = 0, 0.0

    def take(self, samples: Sequence[Inertial] | None, speed: float) -> None:
        """Samples since the last call, oldest first, and the measured speed [m/s]. None: there is no unit."""
        good, t = [], 0
        for s in samples or ():
            numbers = s.rate_x, s.rate_y, s.rate_z, s.force_x, s.force_y, s.force_z
            if all(map(isfinite, numbers)):
                good.append(numbers)
                t = s.t
        if not good:
            return
        p, q, r, *force = [fsum(column) / len(good) for column in zip(*good, strict=True)]
        rate, force = self._in_machine(p, q, r), self._in_machine(*force)
        seconds = min(max((t - self._t) / NS, 0.0), 1.0)
        forward = (speed - self._speed) / seconds if self.is_known and seconds > 0.0 else 0.0
        rate = [a - b for a, b in zip(rate, self._bias, strict=True)]
        x, y, z = force[0] - forward, force[1] - speed * rate[2], force[2] + speed * rate[1]
        size = hypot(x, y, z)
        self._t, self._speed = t, speed
        if size < LEAST_FORCE:
            return
        force = [x / size, y / size, z / size]
        if not self.is_known:
            self._up, self.is_known = force, True
            return
        pull, before = min(1.0, seconds / SETTLE_S), self._up
        up = [u - seconds * c for u, c in zip(before, _cross(rate, before), strict=True)]
        push = pull / BIAS_S
        self._bias = [b + push * c for b, c in zip(self._bias, _cross(up, force), strict=True)]
        up = [u + pull * (f - u) for u, f in zip(up, force, strict=True)]
        size = hypot(*up)
        self._up = [u / size for u in up]

    def _in_machine(self, x: float, y: float, z: float) -> list[float]:
        """A vector of the unit's frame in that of the machine."""
        return [a * x + b * y + c * z for a, b, c in self._turn]

    @property
    def up(self) -> F64:
        """The vertical in the machine frame, a unit vector (3,)."""
        return np.array(self._up)

    @property
    def rise(self) -> tuple[float, float]:
        """How far a plant's top stands ahead and to the left of its foot, per height [1]: 0 on the level.

        In the machine frame, for a plant that stands upright. On a slope that rises to the right the machine
        leans to the left, and plants seem to lean to the right.
        """
        ahead, left, up = self._up
        steep = max(up, 0.5)
        return ahead / steep, left / steep

    def crab(self, per_g: float, lateral: float) -> float:
        """By how much the fixed axle slips to the right of its heading [rad].

        per_g: slip per side force in g; lateral: acceleration to the left [m/s2]
        """
        return per_g * (self.rise[1] + lateral / GRAVITY)


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
