"""What lines sweep over between two moments, as convex polygons without gaps, and what fields make of it."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from swath.core.component import State
from swath.core.errors import SwathError
from swath.core.together import KeepsRows
from swath.field.cutting.land import CORNERS, DONE, Tasks
from swath.field.field import Field
from swath.kernels import Repeated, filled_by, over_rows

Corners = list[list[float]]  # x, y of each [m]
Numbered = tuple[Corners, float, float]  # a polygon, and two numbers that belong to it
POLYGON = CORNERS + 8  # numbers, see `land_kernel.Work`


class Sweeps:
    """Lines of points in worlds, whose points go straight from position to position.

    Between two positions of the ends of a run there are convex polygons, anticlockwise: a quad where the line
    moves ahead; two triangles that meet in a point where it turns about a point of its own (one end backs
    up); two triangles where the quad has a dent. Both positions are edges of what is found, so the next sweep
    joins without a gap. None when nothing moved.

    active: (worlds,) those that still run
    steps: of each, positions closer together than this are joined [m]; below 0 none are
    room: for positions; lines, counts: (worlds, room, points, 2) new positions [m], (worlds,) how many
    runs: (worlds, points - 1, 3) parts of a line: first point (-1 = no more), last point, a code
    last: (worlds, 1 + 2 points) 1 once the line was anywhere, and where it was last
    polygons, found: (worlds, n, POLYGON) with area [m2] and code, (worlds,) how many
    more: what else the kernels take, see `crop_kernel.Sweeping`
    """

    def __init__(self, points: int, steps: Sequence[float]) -> None:
        n = len(steps)
        self.steps, self.active = np.array(steps), np.ones(n, np.bool_)
        self.counts, self.found = np.zeros(n, np.int32), np.zeros(n, np.int32)
        self.runs, self.last = np.full((n, points - 1, 3), -1, np.int32), np.zeros((n, 1 + 2 * points))
        self.runs[:, 0] = 0, points - 1, 0
        self.widen(1)

    def widen(self, room: int, **more: Any) -> None:
        """Have room for so many positions."""
        n, runs, _ = self.runs.shape
        self.lines, self.polygons = np.zeros((n, room, runs + 1, 2)), np.zeros((n, 2 * room * runs, POLYGON))
        vars(self).update(more)
        self.launch = self.launch_of("sweep_lines")  # which finds the polygons

    def launch_of(self, name: str) -> Repeated:
        """The launch of a kernel."""
        from swath.machine import crop_kernel as kernel

        return over_rows(len(self.steps), getattr(kernel, name), filled_by(kernel.Sweeping, self))

    def between(self, before: Corners, after: Corners) -> Iterator[Numbered]:
        """The polygons of a line of two ends in the only world."""
        self.last[0], self.lines[0, 0], self.counts[0] = [1.0, *before[0], *before[1]], after, 1
        self.launch.launch()
        return numbered(self.polygons[0, : self.found[0]])


class FieldTasks(Tasks):
    """Polygons that fields take, each its own."""

    def __init__(self, fields: Sequence[Field], polygons: Any, found: Any, needs: Any) -> None:
        super().__init__(polygons, found, needs)
        self._fields = fields

    def rest(self, take: Callable[..., None]) -> dict[int, SwathError]:
        """Do what compiled code did not; by world why that is refused.

        take: a polygon of a world, with its two numbers
        """
        errors = dict[int, SwathError]()
        for world in np.flatnonzero(self.sums[:, DONE] < self.found).tolist():
            field = self._fields[world]
            try:
                for polygon in numbered(
                    self.polygons[world, int(self.sums[world, DONE]) : self.found[world]]
                ):
                    take(world, *polygon)
                    self.sums[world, DONE] += 1
            except SwathError as error:
                errors[world] = error
            field.lend(self, world)
        return errors


class OneWorld:
    """`save` and `load` of the only world of what keeps rows."""

    def __init__(self, rows: KeepsRows) -> None:
        self.rows = rows

    def save(self) -> State:
        """As that."""
        return self.rows.save(0)

    def load(self, state: State) -> None:
        """As that."""
        self.rows.load(0, state)


def numbered(polygons: Any) -> Iterator[Numbered]:
    """Polygons (n, POLYGON) with the numbers that belong to each."""
    for corners, first, second, *places in polygons.tolist():
        points = zip(places[::2], places[1::2], strict=True)
        yield [[x, y] for x, y in points][: int(corners)], first, second
