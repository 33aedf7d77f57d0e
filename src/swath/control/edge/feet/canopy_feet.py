"""How far the feet of the crop stand behind the edge of its canopy: overhang of an upright stand, ramp of one
that leans away from the edge; and where the rows stand that it was sown in.

The edge of a row crop lies half a spacing out of its last row. Its tops stand over the rows: echoes in the
uppermost layers come at a period of the spacing, whose phase is where the rows are.
"""

from math import cos, exp, pi, sin

import numpy as np

from swath.control.edge.blocks import ALIKE as ALONE
from swath.control.edge.blocks import WINDOW, Block
from swath.control.edge.canopy_classes import CELL, HALF, LAYER, LAYERS, LIMIT, LOWEST, PLACES
from swath.control.edge.feet.canopy_offset import CanopyOffset, Rays
from swath.control.edge.feet.lean_ramp import LeanRamp
from swath.core.component import KeepsState
from swath.core.portable import product
from swath.signals import F64

OBLIQUE = 0.09  # rad to the edge from which on its wall looks like a ramp
MEMORY, GUESS, PARTS = 30.0, 0.06, 3  # m; of the crop's height; parts of plants that make an echo together
USUAL, MOST = 0.09, 0.19  # of the crop's height: overhang of cereals, at most
ROLL = 0.35  # slope of a ramp that upright plants feign, per rise across the edge
ACROSS, ALONG = 0.6, 0.03  # the same per rad at which rays go into the crop, from so many on: they soak in
TOPS = 0.9  # of the crop's height, from which on echoes are of tops
APART, ALIKE = 0.3, 8.0  # m from row to row: nearer ones are a closed stand; m along which rows go alike


class CanopyFeet(KeepsState):
    """Learns from the rays of accepted blocks. lean: (share 0..1, feet [m], tangent of the lean).

    spacing: of the rows [m], 0 where they stand so near that they are none
    tops, noise: of the uppermost layers over the rows: sums of cosines and sines of places; of the squares of
        what each block added to them
    """

    kept = ("_offset", "_ramp", "lean", "tops", "noise", "_heading", "_turned")

    def __init__(self, spacing: float = 0.0) -> None:
        self._offset, self._ramp = CanopyOffset(MEMORY, GUESS, parts=PARTS), LeanRamp()
        self.spacing = spacing_of(spacing)
        turns = [2.0 * pi * (CELL * (k + 0.5) - HALF) / (self.spacing or 1.0) for k in range(PLACES)]
        self._phases = np.array([[cos(turn), sin(turn)] for turn in turns])
        self.clear()

    def clear(self) -> None:
        """Nothing learned."""
        self._offset.clear()
        self._ramp.clear()
        self.lean = (0.0, 0.0, 0.0)
        self.tops: F64 = np.zeros(2)
        self.noise = 0.0
        self._heading, self._turned = 0.0, 0.0  # of the rows, at rest, and of the edge to them [rad]

    def compile(self) -> None:
        """Load what is compiled, before a run is in step with a clock."""
        self._offset.compile()

    def learn(self, block: Block, edge: float, height: float, angle: float, heading: float) -> None:
        """A block and its edge [m].

        height [m] of the crop; angle [rad] of the edge to the machine; heading: of the edge at rest [rad]
        """
        rays, counts, travel = block.answers, block.counts, block.travel
        self._offset.move(travel)
        if not height > 0.0:
            return
        seen = rays[np.isfinite(rays["height"])]
        upper, lower = seen["upper"] - edge, seen["lower"] - edge
        self._offset.add(Rays(upper, lower, seen["height"], height, LIMIT * height), height)
        self._ramp.move(travel)
        self._look_for_rows(counts, edge, travel, height, heading)
        if abs(angle) < OBLIQUE:
            self._ramp.add(counts, edge)
        feigned = ROLL * abs(block.of("rise")) + ACROSS * max(block.of("across") - ALONG, 0.0)
        scans = block.of("next") - block.of("first")
        alike = max(1.0, scans * ALONE / max(travel, ALONE))
        self.lean = self._ramp.foot(height, self.overhang(height), alike, feigned)

    def _look_for_rows(self, counts: F64, edge: float, travel: float, height: float, heading: float) -> None:
        """Rows run straight: an edge that turned away from them goes across, and its plants agree by that."""
        if self.spacing:
            self._heading = self._heading if self.noise > 0.0 else heading
            self._turned = heading - self._heading
            self._heading += self.along * travel / MEMORY * self._turned
            cells = round(self.spacing * int(WINDOW / self.spacing) / CELL)
            first, layer = round((edge + HALF) / CELL), round((TOPS * height - LOWEST) / LAYER)
            tops = counts[first : first + cells, layer:LAYERS].sum(axis=1)
            c, s = product(tops, self._phases[first : first + len(tops)]).tolist()
            turn, keep = 2.0 * pi * edge / self.spacing, exp(-travel / ALIKE)
            self.tops = keep * self.tops + (cos(turn) * c + sin(turn) * s, cos(turn) * s - sin(turn) * c)
            self.noise = float(keep**2 * self.noise + c * c + s * s)

    @property
    def along(self) -> float:
        """How sure the edge goes along the rows, which run straight, 0..1."""
        return 1.0 - min(abs(self._turned) * ALIKE / self.spacing, 1.0)

    def overhang(self, height: float) -> float:
        """Learned overhang of an upright canopy [m]."""
        most = MOST if self._ramp.is_known else USUAL
        return min(self._offset.shift(height), most * height)


def spacing_of(rows: float) -> float:
    """Of rows so far apart [m], 0 where they stand so near that they are none."""
    return rows if rows > APART else 0.0
