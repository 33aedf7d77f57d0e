"""The ground along the way: seen ahead by the scanner, driven over later by the wheels.

The plane of the stubble is seen some metres ahead, over the plane that the machine stands on: the height of
the stubble and the rise of the ground are one number there. When the wheels have come to that place, the
inclination of the machine has told the rise, where there is an inertial unit; what is left is the stubble.
Where there is none, waves of the ground come and go and the stubble stays.

All of it is one Kalman filter. Its state is the height of the stubble, slopes along and across the way in
cells from behind the machine to as far as the scanner sees, and of either the mean slope with the error of
the inertial unit. Slopes are an autoregression of the second order over the travel. How uneven the ground
is, is not known: the filter runs once for every scale, and each counts by how well it foretold what was seen.
"""

from math import exp as exp_of
from math import hypot, sqrt

import numpy as np

from swath.control.edge.canopy_classes import FAR
from swath.control.edge.profile import Clears
from swath.core.component import State
from swath.core.portable import exp, log, power
from swath.signals import F64

# m: of the way in a cell, over which slopes are alike; waves of 20 to 80 m, estimated
CELL, ALIKE = 1.0, 20.0
SCALES = 0.003 * np.array(
    [1.0, 4.0, 16.0, 64.0]
)  # standard deviations of slopes [1] that are tried, estimated
SEEN_SD, FELT_SD = 0.02, 0.006  # m, [1]: of the stubble's plane and the inclination in a cell, estimated
STEEP = 0.2  # standard deviation of a field's mean slope and the inertial unit's error [1], estimated
CHANGES = 0.003  # m, [1]: of the stubble and the mean slopes, from cell to cell, estimated
STANDS, SETTLES = 1e-3, 0.02  # m: weight of a scan of a machine that stands, travel to the first look
SHARE = 0.65  # of the stubble's height, at which rays meet it: measured with `empirical`, 5 to 45 cm
STUBBLE, MEANS, FIRST = 0, (1, 2), 3  # places in the state: height, mean slopes, the first cell along
_KEEPS = exp_of(-CELL / ALIKE)
_NEXT = np.array([-(_KEEPS**2), 2.0 * _KEEPS])  # what the last two slopes are worth in the next one
_NEW = (1.0 - _KEEPS**2) ** 3 / (1.0 + _KEEPS**2)  # share of the variance that is new in every cell


class GroundProfile(Clears):
    """What stubble and ground were found to be.

    wheelbase: from the axle at the origin to the other one, behind it > 0 [m]; usual: height of the stubble
    that the driver expects, and its standard deviation [m]

    stubble, stubble_sd: height of the stubble's plane over the ground [m]
    """

    kept = ("_mean", "_covariance", "_worth", "_seen", "_felt", "_travel")

    def __init__(self, wheelbase: float, usual: tuple[float, float]) -> None:
        self._base, self._usual = wheelbase, (SHARE * usual[0], usual[1])
        self._first = min(0.0, -wheelbase) - CELL  # where the ring begins, of the axle [m]
        self._cells = int((FAR + abs(wheelbase)) / CELL) + 2
        self._begins = self._first + CELL * np.arange(self._cells)
        super().__init__()

    def clear(self) -> None:
        """Nothing seen: any ground may come."""
        apart = np.abs(np.subtract.outer(np.arange(self._cells), np.arange(self._cells)))
        alike = power(_KEEPS, apart) * (1.0 + apart * (1.0 - _KEEPS**2) / (1.0 + _KEEPS**2))
        size = FIRST + 2 * self._cells
        self._mean, self._covariance = np.zeros((len(SCALES), size)), np.zeros((len(SCALES), size, size))
        self._mean[:, STUBBLE] = self._usual[0]
        for k, sd in ((STUBBLE, self._usual[1]), *((k, STEEP) for k in MEANS)):
            self._covariance[:, k, k] = sd**2
        for cells in self._rings():
            self._covariance[:, cells, cells] = SCALES[:, None, None] ** 2 * alike
        self._worth = np.zeros(len(SCALES))  # logarithms
        self._travel = 2.0 * CELL - SETTLES
        self._begin_cell()
        self._weigh()

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self._weigh()

    def _rings(self) -> tuple[slice, slice]:
        middle = FIRST + self._cells
        return slice(FIRST, middle), slice(middle, None)

    def _begin_cell(self) -> None:
        self._travel, self._seen, self._felt = self._travel - CELL, np.zeros(5), np.zeros(3)

    def take(self, travel: float, seen: tuple[float, ...] | None, rise: tuple[float, float] | None) -> bool:
        """What was seen and felt over a travel [m]; True where that completed a cell, so that all is new.

        seen: of the stubble's plane ahead, over the plane of the wheels: x, u of its middle and height there
        [m], slope toward the crop [1]; None where it cannot be seen
        rise: slopes of the machine ahead and toward the crop [1]; None without an inertial unit
        """
        self._travel += travel
        weight = max(travel, STANDS)
        if seen is not None:
            self._seen += weight * np.array([*seen, 1.0])
        if rise is not None:
            self._felt += weight * np.array([*rise, 1.0])
        if self._travel < CELL:
            return False
        means = [total[:-1] / total[-1] if total[-1] > 0.0 else None for total in (self._seen, self._felt)]
        self._begin_cell()
        self._advance()
        self._learn(*means)
        self._weigh()
        return True

    def _learn(self, seen: F64 | None, felt: F64 | None) -> None:
        """Means over the last cell.

        The parabola across that has the seen slope there meets the way of the wheels as high as the plane is
        half as far aside. What the unit felt is taken off it: there the roughness below the wheels is none.
        """
        (along, across), axle = self._rings(), -0.5 * CELL
        under = self._way(axle - self._base, axle) / self._base, self._at(axle)
        if felt is not None:
            for mean, cells, slopes, slope in zip(MEANS, self._rings(), under, felt.tolist(), strict=True):
                row = np.zeros(self._mean.shape[1])
                row[mean], row[cells] = 1.0, slopes
                self._measure(row, slope, FELT_SD)
        if seen is None:
            return
        x, u, level, slope = seen.tolist()
        aside = 0.5 * u
        level -= aside * slope
        row = np.zeros(self._mean.shape[1])
        row[STUBBLE] = 1.0
        row[along], row[across] = self._way(axle, axle + x), aside * self._at(axle + x)
        if felt is not None:
            row[list(MEANS)] = x, aside
            self._measure(row, level + x * float(felt[0]) + aside * float(felt[1]), SEEN_SD)
        else:
            row[along] -= x * under[0]
            row[across] -= aside * under[1]
            self._measure(row, level, hypot(SEEN_SD, x * FELT_SD))

    def _way(self, begin: float, end: float) -> F64:
        """Metres of every cell that lie between two places [m]; less than 0 where they are the other way."""
        low, high = min(begin, end), max(begin, end)
        inside = np.minimum(high, self._begins + CELL) - np.maximum(low, self._begins)
        return np.asarray(np.maximum(inside, 0.0) * (1.0 if end >= begin else -1.0))

    def _at(self, x: float) -> F64:
        """What every cell is worth in the slope at a place [m]."""
        return self._way(x - 0.5 * CELL, x + 0.5 * CELL) / CELL

    def _advance(self) -> None:
        """One more cell ahead, and one less behind."""
        mean, both = self._mean, self._covariance
        for cells in self._rings():
            last = cells.start + self._cells - 1
            before = slice(last - 2, last)
            mean[:, cells.start : last] = mean[:, cells.start + 1 : last + 1].copy()
            both[:, cells.start : last] = both[:, cells.start + 1 : last + 1].copy()
            both[:, :, cells.start : last] = both[:, :, cells.start + 1 : last + 1].copy()
            mean[:, last] = (mean[:, before] * _NEXT).sum(axis=-1)
            row = (both[:, before] * _NEXT[:, None]).sum(axis=1)
            own = (row[:, before] * _NEXT).sum(axis=-1)
            both[:, last], both[:, :, last] = row, row
            both[:, last, last] = own + SCALES**2 * _NEW
        for k in (STUBBLE, *MEANS):
            both[:, k, k] += CHANGES**2
        self._worth *= _KEEPS  # what is long ago says little of how uneven the ground is here

    def _measure(self, row: F64, value: float, sd: float) -> None:
        """The state's product with a row was measured."""
        with_state = (self._covariance * row).sum(axis=-1)
        variance = (with_state * row).sum(axis=-1) + sd**2
        away = value - (self._mean * row).sum(axis=-1)
        gain = with_state / variance[:, None]
        self._mean += gain * away[:, None]
        self._covariance -= gain[:, :, None] * with_state[:, None, :]
        self._worth -= 0.5 * (away**2 / variance + log(variance))
        self._worth -= self._worth.max()

    def _weigh(self) -> None:
        """What the scales say of the stubble, each by its chance."""
        chance, mean = exp(self._worth), self._mean[:, STUBBLE]
        self._chance = chance / chance.sum()
        self.stubble = float((self._chance * mean).sum())
        variance = (mean - self.stubble) ** 2 + self._covariance[:, STUBBLE, STUBBLE]
        self.stubble_sd = sqrt((self._chance * variance).sum())

    def grade(self, begin: float, end: float) -> float:
        """Slope of the ground between two places ahead [m], over the plane of the wheels [1]."""
        begin = min(begin, end - CELL)
        row = self._way(begin, end) / (end - begin) - self._way(-self._base, 0.0) / self._base
        mean = (self._chance[:, None] * self._mean[:, self._rings()[0]]).sum(axis=0)
        return float((row * mean).sum())
