"""A way that a machine with a trailer can drive to a place, without reversing and without touching crop.

A* over places and directions: from each it goes on straight or in an arc of the least radius, and from each
the shortest way of arcs and straights (Dubins) to the goal is tried; after Dolgov et al. 2010
(doi:10.1177/0278364909359210); what is found is straightened instead of smoothed. What is left is estimated
by the way of a point around the crop. Where too many places are looked at, as on a large field, all is
searched again with more weight on what is left (weighted A*, Pohl 1970, doi:10.1016/0004-3702(70)90007-X). A
goal that no step backward leads away from is not looked for.
"""

from heapq import heappop, heappush
from math import fsum, hypot, inf, pi
from typing import NamedTuple

from swath.control.job.cells import LOOK, Cells, Remaining, Way
from swath.control.job.ground import Ground, Mask
from swath.control.job.straighten import straightened
from swath.control.turns.dubins import Place, moved, shortest

STEP = 3.0  # of the search [m]
BINS = 24  # directions
MOST = 40_000  # places looked at before it gives up
SHOT = 60.0  # the direct way is tried within this distance [m]
NEARLY = 1.1  # a way is taken that is at most so much longer than any other can be
GREEDY = 1.5  # weight of what is left, where MOST places are not enough
MORE = 300  # places that are looked at for a better one, once there is a way
AWAY, NEAR = 40.0, 6.0  # m from a goal, and nearer to it than the start is, that steps backward have to lead
ASKED = 3000  # places that are looked at for that


class Step(NamedTuple):
    """Straight on or in an arc: turns: of the direction, in arcs; looks: along it, from its begin; x, y: its
    end [m]; cost [m]
    """

    word: str
    turns: int
    looks: tuple[tuple[float, float], ...]
    x: float
    y: float
    cost: float


class Steps:
    """The steps from every direction that is reached from a first one [rad]. radius: of an arc [m]"""

    def __init__(self, heading: float, radius: float) -> None:
        self._heading, self._radius = heading, radius
        self._made: dict[int, tuple[int, list[Step]]] = {}

    def heading(self, turns: int) -> float:
        """Direction after so many arcs to the left more than to the right [rad]."""
        return self._heading + turns * STEP / self._radius

    def of(self, turns: int) -> tuple[int, list[Step]]:
        """One of BINS directions, and the steps from there."""
        if turns not in self._made:
            here = Place(0.0, 0.0, self.heading(turns))
            which = round(here.heading / (2.0 * pi) * BINS) % BINS
            count = round(STEP / LOOK)
            made = []
            for word, side in (("S", 0), ("L", 1), ("R", -1)):
                looks = [moved(here, word, STEP * (i + 1) / count, self._radius)[:2] for i in range(count)]
                made.append(
                    Step(word, turns + side, tuple(looks), *looks[-1], STEP * (1.05 if side else 1.0))
                )
            self._made[turns] = which, made
        return self._made[turns]


class Search:
    """blocked, near: cells of the ground that are not driven on, and those near start and goal."""

    def __init__(self, ground: Ground, blocked: Mask, near: Mask, radius: float) -> None:
        self._ground, self._blocked, self._near, self._radius = ground, blocked, near, radius

    def way(self, start: Place, goals: list[Place]) -> Way | None:
        """Turns and straights from a start to the goal that is reached first; None where there is none.

        All goals are at one place, with different directions.
        """
        cells = Cells(self._ground, self._blocked, self._near, (start, goals[0]))
        goals = [goal for goal in goals if self._is_reached(cells, goal, start)]
        if not goals:
            return None
        remaining = cells.remaining_to(goals[0])
        way, is_whole = self._searched(cells, remaining, start, goals, 1.0)
        if way is None and not is_whole:
            way, _ = self._searched(cells, remaining, start, goals, GREEDY)
        return None if way is None else straightened(cells.widened(), start, way, self._radius)

    def _searched(
        self, cells: Cells, remaining: Remaining, start: Place, goals: list[Place], weight: float
    ) -> tuple[Way | None, bool]:
        """A way, and whether all was looked at. weight: of what is left to the goal; > 1: sooner a way"""
        steps = Steps(start.heading, self._radius)
        best: Way | None = None
        least, more = inf, MORE
        came: list[tuple[int, str]] = []
        done: set[tuple[int, int, int]] = set()
        queue = [(weight * remaining.at(start.x, start.y), 0, start.x, start.y, 0, 0.0, -1, "")]
        count = 0
        while queue and count < MOST:
            whole, _, x, y, turns, cost, parent, word = heappop(queue)
            if least <= NEARLY * whole or more == 0 or (best is not None and weight > 1.0):
                break
            more -= best is not None
            key, following = self._key(x, y, steps, turns)
            if key in done:
                continue
            done.add(key)
            came.append((parent, word))
            own = len(came) - 1
            if (shot := self._shot(cells, Place(x, y, steps.heading(turns)), goals)) is not None:
                size = cost + fsum(length for _, length in shot)
                if size < least:
                    best, least = [*_followed(came, own), *shot], size
            for step in following:
                to = x + step.x, y + step.y
                if self._key(*to, steps, step.turns)[0] in done or not is_step_free(cells, x, y, step):
                    continue
                rest = remaining.at(*to)
                if rest < inf:
                    count += 1
                    spent = cost + step.cost
                    heappush(queue, (spent + weight * rest, count, *to, step.turns, spent, own, step.word))
        return best, not queue

    def _is_reached(self, cells: Cells, goal: Place, start: Place) -> bool:
        """Whether steps backward from a goal lead away from it, or nearly to the start."""
        if not cells.is_open(goal.x, goal.y):
            return False
        reach = min(AWAY, hypot(goal.x - start.x, goal.y - start.y) - NEAR)
        steps = Steps(goal.heading + pi, self._radius)
        done: set[tuple[int, int, int]] = set()
        queue = [(goal.x, goal.y, 0)]
        while queue and len(done) < ASKED:
            x, y, turns = queue.pop()
            if hypot(x - goal.x, y - goal.y) >= reach:
                return True
            key, following = self._key(x, y, steps, turns)
            if key in done:
                continue
            done.add(key)
            queue += [
                (x + step.x, y + step.y, step.turns)
                for step in reversed(following)
                if is_step_free(cells, x, y, step)
            ]
        return bool(queue)

    @staticmethod
    def _key(x: float, y: float, steps: Steps, turns: int) -> tuple[tuple[int, int, int], list[Step]]:
        which, following = steps.of(turns)
        return (round(x / 1.5), round(y / 1.5), which), following

    def _shot(self, cells: Cells, here: Place, goals: list[Place]) -> Way | None:
        """The shortest direct way that is free."""
        if hypot(here.x - goals[0].x, here.y - goals[0].y) > SHOT:
            return None
        ways = [shortest(here, goal, self._radius) for goal in goals]
        for way in sorted(ways, key=lambda w: sum(size for _, size in w)):
            if cells.is_free(here, way, self._radius):
                return way
        return None


def is_step_free(cells: Cells, x: float, y: float, step: Step) -> bool:
    """Whether all of a step from a place [m] is open."""
    is_open = cells.is_open
    for dx, dy in step.looks:  # noqa: SIM110 - in the innermost loop of a search
        if not is_open(x + dx, y + dy):
            return False
    return True


def _followed(came: list[tuple[int, str]], at: int) -> Way:
    """The steps from the start to a place."""
    way: Way = []
    while came[at][0] >= 0:
        parent, word = came[at]
        way.append((word, STEP))
        at = parent
    return way[::-1]
