"""Which way stems lean, from how bright they are to scanners that look at them from several sides.

A thin cylinder that scatters as a matt surface does sends back, averaged over the side that is lit, a part of
the light that goes with the sine of the angle between ray d and axis s. With q = d s, crops follow

    ln(bright) = c + a q + b ln(1 - q^2) / 2

b = 1, a = 0 for bare cylinders. Leaves lie at all angles and make b smaller; they stand off the stem toward
its tip, so that a ray from foot to tip meets more of their faces: a > 0. Simulated wheat has a = 0.11,
b = 0.37, barley 0.08 and 0.22, both within 0.01 in the mean over azimuths and leans. One scanner beside the
crop looks at it from one side only and cannot distinguish a dark crop from one that leans; one at each end of
the header do: by azimuth both parts of the lean, across the edge and along it, show. How far stems lean in
all is known from their height; every lean in 5 deg and direction in 11.25 deg is a hypothesis.
"""

from math import cos, exp, pi, sin

import numpy as np

from swath.core import portable
from swath.core.component import KeepsState
from swath.core.units import DEG
from swath.signals import F64

MEMORY = 8.0  # m of travel after which looks are worth 1/e
ASIDE = 0.4  # sine of the azimuth from which on a ray goes inward, or outward
SECTORS = 12  # of azimuth, from outward over ahead to inward
FACES, FACES_SD = 0.1, 0.03  # a: mean and standard deviation of crops
ROUND, ROUND_SD = 0.35, 0.15  # b: the same
UNEVEN = 0.012  # standard deviation of a sector: density, spots that are half full, ears
SPREAD, ALIKE = 0.3, 10.0  # of single looks, relative; looks per independent one
ENOUGH, FEW = 300.0, 50.0  # looks to a side, in a sector
UPRIGHT = 15.0 * DEG  # smaller leans are those of a stand that stands
LOOSE, LOW = 12.0 * DEG, 8.0 * DEG  # standard deviations of the lean: of any stand, of what its height says
SHORT = 0.1  # chance that a low stand is a short one that stands
_POLAR = [(5.0 * k * DEG, pi / 16.0 * j) for k in range(13) for j in range(32)]
_LEAN = np.array([lean for lean, _ in _POLAR])
_STEM = np.array([[sin(p) * cos(w), sin(p) * sin(w), cos(p)] for p, w in _POLAR]).T
OUTWARD = np.array([max(-sin(p) * sin(w) / cos(p), 0.0) if p > UPRIGHT else 0.0 for p, w in _POLAR])


class StemLean(KeepsState):
    """Looks by scanner and sector of azimuth: sums of (1, intensity, ray along the edge, to the crop, up).

    gain_sd: relative, of each scanner's intensities of one target
    """

    kept = ("_sums", "_sides")

    def __init__(self, gain_sd: float, scanners: int = 1) -> None:
        self._gain, self._scanners = gain_sd, scanners
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        self._sums: F64 = np.zeros((self._scanners, SECTORS, 5))
        self._sides: F64 = np.zeros(2)

    def move(self, travel: float) -> None:
        """Old looks fade over a travel [m]."""
        keep = exp(-travel / MEMORY)
        self._sums *= keep
        self._sides *= keep

    def add(self, rays: F64, intensity: F64, scanner: int = 0) -> None:
        """Looks at stems. rays: unit vectors along the edge, toward the crop, up, (n, 3); intensity (n,)."""
        good = np.isfinite(intensity)
        rays, intensity = rays[good], intensity[good]
        aside = rays[:, 1] / np.sqrt(rays[:, 0] ** 2 + rays[:, 1] ** 2)
        self._sides += np.count_nonzero(aside > ASIDE), np.count_nonzero(aside < -ASIDE)
        sector = np.searchsorted(_LIMITS, aside)
        row = np.column_stack([np.ones_like(intensity), intensity, rays])
        np.add.at(self._sums[scanner], sector, row)

    @property
    def is_seen(self) -> bool:
        """The stems were looked at from both sides."""
        return float(self._sides.min()) >= ENOUGH

    def outward(self, lean: float) -> tuple[float, float]:
        """(tangent of the lean out over the edge, its standard deviation), 0 where the stand stands.

        lean: what its height says [rad], 0 = nothing. Only where it `is_seen`
        """
        score = self._scores()
        chance = portable.exp(score - float(score.max())) * _prior(lean)
        chance /= float(chance.sum())
        mean = float((chance * OUTWARD).sum())
        return mean, float(np.sqrt((chance * (OUTWARD - mean) ** 2).sum()))

    def _scores(self) -> F64:
        """Log-likelihood [nat] of every hypothesis; c, the scanners' gains, a and b are integrated out."""
        scanner, sector = np.nonzero(self._sums[:, :, 0] > FEW)
        count, bright, *ray = self._sums[scanner, sector].T
        seen = portable.log(bright / count)
        rays = np.stack(ray, axis=1)
        rays /= np.sqrt((rays * rays).sum(axis=1))[:, None]
        weight = 1.0 / (UNEVEN**2 + SPREAD**2 * ALIKE / count)
        q = portable.product(rays, _STEM)
        faces, round_ = q, 0.5 * portable.log(np.maximum(1.0 - q * q, 1e-3))

        def inner(x: F64, y: F64) -> F64:
            """Product x P y of columns, P the precision of the sectors with gains and c unknown."""
            whole = (weight[:, None] * x * y).sum(axis=0)
            left, right, total = np.zeros_like(whole), np.zeros_like(whole), 0.0
            for k in range(self._scanners):
                w = weight * (scanner == k)
                n, of_x, of_y = float(w.sum()), (w[:, None] * x).sum(axis=0), (w[:, None] * y).sum(axis=0)
                share = self._gain**2 / (1.0 + self._gain**2 * n)
                whole = whole - share * of_x * of_y
                keep = 1.0 - share * n
                left, right, total = left + keep * of_x, right + keep * of_y, total + keep * n
            return np.asarray(whole - left * right / total)

        rest = seen[:, None] - FACES * faces - ROUND * round_
        ff, rr, fr = inner(faces, faces), inner(round_, round_), inner(faces, round_)
        f0, r0, all_ = inner(faces, rest), inner(round_, rest), inner(rest, rest)
        a, d, b = 1.0 / FACES_SD**2 + ff, 1.0 / ROUND_SD**2 + rr, fr
        det = a * d - b * b
        fitted = (d * f0 * f0 - 2.0 * b * f0 * r0 + a * r0 * r0) / det
        return np.asarray(-0.5 * (all_ - fitted) - 0.5 * portable.log(det))


_LIMITS = np.array([sin(pi * (k / SECTORS - 0.5)) for k in range(1, SECTORS)])  # of sectors, sines of azimuth


def _prior(lean: float) -> F64:
    """Of every hypothesis: any direction; how far by the height, or a short stand that stands."""
    stands = portable.exp(-0.5 * (_LEAN / LOOSE) ** 2)
    if lean <= 0.0:
        return np.asarray(stands)
    leans = portable.exp(-0.5 * ((_LEAN - lean) / LOW) ** 2)
    return np.asarray(SHORT * stands / float(stands.sum()) + (1.0 - SHORT) * leans / float(leans.sum()))
