"""Which way is up, seen from the machine: from an inertial unit, for control.

A complementary filter on the direction of gravity, the vector form of Mahony, Hamel & Pflimlin 2008
(doi:10.1109/TAC.2008.923738): gyroscopes turn the last estimate, the specific force pulls it back over some
seconds, less what driving adds to it: dv/dt forward, v r to the left and -v q upward, with the turn rates q
and r about y and z. What the pull has to undo again and again is the gyroscopes' bias. In the first seconds
the pull is that of a mean over all samples so far: the first of them may say anything.
"""

from collections.abc import Sequence
from struct import Struct

import numpy as np

from swath.control.inertial_memory import InertialMemory, Number, Numbers
from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.signals import F64, Inertial

SURE_S = 1.0  # s of samples, over which their noise has become small beside a slope, estimated
CRAB = 0.27  # side slip per side force in g: about 1 / the tyres' cornering stiffness over load
GRAVITY = 9.81  # m/s2
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
        self._memory = InertialMemory()
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
        STEP.pack_into(self._memory.bytes, 0, len(samples), speed)
        self._memory.step(samples)

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
