"""Which way is up, seen from the machine: from an inertial unit, for control.

A complementary filter on the direction of gravity, the vector form of Mahony, Hamel & Pflimlin 2008
(doi:10.1109/TAC.2008.923738): gyroscopes turn the last estimate, the specific force pulls it back over some
seconds, less what driving adds to it: dv/dt forward, v r to the left and -v q upward, with the turn rates q
and r about y and z. What the pull has to undo again and again is the gyroscopes' bias. In the first seconds
the pull is that of a mean over all samples so far: the first of them may say anything.
"""

from collections.abc import Sequence
from math import fsum, hypot, isfinite
from struct import Struct

import numpy as np

from swath.control.inertial_memory import InertialMemory, Number, Numbers
from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.signals import F64, Inertial

SETTLE_S = 3.0  # time constant of the pull of gravity [s]
SURE_S = 1.0  # s of samples, over which their noise has become small beside a slope, estimated
LEAST_S = 1e-6  # samples of one moment
BIAS_S = 30.0  # the same of the gyroscopes' bias [s]
CRAB = 0.27  # side slip per side force in g: about 1 / the tyres' cornering stiffness over load
GRAVITY = 9.81  # m/s2
LEAST_FORCE = 1.0  # m/s2: a smaller specific force has no direction
# Numbers of the shared memory: samples and speed of the step; direction upward, bias of the gyroscopes,
# whether samples came in, time and speed then; rotation of the unit; for how long samples have come in.
STEP, UPWARD = Struct("2d"), Struct("3d")
UP, BIAS, KNOWN, TIME, SPEED, TURN, SINCE = 2, 5, 8, 9, 10, 11, 20


class Inclination(KeepsState):
    """The upward direction in the machine frame. mounting: pose_machine_sensor of the inertial unit.

    up: unit vector (3,), the vertical in the machine frame; (0, 0, 1) before the first sample
    is_known: samples came in
    """

    kept = ("_up", "is_known", "_bias", "_t", "_speed", "_since")
    is_known = Number(KNOWN, bool)
    _up, _bias = Numbers(slice(UP, BIAS)), Numbers(slice(BIAS, KNOWN))
    _t, _speed, _since = Number(TIME, int), Number(SPEED, float), Number(SINCE, float)

    def __init__(self, mounting: Pose | None) -> None:
        self._turn = (np.eye(3) if mounting is None else mounting.rotation).tolist()
        self._memory = InertialMemory("take_inclination")
        self.numbers = self._memory.numbers
        self.numbers[TURN:SINCE] = [v for row in self._turn for v in row]
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._up = [0.0, 0.0, 1.0]
        self.is_known = False
        self._bias = [0.0, 0.0, 0.0]
        self._t, self._speed, self._since = 0, 0.0, 0.0

    def take(self, samples: Sequence[Inertial] | None, speed: float) -> None:
        """Samples since the last call, oldest first, and the measured speed [m/s]. None: there is no unit."""
        if not samples:
            return
        if self._memory.put(samples):
            STEP.pack_into(self._memory.bytes, 0, len(samples), speed)
            self._memory.step()
        else:
            self.take_in_python(samples, speed)

    def take_in_python(self, samples: Sequence[Inertial], speed: float) -> None:
        """The same, bit for bit, and for any number of samples."""
        good, t = [], 0
        for s in samples:
            p, q, r, x, y, z = s.rate_x, s.rate_y, s.rate_z, s.force_x, s.force_y, s.force_z
            if isfinite(p + q + r + x + y + z):
                good.append((p, q, r, x, y, z))
                t = s.t
        if not good:
            return
        count = len(good)
        p, q, r, x, y, z = [fsum(column) / count for column in zip(*good, strict=True)]
        (p, q, r), (x, y, z), (bias_p, bias_q, bias_r) = (
            self._in_machine(p, q, r),
            self._in_machine(x, y, z),
            self._bias,
        )
        seconds = min(max((t - self._t) / NS, 0.0), 1.0)
        forward = (speed - self._speed) / seconds if self.is_known and seconds > 0.0 else 0.0
        p, q, r = p - bias_p, q - bias_q, r - bias_r
        x, y, z = x - forward, y - speed * r, z + speed * q
        size = hypot(x, y, z)
        self._t, self._speed = t, speed
        if size < LEAST_FORCE:
            return
        x, y, z = x / size, y / size, z / size
        if not self.is_known:
            self._up, self.is_known = [x, y, z], True
            return
        self._since += seconds
        pull = min(1.0, seconds / max(min(SETTLE_S, self._since + seconds), LEAST_S))
        a, b, c = self._up  # what the turn leaves of it, then what the force pulls it to
        a, b, c = a - seconds * (q * c - r * b), b - seconds * (r * a - p * c), c - seconds * (p * b - q * a)
        push = min(1.0, seconds / SETTLE_S) / BIAS_S
        self._bias = [
            bias_p + push * (b * z - c * y),
            bias_q + push * (c * x - a * z),
            bias_r + push * (a * y - b * x),
        ]
        a, b, c = a + pull * (x - a), b + pull * (y - b), c + pull * (z - c)
        size = hypot(a, b, c)
        self._up = [a / size, b / size, c / size]

    def _in_machine(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A vector of the unit's frame in that of the machine."""
        (a, b, c), (d, e, f), (g, h, i) = self._turn
        return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z

    @property
    def is_sure(self) -> bool:
        """Samples came in for so long that their mean is known."""
        return self._since >= SURE_S

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
        ahead, left, up = UPWARD.unpack_from(self._memory.bytes, 8 * UP)
        steep = max(up, 0.5)
        return ahead / steep, left / steep

    def crab(self, per_g: float, lateral: float) -> float:
        """Angle by which the fixed axle slips to the right of its heading [rad].

        per_g: slip per side force in g; lateral: acceleration to the left [m/s2]
        """
        return per_g * (self.rise[1] + lateral / GRAVITY)
