"""The yaw rate without the bias of its gyroscope, for control.

One gyroscope cannot separate its bias from a bend that the machine drives. Others can: wheels at an angle
delta turn a machine at v tan(delta) / wheelbase, at rest not at all, and an inertial unit has a gyroscope of
its own. Each may be off, most of them by little and a few by much: errors are normal with one of two
deviations, that of a sound sensor or that of a faulty one. All combinations of sound and faulty are weighed
by how well they explain what the sensors differ by, and the bias is the mean over them (a mixture of normals
is conjugate: Gelman et al., Bayesian Data Analysis, 3rd ed., section 22.1).
"""

from collections.abc import Sequence
from struct import Struct

from swath.control.inertial_memory import InertialMemory, Numbers
from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.signals import Inertial, Odometry

# Numbers of the shared memory: samples, yaw rate, speed, steering angle and seconds of the step; wheelbase,
# direction upward in the unit's frame; means of what the wheels and the unit differ by; bias, its age.
STEP = Struct("5d")
WHEELBASE, UP, KNOWN, BIAS = 5, slice(6, 9), slice(9, 16), 14


class YawRate(KeepsState):
    """Estimates the bias of the odometry's gyroscope from what its other sensors say.

    wheelbase [m]; mounting: pose_machine_sensor of the inertial unit
    known: what it goes on from
    """

    kept = ("known",)
    known = Numbers(KNOWN)

    def __init__(self, wheelbase: float, mounting: Pose | None) -> None:
        self._memory = InertialMemory("take_yaw_rate")
        numbers = self.numbers = self._memory.numbers
        numbers[WHEELBASE], numbers[UP] = wheelbase, (0, 0, 1) if mounting is None else mounting.rotation[2]

    def clear(self) -> None:
        """No bias is known."""
        self.numbers[KNOWN] = 0.0

    def of(self, odometry: Odometry, samples: Sequence[Inertial] | None, seconds: float) -> float:
        """The yaw rate [rad/s], > 0 to the left, less the bias; nan where none is measured.

        samples: of the inertial unit since the last call, None = there is none; seconds: since then
        """
        samples, rate = samples or (), odometry.yaw_rate
        measured = rate, odometry.speed, odometry.steer_angle, seconds
        STEP.pack_into(self._memory.bytes, 0, len(samples), *measured)
        self._memory.step(samples)
        return rate - float(self.numbers[BIAS])
