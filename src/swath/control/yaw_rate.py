"""The yaw rate without the bias of its gyroscope, for control.

One gyroscope cannot separate its bias from a bend that the machine drives. Others can: wheels at an angle
delta turn a machine at v tan(delta) / wheelbase, at rest not at all, and an inertial unit has a gyroscope of
its own. Each may be off, most of them by little and a few by much: errors are normal with one of two
deviations, that of a sound sensor or that of a faulty one. All combinations of sound and faulty are weighed
by how well they explain what the sensors differ by, and the bias is the mean over them (a mixture of normals
is conjugate: Gelman et al., Bayesian Data Analysis, 3rd ed., section 22.1).
"""

from collections.abc import Sequence
from itertools import product
from math import exp, fsum, hypot, isfinite, log
from struct import Struct

from swath.control.inertial_memory import InertialMemory, Number, Numbers
from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.units import DEG
from swath.signals import F64, Inertial, Odometry

# sensor: standard deviation when sound, when faulty; estimates after the data sheets of the bundled ones
GYRO = 0.03 * DEG, 0.5 * DEG  # rad/s, of the odometry
UNIT = 0.1 * DEG, 0.5 * DEG  # rad/s, of the inertial unit
ANGLE, FAULTY_ANGLE = 0.2 * DEG, 10.0 * DEG  # rad, of the zero of the steering angle
LEAST = 0.003 * DEG  # rad/s: a machine at rest turns by no more, whatever its sensors say
FAULTY = 0.05  # chance of each sensor
CHANCES = log(1.0 - FAULTY), log(FAULTY)
AGAIN_S = 0.5  # s from one estimate to the next
LONGEST_S = 0.5  # s: of a step that counts
# Numbers of the shared memory: samples, yaw rate, speed, steering angle and seconds of the step; means of
# what the wheels and the unit differ by; wheelbase, direction upward in the unit's frame.
STEP = Struct("5d")
WHEELS, TURN, WHEELBASE, UP = slice(5, 8), slice(8, 10), 10, slice(11, 14)


class YawRate(KeepsState):
    """Estimates the bias of the odometry's gyroscope from what its other sensors say.

    wheelbase [m]; mounting: pose_machine_sensor of the inertial unit
    bias: what is taken off [rad/s]
    """

    kept = ("bias", "_angle", "_unit", "_since")

    def __init__(self, wheelbase: float, mounting: Pose | None) -> None:
        self._wheelbase = wheelbase
        self._up = [0.0, 0.0, 1.0] if mounting is None else mounting.rotation[2].tolist()
        self._memory = InertialMemory("take_yaw_rate")
        numbers = self.numbers = self._memory.numbers
        numbers[WHEELBASE], numbers[UP] = wheelbase, self._up
        self._angle, self._unit = _Mean(numbers[WHEELS]), _Mean(numbers[TURN])
        self.clear()

    def clear(self) -> None:
        """No bias is known."""
        self.bias, self._since = 0.0, 0.0
        self._angle.clear()
        self._unit.clear()

    def of(self, odometry: Odometry, samples: Sequence[Inertial] | None, seconds: float) -> float:
        """The yaw rate [rad/s], > 0 to the left, less the bias; nan where none is measured.

        samples: of the inertial unit since the last call, None = there is none; seconds: since then
        """
        rate, speed = odometry.yaw_rate, odometry.speed
        if not isfinite(rate):
            return rate
        seconds, samples = min(seconds, LONGEST_S), samples or ()
        STEP.pack_into(self._memory.bytes, 0, len(samples), rate, speed, odometry.steer_angle, seconds)
        self._memory.step(samples)
        self._since += seconds
        if self._since >= AGAIN_S:
            self._since = 0.0
            self.bias = _bias(self._differences())
        return rate - self.bias

    def _differences(self) -> list[tuple[float, float, float]]:
        """(by what the gyroscope is above another sensor, deviations of that: sound, faulty) [rad/s]."""
        found = []
        if self._angle.seconds > AGAIN_S:
            away, sd = self._angle.values
            found.append((away, hypot(sd, LEAST), hypot(sd * FAULTY_ANGLE / ANGLE, LEAST)))
        if self._unit.seconds > AGAIN_S:
            found.append((self._unit.values[0], *UNIT))
        return found


class _Mean(KeepsState):
    """Means of some values over the last while."""

    kept = ("values", "seconds")
    values, seconds = Numbers(slice(-1)), Number(-1, float)

    def __init__(self, numbers: F64) -> None:
        self.numbers = numbers

    def clear(self) -> None:
        """Nothing yet."""
        self.numbers[:] = 0.0


def _bias(differences: Sequence[tuple[float, float, float]]) -> float:
    """Posterior mean of the gyroscope's bias [rad/s] from its differences to other sensors."""
    logs, means = [], []
    terms = [  # of each sensor, sound and faulty: precision, pull, cost
        [(1.0 / sd**2, away / sd**2, 2.0 * log(sd) + (away / sd) ** 2) for sd in sds]
        for away, *sds in differences
    ]
    for which in product((0, 1), repeat=1 + len(differences)):
        gyro, *others = which
        precision, pull, cost = 1.0 / GYRO[gyro] ** 2, 0.0, 2.0 * log(GYRO[gyro])
        for is_faulty, of in zip(others, terms, strict=True):
            more, to, costs = of[is_faulty]
            precision, pull, cost = precision + more, pull + to, cost + costs
        cost += log(precision) - pull**2 / precision
        chance = fsum(CHANCES[is_faulty] for is_faulty in which)
        logs.append(chance - 0.5 * cost)
        means.append(pull / precision)
    most = max(logs)
    weights = [exp(value - most) for value in logs]
    return fsum(w * m for w, m in zip(weights, means, strict=True)) / fsum(weights)
