"""The edge as an arc that grows with the travel: where it will be a little further ahead.

All in a frame at rest on the ground, (x, u), which dead reckoning keeps. The state is a point of the arc, its
angle and its bend; a Kalman filter over the way along the arc takes one block after another. What it was some
blocks ago is kept: where an edge breaks off, the blocks just before the break were already wrong, and the
track goes back behind them.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from math import cos, sin

import numpy as np

from swath.control.edge.canopy_rays import EdgeFrame
from swath.core.component import KeepsState
from swath.core.packed_state import saved_type
from swath.core.portable import product
from swath.signals import F64

BEND_STEP = 0.02  # 1/m per sqrt(m): how fast the bend of an edge changes
ANGLE_STEP = 0.01  # rad per sqrt(m), of a ragged one
CLIP = 2.0  # standard deviations that an innovation may count
BACK, BACK_M = 6, 4.0  # blocks that a break takes back, and the way along the edge [m] that they lie in
KEPT = 12  # earlier states
STRETCH, ALIGNED, ENOUGH = 10.0, 0.1, 8  # m, m and number of points that tell where a line goes on from
SCATTER, TURNS = 0.03, 0.05  # m of a point; rad that the arc may be off
_ONE = np.eye(3)


@saved_type()
@dataclass(frozen=True)
class Arc:
    """A point [m] of the edge, its angle [rad] and bend [1/m], their covariance (beside, angle, bend)

    way: along the edge from where it was first seen [m]; unseen: of it since the last block that fitted [m]
    """

    x: float
    u: float
    angle: float
    bend: float
    covariance: F64 = field(default_factory=lambda: np.diag([0.1**2, 0.15**2, 0.02**2]))
    way: float = 0.0
    unseen: float = 0.0

    def ahead(self, way: float, *, is_seen: bool = True) -> "Arc":
        """The arc a way [m] further on. Unseen, its bend is taken to stay as it is."""
        f = np.array([[1.0, way, 0.5 * way * way], [0.0, 1.0, way], [0.0, 0.0, 1.0]])
        covariance = product(product(f, self.covariance), f.T)
        step = abs(way)
        covariance[0, 0] += 1e-5 * step
        if is_seen:
            covariance[1, 1] += ANGLE_STEP**2 * step
            covariance[2, 2] += BEND_STEP**2 * step
        middle = self.angle + 0.5 * self.bend * way
        x, u = self.x + way * np.cos(middle), self.u + way * np.sin(middle)
        angle = self.angle + self.bend * way
        unseen = self.unseen + max(way, 0.0)
        return Arc(float(x), float(u), float(angle), self.bend, covariance, self.way + way, unseen)

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
        bend = min(max(self.bend + float(move[2]), -0.2), 0.2)
        return Arc(float(x), float(u), float(self.angle + move[1]), bend, covariance, self.way, 0.0)

    def beside(self, aside: float) -> tuple[float, float]:
        """A place x, u [m] beside its point [m]."""
        return self.x - aside * float(np.sin(self.angle)), self.u + aside * float(np.cos(self.angle))

    def frame(self, x: float, u: float, angle: float) -> EdgeFrame:
        """The arc in the frame of a machine that stands at x, u [m] with a heading [rad]."""
        c, s = cos(angle), sin(angle)
        dx, du = self.x - x, self.u - u
        return EdgeFrame(c * dx + s * du, c * du - s * dx, self.angle - angle, self.bend)


class ArcTrack(KeepsState):
    """An arc and what it was before. arc: None = no edge."""

    kept = ("arc", "_past")

    def __init__(self) -> None:
        self.clear()

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

    def advance(self, way: float) -> None:
        """The next block lies a way [m] further on."""
        assert self.arc is not None
        self.arc = self.arc.ahead(way, is_seen=self.arc.unseen < 2.0)

    def retrace(self, way: float, points: F64) -> None:
        """Back to before a way along the edge [m], and from there on along the points seen since.

        points: of the edge so far, rows of x, u [m], variance [m2] and way along the edge [m]
        """
        assert self.arc is not None
        now = self.arc.way
        while len(self._past) > 1 and self._past[-1].way >= way:
            self._past.pop()
        if not self._past:
            return
        arc = self._past[-1]
        for x, u, variance, there in points[points[:, -1] > arc.way + 1e-6].tolist():
            at = arc.frame(x, u, arc.angle)
            arc = arc.ahead(-at.x)
            arc = replace(arc, way=there).corrected(-arc.frame(x, u, arc.angle).u, variance)
            self._past.append(arc)
        unseen = now - arc.way
        self.arc = replace(arc.ahead(unseen), unseen=unseen) if unseen > 0.0 else arc

    def rewind(self, straighten: float, points: F64) -> float:
        """Back behind the last blocks, and on from there; the way along [m] from which blocks are doubted.

        straighten: part of the bend that is kept; points: of the edge so far, rows that begin with x, u [m]
        and end with the way along the edge [m]
        """
        assert self.arc is not None
        way = self.arc.way
        for _ in range(min(BACK, len(self._past) - 1)):
            if self._past[-1].way > way - BACK_M:
                self._past.pop()
        if not self._past:
            return way
        old = self._past[-1]
        old = _aligned(old, points[points[:, -1] < old.way + 1e-6])
        old = replace(old, bend=straighten * old.bend)
        self.arc = replace(old.ahead(way - old.way, is_seen=False), unseen=way - old.way)
        return old.way + 1e-6


def _aligned(arc: Arc, points: F64) -> Arc:
    """An arc turned into line with the points before it, straight where as many show that as show its bend.

    Its own angle rests on the last metre. Least squares over the last points that lie near it.
    """
    c, s = cos(arc.angle), sin(arc.angle)
    x, u = points[::-1, 0] - arc.x, points[::-1, 1] - arc.u
    along, beside = c * x + s * u, c * u - s * x
    straight, bent = (_last_near(along, beside - 0.5 * bend * along**2) for bend in (0.0, arc.bend))
    bend = 0.0 if straight >= bent else arc.bend
    count = max(straight, bent)
    if count < ENOUGH:
        return arc
    t, v = along[:count], (beside - 0.5 * bend * along**2)[:count]
    s0, s1, s2 = count + 1.0, float(t.sum()), float((t * t).sum()) + (SCATTER / TURNS) ** 2
    b0, b1 = float(v.sum()), float((t * v).sum())
    det = s0 * s2 - s1 * s1
    aside, turn = (s2 * b0 - s1 * b1) / det, (s0 * b1 - s1 * b0) / det
    return replace(arc, x=arc.x - aside * s, u=arc.u + aside * c, angle=arc.angle + turn, bend=bend)


def _last_near(along: F64, beside: F64) -> int:
    """How many points from the last one on lie so near a line that a small turn takes them into it."""
    far = (np.abs(beside) > ALIGNED - TURNS * along) | (along < -STRETCH)
    return int(np.argmax(far)) if far.any() else len(far)
