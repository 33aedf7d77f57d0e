"""A stand that leans into itself, away from the edge, shows a ramp: its canopy begins at the feet and rises.

The higher the layer, the further in it begins: at height z the outermost stems have come z tan(lean) inward.
Where each layer begins is fitted by a line over its height; the line's zero is the row of feet. A stand that
leans out shows nothing of the kind: its wall is as sharp as that of an upright one, only further out.

An upright canopy rises a little, too: its top is sparse. The further it hangs over the edge, the less, so
that the slope says more together with the overhang: leaning inward makes both larger.
"""

from math import exp

import numpy as np

from swath.control.edge.canopy_classes import CELL, LAYER, LAYERS, LOWEST, PLACES
from swath.control.edge.profile import Clears
from swath.signals import F64

HALF = 1.2  # m to either side of the edge that are kept
MEMORY = 6.0  # m of travel
SHARES = (0.3, 0.4, 0.5, 0.6, 0.7)  # of the crop's height
ENOUGH = 400.0  # counts
FEWEST = 2  # layers between the lowest and the highest share: fewer show no ramp
WITHIN = 0.6  # m behind the edge: the stand within
WALL = (-0.4, 0.6)  # m beside the edge, between which the canopy begins
WHOLE = 0.75  # of the share that is stopped within: there the canopy has begun
SOAK = 0.035  # m per slope by which it seems to begin late
STEEP, FLATTER = 0.085, 0.6  # slope of an upright canopy without overhang; less this times that per height
LEAST, WIDTH = 0.045, 0.07  # slope beyond that from which on it may be a ramp, and further until it is one
SPARSE, DENSE = 0.7, 0.98  # LEAST grows with the share within that is not stopped, from DENSE on
LOW, HEIGHTS = 0.3, (0.55, 0.75)  # and with a low crop, among whose lower layers is stubble: two heights [m]
FIRST, SETTLED = 0.4, (1.0, 5.0)  # and while little was seen: between two ways since the beginning [m]
_CELLS = 2 * round(HALF / CELL)
_PLACE = CELL * (np.arange(_CELLS) + 0.5) - HALF
_WALL = slice(*(round((HALF + place) / CELL) for place in WALL))


class LeanRamp(Clears):
    """Counts of answers by place beside the edge and by layer."""

    kept = ("_counts", "_way")

    def clear(self) -> None:
        """Nothing seen."""
        self._counts: F64 = np.zeros((_CELLS, LAYERS))
        self._way = 0.0

    @property
    def is_known(self) -> bool:
        """Enough was seen to tell whether there is a ramp."""
        return float(self._counts.sum()) >= ENOUGH

    def move(self, travel: float) -> None:
        """Old counts fade over a travel [m]."""
        self._counts *= exp(-travel / MEMORY)
        self._way += travel

    def add(self, counts: F64, edge: float) -> None:
        """A block's counts (PLACES, CLASSES) with its edge [m]."""
        first = PLACES // 2 + round(edge / CELL) - _CELLS // 2
        if first >= 0 and first + _CELLS <= PLACES:
            self._counts += counts[first : first + _CELLS, :LAYERS]

    def foot(self, height: float, overhang: float, feigned: float = 0.0) -> tuple[float, float, float]:
        """(share 0..1 of it being a ramp, the feet beside the edge [m], tangent of the lean).

        height [m] of the crop; overhang [m] that an upright one would have; slope that the view may feign
        """
        if not (SHARES[-1] - SHARES[0]) * height > FEWEST * LAYER or not self.is_known:
            return 0.0, 0.0, 0.0
        above = np.cumsum(self._counts[:, ::-1], axis=1)[:, ::-1]
        tall = np.array(SHARES) * height
        layer = np.clip(np.round((tall - LOWEST) / LAYER), 1, LAYERS - 1).astype(np.int64)
        stopped, rays = above[:, layer], above[:, 0]
        inside = _PLACE > WITHIN
        most = stopped[inside].sum(axis=0) / max(float(rays[inside].sum()), 1.0)
        if float(most[1]) < 0.5:
            return 0.0, 0.0, 0.0
        begins = WALL[0] + CELL * _open(stopped[_WALL], rays[_WALL], WHOLE * most).sum(axis=0)
        level = LOWEST + LAYER * layer
        apart = level - level.mean()
        slope = float((apart * begins).sum() / (apart * apart).sum())
        foot = float(begins.mean()) - slope * (float(level.mean()) + SOAK)
        upright = max(STEEP - FLATTER * overhang / height, 0.0)
        least = upright + feigned + self._least(height, float(most[1]))
        is_ramp = min(max((slope - least) / WIDTH, 0.0), 1.0)
        return is_ramp, min(max(foot, -0.5), 0.2), slope

    def _least(self, height: float, stopped: float) -> float:
        """Slope beyond that of an upright canopy that may be chance.

        height [m] of the crop; stopped: share of the rays within
        """
        short, tall = HEIGHTS
        low = min(max((tall - height) / (tall - short), 0.0), 1.0)
        early, late = SETTLED
        fresh = min(max((late - self._way) / (late - early), 0.0), 1.0)
        return LEAST + SPARSE * max(DENSE - stopped, 0.0) + LOW * low + FIRST * fresh**2


def _open(stopped: F64, rays: F64, whole: F64) -> F64:
    """Share 0..1 of the canopy that is not there yet: (places, layers).

    stopped: rays above each layer, (places, layers), of all rays (places,); whole: share that is stopped
    where it is there, (layers,). A place without rays is as the nearest one with some.
    """
    seen = np.flatnonzero(rays > 0.0)
    if not len(seen):
        return np.zeros_like(stopped)
    share = stopped[seen] / (rays[seen, None] * np.maximum(whole, 1e-3))
    missing = 1.0 - np.minimum(share, 1.0)
    if len(seen) == len(rays):
        return missing
    nearest = np.rint(np.interp(np.arange(len(rays)), seen, np.arange(len(seen)))).astype(np.int64)
    return missing[nearest]
