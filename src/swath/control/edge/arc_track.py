"""The edge as an arc that grows with the travel: where it will be a little further ahead.

All in a frame at rest on the ground, (x, u), which dead reckoning keeps. The state is a point of the arc, its
angle and its bend; a Kalman filter over the distance along the arc takes one block after another. Earlier
states are kept: where an edge breaks off, the blocks just before the break were already wrong, and the track
goes back behind them.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from math import cos, sin

import numpy as np

from swath.control.edge.canopy_rays import EdgeFrame
from swath.control.edge.profile import Clears
from swath.core.packed_state import saved_type
from swath.core.portable import product
from swath.signals import F64

BEND_STEP = 0.02  # 1/m per sqrt(m): how fast the bend of an edge changes
ANGLE_STEP = 0.01  # rad per sqrt(m), of a ragged one
CLIP = 2.0  # standard deviations that an innovation may count
KEPT = 12  # earlier states
MOST_BENT = 0.2  # 1/m
SAME = 1e-6  # m along an edge: one place
_ONE = np.eye(3)


@saved_type()
@dataclass(frozen=True)
class Arc:
    """A point [m] of the edge, its angle [rad] and bend [1/m], their covariance (beside, angle, bend).

    distance: along the edge from where it was first seen [m]
    unseen: of it since the last block that fitted [m]
    """

    x: float
    u: float
    angle: float
    bend: float
    covariance: F64 = field(default_factory=lambda: np.diag([0.1**2, 0.15**2, 0.02**2]))
    distance: float = 0.0
    unseen: float = 0.0

    def ahead(self, distance: float, *, is_seen: bool = True) -> "Arc":
        """The arc a distance [m] further on. Unseen, its bend is taken to stay as it is."""
        f = np.array([[1.0, distance, 0.5 * distance * distance], [0.0, 1.0, distance], [0.0, 0.0, 1.0]])
        covariance = product(product(f, self.covariance), f.T)
        step = abs(distance)
        covariance[0, 0] += 1e-5 * step
        if is_seen:
            covariance[1, 1] += ANGLE_STEP**2 * step
            covariance[2, 2] += BEND_STEP**2 * step
        middle = self.angle + 0.5 * self.bend * distance
        x, u = self.x + distance * np.cos(middle), self.u + distance * np.sin(middle)
        angle = self.angle + self.bend * distance
        unseen = self.unseen + max(distance, 0.0)
        return Arc(float(x), float(u), float(angle), self.bend, covariance, self.distance + distance, unseen)

    def corrected(self, beside: float, variance: float, *, turns: bool = True) -> "Arc":
        """After an edge was found `beside` it [m], with a variance [m2]. turns: of angle and bend, too."""
        p = self.covariance
        total = float(p[0, 0]) + variance
        limit = CLIP * float(np.sqrt(total))
        gain = p[:, 0] / total
        if not turns:
            gain[1:] = 0.0
        move = gain * min(max(beside, -limit), limit)
        left = _ONE.copy()
        left[:, 0] -= gain
        covariance = product(product(left, p), left.T) + variance * np.outer(gain, gain)
        x = self.x - float(move[0]) * np.sin(self.angle)
        u = self.u + float(move[0]) * np.cos(self.angle)
        bend = min(max(self.bend + float(move[2]), -MOST_BENT), MOST_BENT)
        return Arc(float(x), float(u), float(self.angle + move[1]), bend, covariance, self.distance, 0.0)

    def beside(self, aside: float) -> tuple[float, float]:
        """A place x, u [m] beside its point [m]."""
        return self.x - aside * float(np.sin(self.angle)), self.u + aside * float(np.cos(self.angle))

    def frame(self, x: float, u: float, angle: float) -> EdgeFrame:
        """The arc in the frame of a machine that stands at x, u [m] with a heading [rad]."""
        c, s = cos(angle), sin(angle)
        dx, du = self.x - x, self.u - u
        return EdgeFrame(c * dx + s * du, c * du - s * dx, self.angle - angle, self.bend)


class ArcTrack(Clears):
    """An arc and what it was before. arc: None = no edge."""

    kept = ("arc", "_past")

    def clear(self) -> None:
        """No edge."""
        self.arc: Arc | None = None
        self._past: deque[Arc] = deque(maxlen=KEPT)

    def begin(self, arc: Arc) -> None:
        """An edge was found."""
        self.clear()
        self.arc = arc

    def accept(self, beside: float, variance: float, *, turns: bool = True) -> None:
        """A block shows the edge `beside` the arc [m]. turns: and where it goes."""
        assert self.arc is not None
        self.arc = self.arc.corrected(beside, variance, turns=turns)
        self._past.append(self.arc)

    def advance(self, distance: float) -> None:
        """The next block lies a distance [m] further on."""
        assert self.arc is not None
        self.arc = self.arc.ahead(distance, is_seen=self.arc.unseen < 2.0)

    def retrace(self, distance: float, points: F64, noise: float) -> None:
        """Back to before a distance along the edge [m], and from there on along the points seen since.

        points: of the edge so far, rows of x, u [m], variance [m2] and distance along the edge [m]; noise: of
        all, beside that [m2]
        """
        assert self.arc is not None
        now = self.arc.distance
        while len(self._past) > 1 and self._past[-1].distance >= distance - SAME:
            self._past.pop()
        if not self._past:
            return
        arc = self._past[-1]
        for x, u, variance, there in points[points[:, -1] > arc.distance + SAME].tolist():
            at = arc.frame(x, u, arc.angle)
            arc = arc.ahead(-at.x)
            arc = replace(arc, distance=there).corrected(-arc.frame(x, u, arc.angle).u, variance + noise)
            self._past.append(arc)
        unseen = now - arc.distance
        self.arc = replace(arc.ahead(unseen), unseen=unseen) if unseen > 0.0 else arc

    def rewind(self, arc: Arc, distance: float) -> None:
        """Back to before a distance along the edge [m], and on as an arc from where the last block fitted."""
        while self._past and self._past[-1].distance > distance + SAME:
            self._past.pop()
        self.arc = replace(arc, unseen=arc.distance - distance)
