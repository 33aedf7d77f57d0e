"""The wall of an edge: where along it the outermost crop stops rays, and what bites that does show.

In a bend away from the crop the rays run along the edge and meet it from outside, up to 2 m from the middle
of the block. In one toward the crop they come out of it, and no wall is seen. Along an even edge the wall
lies as far ahead of the middle from block to block; bites behind what stands out are not seen themselves, but
the rays then meet the faces of the teeth, now nearer, now further ahead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from swath.control.edge.canopy_classes import CELL, CLASSES, HALF
from swath.control.edge.canopy_rays import RayAnswers
from swath.core.component import KeepsState

STRIP, ENOUGH = (-0.05, 0.2), 4  # m beside the edge, number: the echoes that show the wall
ASLANT = (0.2, 0.4)  # rad away from the crop, from which on and beyond which rays run along the edge
JAGGED_M, USUAL_M = 6.0, 15.0  # m of travel over which it is seen how jagged the edge is, and what is usual
EVEN = 0.18  # m, standard deviation of where the wall of an even edge lies


@dataclass(frozen=True)
class Wall:
    """Mean of where the outermost crop stops rays, along the edge [m], and its variance [m2]; nan: unseen."""

    along: float
    variance: float


def wall_of(scans: Sequence[RayAnswers], beside: float, alike: float) -> Wall:
    """The wall of an edge `beside` the frame [m] in the scans of a block; alike: rays per independent ray."""
    first, last = (round((beside + side + HALF) / CELL) * CLASSES for side in STRIP)
    cells, ahead = np.concatenate([r.cells for r in scans]), np.concatenate([r.ahead for r in scans])
    ahead = ahead[(cells >= first) & (cells < last)]
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


class JaggedWall(KeepsState):
    """How far to and fro the wall lies, from block to block. variance [m2], beyond what chance gives."""

    kept = ("variance", "_usual")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        self.variance, self._usual = 0.0, float("nan")  # m2; m, of the wall ahead of the middle

    def add(self, wall: Wall, middle: float, angle: float, travel: float) -> None:
        """A block's wall, middle of its rays [m] and travel [m]; angle: of the track to the machine [rad].

        Of a wall aslant nothing is told, and what was seen is forgotten.
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

    @property
    def swing(self) -> float:
        """How much more than along an even edge the wall lies to and fro, standard deviation [m]."""
        return float(np.sqrt(max(0.0, self.variance - EVEN**2)))
