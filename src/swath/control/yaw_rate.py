"""The yaw rate without the bias of its gyroscope, for control.

One gyroscope cannot separate its bias from a bend that the machine drives. Others can: wheels at an angle
delta turn a machine at v tan(delta) / wheelbase, at rest not at all, and an inertial unit has a gyroscope of
its own. Each may be off, most of them by little and a few by much: errors are normal with one of two
deviations, that of a sound sensor or that of a faulty one. All combinations of sound and faulty are weighed
by how well they explain what the sensors differ by, and the bias is the mean over them (a mixture of normals
is conjugate: Gelman et al., Bayesian Data Analysis, 3rd ed., section 22.1).
"""

import numpy as np

from swath.control.inertial_memory import SAMPLES
from swath.core.frames import Pose
from swath.signals import F64

# Numbers of the shared memory: samples, yaw rate, speed, steering angle and seconds of the step; wheelbase,
# direction upward in the unit's frame; means of what the wheels and the unit differ by; bias, its age.
WHEELBASE, UP, BIAS = 5, slice(6, 9), 14


def no_bias(wheelbase: float, mounting: Pose | None) -> F64:
    """The memory of yaw_rate.cpp where no bias of the odometry's gyroscope is known, (SAMPLES,).

    wheelbase [m]; mounting: pose_machine_sensor of the inertial unit
    """
    numbers = np.zeros(SAMPLES)
    numbers[WHEELBASE], numbers[UP] = wheelbase, (0, 0, 1) if mounting is None else mounting.rotation[2]
    return numbers
