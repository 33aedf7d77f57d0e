"""A stand that leans into itself, away from the edge, shows a ramp: its canopy begins at the feet and rises.

The higher the layer, the further in it begins: at height z the outermost stems have come z tan(lean) inward.
Where each layer begins is fitted by a line over its height; the line's zero is the row of feet. A stand that
leans out shows nothing of the kind: its wall is as sharp as that of an upright one, only further out.
"""

from math import exp

import numpy as np

from swath.control.edge.canopy_classes import CELL, LAYER, LAYERS, LOWEST, PLACES
from swath.core.component import KeepsState
from swath.signals import F64

HALF = 1.2  # m to either side of the edge that are kept
MEMORY = 4.0  # m of travel
SHARES = (0.3, 0.4, 0.5, 0.6, 0.7)  # of the crop's height
ENOUGH = 400.0  # counts
LOWEST_CROP = 0.5  # m above the stubble: of a lower one too few layers are seen
LEAST, SURE = 0.2, 0.35  # slopes from which on it may be a ramp, and is one
SOAK = 0.08  # m per slope by which half of the rays are stopped later than the stand begins
_CELLS = 2 * round(HALF / CELL)
_PLACE = -HALF + CELL * np.arange(_CELLS)


class LeanRamp(KeepsState):
    """Counts of answers by place beside the edge and by layer."""

    kept = ("_counts",)

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        self._counts: F64 = np.zeros((_CELLS, LAYERS))

    @property
    def is_known(self) -> bool:
        """Enough was seen to tell whether there is a ramp."""
        return float(self._counts.sum()) >= ENOUGH

    def move(self, travel: float) -> None:
        """Old counts fade over a travel [m]."""
        self._counts *= exp(-travel / MEMORY)

    def add(self, counts: F64, edge: float) -> None:
        """A block's counts (PLACES, CLASSES) with its edge [m]."""
        first = PLACES // 2 + round(edge / CELL) - _CELLS // 2
        if first >= 0 and first + _CELLS <= PLACES:
            self._counts += counts[first : first + _CELLS, :LAYERS]

    def foot(self, height: float) -> tuple[float, float, float]:
        """(share 0..1 of it being a ramp, the feet beside the edge [m], tangent of the lean).

        height: of the crop [m]
        """
        if not height > LOWEST_CROP or not self.is_known:
            return 0.0, 0.0, 0.0
        above = np.cumsum(self._counts[:, ::-1], axis=1)[:, ::-1]
        tall = np.array(SHARES) * height
        layer = np.clip(np.round((tall - LOWEST) / LAYER), 1, LAYERS - 1).astype(np.int64)
        stopped, rays = above[:, layer], above[:, :1]
        inside = _PLACE > 0.6 * HALF
        most = stopped[inside].sum(axis=0) / max(float(rays[inside].sum()), 1.0)
        if float(most[1]) < 0.5:
            return 0.0, 0.0, 0.0
        excess = np.cumsum((stopped - 0.5 * most * rays)[::-1], axis=0)[::-1]
        begins = _PLACE[np.argmax(excess, axis=0)]
        level = LOWEST + LAYER * layer
        apart = level - level.mean()
        slope = float((apart * begins).sum() / (apart * apart).sum())
        foot = float(begins.mean()) - slope * (float(level.mean()) + SOAK)
        is_ramp = float(np.clip((slope - LEAST) / (SURE - LEAST), 0.0, 1.0))
        return is_ramp, float(np.clip(foot, -0.5, 0.2)), slope
