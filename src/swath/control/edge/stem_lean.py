"""Which way stems lean, from how bright they are to scanners that look at them from two sides.

A thin cylinder that scatters as a matt surface does sends back, averaged over the side that is lit, a part of
the light that goes with the sine of the angle between ray and cylinder: stems that lean along the ray are
darker. For a ray d, with its part d_u toward the crop, and a small lean of the stems out over the edge,

    ln(bright / upright) = -|d_z| d_u / (1 - d_z^2) lean

so that rays inward meet darker stems than rays outward. One scanner beside the crop looks at it from one side
only and cannot tell a dark crop from one that leans; one at each end of the header do. Leaves lie at all
angles and take a part of it. How far stems lean in all is known from their height; every lean in 5 deg and
direction in 22.5 deg is a hypothesis.
"""

from math import cos, exp, hypot, log, pi, sin

import numpy as np

from swath.core import portable
from swath.core.component import KeepsState
from swath.core.units import DEG
from swath.signals import F64

MEMORY = 8.0  # m of travel after which looks are worth 1/e
ASIDE = 0.4  # sine of the azimuth from which on a ray goes inward, or outward
STEMS, LEAVES = 0.75, 0.3  # part of the contrast of bare cylinders, and its relative standard deviation
UNEVEN = 0.015  # standard deviation of the contrast: density, spots that are half full, ears
ENOUGH = 300.0  # looks to a side
UPRIGHT = 15.0 * DEG  # smaller leans are those of a stand that stands
LOOSE, LOW = 12.0 * DEG, 8.0 * DEG  # standard deviations of the lean: of any stand, of what its height says
SHORT = 0.1  # chance that a low stand is a short one that stands
_POLAR = [(5.0 * k * DEG, pi / 8.0 * j) for k in range(13) for j in range(16)]
_LEAN = np.array([lean for lean, _ in _POLAR])
_ACROSS = np.array([-lean * sin(way) for lean, way in _POLAR])  # rad, > 0 out over the edge
OUTWARD = np.array([max(-sin(p) * sin(w) / cos(p), 0.0) if p > UPRIGHT else 0.0 for p, w in _POLAR])


class StemLean(KeepsState):
    """Looks inward and outward: sums of (1, intensity, change of its logarithm per lean).

    gain_sd: relative, between the intensities of two scanners
    """

    kept = ("_sums",)

    def __init__(self, gain_sd: float) -> None:
        self._noise = hypot(gain_sd, UNEVEN)
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        self._sums: F64 = np.zeros((2, 3))

    def move(self, travel: float) -> None:
        """Old looks fade over a travel [m]."""
        self._sums *= exp(-travel / MEMORY)

    def add(self, rays: F64, intensity: F64) -> None:
        """Looks at stems. rays: unit vectors along the edge, toward the crop, up, (n, 3); intensity (n,)."""
        ahead, inward, up = rays.T
        aside = inward / np.sqrt(ahead * ahead + inward * inward)
        change = np.abs(up) * inward / (1.0 - up * up)
        row = np.stack([np.ones_like(intensity), intensity, change])
        good = np.isfinite(intensity)
        for side, is_there in enumerate((good & (aside > ASIDE), good & (aside < -ASIDE))):
            self._sums[side] += row[:, is_there].sum(axis=1)

    @property
    def is_seen(self) -> bool:
        """The stems were looked at from both sides."""
        return float(self._sums[:, 0].min()) >= ENOUGH and float(self._sums[:, 1].min()) > 0.0

    def outward(self, lean: float) -> tuple[float, float]:
        """(tangent of the lean out over the edge, its standard deviation), 0 where the stand stands.

        lean: what its height says [rad], 0 = nothing. Only where it `is_seen`
        """
        (n, bright, change), (m, dark, other) = self._sums.tolist()
        contrast = log(bright / n) - log(dark / m)
        told = STEMS * (other / m - change / n) * _ACROSS
        variance = self._noise**2 + (LEAVES * told) ** 2
        chance = portable.exp(-0.5 * (contrast - told) ** 2 / variance) / np.sqrt(variance) * _prior(lean)
        chance /= float(chance.sum())
        mean = float((chance * OUTWARD).sum())
        return mean, float(np.sqrt((chance * (OUTWARD - mean) ** 2).sum()))


def _prior(lean: float) -> F64:
    """Of every hypothesis: any direction; how far by the height, or a short stand that stands."""
    stands = portable.exp(-0.5 * (_LEAN / LOOSE) ** 2)
    if lean <= 0.0:
        return np.asarray(stands)
    leans = portable.exp(-0.5 * ((_LEAN - lean) / LOW) ** 2)
    return np.asarray(SHORT * stands / float(stands.sum()) + (1.0 - SHORT) * leans / float(leans.sum()))
