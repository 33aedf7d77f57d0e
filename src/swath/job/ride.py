"""A machine that drives along its path, as wide as a line: distance and speed, without steering.

The event level moves machines between two places by it. Speed limits, drive and the speed that is wanted at a
place are those of the driven machines (`swath.job.kinematic`); what is missing is the distance from the path.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from swath.job.path import Path
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import MachineSheet, dynamics_of

Array = NDArray[np.float64]
STEP = 0.5  # s
GRID = 0.5  # m between two speed limits


class Ride:
    """at: how far it has come [m]; speed [m/s]; limits: highest speed at each point of the path [m/s]; lost:
    time that it does not come farther first [s]
    """

    def __init__(
        self, path: Path, limits: Array, sheet: MachineSheet, speed: float, lost: float = 0.0
    ) -> None:
        self.path, self.at, self.speed, self.lost = path, 0.0, speed, lost
        self._loop = SpeedLoop(dynamics_of(sheet))
        grid = np.arange(0.0, path.length + 2.0 * GRID, GRID)
        self._limits: list[float] = np.interp(grid, path.distance, limits).tolist()

    @property
    def left(self) -> float:
        """Way to the end of the path [m]."""
        return max(0.0, self.path.length - self.at)

    def limit(self) -> float:
        """Highest speed here [m/s]."""
        return self._limits[min(int(self.at / GRID), len(self._limits) - 1)]

    def drive(self, most: float, wanted: Callable[[float], float], left: Callable[[float], float]) -> float:
        """Drive for at most a time [s], until nothing is left; returns the time that it took.

        wanted: speed [m/s] at a time from now; left: way to go [m] at that time
        """
        if left(0.0) <= 0.0:
            return 0.0
        gone = min(self.lost, most)
        self.lost -= gone
        before = left(gone)
        if before <= 0.0:
            return gone
        while gone < most - 1e-9:
            dt = min(STEP, most - gone)
            speed, was = self.speed, self.at
            self.speed, way = self._loop.advance(speed, min(wanted(gone), self.limit()), dt)
            self.at += way
            after = left(gone + dt)
            if after <= 0.0:
                share = before / (before - after) if before > after else 0.0
                self.at = was + share * way
                return gone + share * dt
            gone, before = gone + dt, after
        return most


def time_over(way: float, speed: float, wanted: float, loop: SpeedLoop, most: float) -> float:
    """Time [s] in which a machine at a speed that wants another one [m/s] drives a way [m]; infinite where
    that takes longer than `most` [s].
    """
    if way <= 0.0 or loop.advance(speed, wanted, most)[1] < way:
        return math.inf
    low, high = 0.0, most
    for _ in range(30):
        middle = 0.5 * (low + high)
        if loop.advance(speed, wanted, middle)[1] < way:
            low = middle
        else:
            high = middle
    return high
