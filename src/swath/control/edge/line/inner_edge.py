"""An edge further in than a line that broke off: the wall of a hole, or the edge itself from now on.

Both look alike until a hole ends. A wall that has gone on beside the line, straight and at one distance, for
longer than a hole that is bridged, is the edge: another header width was driven before, or a strip missed.
"""

import numpy as np

from swath.control.edge.profile import Clears
from swath.core.portable import median
from swath.signals import F64

LONG = 7.0  # m of travel along a wall after which it is the edge
NEAREST, FARTHEST = 0.25, 0.9  # m beside the line
JUMP, NEWEST = 0.15, 5  # m by which a block may lie off the newest ones, their number
EVEN, PARALLEL = 0.06, 0.06  # m, root mean square about its line; rad to the line that broke off
FEWEST = 3  # blocks that show a wall


class InnerEdge(Clears):
    """Blocks that show an edge beside a line.

    rows: distance beside the line [m], x, u [m], variance [m2], distance along the line [m]
    """

    kept = ("rows",)

    def clear(self) -> None:
        """None seen."""
        self.rows: F64 = np.zeros((0, 5))

    def add(self, beside: float, at: tuple[float, float], variance: float, distance: float) -> None:
        """A block's edge beside the line [m], its place x, u [m], variance [m2] and distance along [m]."""
        if not NEAREST < beside < FARTHEST:
            self.clear()
            return
        if len(self.rows) and abs(beside - median(self.rows[-NEWEST:, 0])) > JUMP:
            self.clear()
        self.rows = np.vstack([self.rows, [beside, *at, variance, distance]])

    @property
    def is_seen(self) -> bool:
        """A wall goes along the line."""
        return len(self.rows) >= FEWEST

    def line(self) -> tuple[float, float] | None:
        """(beside the line at the newest block [m], angle to it [rad]) of what is the edge, or None."""
        if len(self.rows) < FEWEST or self.rows[-1, 4] - self.rows[0, 4] < LONG:
            return None
        distance, beside = self.rows[:, 4] - self.rows[-1, 4], self.rows[:, 0]
        apart = distance - distance.mean()
        slope = float((apart * beside).sum() / (apart * apart).sum())
        at = float(beside.mean()) - slope * float(distance.mean())
        about = beside - at - slope * distance
        if abs(slope) > PARALLEL or float(np.sqrt((about * about).mean())) > EVEN:
            return None
        return at, slope
