"""How far the feet of the crop stand behind the edge of its canopy: overhang of an upright stand, ramp of one
that leans away from the edge; and where the rows stand that it was sown in.

The edge of a row crop lies half a spacing out of its last row. Its tops stand over the rows: echoes in the
uppermost layers come at a period of the spacing, whose phase is where the rows are.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin

import numpy as np

from swath.control.edge.blocks import WINDOW
from swath.control.edge.canopy_classes import CELL, HALF, LAYER, LAYERS, LIMIT, LOWEST, PLACES
from swath.control.edge.canopy_offset import CanopyOffset, Rays
from swath.control.edge.canopy_rays import RayAnswers
from swath.control.edge.lean_ramp import LeanRamp
from swath.core.component import KeepsState
from swath.core.portable import exp, product
from swath.signals import F64

OBLIQUE = 0.09  # rad to the edge from which on its wall looks like a ramp
MEMORY, GUESS, PARTS = 30.0, 0.06, 3  # m; of the crop's height; parts of plants that make an echo together
CLEAR, DUSTY, USUAL = 0.05, 0.12, 0.09  # shares of rays; in dust the overhang of cereals, of their height
MOST = 0.19  # of the crop's height
DENSE, THIN = 0.85, 0.6  # shares of rays stopped within the crop: overhang is seen, is not seen
STEEP, STEEPER = 0.2, 0.35  # tangents of a lean inward that may be, and is, beyond doubt
ROLL = 0.35  # slope of a ramp that upright plants feign, per rise across the edge
ACROSS, ALONG = 0.6, 0.03  # the same per rad at which rays go into the crop, from so many on: they soak in
FINE, COARSE = 0.07, 5.0  # the same per m by which the rays of a scan lie farther apart than that
TOPS = 0.9  # of the crop's height, from which on echoes are of tops
APART = 0.3  # m from row to row: nearer ones are a closed stand
DIM, CLEAR_ROWS, FEWEST = 0.3, 0.5, 100.0  # contrast of rows: not seen, seen; echoes
EVEN, RAGGED = 0.05, 0.09  # m of spread of the blocks: on a ragged edge the usual overhang counts


class CanopyFeet(KeepsState):
    """Learns from the rays of accepted blocks. lean: (share 0..1, feet [m], tangent of the lean).

    spacing: of the rows [m], 0 where they stand so near that they are none
    """

    kept = ("_offset", "_ramp", "lean", "_tops")

    def __init__(self, spacing: float = 0.0) -> None:
        self._offset, self._ramp = CanopyOffset(MEMORY, GUESS, parts=PARTS), LeanRamp()
        self.spacing = spacing if spacing > APART else 0.0
        turns = [2.0 * pi * (CELL * (k + 0.5) - HALF) / (self.spacing or 1.0) for k in range(PLACES)]
        self._phases = np.array([[cos(turn), sin(turn), 1.0] for turn in turns])
        self.clear()

    def clear(self) -> None:
        """Nothing learned."""
        self._offset.clear()
        self._ramp.clear()
        self.lean = (0.0, 0.0, 0.0)
        self._tops: F64 = np.zeros(3)  # of the uppermost layers: sums of cosines, sines of places, and counts

    def compile(self) -> None:
        """Load what is compiled, before a run is in step with a clock."""
        self._offset.compile()

    def learn(
        self,
        scans: Sequence[RayAnswers],
        counts: F64,
        edge: float,
        travel: float,
        height: float,
        angle: float,
    ) -> None:
        """A block: its scans, their counts, its edge [m] and travel [m].

        height [m] of the crop; angle [rad] of the edge to the machine
        """
        self._offset.move(travel)
        if not height > 0.0:
            return
        tall = np.concatenate([rays.height for rays in scans])
        seen = np.isfinite(tall)
        upper = np.concatenate([rays.upper for rays in scans])[seen] - edge
        lower = np.concatenate([rays.lower for rays in scans])[seen] - edge
        self._offset.add(Rays(upper, lower, tall[seen], height, LIMIT * height), 0.0, height)
        self._ramp.move(travel)
        self._look_for_rows(counts, edge, travel, height)
        if abs(angle) < OBLIQUE:
            self._ramp.add(counts, edge)
        feigned = ROLL * abs(scans[-1].rise) + ACROSS * max(scans[-1].across - ALONG, 0.0)
        feigned += COARSE * max(_apart(scans[-1].upper - edge) - FINE, 0.0)
        self.lean = self._ramp.foot(height, self._overhang(height), feigned)

    def _look_for_rows(self, counts: F64, edge: float, travel: float, height: float) -> None:
        if self.spacing:
            cells = round(self.spacing * int(WINDOW / self.spacing) / CELL)
            first, layer = round((edge + HALF) / CELL), round((TOPS * height - LOWEST) / LAYER)
            tops = counts[first : first + cells, layer:LAYERS].sum(axis=1)
            c, s, n = product(tops, self._phases[first : first + len(tops)]).tolist()
            turn = 2.0 * pi * edge / self.spacing
            found = cos(turn) * c + sin(turn) * s, cos(turn) * s - sin(turn) * c, n
            self._tops = float(exp(-travel / MEMORY)) * self._tops + found

    @property
    def rows(self) -> tuple[float, float]:
        """(how clearly rows are seen 0..1, half a spacing out of one, nearest to the canopy's edge [m])."""
        c, s, n = self._tops.tolist()
        if not n > FEWEST:
            return 0.0, 0.0
        clear = min(max((hypot(c, s) / n - DIM) / (CLEAR_ROWS - DIM), 0.0), 1.0)
        half = 0.5 * self.spacing
        beside = self.spacing * atan2(s, c) / (2.0 * pi) - half
        return clear, beside if beside >= -half else beside + self.spacing

    @property
    def leans_in(self) -> float:
        """How sure the crop is to lean away from the edge by more than ragged edges and wind feign, 0..1."""
        return min(max((self.lean[2] - STEEP) / (STEEPER - STEEP), 0.0), 1.0)

    def _overhang(self, height: float) -> float:
        """Learned overhang of an upright canopy [m]."""
        most = MOST if self._ramp.is_known else USUAL
        return min(self._offset.shift(height), most * height)

    def shift(self, height: float, stopped: float, spread: float, dust: float) -> float:
        """The feet behind the edge of the canopy [m].

        height [m] of the crop; share of rays that it stopped; spread of the blocks about the line [m]; share
        of rays that dust took
        """
        if not height > 0.0:
            return 0.0
        dense = min(max((stopped - THIN) / (DENSE - THIN), 0.0), 1.0)
        seen = min(max((DUSTY - dust) / (DUSTY - CLEAR), 0.0), 1.0)
        dense = max(dense, 1.0 - seen)  # in dust it is not seen how dense the crop is
        learned = self._overhang(height)
        upright = dense * (seen * learned + (1.0 - seen) * USUAL * height)
        share, foot, _ = self.lean
        even = min(max((RAGGED - spread) / (RAGGED - EVEN), 0.0), 1.0)
        upright = even * upright + (1.0 - even) * dense * USUAL * height
        clear, beside = self.rows
        return (1.0 - share) * ((1.0 - clear) * upright + clear * beside) + share * seen * foot


def _apart(places: F64) -> float:
    """Distance of neighbouring rays where they reach the canopy, within 1 m of the edge [m]; places (n,)."""
    near = np.sort(places[np.abs(places) < 1.0])
    return float(np.median(np.diff(near))) if len(near) > 2 else np.inf
