"""The crop edge as it stands now: where, on a line across a machine, ground without crop turns into crop.

The lines are sampled every STEP_M. A place is an edge where more than half of the SIDE_M on its one side are
standing crop and more than half of those on its other side are not; of several such places within SIDE_M the
one that splits best counts. So stems left standing, weeds and tramlines narrower than that are no edge.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Place = tuple[float, float]  # x, y in the world [m]
STEP_M = 0.01
SIDE_M = 1.5
_HALF = round(SIDE_M / STEP_M)


class Standing(Protocol):
    """Whether crop stands at the middles of `count` steps from places on: (n, count)."""

    def standing_along(self, starts: Sequence[Place], step: Place, count: int, /) -> Bits: ...


def crop_across(field: Standing, pose: Pose, x: Array | float, begin: float, end: float) -> Bits:
    """Whether crop stands on lines across a machine at x [m] ahead, from y = begin to y = end [m].

    pose: pose_world_machine. Shape (n, k) for x of shape (n,), else (k,): the middles of k steps.
    """
    count = max(round(abs(end - begin) / STEP_M), 2)
    (px, py, _), ((ax, bx, _), (ay, by, _), _) = pose.numbers
    first_x, first_y = px + bx * begin, py + by * begin
    at = np.asarray(x, dtype=float)
    starts = [(first_x + ax * ahead, first_y + ay * ahead) for ahead in at.ravel().tolist()]
    width = (end - begin) / count
    return field.standing_along(starts, (bx * width, by * width), count).reshape(*at.shape, count)


def edges_of(crop: Bits) -> list[Array]:
    """Places of all edges on each line, in steps from its begin.

    crop: (n, k), from the cut side to the crop side
    """
    n, k = crop.shape
    flat = crop.ravel()  # one axis: several times as fast
    sums = np.zeros(n * k + 1, np.int32)
    np.cumsum(flat, out=sums[1:])
    place = np.flatnonzero(flat[1:] > flat[:-1]) + 1
    row, at = np.divmod(place, k)
    whole = (at >= _HALF) & (at <= k - _HALF)  # never the begin of a line
    row, at, place = row[whole], at[whole], place[whole]
    inside = sums[place + _HALF] - sums[place]
    outside = _HALF - (sums[place] - sums[place - _HALF])
    is_edge = (2 * inside > _HALF) & (2 * outside > _HALF)
    row, at, score = row[is_edge], at[is_edge], (inside + outside)[is_edge]
    starts = np.searchsorted(row, np.arange(n + 1))
    return [_best(at[a:b], score[a:b]) for a, b in pairwise(starts.tolist())]


def _best(at: NDArray[np.intp], score: NDArray[np.int32]) -> Array:
    """The places that split best among those within SIDE_M; of equal ones the outermost."""
    if len(at) > 1:
        near = np.abs(at[:, None] - at) <= _HALF
        earlier = at[:, None] > at
        better = near & ((score > score[:, None]) | ((score == score[:, None]) & earlier))
        at = at[~better.any(axis=1)]
    return at.astype(float)
