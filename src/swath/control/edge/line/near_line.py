"""The edge beside the machine: a robust local parabola through the blocks around the place that is reported.

Interpolation, not extrapolation: the place lies just ahead of the knife, so that blocks stand on both sides.
Weights, least squares and their rounds are compiled (`near_line_kernel`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.control.edge.arc_track import SAME
from swath.control.edge.canopy_rays import EdgeFrame
from swath.control.edge.profile import Clears
from swath.kernels import Row, repeatable, shared, start_warp
from swath.signals import F64

VARIANCE, DISTANCE, COLUMNS = 2, 3, 4  # of the rows: x, u, variance, distance
VAGUE = 0.15  # m, standard deviation from which on a point does not show the edge: lodged crop
BEHIND = 14.0  # m of the edge that are kept
ROOM = 256  # points that a fit takes, the newest


class EdgePoints(Clears):
    """Points of the accepted blocks, in the frame at rest. rows (n, COLUMNS).

    returns: distances along the edge at which it was found again behind a hole [m]
    """

    kept = ("rows", "returns")

    def clear(self) -> None:
        """None."""
        self.rows: F64 = np.zeros((0, COLUMNS))
        self.returns: tuple[float, ...] = ()

    def shows(self, distance: float, reach: float, early: float) -> bool:
        """A standing edge was seen within a reach [m] of a distance along it, and no hole may lie there.

        early: how far ahead of where it begins crop behind a hole may seem to stand [m]
        """
        is_near = np.abs(self.rows[:, DISTANCE] - distance) <= reach
        if not (is_near & (self.rows[:, VARIANCE] < VAGUE**2)).any():
            return False
        return not any(distance - early < again < distance + reach for again in self.returns)

    def shows_beyond(self, distance: float) -> bool:
        """A standing edge was seen beyond a distance along it [m]."""
        return bool(((self.rows[:, DISTANCE] >= distance) & (self.rows[:, VARIANCE] < VAGUE**2)).any())

    def add(self, x: float, u: float, variance: float, distance: float) -> None:
        """A block's edge point [m], its variance [m2], and its distance along the edge [m]."""
        rows = self.rows[self.rows[:, DISTANCE] > distance - BEHIND - 10.0]
        self.rows = np.vstack([rows, [x, u, variance, distance]])
        self.returns = tuple(old for old in self.returns if old > distance - BEHIND)

    def found_again(self, distance: float) -> None:
        """Behind a hole, at a distance along the edge [m]."""
        self.returns = (*self.returns, distance)

    def move(self, moves: F64) -> None:
        """Move points. moves: rows of the distance along the edge, and the moves in x, u and distance [m]."""
        for distance, *more in moves.tolist():
            self.rows[np.abs(self.rows[:, DISTANCE] - distance) < SAME] += [more[0], more[1], 0.0, more[2]]

    def doubt(self, distance: float) -> None:
        """Forget those from a distance along the edge [m] on."""
        self.rows = self.rows[self.rows[:, DISTANCE] < distance]


@dataclass(frozen=True)
class NearLine:
    """The edge near a place. frame: of the machine; offset_sd [m], angle_sd [rad].

    gap: distance along the edge from the place to the nearest point [m]
    spread: of the points about the line [m]
    seen_to: distance along the edge from the place to the last point [m]
    """

    frame: EdgeFrame
    offset_sd: float
    angle_sd: float
    gap: float
    spread: float
    seen_to: float


class LineFit:
    """Fits the edge abreast of a reference [m] ahead of the machine's origin."""

    def __init__(self, reference: float) -> None:
        self._reference = reference
        self._launch: Any = None

    def near(
        self, rows: F64, at: tuple[float, float, float], front: EdgeFrame, distance: float
    ) -> NearLine | None:
        """The edge seen from a machine at x, u [m] with a heading [rad]; None with less than two points.

        rows: of `EdgePoints`
        front: the newest place of the track in the machine's frame
        distance: of that place along the edge [m]
        """
        if len(rows) < 2:
            return None
        self.compile()
        rows = rows[-ROOM:]
        self._points[: len(rows)] = rows
        self._asked.write(len(rows), *at, front.x, front.u, front.angle, distance, self._reference)
        self._launch()
        x, u, angle, bend, *rest = self._line.read()
        return NearLine(EdgeFrame(x, u, angle, bend), *rest)

    def compile(self) -> None:
        """Load the compiled fit, some 10 ms the first time: before a run is in step with a clock."""
        if self._launch is not None:
            return
        from swath.control.edge.line import near_line_kernel as kernel

        self._asked, self._line = Row(kernel.Asked), Row(kernel.Line)
        self._points = np.zeros((ROOM, COLUMNS))
        points = shared(self._points, start_warp().vec4d)
        scratch = shared(np.zeros((8, ROOM + 1)))
        inputs = [self._asked.array, points, scratch, self._line.array]
        self._launch = repeatable(kernel.near_line, inputs).launch
