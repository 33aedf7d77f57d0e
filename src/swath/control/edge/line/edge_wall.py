"""The wall of an edge: where along it the outermost crop stops rays, and what bites that does show.

In a bend away from the crop the rays run along the edge and meet it from outside, up to 2 m from the middle
of the block. In one toward the crop they come out of it, and no wall is seen. Along an even edge the wall
lies as far ahead of the middle from block to block; bites behind what stands out are not seen themselves, but
the rays then meet the faces of the teeth, now nearer, now further ahead.
"""

from dataclasses import dataclass
from math import cos, isfinite, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.canopy_classes import CELL, CLASSES, HALF
from swath.control.edge.profile import Clears
from swath.signals import F64

STRIP, ENOUGH = (-0.05, 0.2), 4  # m beside the edge, number: the echoes that show the wall
ASLANT = (0.2, 0.4)  # rad away from the crop, from which on and beyond which rays run along the edge
JAGGED_M, USUAL_M = 6.0, 15.0  # m of travel over which it is seen how jagged the edge is, and what is usual
TURNS_M, TURNED, LEAST = 6.0, (0.08, 0.2), 0.02  # m of the edge behind; rad by which it turns away since; m
TURNING = 3  # blocks from which it turned away
EVEN = 0.21  # of the crop's height, over which rays come down: standard deviation of where an even wall lies


@dataclass(frozen=True)
class Wall:
    """Mean of where the outermost crop stops rays, along the edge [m], and its variance [m2]; nan: unseen."""

    along: float
    variance: float


def wall_of(rays: NDArray[Any], beside: float, alike: float) -> Wall:
    """The wall of an edge `beside` the frame [m] in answers of a block; alike: rays per independent one."""
    first, last = (round((beside + side + HALF) / CELL) * CLASSES for side in STRIP)
    ahead = rays["ahead"][(rays["cell"] >= first) & (rays["cell"] < last)]
    ahead = ahead[np.isfinite(ahead)]
    if len(ahead) < ENOUGH:
        return Wall(float("nan"), float("nan"))
    mean = float(ahead.mean())
    away = ahead - mean
    return Wall(mean, alike * float((away * away).mean()) / len(ahead))


def place_along(wall: Wall, middle: float, angle: float) -> float:
    """How far ahead along the track a block's edge lies [m]: in the middle of its rays, or at its wall.

    angle: of the track to the machine, < 0 away from the crop [rad]
    """
    share = min(max((-angle - ASLANT[0]) / (ASLANT[1] - ASLANT[0]), 0.0), 1.0)
    return middle + share * (wall.along - middle) if share > 0.0 and isfinite(wall.along) else middle


class WallsBehind(Clears):
    """How far ahead of the middles of their blocks the walls of the last metres lie.

    While an edge goes straight on that says nothing. Where it has turned away since, they are where it was.

    rows: (n, 4): distance of the block along the track [m], angle of the track there [rad], the wall ahead of
        it [m], and how much of that its point was moved [m]
    """

    kept = ("rows",)

    def clear(self) -> None:
        """None."""
        self.rows: F64 = np.zeros((0, 4))

    def add(self, distance: float, angle: float, ahead: float) -> None:
        """Take in a block: distance along the track [m], angle [rad], how far ahead its wall is [m]."""
        rows = self.rows[self.rows[:, 0] > distance - TURNS_M]
        self.rows = np.vstack([rows, [distance, angle, ahead, 0.0]])

    def moves(self, angle: float) -> F64:
        """How an edge that turns moves points: rows of their distance, and moves in x, u and distance [m].

        angle: of the track at its newest block [rad]
        """
        share = np.clip((self.rows[:, 1] - angle - TURNED[0]) / (TURNED[1] - TURNED[0]), 0.0, 1.0)
        if np.count_nonzero(share) < TURNING:
            return np.zeros((0, 4))
        more = share * self.rows[:, 2] - self.rows[:, 3]
        is_moved = share * np.abs(self.rows[:, 2]) > np.abs(self.rows[:, 3]) + LEAST
        more = np.where(is_moved, more, 0.0)
        distance = self.rows[:, 0] + self.rows[:, 3]
        self.rows[:, 3] += more
        which = np.flatnonzero(is_moved)
        angles = self.rows[which, 1].tolist()
        towards = np.array([(cos(a), sin(a), 1.0) for a in angles]).reshape(-1, 3)
        return np.column_stack([distance[which], more[which, None] * towards])


class JaggedWall(Clears):
    """How far to and fro the wall lies, from block to block. variance [m2], beyond what chance gives."""

    kept = ("variance", "_usual")

    def clear(self) -> None:
        """Nothing seen."""
        self.variance, self._usual = 0.0, float("nan")  # m2; m, of the wall ahead of the middle

    def add(self, wall: Wall, middle: float, angle: float, travel: float) -> None:
        """A block's wall, middle of its rays [m] and travel [m]; angle: of the track to the machine [rad].

        Of a wall aslant nothing is reported, and what was seen is forgotten.
        """
        late, usual = min(1.0, travel / JAGGED_M), min(1.0, travel / USUAL_M)
        if abs(angle) > ASLANT[0]:
            self.variance, self._usual = (1.0 - late) * self.variance, float("nan")
        elif isfinite(wall.along):
            ahead = wall.along - middle
            if not isfinite(self._usual):
                self._usual = ahead
            away = (ahead - self._usual) ** 2
            self.variance += late * (max(0.0, away - wall.variance) - self.variance)
            self._usual += usual * (ahead - self._usual)

    def swing(self, height: float) -> float:
        """How much more than along an even edge the wall lies to and fro, standard deviation [m].

        height: of the crop over the stubble [m]
        """
        return float(np.sqrt(max(0.0, self.variance - (EVEN * height) ** 2)))
