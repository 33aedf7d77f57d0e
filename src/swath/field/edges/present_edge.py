"""The true edge of the crop: the wall that stands now, and the line to be steered along.

The wall is where, on a line across a machine, ground without crop turns into crop. The line is what an edge
detector should report: the wall, but across a hole of the initial edge, which goes on behind it (`Holes`).

Lines across a machine are sampled every STEP_M. A place is an edge where more than half of the SIDE_M on its
one side are standing crop and more than half of those on its other side are not; of several such places
within SIDE_M the one that splits best counts. So stems left standing, weeds and tramlines narrower than that
are no edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.core.together import plain
from swath.field.edges.edge_defects import Gap
from swath.field.edges.rows import Rows

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Place = tuple[float, float]  # x, y in the world [m]
STEP_M = 0.01
SIDE_M = 1.5
FIRST_M, ROUNDS, CLOSE_M = 0.1, 4, 0.005  # first step, rounds and what the last one may change
FLAT = 1e-3  # sine of the angle to the edge at which a line across a machine runs along it
_HALF = round(SIDE_M / STEP_M)
_BESIDE = np.arange(-_HALF, _HALF)


class Standing(Protocol):
    """Whether crop stands at the middles of `count` steps from places on: (n, count).

    rows: of a row crop
    """

    @property
    def rows(self) -> Rows | None:
        """Rows of the crop, None without."""

    def standing_along(self, starts: Sequence[Place], step: Place, count: int, /) -> Bits:
        """Whether crop stands, (n, count)."""


def crop_across(field: Standing, pose: Pose, x: Array | float, begin: float, end: float) -> Bits:
    """Whether crop stands on lines across a machine at x [m] ahead, from y = begin to y = end [m].

    pose: pose_world_machine. Shape (n, k) for x of shape (n,), else (k,): the middles of k steps.
    """
    at = np.asarray(x, dtype=float)
    numbers, count = plain(pose), steps_between(begin, end)
    starts = [start_across(numbers, ahead, begin) for ahead in at.ravel().tolist()]
    crop = crop_along(field, numbers, starts, (end - begin) / count, count)
    return crop.reshape(*at.shape, count)


def steps_between(begin: float, end: float) -> int:
    """How many steps a line between two places [m] has."""
    return max(round(abs(end - begin) / STEP_M), 2)


def start_across(pose: Any, x: Any, begin: Any) -> Any:
    """Where a line across a machine begins, x ahead and `begin` to the left of its origin [m].

    pose: pose_world_machine as 12 numbers: position, then rows of the rotation; of several machines (12, n)
    """
    px, py, _, ax, bx, _, ay, by = pose[:8]
    return px + bx * begin + ax * x, py + by * begin + ay * x


def crop_along(
    field: Standing, pose: Sequence[float], starts: Sequence[Place], width: float, count: int
) -> Bits:
    """Whether crop stands at the middles of steps of a width [m] to the left of a machine, (n, count).

    In a row crop the ground is its row's, see `field/edges/rows.py`.

    pose: as 12 numbers; starts: of the lines, in the world [m]
    """
    bx, by = pose[4], pose[7]
    crop = field.standing_along(starts, (bx * width, by * width), count)
    return whole_rows(field, crop, pose, starts, width)


def whole_rows(field: Standing, crop: Bits, pose: Sequence[float], starts: Any, width: float) -> Bits:
    """In a row crop that is driven along, the ground is its row's."""
    rows, (ax, bx, _, ay, by) = field.rows, pose[3:8]
    if rows is None or not rows.are_along(ax, ay):
        return crop
    return rows.whole(crop, rows.left(*np.array(starts).T), width * float(rows.left(bx, by)))


def edges_of(crop: Bits) -> list[Array]:
    """Places of all edges on each line, in steps from its begin.

    crop: (n, k), from the cut side to the crop side
    """
    n, k = crop.shape
    flat = crop.ravel()  # one axis: several times as fast
    place = np.flatnonzero(flat[1:] > flat[:-1]) + 1
    row, at = np.divmod(place, k)
    whole = (at >= _HALF) & (at <= k - _HALF)  # never the begin of a line
    row, at = row[whole], at[whole]
    beside = flat[place[whole, None] + _BESIDE]
    inside = np.count_nonzero(beside[:, _HALF:], axis=1)
    outside = _HALF - np.count_nonzero(beside[:, :_HALF], axis=1)
    is_edge = (2 * inside > _HALF) & (2 * outside > _HALF)
    row, at, score = row[is_edge], at[is_edge], (inside + outside)[is_edge]
    starts = np.searchsorted(row, np.arange(n + 1))
    places = at.astype(float)
    ends = pairwise(starts.tolist())
    return [places[a:b] if b <= a + 1 else _best(places[a:b], score[a:b]) for a, b in ends]


def _best(at: Array, score: NDArray[np.int64]) -> Array:
    """The places that split best among those within SIDE_M; of equal ones the outermost."""
    near = np.abs(at[:, None] - at) <= _HALF
    earlier = at[:, None] > at
    better = near & ((score > score[:, None]) | ((score == score[:, None]) & earlier))
    found: Array = at[~better.any(axis=1)]
    return found


class InitialEdge(Protocol):
    """The initial edge without its holes; distances > 0 on the side of the crop. length [m]."""

    @property
    def length(self) -> float:
        """Length of the edge [m]."""

    def signed_distance(self, x: Any, y: Any) -> Any:
        """Distance from the edge [m], > 0 on the side of the crop."""

    def project(self, x: Any, y: Any) -> Any:
        """Distance along the edge of the nearest point on it [m]."""


@dataclass(frozen=True)
class Holes:
    """Holes of the initial edge, across which the line to be steered along is the initial edge itself.

    A hole ends before the edge does; else the crop ends there. So it is on the first pass, while the header
    end that follows the edge is within `reach` [m] of it, half a header. A later pass leaves an edge of its
    own, and nobody knows where it would go on beside a hole.
    """

    edge: InitialEdge
    gaps: Sequence[Gap]
    reach: float

    def line(self, places: Array, left: Array, ends: Array) -> Array:
        """How far left of places the line across a hole lies [m], nan where no hole is: (n,).

        places: (n, 2) in the world; left: unit vectors (n, 2) of the machine's y axis, along which it is
        looked for; ends: of the header (n, 2), at the knife
        """
        first, second = np.zeros(len(places)), np.full(len(places), FIRST_M)
        off = self._off(places, left, first)
        for _ in range(ROUNDS):  # of the secant method: one finds a straight edge
            last, off = off, self._off(places, left, second)
            steep = np.abs(off - last) > FLAT * np.abs(second - first)
            change = np.divide(off * (second - first), off - last, out=np.zeros_like(off), where=steep)
            first, second = second, second - change
        x, y = (places + second[:, None] * left).T
        s = np.asarray(self.edge.project(x, y)[0])
        holes = [gap for gap in self.gaps if gap.end < self.edge.length]
        is_hole = np.any([np.zeros(len(s), bool), *((s >= g.start) & (s < g.end) for g in holes)], axis=0)
        is_first = np.abs(self.edge.signed_distance(*ends.T)) <= self.reach
        return np.where(is_hole & is_first & (np.abs(change) < CLOSE_M), second, np.nan)

    def _off(self, places: Array, left: Array, at: Array) -> Array:
        x, y = (places + at[:, None] * left).T
        return np.asarray(self.edge.signed_distance(x, y), dtype=float)
