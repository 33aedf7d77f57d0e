"""The ground along the way: seen ahead by the scanner, driven over later by the wheels.

The plane of the stubble is seen some metres ahead, over the plane that the machine stands on: the height of
the stubble and the rise of the ground are one number there. When the wheels have come to that place, the
inclination of the machine has told the rise, where there is an inertial unit; what is left is the stubble.
Where there is none, waves of the ground come and go and the stubble stays.

All of it is one Kalman filter. Its state is the height of the stubble, slopes along and across the way in
cells from behind the machine to as far as the scanner sees, and of either the mean slope with the error of
the inertial unit. Slopes are an autoregression of the second order over the travel. How uneven the ground
is, is not known: the filter runs once for every scale, and each counts by how well it foretold what was seen.

Here is how it begins; it goes on in ground_profile.cpp.
"""

from math import exp

import numpy as np

from swath.control.edge.canopy_classes import FAR
from swath.core.portable import power
from swath.signals import F64

# m: of the way in a cell, over which slopes are alike; waves of 20 to 80 m, estimated
CELL, ALIKE = 1.0, 20.0
SCALES = 0.003 * 1.0, 0.003 * 4.0, 0.003 * 16.0, 0.003 * 64.0  # deviations of slopes [1], estimated
SEEN_SD, FELT_SD = 0.02, 0.006  # m, [1]: of the stubble's plane and the inclination in a cell, estimated
STEEP = 0.2  # standard deviation of a field's mean slope and the inertial unit's error [1], estimated
CHANGES = 0.003  # m, [1]: of the stubble and the mean slopes, from cell to cell, estimated
STANDS, SETTLES = 1e-3, 0.02  # m: weight of a scan of a machine that stands, travel to the first look
SHARE = 0.65  # of the stubble's height, at which rays meet it: measured with `empirical`, 5 to 45 cm
STUBBLE, MEANS, FIRST = 0, (1, 2), 3  # places in the state: height, mean slopes, the first cell along
KEEPS = exp(-CELL / ALIKE)
NEXT = -(KEEPS**2), 2.0 * KEEPS  # what the last two slopes are worth in the next one
NEW = (1.0 - KEEPS**2) ** 3 / (1.0 + KEEPS**2)  # share of the variance that is new in every cell


def cells_of(wheelbase: float) -> tuple[float, int]:
    """Where the cells begin, of the axle [m], and how many there are."""
    return min(0.0, -wheelbase) - CELL, int((FAR + abs(wheelbase)) / CELL) + 2


def unseen(cells: int, usual: tuple[float, float]) -> tuple[F64, F64]:
    """Mean (scales, n) and covariance (scales, n, n) where nothing was seen: any ground may come.

    usual: height of the stubble that the driver expects, and its standard deviation [m]
    """
    apart = np.abs(np.subtract.outer(np.arange(cells), np.arange(cells)))
    alike = power(KEEPS, apart) * (1.0 + apart * (1.0 - KEEPS**2) / (1.0 + KEEPS**2))
    size = FIRST + 2 * cells
    mean, covariance = np.zeros((len(SCALES), size)), np.zeros((len(SCALES), size, size))
    mean[:, STUBBLE] = SHARE * usual[0]
    for k, sd in ((STUBBLE, usual[1]), *((k, STEEP) for k in MEANS)):
        covariance[:, k, k] = sd**2
    for ring in (slice(FIRST, FIRST + cells), slice(FIRST + cells, size)):
        covariance[:, ring, ring] = np.square(SCALES)[:, None, None] * alike
    return mean, covariance
