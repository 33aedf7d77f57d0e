"""The way of a thing that moves: straight from point to point, at one speed."""

from math import atan2, hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Way:
    """points: world (n, 2) [m], n >= 2, neighbours apart; speed [m/s]; returns: to and fro, for ever."""

    def __init__(self, points: Any, speed: float, *, returns: bool = False) -> None:
        self.points: Array = np.asarray(points, dtype=float)
        self.speed, self.returns = speed, returns
        steps = np.diff(self.points, axis=0)
        self.at: Array = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])

    @property
    def length(self) -> float:
        """From the first point to the last [m]."""
        return float(self.at[-1])

    def after(self, seconds: float) -> tuple[float, float, float, float]:
        """x, y [m], heading [rad] and speed [m/s] so long after it set off; before, it stands."""
        gone = max(seconds, 0.0) * self.speed
        comes_back = self.returns and gone % (2.0 * self.length) > self.length
        if self.returns:
            gone %= 2.0 * self.length
            gone = 2.0 * self.length - gone if comes_back else gone
        leg = int(np.clip(np.searchsorted(self.at, gone, side="right") - 1, 0, len(self.at) - 2))
        (ax, ay), (bx, by) = self.points[leg].tolist(), self.points[leg + 1].tolist()
        share = min((gone - float(self.at[leg])) / hypot(bx - ax, by - ay), 1.0)
        back = -1.0 if comes_back else 1.0
        moves = seconds >= 0.0 and (self.returns or gone < self.length)
        heading = atan2(back * (by - ay), back * (bx - ax))
        return ax + share * (bx - ax), ay + share * (by - ay), heading, self.speed if moves else 0.0
