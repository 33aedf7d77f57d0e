"""How far the tops of a stand may hang over the edge, and what its height says of that.

A stand that leans out over the edge shows a wall as sharp as that of an upright one, only further out. It is
lower: stems of length h whose tops are at z lean by acos(z / h).
"""

from math import acos, sqrt
from typing import Protocol

LEANS, DENSE = 0.92, 0.9  # of the upright crop's height, in a stand that stops this share of the rays
LEANS_THIN, THIN = 0.82, 0.5  # the same of one that shows less of its tops


class Overhang(Protocol):
    """(how far the feet stand behind the edge of the tops [m], standard deviation [m])."""

    def of(self, crop: float, stopped: float, ramp: float) -> tuple[float, float]: ...


class HeightOverhang:
    """What one scanner can know: the size from the height, not the direction.

    upright: height of the crop where it stands upright [m], 0 = unknown
    """

    def __init__(self, upright: float) -> None:
        self._upright = upright

    def lean(self, crop: float, stopped: float) -> float:
        """Of the stems off the vertical [rad], 0 where the crop [m] stands.

        stopped: share of the rays in the crop that it stopped
        """
        dense = min(max((stopped - THIN) / (DENSE - THIN), 0.0), 1.0)
        limit = LEANS_THIN + dense * (LEANS - LEANS_THIN)
        return acos(max(crop, 0.0) / self._upright) if crop < limit * self._upright else 0.0

    def of(self, crop: float, stopped: float, ramp: float) -> tuple[float, float]:
        """As `Overhang`; ramp: how sure the crop is to lean away from the edge, 0..1.

        The tops lie no farther off than stems of that height reach, evenly anywhere up to there.
        """
        if ramp >= 0.5 or self.lean(crop, stopped) == 0.0:
            return 0.0, 0.0
        return 0.0, sqrt((self._upright**2 - crop**2) / 3.0)
