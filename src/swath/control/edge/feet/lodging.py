"""Crop that has become lower than before: lodged, its tops lie off, and its edge says little of its feet."""

import numpy as np

from swath.control.edge.blocks import Block
from swath.control.edge.canopy_classes import LIMIT
from swath.control.edge.feet.canopy_feet import OBLIQUE
from swath.control.edge.populations import Populations
from swath.control.edge.profile import Clears

STANDS, LOW_SHARE, LOW_STEP = (
    0.3,
    0.94,
    0.03,
)  # [1], [1], m: of its height over the stubble; lower than this is lodged
MAT = 0.3  # m inside the track: there crop that lies flat is looked for
DENSE = 0.8  # share of the rays that crop stops, from which on its height is known


class Lodging(Clears):
    """Compares the first metre of crop with itself before.

    is_lodged: the last block was; blocks: of the patch so far
    stubble: height of its plane over the ground [m]
    """

    kept = ("is_lodged", "blocks", "stubble", "_usual")

    def clear(self) -> None:
        """No crop was seen."""
        self.is_lodged, self.blocks, self.stubble = False, 0, 0.0
        self._usual = float("nan")  # height of the first metre of crop over the plane

    def first_metre(self, block: Block, edge: float, populations: Populations) -> float:
        """Height of the first metre of crop behind an edge over the plane [m], nan where it is no canopy."""
        return populations.height_of(block.just_inside(edge))

    def stands(self, block: Block, edge: float, populations: Populations) -> None:
        """Crop stands behind an edge [m] of a block."""
        self.is_lodged = False
        now = self.first_metre(block, edge, populations)
        if np.isfinite(now):
            self._usual = now if np.isnan(self._usual) else self._usual + 0.1 * (now - self._usual)

    def lies(self) -> bool:
        """One more block of a patch that lies; whether it is its first."""
        is_first = not self.is_lodged
        self.is_lodged, self.blocks = True, 1 if is_first else self.blocks + 1
        return is_first

    def swing(self, block: Block, edge: float, populations: Populations, angle: float) -> float:
        """How far the tops of a stand that has become low may have moved aside [m], 0 where it stands.

        Stems of length h whose tops are at z lean by acos(z / h), their tops lie h sin(lean) beside the feet.
        edge: of the block [m]; angle: of the track to the machine [rad]
        """
        usual = self._usual + self.stubble
        is_doubtful = populations.heights()[2] < DENSE and not self.is_lodged
        is_doubtful |= not self._usual > STANDS * usual
        if is_doubtful or abs(angle) > 3.0 * OBLIQUE:
            return 0.0
        now = self.stubble + self.first_metre(block, edge, populations)
        if np.isnan(now) and populations.has_mat(block.just_inside(MAT)):
            now = self.stubble + LIMIT * self._usual
        if not now < LOW_SHARE * usual - LOW_STEP:
            return 0.0
        return float(np.sqrt(usual**2 - now**2))
