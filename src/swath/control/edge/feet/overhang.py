"""How far the tops of a stand may hang over the edge, and what its height says of that.

A stand that leans out over the edge shows a wall as sharp as that of an upright one, only further out. It is
lower: stems of length h whose tops are at z over the ground lean by acos(z / h). How high an upright stand is
seen, is known to some hundredths where it stops the rays, and less in a thin one, into which they go. Every
lean is a hypothesis; what is reported is the mean over all of them, after what is seen.
"""

from math import acos, hypot, isnan, sqrt
from typing import Protocol

import numpy as np

from swath.core.portable import exp
from swath.core.units import DEG
from swath.signals import F64

# of a stand's usual height, mean and standard deviation of what is seen of it where it stands, and share of
# the rays that it stops: 26 upright stands of six crops, five scanners, `empirical` and `plants`
DENSE, THIN = (0.965, 0.03, 1.0), (0.77, 0.06, 0.75)
LEANING = 0.2  # share of stands that lean or lie, by any angle of these
_LEANS = DEG * np.arange(0.0, 75.0, 5.0)
_TALL, _ASIDE = np.cos(_LEANS), np.sin(_LEANS)
_PRIOR = np.array([1.0 - LEANING, *(len(_LEANS) - 1) * [LEANING / (len(_LEANS) - 1)]])


class Overhang(Protocol):
    """(how far the feet stand behind the edge of the tops [m], standard deviation [m])."""

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: float) -> tuple[float, float]:
        """Overhang [m] and its standard deviation for a crop height, a share of rays stopped and a ramp."""


class HeightOverhang:
    """What one scanner can know: the size from the height, not the direction.

    upright: height of the crop where it stands upright [m], 0 = unknown
    view: height of the scanner [m], over which it sees no tops
    """

    def __init__(self, upright: float, view: float) -> None:
        self._upright, self._most = upright, min(view / upright, 1.0) if upright > 0.0 else 1.0

    def lean(self, crop: float, stopped: float) -> float:
        """Lean of the stems off the vertical [rad], 0 where crop of this height [m] may as well stand.

        stopped: share of the rays in the crop that it stopped
        """
        if not (self._upright > 0.0 and self._chance(crop, 0.0, stopped)[0] < 0.5):
            return 0.0
        return acos(min(max(crop, 0.0) / (self._upright * _seen(stopped)[0]), 1.0))

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: float) -> tuple[float, float]:
        """As `Overhang`. crop: over the ground, and its deviation [m]; ramp: how sure a lean inward is, 0..1.

        Tops that lean lie no farther off than stems of that height reach, evenly anywhere up to there.
        """
        if isnan(crop):
            return 0.0, self._upright / 3.0  # any height up to that, leaning or not
        if not self._upright > 0.0:
            return 0.0, 0.0
        aside = float((self._chance(crop, crop_sd, stopped) * _ASIDE**2).sum())
        return 0.0, self._upright * sqrt((1.0 - ramp) * aside / 3.0)

    def _chance(self, crop: float, crop_sd: float, stopped: float) -> F64:
        """Chance of every lean after a height was seen."""
        mean, sd = _seen(stopped)
        tall = mean * np.minimum(_TALL, self._most)
        sd = hypot(sd, crop_sd / self._upright)
        away = (min(crop / self._upright, mean + sd) - tall) / sd  # higher: it is no crop of that height
        chance = _PRIOR * exp(-0.5 * away**2)
        return np.asarray(chance / max(float(chance.sum()), 1e-300))


def density(stopped: float) -> float:
    """How dense a stand is that stops a share of the rays, 0 = thin .. 1."""
    return min(max((stopped - THIN[2]) / (DENSE[2] - THIN[2]), 0.0), 1.0)


def _seen(stopped: float) -> tuple[float, float]:
    """Mean and standard deviation of the height at which a stand is seen that stands, of its usual one."""
    share = density(stopped)
    return THIN[0] + share * (DENSE[0] - THIN[0]), THIN[1] + share * (DENSE[1] - THIN[1])
