"""Which way is up, seen from the machine: from an inertial unit, for control.

A complementary filter on the direction of gravity, the vector form of Mahony, Hamel & Pflimlin 2008
(doi:10.1109/TAC.2008.923738): gyroscopes turn the last estimate, the specific force pulls it back over some
seconds, less what driving adds to it: dv/dt forward, v r to the left and -v q upward, with the turn rates q
and r about y and z. What the pull has to undo again and again is the gyroscopes' bias.
"""

from collections.abc import Sequence
from math import hypot

import numpy as np

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.portable import product
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

    kept = ("up", "is_known", "_bias", "_t", "_speed")

    def __init__(self, mounting: Pose | None) -> None:
        self._turn = np.eye(3) if mounting is None else mounting.rotation
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.up: F64 = np.array([0.0, 0.0, 1.0])
        self.is_known = False
        self._bias: F64 = np.zeros(3)
        self._t, self._speed = 0, 0.0

    def take(self, samples: Sequence[Inertial] | None, speed: float) -> None:
        """Samples since the last call, oldest first, and the measured speed [m/s]. None: there is no unit."""
        good = [s for s in samples or () if np.isfinite(_values(s)).all()]
        if not good:
            return
        rate, force = (
            product(self._turn, part) for part in np.mean([_values(s) for s in good], axis=0).reshape(2, 3)
        )
        seconds = min(max((good[-1].t - self._t) / NS, 0.0), 1.0)
        forward = (speed - self._speed) / seconds if self.is_known and seconds > 0.0 else 0.0
        rate = rate - self._bias
        force = force - np.array([forward, speed * rate[2], -speed * rate[1]])
        size = hypot(*force)
        self._t, self._speed = good[-1].t, speed
        if size < LEAST_FORCE:
            return
        if not self.is_known:
            self.up, self.is_known = force / size, True
            return
        pull = min(1.0, seconds / SETTLE_S)
        up = self.up - seconds * np.cross(rate, self.up)
        self._bias = self._bias + pull / BIAS_S * np.cross(up, force / size)
        up = up + pull * (force / size - up)
        self.up = up / hypot(*up)

    @property
    def rise(self) -> tuple[float, float]:
        """How far a plant's top stands ahead and to the left of its foot, per height [1]: 0 on the level.

        In the machine frame, for a plant that stands upright. On a slope that rises to the right the machine
        leans to the left, and plants seem to lean to the right.
        """
        steep = max(float(self.up[2]), 0.5)
        return float(self.up[0]) / steep, float(self.up[1]) / steep

    def crab(self, per_g: float, lateral: float) -> float:
        """By how much the fixed axle slips to the right of its heading [rad].

        per_g: slip per side force in g; lateral: acceleration to the left [m/s2]
        """
        return per_g * (self.rise[1] + lateral / GRAVITY)


def _values(s: Inertial) -> tuple[float, float, float, float, float, float]:
    return s.rate_x, s.rate_y, s.rate_z, s.force_x, s.force_y, s.force_z
