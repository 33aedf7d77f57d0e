"""How far the tops of a stand may hang over the edge, and what its height says of that.

A stand that leans out over the edge shows a wall as sharp as that of an upright one, only further out. It is
lower: stems of length h whose tops are at z over the ground lean by acos(z / h).
"""

from math import acos, erfc, hypot, isnan, sqrt
from typing import Protocol

LEANS, DENSE = 0.92, 0.9  # of the upright crop's height, in a stand that stops this share of the rays
LEANS_THIN, THIN = 0.82, 0.5  # the same of one that shows less of its tops
TOPS = 0.02  # of that height: standard deviation of what is seen of an upright stand


class Overhang(Protocol):
    """(how far the feet stand behind the edge of the tops [m], standard deviation [m])."""

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: float) -> tuple[float, float]: ...


class HeightOverhang:
    """What one scanner can know: the size from the height, not the direction.

    upright: height of the crop where it stands upright [m], 0 = unknown
    """

    def __init__(self, upright: float) -> None:
        self._upright = upright

    def lean(self, crop: float, stopped: float) -> float:
        """Of the stems off the vertical [rad], 0 where the crop, over the ground [m], stands.

        stopped: share of the rays in the crop that it stopped
        """
        is_low = crop < _limit(stopped) * self._upright
        return acos(max(crop, 0.0) / self._upright) if is_low else 0.0

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: float) -> tuple[float, float]:
        """As `Overhang`. crop: over the ground, and its deviation [m]; ramp: how sure a lean inward is, 0..1.

        Tops that lean lie no farther off than stems of that height reach, evenly anywhere up to there.
        """
        if isnan(crop):
            return 0.0, self._upright / 3.0  # any height up to that, leaning or not
        if not crop < self._upright:
            return 0.0, 0.0
        beyond = (crop / self._upright - _limit(stopped)) / hypot(TOPS, crop_sd / self._upright)
        leans = 0.5 * erfc(beyond / sqrt(2.0)) * (1.0 - ramp)
        return 0.0, sqrt(leans * (self._upright**2 - crop**2) / 3.0)


def _limit(stopped: float) -> float:
    """Height below which a stand may lean, of that of an upright one; stopped: share of the rays in it."""
    dense = min(max((stopped - THIN) / (DENSE - THIN), 0.0), 1.0)
    return LEANS_THIN + dense * (LEANS - LEANS_THIN)
