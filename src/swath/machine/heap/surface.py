"""The surface of grain in a box with walls, poured slowly: nowhere steeper than the angle of repose.

Grain poured on a point p builds a cone of slope tan(a) about it, as far as that rises above what lies there:

    h(x) = max(h(x), H - tan(a) |x - p|)

with H by the volume. From a surface that is nowhere steeper than a this is the exact growth of a sand pile
(Prigozhin 1996, Eur. J. Appl. Math. 7:225, for a source in a point); walls only bound it. The cone reaches
the rim, at the wall nearest to p, when H = depth + tan(a) distance: more than that runs over there.
"""

from math import floor, tan

import numpy as np

from swath.core.component import KeepsState
from swath.signals import F64
from swath.signals.setup import OpenBox

BESIDE = 0.15  # how far from the wall grain lands that ran over the rim [m]


class Surface(KeepsState):
    """Heights above the floor at the middles of square cells, x along the box, y to the left of its middle.

    box: its measures; slope: tangent of the angle of repose; cell: wanted side of a cell [m]
    """

    kept = ("heights",)

    def __init__(self, box: OpenBox, slope: float, cell: float) -> None:
        self.box, self.slope = box, slope
        self._nx = max(1, round(box.length / cell))
        self._ny = max(1, round(box.width / cell))
        dx, dy = box.length / self._nx, box.width / self._ny
        self.x = (np.arange(self._nx) + 0.5) * dx - 0.5 * box.length
        self.y = (np.arange(self._ny) + 0.5) * dy - 0.5 * box.width
        self.area = dx * dy
        self.heights = np.zeros((self._nx, self._ny))

    def level(self, volume: float) -> None:
        """An even surface of so much grain [m3]."""
        self.heights[:] = volume / (self.box.length * self.box.width)

    @property
    def volume(self) -> float:
        """Grain under the surface [m3]."""
        return float(self.heights.sum()) * self.area

    def pour(self, volume: float, x: float, y: float) -> float:
        """Pour grain [m3] on a point of the box [m]; returns what runs over the rim."""
        away = self.slope * np.sqrt((self.x[:, None] - x) ** 2 + (self.y[None, :] - y) ** 2)
        foot = (self.heights + away).ravel()
        order = np.sort(foot)
        count = np.arange(1, len(order) + 1)
        # volume below a cone with its top at the k-th foot; the top lies between two of them
        under = (count * order - np.cumsum(order)) * self.area
        k = int(np.searchsorted(under, volume, side="right"))
        top = (volume / self.area + float(np.cumsum(order)[k - 1])) / k
        most = self.top_at_rim(x, y)
        spilled = 0.0
        if top > most:
            top = max(most, float(order[0]))
            spilled = volume - float(np.maximum(top - foot, 0.0).sum()) * self.area
        np.maximum(self.heights, top - away, out=self.heights)
        return max(spilled, 0.0)

    def top_at_rim(self, x: float, y: float) -> float:
        """Height above the floor of a cone about a point whose foot lies on the rim [m]."""
        beside = min(0.5 * self.box.length - abs(x), 0.5 * self.box.width - abs(y))
        return self.box.depth + self.slope * max(beside, 0.0)

    def at(self, x: float, y: float) -> float:
        """Height of the surface above the floor at a point of the box, of the nearest cell [m]."""
        i = floor((x / self.box.length + 0.5) * self._nx)
        j = floor((y / self.box.width + 0.5) * self._ny)
        return float(self.heights[min(max(i, 0), self._nx - 1), min(max(j, 0), self._ny - 1)])

    def profile(self, x: F64) -> F64:
        """Heights along the middle line at places of the box [m]."""
        half = self._ny // 2
        middle = 0.5 * (self.heights[:, half] + self.heights[:, (self._ny - 1) // 2])
        return np.asarray(np.interp(x, self.x, middle))

    @property
    def lean(self) -> float:
        """How much higher grain stands at the left wall than at the right one, the mean [m]."""
        return float((self._at_wall(-1, -2) - self._at_wall(0, 1)).mean())

    def freeboard(self, count: int) -> F64:
        """Rim above the grain at the nearest walls, the least in each of `count` parts of the length [m]."""
        sides = np.maximum(self._at_wall(0, 1), self._at_wall(-1, -2))
        if self._nx > 1:
            for end, inner in ((0, 1), (-1, -2)):
                at_end = self.heights[end] + 0.5 * (self.heights[end] - self.heights[inner])
                sides[end] = max(sides[end], float(at_end.max()))
        part = np.minimum((np.arange(self._nx) * count) // self._nx, count - 1)
        found = np.zeros(count)
        np.maximum.at(found, part, sides)
        return np.asarray(self.box.depth - found)

    def _at_wall(self, last: int, inner: int) -> F64:
        """Heights at a side wall, (nx,) [m]: half a cell beyond the last cells, as the surface falls."""
        if self._ny < 2:
            return np.asarray(self.heights[:, last])
        beside = self.heights[:, last]
        return np.asarray(beside + 0.5 * (beside - self.heights[:, inner]))


def outside(box: OpenBox, x: float, y: float) -> tuple[float, float]:
    """Where grain comes down that runs over the wall nearest to a point of the box [m]."""
    along, across = 0.5 * box.length - abs(x), 0.5 * box.width - abs(y)
    if along < across:
        return (0.5 * box.length + BESIDE) * (1.0 if x >= 0.0 else -1.0), y
    return x, (0.5 * box.width + BESIDE) * (1.0 if y >= 0.0 else -1.0)


def largest_heap(box: OpenBox, slope: float) -> float:
    """The most that stands on the rim, a hip roof [m3]: L W D + tan(a) W^2 / 4 (L - W / 3)."""
    long, wide = max(box.length, box.width), min(box.length, box.width)
    return long * wide * box.depth + slope * wide**2 / 4.0 * (long - wide / 3.0)


def slope_of(repose: float) -> float:
    """Tangent of an angle of repose [rad]."""
    return tan(repose)
