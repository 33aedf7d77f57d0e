"""The cells of a search for a way: where the middle of a machine may be, and how far it is from there."""

from copy import copy
from heapq import heappop, heappush
from math import ceil, cos, hypot, inf, sin

import numpy as np

from swath.control.job.ground import Ground, Mask
from swath.control.turns.dubins import Place
from swath.signals import F64

LOOK = 0.75  # between two places that are looked at, at most [m]
START = 12.0  # about start and goal, where `near` says what is blocked [m]
COARSE = 4  # cells of the ground in one of the estimate, along a side
Way = list[tuple[str, float]]


class Cells:
    """blocked, near: cells of the ground that are not driven on, and those within START of the ends."""

    def __init__(self, ground: Ground, blocked: Mask, near: Mask, ends: tuple[Place, Place]) -> None:
        self.cell, self.west, self.south = ground.cell, ground.west, ground.south
        x, y = ground.x[:, None], ground.y[None, :]
        closed = blocked
        for end in ends:
            closed = np.where(np.hypot(x - end.x, y - end.y) < START, near, closed)
        self._mask = closed
        self.columns, self.rows = closed.shape
        self.closed = closed.astype(np.uint8).tobytes()

    def widened(self) -> "Cells":
        """With the cells next to closed ones closed, too."""
        other, wide = copy(self), np.pad(self._mask, 1)
        for i, j in _ALL:
            other._mask = other._mask | wide[1 + i : wide.shape[0] - 1 + i, 1 + j : wide.shape[1] - 1 + j]
        other.closed = other._mask.astype(np.uint8).tobytes()
        return other

    def is_open(self, x: float, y: float) -> bool:
        """False beyond the cells, too."""
        i, j = (x - self.west) / self.cell, (y - self.south) / self.cell
        inside = 0.0 <= i < self.columns and 0.0 <= j < self.rows
        return inside and not self.closed[int(i) * self.rows + int(j)]

    def is_free(self, here: Place, way: Way, radius: float) -> bool:
        """Whether all of a way of turns and straights from a place is open. radius: of the turns [m]"""
        x, y, heading = here
        is_open = self.is_open
        for word, size in way:
            count = ceil(size / LOOK)
            if word == "S":
                dx, dy = size / count * cos(heading), size / count * sin(heading)
                for i in range(1, count + 1):
                    if not is_open(x + i * dx, y + i * dy):
                        return False
                x, y = x + count * dx, y + count * dy
                continue
            side = radius if word == "L" else -radius
            cx, cy, turn = x - side * sin(heading), y + side * cos(heading), size / count / side
            for i in range(1, count + 1):
                angle = heading + i * turn
                if not is_open(cx + side * sin(angle), cy - side * cos(angle)):
                    return False
            heading += count * turn
            x, y = cx + side * sin(heading), cy - side * cos(heading)
        return True

    def remaining_to(self, goal: Place) -> "Remaining":
        """How far a point has to go to the goal around what is closed, from everywhere."""
        size = COARSE * self.cell
        i, j = (np.arange(COARSE // 2, n, COARSE) for n in (self.columns, self.rows))
        closed = np.pad(self._mask[np.ix_(i, j)], 1, constant_values=True)
        wide = closed.shape[1]
        at = int((goal.x - self.west) // size) + 1, int((goal.y - self.south) // size) + 1
        done = bytearray(closed.astype(np.uint8).tobytes())  # what is closed is never gone to
        ways = [inf] * len(done)
        around = [(a * wide + b, size * hypot(a, b)) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
        begin = at[0] * wide + at[1]
        done[begin] = 0
        queue = [(0.0, begin)]
        while queue:
            way, own = heappop(queue)
            if done[own]:
                continue
            done[own] = 1
            ways[own] = way
            for step, far in around:
                if not done[own + step]:
                    heappush(queue, (way + far, own + step))
        return Remaining(self, size, np.array(ways).reshape(closed.shape))


class Remaining:
    """ways: of coarse cells of a size, with a rim around them [m]; a closed cell has that of a neighbour."""

    def __init__(self, cells: Cells, size: float, ways: F64) -> None:
        self.west, self.south, self.size = cells.west, cells.south, size
        self.columns, self.rows = ways.shape
        wide = np.pad(ways, 1, constant_values=np.inf)
        near = [wide[1 + i : wide.shape[0] - 1 + i, 1 + j : wide.shape[1] - 1 + j] for i, j in _ALL]
        self.ways = np.where(np.isfinite(ways), ways, np.min(near, axis=0) + size).ravel().tolist()

    def at(self, x: float, y: float) -> float:
        """From a place [m]; inf where no way leads to the goal."""
        i, j = int((x - self.west) // self.size) + 1, int((y - self.south) // self.size) + 1
        inside = 0 <= i < self.columns and 0 <= j < self.rows
        return self.ways[i * self.rows + j] if inside else inf


_ALL = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
