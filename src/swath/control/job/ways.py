"""A way that a machine with a trailer can drive to a place, without reversing and without touching crop.

A* over places and directions: from each it goes on straight or in an arc of the least radius, and from each
the shortest way of arcs and straights (Dubins) to the goal is tried; after Dolgov et al. 2010
(doi:10.1177/0278364909359210), without their smoothing. What is left is estimated by the way of a point
around the crop.
"""

from collections.abc import Iterator
from heapq import heappop, heappush
from math import cos, fsum, hypot, inf, pi, sin

from swath.control.job.dubins import Place, shortest
from swath.control.job.ground import Ground, Mask

STEP = 3.0  # of the search [m]
LOOK = 0.75  # between two places that are looked at [m]
COARSE = 4  # cells of the ground in one of the estimate, along a side
BINS = 24  # directions
MOST = 40_000  # places looked at before it gives up
SHOT = 60.0  # the direct way is tried within this distance [m]
START = 12.0  # about start and goal, where `near` says what is blocked [m]
NEARLY = 1.1  # a way is taken that is at most so much longer than any other can be
MORE = 300  # places that are looked at for a better one, once there is a way
Way = list[tuple[str, float]]


class Search:
    """blocked, near: cells of the ground that are not driven on, and those within START of start and goal."""

    def __init__(self, ground: Ground, blocked: Mask, near: Mask, radius: float) -> None:
        self._ground, self._blocked, self._near, self._radius = ground, blocked, near, radius

    def way(self, start: Place, goals: list[Place]) -> Way | None:
        """Turns and straights from a start to the goal that is reached first; None where there is none.

        All goals are at one place, with different directions.
        """
        self._ends = (start, goals[0])
        estimate = self._estimate(goals[0])
        best: Way | None = None
        least, more = inf, MORE
        queue: list[tuple[float, int, Place, float, int, str]] = []
        came: list[tuple[int, str]] = []
        done: set[tuple[int, int, int]] = set()
        heappush(queue, (self._left(estimate, start), 0, start, 0.0, -1, ""))
        count = 0
        while queue and count < MOST:
            whole, _, here, cost, parent, word = heappop(queue)
            if least <= NEARLY * whole or more == 0:
                break
            more -= best is not None
            key = self._key(here)
            if key in done:
                continue
            done.add(key)
            came.append((parent, word))
            own = len(came) - 1
            if (shot := self._shot(here, goals)) is not None:
                size = cost + fsum(length for _, length in shot)
                if size < least:
                    best, least = [*_followed(came, own), *shot], size
            for to, turn in self._steps(here):
                if self._key(to) in done or not self._is_free(here, [(turn, STEP)]):
                    continue
                spent = cost + STEP * (1.0 if turn == "S" else 1.05)
                left = self._left(estimate, to)
                if left < inf:
                    count += 1
                    heappush(queue, (spent + left, count, to, spent, own, turn))
        return best

    def _key(self, at: Place) -> tuple[int, int, int]:
        turn = round(at.heading / (2.0 * pi) * BINS) % BINS
        return round(at.x / 1.5), round(at.y / 1.5), turn

    def _steps(self, at: Place) -> Iterator[tuple[Place, str]]:
        for word in ("S", "L", "R"):
            yield moved(at, word, STEP, self._radius), word

    def _shot(self, here: Place, goals: list[Place]) -> Way | None:
        """The shortest direct way that is free."""
        if hypot(here.x - goals[0].x, here.y - goals[0].y) > SHOT:
            return None
        ways = [shortest(here, goal, self._radius) for goal in goals]
        for way in sorted(ways, key=lambda w: sum(size for _, size in w)):
            if self._is_free(here, way):
                return way
        return None

    def _is_free(self, here: Place, way: Way) -> bool:
        for word, size in way:
            gone = 0.0
            while gone < size:
                gone = min(gone + LOOK, size)
                if not self._is_open(*moved(here, word, gone, self._radius)[:2]):
                    return False
            here = moved(here, word, size, self._radius)
        return True

    def _is_open(self, x: float, y: float) -> bool:
        is_near = any(hypot(x - end.x, y - end.y) < START for end in self._ends)
        return not self._ground.is_in(self._near if is_near else self._blocked, x, y)

    def _estimate(self, goal: Place) -> dict[tuple[int, int], float]:
        """Way of a point around what is blocked, from coarse cells to the goal [m]."""
        size = COARSE * self._ground.cell
        begin = int((goal.x - self._ground.west) // size), int((goal.y - self._ground.south) // size)
        nx, ny = (-(-n // COARSE) for n in self._blocked.shape)
        found: dict[tuple[int, int], float] = {}
        queue = [(0.0, begin)]
        while queue:
            way, at = heappop(queue)
            if at in found:
                continue
            found[at] = way
            for i, j, step in _AROUND:
                to = at[0] + i, at[1] + j
                if 0 <= to[0] < nx and 0 <= to[1] < ny and to not in found:
                    x = self._ground.west + (to[0] + 0.5) * size
                    y = self._ground.south + (to[1] + 0.5) * size
                    if self._is_open(x, y):
                        heappush(queue, (way + step * size, to))
        return found

    def _left(self, estimate: dict[tuple[int, int], float], at: Place) -> float:
        size = COARSE * self._ground.cell
        cell = int((at.x - self._ground.west) // size), int((at.y - self._ground.south) // size)
        near = [estimate.get((cell[0] + i, cell[1] + j), inf) for i in (0, -1, 1) for j in (0, -1, 1)]
        return near[0] if near[0] < inf else min(near) + size


_AROUND = [(i, j, hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


def moved(at: Place, word: str, size: float, radius: float) -> Place:
    """A place after a turn (`L`, `R`) or a straight (`S`) of a length [m]."""
    if word == "S":
        return Place(at.x + size * cos(at.heading), at.y + size * sin(at.heading), at.heading)
    side = 1.0 if word == "L" else -1.0
    angle = at.heading + side * size / radius
    x = at.x + side * radius * (sin(angle) - sin(at.heading))
    y = at.y - side * radius * (cos(angle) - cos(at.heading))
    return Place(x, y, angle)


def _followed(came: list[tuple[int, str]], at: int) -> Way:
    """The steps from the start to a place."""
    way: Way = []
    while came[at][0] >= 0:
        parent, word = came[at]
        way.append((word, STEP))
        at = parent
    return way[::-1]
