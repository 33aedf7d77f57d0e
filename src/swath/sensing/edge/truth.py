"""Edge level `truth`: the crop edge straight from the field. For isolating steering from perception.

It is the line to be steered along: the edge of the crop that stands, or across a hole the initial edge
(`field/edges/present_edge.py`). It is followed forwards from the first place ahead of the header end where
there is one, along lines across the machine ROW_M apart, as far as it goes on without a break. It is
reported at the reference distance, or nearer where it bends away or breaks.
"""

from dataclasses import dataclass
from math import atan, cos
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.portable import arctan, solve
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.edges.present_edge import SIDE_M, STEP_M, Holes, crop_across, edges_of
from swath.field.site_setup import SiteSetup
from swath.signals import F64, CropEdge, MachineState

ROW_M = 1.0  # between the lines
AHEAD_M = 0.3  # of the knife, at least, where the first line lies: what it has cut shows another edge
JUMP_M = 0.6  # an edge goes on in the next line when it is no farther from where its last two places point
BEND_RAD = 0.3  # the heading at the reference differs by no more than this from that beside the header end
FEWEST = 3  # lines that make an edge
FIT_M = 0.01  # a parabola fits when it is no farther from the edge at its own place
STEEP = 1.2  # tan of the heading beyond which a line across the machine says little
MORE_M = 3.0  # lines reach so much farther to both sides than the search beside the header end


@dataclass(frozen=True)
class Params:
    """The true edge.

    reference_x_m: where ahead of the fixed axle the edge is reported; nearer where it bends by more than 0.3
        rad before that, or breaks
    reach_m: how far beside the header end the edge is looked for
    """

    reference_x_m: Annotated[float, Gt(0), Le(40)] = 10.0
    reach_m: Annotated[float, Gt(0), Le(20)] = 3.0


class TruthEdge(KeepsState):
    """Follows the edge through the field's cut cells; no edge where there is none beside the header end."""

    inputs = (Port("state", MachineState),)
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p, self._setup = params, setup
        self._knife_x, self._end_y = setup.machine.header_end(setup.edge_side)
        gaps = setup.field.gaps_of(setup.edge)
        reach = 0.5 * setup.machine.header_width
        self._holes = Holes(setup.edge, gaps, reach) if gaps and setup.edge is not None else None
        first = min(np.ceil((self._knife_x + AHEAD_M - params.reference_x_m) / ROW_M), -1.0)
        self._x: F64 = params.reference_x_m + ROW_M * np.arange(first, 3.0)
        self._out = 1.0 if setup.edge_side == "left" else -1.0
        self._half = params.reach_m + MORE_M + SIDE_M

    def reset(self, stream: Stream) -> Outputs:
        """No edge yet."""
        return {"edge": _no_edge(0, self._p.reference_x_m)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The edge at t + dt."""
        x, y = self.follow(inputs["state"])
        if len(y) < FEWEST:
            return {"edge": _no_edge(t + dt, self._p.reference_x_m)}
        at = self._reference(x, y)
        bend, slope, offset = self._fit(x, y, at)
        heading = atan(slope)
        curvature = 2.0 * bend * cos(heading) ** 3
        edge = CropEdge(
            t + dt, offset, heading, curvature, float(x[at]), 1.0, np.nan, np.nan, seen_to=float(x[-1])
        )
        return {"edge": edge}

    @staticmethod
    def _fit(x: F64, y: F64, at: int) -> tuple[float, float, float]:
        """Bend, slope and offset of a parabola about a line: over five lines, over three where it bends."""
        for reach in (2, 1):
            near = slice(max(at - reach, 0), at + reach + 1)
            ahead = x[near] - x[at]
            powers = np.stack([ahead * ahead, ahead, np.ones(len(ahead))])
            normal = np.einsum("ik,jk->ij", powers, powers, optimize=False)
            bend, slope, offset = solve(normal, np.einsum("ik,k->i", powers, y[near])).tolist()
            if abs(offset - y[at]) <= FIT_M:
                break
        return bend, slope, offset

    def follow(self, state: MachineState) -> tuple[F64, F64]:
        """Places x, y [m] of the edge on the lines, from the first that shows it to its end, (n,)."""
        begin = self._end_y + self._out * self._half
        crop = crop_across(
            self._setup.field, state.pose, self._x, begin, self._end_y - self._out * self._half
        )
        found: list[float] = []
        first = 0
        lines = self._across_holes(state)
        for row, places in enumerate(edges_of(crop)):
            y = (begin - self._out * STEP_M * places).tolist()
            if np.isfinite(lines[row]):
                y = [float(lines[row])]
            near = self._nearest(y, found)
            if near is None and len(found) < FEWEST:
                found = []
                near = self._nearest(y, found)
            if near is not None:
                first = first if found else row
                found.append(near)
            elif found:
                break
        return self._x[first : first + len(found)], np.array(found)

    def _across_holes(self, state: MachineState) -> F64:
        """Place y of the line across a hole, on each line across the machine; nan where no hole is."""
        if self._holes is None:
            return np.full(len(self._x), np.nan)
        (px, py, _), ((ax, bx, _), (ay, by, _), _) = state.pose.numbers
        end = np.array([px + bx * self._end_y, py + by * self._end_y])
        left, ahead = np.tile([bx, by], (len(self._x), 1)), np.array([ax, ay])
        knife = np.tile(end + self._knife_x * ahead, (len(self._x), 1))
        return self._end_y + self._holes.line(end + self._x[:, None] * ahead, left, knife)

    def _nearest(self, y: list[float], found: list[float]) -> float | None:
        """The place on a line where the edge so far goes on; its start is beside the header end."""
        gate, expected = self._p.reach_m, self._end_y
        if found:
            gate, expected = STEEP * ROW_M, found[-1]
        if len(found) > 1:
            gate, expected = JUMP_M, 2.0 * found[-1] - found[-2]
        near = min(y, key=lambda place: abs(place - expected), default=None)
        return near if near is not None and abs(near - expected) <= gate else None

    def _reference(self, x: F64, y: F64) -> int:
        """The farthest line to report at, up to the reference, with a line on either side."""
        slope = np.gradient(y, ROW_M)
        turned = np.abs(arctan(slope) - arctan(slope[0])) > BEND_RAD
        last = min(len(y) - 2, int(np.searchsorted(x, self._p.reference_x_m)))
        bent = int(np.argmax(turned)) - 1 if turned.any() else last
        return max(min(last, bent), 1)


def _no_edge(t: int, reference_x: float) -> CropEdge:
    return CropEdge(t, np.nan, np.nan, 0.0, reference_x, 0.0, np.nan, np.nan)


LEVEL = Level(
    TruthEdge,
    Params,
    "the true edge, for testing steering alone",
    cost="0.3 ms per step",
    tolerance="15.6 mm cells",
    sees_truth=True,
)
