"""What a LiDAR sees of the box, beside what the messages say: their error of place, and the grain."""

from math import exp

import numpy as np

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.signals import F64, BoxSeen

SETTLES = 2.0  # time in which the error of the messages is learnt [s]


class SeenBox(KeepsState):
    """Remembers between looks. dx, dy: the box as it is seen less the box as the messages say [m].

    at: time of the last look that showed it [ns], -1 before
    """

    kept = ("dx", "dy", "at", "_heights", "_freeboard", "lean")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing seen: the messages are right."""
        self.dx = self.dy = self.lean = 0.0
        self.at = -1
        self._heights: F64 | None = None
        self._freeboard: F64 | None = None

    def update(self, seen: BoxSeen | None, x: float, y: float) -> None:
        """Take the newest look. x, y: of the box by the messages, in the frame of the looks [m]."""
        if seen is None or not seen.is_seen or seen.t == self.at:
            return
        share = 1.0 if self.at < 0 else 1.0 - exp(-(seen.t - self.at) / NS / SETTLES)
        self.dx += share * (seen.x - x - self.dx)
        self.dy += share * (seen.y - y - self.dy)
        self.at = seen.t
        self._heights = _newer(seen.profile, self._heights)
        self._freeboard = _newer(seen.freeboard, self._freeboard)
        self.lean = seen.lean

    def age(self, t: int) -> float:
        """Time since the last look that showed the box [s], inf before."""
        return (t - self.at) / NS if self.at >= 0 else float("inf")

    def grain(self, depth: float) -> tuple[F64, F64]:
        """Heights above the floor and freeboard, rear to front [m]; a place never seen counts as empty."""
        heights = np.full(1, np.nan) if self._heights is None else self._heights
        freeboard = np.full(len(heights), np.nan) if self._freeboard is None else self._freeboard
        height = np.where(np.isfinite(heights), heights, -depth) + depth
        return height, np.where(np.isfinite(freeboard), freeboard, depth)


def _newer(now: F64, before: F64 | None) -> F64:
    """What is seen now, elsewhere what was seen before."""
    if before is None or len(before) != len(now):
        return now
    return np.where(np.isfinite(now), now, before)
