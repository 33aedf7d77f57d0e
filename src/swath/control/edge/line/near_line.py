"""Where blocks showed the edge: the points that the line beside the machine goes by (near.cpp)."""

import numpy as np

from swath.control.edge.arc_track import SAME
from swath.control.edge.profile import Clears
from swath.signals import F64

VARIANCE, DISTANCE, COLUMNS = 2, 3, 4  # of the rows: x, u, variance, distance
VAGUE = 0.15  # m, standard deviation from which on a point does not show the edge: lodged crop
BEHIND = 14.0  # m of the edge that are kept


class EdgePoints(Clears):
    """Points of the accepted blocks, in the frame at rest. rows (n, COLUMNS).

    returns: distances along the edge at which it was found again behind a hole [m]
    """

    kept = ("rows", "returns")

    def clear(self) -> None:
        """None."""
        self.rows: F64 = np.zeros((0, COLUMNS))
        self.returns: tuple[float, ...] = ()

    def add(self, x: float, u: float, variance: float, distance: float) -> None:
        """A block's edge point [m], its variance [m2], and its distance along the edge [m]."""
        rows = self.rows[self.rows[:, DISTANCE] > distance - BEHIND - 10.0]
        self.rows = np.vstack([rows, [x, u, variance, distance]])
        self.returns = tuple(old for old in self.returns if old > distance - BEHIND)

    def found_again(self, distance: float) -> None:
        """Behind a hole, at a distance along the edge [m]."""
        self.returns = (*self.returns, distance)

    def move(self, moves: F64) -> None:
        """Move points. moves: rows of the distance along the edge, and the moves in x, u and distance [m]."""
        for distance, *more in moves.tolist():
            self.rows[np.abs(self.rows[:, DISTANCE] - distance) < SAME] += [more[0], more[1], 0.0, more[2]]

    def doubt(self, distance: float) -> None:
        """Forget those from a distance along the edge [m] on."""
        self.rows = self.rows[self.rows[:, DISTANCE] < distance]
