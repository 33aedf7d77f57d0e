"""A stand that leans into itself, away from the edge, shows a ramp: its canopy begins at the feet and rises.

The higher the layer, the further in it begins: at height z the outermost stems have come z tan(lean) inward.
Where each layer begins is fitted by a line over its height; the line's zero is the row of feet. A stand that
leans out shows nothing of the kind: its wall is as sharp as that of an upright one, only further out.

An upright canopy rises a little, too: its top is sparse. The further it hangs over the edge, the less, so
that the slope says more together with the overhang: leaning inward makes both larger.
"""

import math
from math import erfc, pi, sqrt

import numpy as np

from swath.control.edge.canopy_classes import CELL, LAYER, LAYERS, LOWEST, PLACES
from swath.control.edge.profile import Clears
from swath.core.portable import exp
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
SURE = 2.0  # standard deviations beyond that (by chance 1 in 40) from which on it may be a ramp
WIDTH = 0.07  # slope further until it is one
LOW = 0.3  # slope that a low crop feigns, among whose lower layers is stubble
HEIGHTS = 0.55, 0.75  # m: it is low below the first, no longer from the second on
_CELLS = 2 * round(HALF / CELL)
_PLACE = CELL * (np.arange(_CELLS) + 0.5) - HALF
_WALL = slice(*(round((HALF + place) / CELL) for place in WALL))


class LeanRamp(Clears):
    """Counts of answers by place beside the edge and by layer."""

    kept = ("_counts",)

    def clear(self) -> None:
        """Nothing seen."""
        self._counts: F64 = np.zeros((_CELLS, LAYERS))

    @property
    def is_known(self) -> bool:
        """Enough was seen to see whether there is a ramp."""
        return float(self._counts.sum()) >= ENOUGH

    def move(self, travel: float) -> None:
        """Old counts fade over a travel [m]."""
        self._counts *= math.exp(-travel / MEMORY)

    def add(self, counts: F64, edge: float) -> None:
        """A block's counts (PLACES, CLASSES) with its edge [m]."""
        first = PLACES // 2 + round(edge / CELL) - _CELLS // 2
        if first >= 0 and first + _CELLS <= PLACES:
            self._counts += counts[first : first + _CELLS, :LAYERS]

    def foot(
        self, height: float, overhang: float, alike: float, feigned: float = 0.0
    ) -> tuple[float, float, float]:
        """(share 0..1 of it being a ramp, the feet beside the edge [m], tangent of the lean).

        height [m] of the crop; overhang [m] that an upright one would have; alike: rays per independent ray;
        feigned: slope that the view may feign
        """
        if not (SHARES[-1] - SHARES[0]) * height > FEWEST * LAYER or not self.is_known:
            return 0.0, 0.0, 0.0
        above = np.cumsum(self._counts[:, ::-1], axis=1)[:, ::-1]
        tall = np.array(SHARES) * height
        layer = np.clip(np.round((tall - LOWEST) / LAYER), 1, LAYERS - 1).astype(np.int64)
        stopped, rays = above[:, layer], above[:, 0]
        inside = _PLACE > WITHIN
        most = stopped[inside].sum(axis=0) / max(float(rays[inside].sum()), 1.0)
        if float(most[1]) < 0.5 or not most.all():
            return 0.0, 0.0, 0.0
        missing, rays_of = _open(stopped[_WALL], rays[_WALL], WHOLE * most)
        rays_of = rays_of / alike
        missing -= (1.0 - missing) * _by_chance(rays_of, most)
        begins = WALL[0] + CELL * missing.sum(axis=0)
        level = LOWEST + LAYER * layer
        apart = level - level.mean()
        lever = apart / float((apart * apart).sum())
        slope = float((lever * begins).sum())
        foot = float(begins.mean()) - slope * (float(level.mean()) + SOAK)
        upright = max(STEEP - FLATTER * overhang / height, 0.0)
        low = min(max((HEIGHTS[1] - height) / (HEIGHTS[1] - HEIGHTS[0]), 0.0), 1.0)
        chance = SURE * _slope_sd(missing, rays_of, lever, WHOLE * most)
        is_ramp = min(max((slope - upright - feigned - LOW * low - chance) / WIDTH, 0.0), 1.0)
        return is_ramp, min(max(foot, -0.5), 0.2), slope


def _by_chance(rays: F64, most: F64) -> F64:
    """What seems missing in the mean where all is there: more than all does not count, (places, layers)."""
    sd = np.sqrt(np.maximum(1.0 - most, 0.0) / (most * rays[:, None])) / WHOLE
    away = (1.0 / WHOLE - 1.0) / np.maximum(sd, 1e-3)
    beyond = np.array([0.5 * erfc(sqrt(0.5) * a) for a in away.ravel().tolist()]).reshape(away.shape)
    return np.asarray(sd * (exp(-0.5 * away * away) / sqrt(2.0 * pi) - away * beyond))


def _slope_sd(missing: F64, rays: F64, lever: F64, whole: F64) -> float:
    """Standard deviation that chance gives the slope, of rays (places,) that are each stopped in one layer.

    missing: as `_open`; lever: weight of the begin of each layer in the slope; whole: as `_open`, (layers,)
    """
    is_open = missing > 0.0
    above = np.where(is_open, (1.0 - missing) * whole, whole)
    stopped = np.maximum(above - np.column_stack([above[:, 1:], np.zeros(len(above))]), 0.0)
    worth = np.cumsum(np.where(is_open, lever / whole, 0.0), axis=1)  # of a ray that such a layer stops
    mean = (stopped * worth).sum(axis=1)
    return CELL * sqrt(float((((stopped * worth**2).sum(axis=1) - mean**2) / rays).sum()))


def _open(stopped: F64, rays: F64, whole: F64) -> tuple[F64, F64]:
    """Share 0..1 of the canopy that is not there yet: (places, layers); rays that show it (places,).

    stopped: rays above each layer, (places, layers), of all rays (places,); whole: share that is stopped
    where it is there, (layers,). A place without rays is as the nearest one with some.
    """
    seen = np.flatnonzero(rays > 0.0)
    if not len(seen):
        return np.zeros_like(stopped), np.ones(len(rays))
    share = stopped[seen] / (rays[seen, None] * np.maximum(whole, 1e-3))
    missing = 1.0 - np.minimum(share, 1.0)
    if len(seen) == len(rays):
        return missing, rays
    nearest = np.rint(np.interp(np.arange(len(rays)), seen, np.arange(len(seen)))).astype(np.int64)
    return missing[nearest], rays[seen][nearest] / np.bincount(nearest)[nearest]
