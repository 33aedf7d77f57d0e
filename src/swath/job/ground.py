"""Which ground is cut while combines work a field, each at its own place of the plan."""

from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.job.plan import FREE_SHARE, PlannedPass

Array = NDArray[np.float64]
SPACING = 8.0  # m between the places on a pass's left that are looked at


class CutGround:
    """Strips of the passes that are done. width: of the header [m]; pipe: how far left a cart drives [m]."""

    def __init__(self, passes: tuple[PlannedPass, ...], width: float, pipe: float) -> None:
        self._half, self._pipe = 0.5 * width, pipe
        rows = [(*a, *b, i) for i, p in enumerate(passes) for a, b in _pieces(p)]
        table = np.array(rows)
        self._from, self._of = table[:, :2], table[:, 4].astype(int)
        way = table[:, 2:4] - self._from
        self._length = np.hypot(way[:, 0], way[:, 1])
        self._ahead = way / self._length[:, None]
        self._is_cut = np.zeros(len(rows), dtype=bool)

    def cut(self, index: int) -> None:
        """A pass is done."""
        self._is_cut |= self._of == index

    def is_free_beside(self, task: PlannedPass, begun: Collection[int] = ()) -> bool:
        """True where the ground on the left of a pass, under the pipe, is cut. begun: passes that are being
        cut ahead of it
        """
        cut = self._is_cut | np.isin(self._of, list(begun))
        places = _beside(task, self._pipe)
        return bool(self._is_on(self._strips(cut), places, 0.0).mean() >= FREE_SHARE)

    def is_beside(self, task: PlannedPass, index: int) -> bool:
        """True where a pass lies beside another one, on its left or right."""
        strips = self._strips(self._of == index)
        sides = (_beside(task, side * 2.0 * self._half) for side in (1.0, -1.0))
        return any(self._is_on(strips, places, 0.0).mean() >= 0.5 for places in sides)

    def is_clear(self, points: Array, keep: float, begun: Sequence[tuple[int, Array]] = ()) -> bool:
        """Whether all points, (n, 2) [m], are so far from standing crop [m]. begun: passes that are being
        cut, and the line (n, 2) [m] of what is left of each
        """
        stands = ~(self._is_cut | np.isin(self._of, [index for index, _ in begun]))
        off = not self._is_on(self._strips(stands), points, keep).any()
        return off and self.is_off([line for _, line in begun], points, keep)

    def is_off(self, lines: Sequence[Array], points: Array, keep: float) -> bool:
        """Whether all points, (n, 2), are so far from the strips along some lines, (n, 2) each [m]."""
        pieces = [(a, b) for line in lines for a, b in pairwise(line.tolist()) if a != b]
        if not pieces:
            return True
        ends = np.array(pieces)
        way = ends[:, 1] - ends[:, 0]
        length = np.hypot(way[:, 0], way[:, 1])
        return not self._is_on((ends[:, 0], way / length[:, None], length), points, keep).any()

    def _strips(self, which: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Of some pieces of passes: begins, directions, (n, 2) each, and lengths, (n,) [m]."""
        return self._from[which], self._ahead[which], self._length[which]

    def _is_on(self, strips: tuple[Array, Array, Array], points: Array, keep: float) -> NDArray[np.bool_]:
        """Whether each of some points, (n, 2), is on one of some strips or so near to it [m], (n,)."""
        begins, ahead, length = strips
        dx, dy = (points[:, None, :] - begins).transpose(2, 0, 1)
        along, across = dx * ahead[:, 0] + dy * ahead[:, 1], dy * ahead[:, 0] - dx * ahead[:, 1]
        on = (along >= -keep) & (along <= length + keep) & (np.abs(across) <= self._half + keep)
        return np.asarray(on.any(axis=1))


def _beside(task: PlannedPass, left: float) -> Array:
    """Places on the left of a pass [m], (n, 2)."""
    found = []
    for a, b in ((np.array(a), np.array(b)) for a, b in _pieces(task)):
        way = b - a
        size = float(np.hypot(*way))
        count = max(2, round(size / SPACING))
        aside = left * np.array([-way[1], way[0]]) / size
        found.append(a + aside + (np.arange(count)[:, None] + 0.5) / count * way)
    return np.concatenate(found)


def _pieces(task: PlannedPass) -> list[tuple[list[float], list[float]]]:
    points = task.line.tolist()
    return [(a, b) for a, b in pairwise(points) if a != b]
