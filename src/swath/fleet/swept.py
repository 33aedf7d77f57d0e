"""The ground that bodies sweep: convex outlines, and which of them touch."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.fleet.bodies import Body
from swath.fleet.ground import shapely_here
from swath.kernels import filled, launch

Array = NDArray[np.float64]
Numbers = NDArray[np.int32]
BLOCK = 16  # segments of the table whose box is looked at first


@dataclass
class Swept:
    """Outlines of what a body sweeps over each segment of a path, one of each of its rectangles.

    points: their corners, anticlockwise [m], (n, 2); starts: the first of each outline, and how many there
    are in all, (segments * rects + 1,). An index gives polygons of shapely, (rects,) of a segment, (n, rects)
    of a slice
    """

    points: Array
    starts: Numbers
    rects: int

    def __len__(self) -> int:
        return (len(self.starts) - 1) // self.rects

    def __getitem__(self, which: int | slice) -> Any:
        begin, end, _ = (slice(which, which + 1) if isinstance(which, int) else which).indices(len(self))
        starts = self.starts[begin * self.rects : end * self.rects + 1]
        counts = np.diff(starts)
        rings = np.repeat(np.arange(len(counts)), counts + 1)
        at = np.arange(len(rings)) - rings  # each outline ends where it begins
        at[np.cumsum(counts + 1) - 1] = starts[:-1] - starts[0]
        shapely = shapely_here()
        points = self.points[starts[0] + at]
        out = shapely.polygons(shapely.linearrings(points, indices=rings)).reshape(-1, self.rects)
        return out[0] if isinstance(which, int) else out

    @cached_property
    def boxes(self) -> Array:
        """West, south, east, north of each segment [m], (n, 4)."""
        begins = self.starts[: -1 : self.rects]
        low, high = np.minimum.reduceat(self.points, begins), np.maximum.reduceat(self.points, begins)
        return np.concatenate([low, high], axis=1)

    def then(self, other: "Swept") -> "Swept":
        """These and those of a path behind it."""
        starts = np.concatenate([self.starts, other.starts[1:] + self.starts[-1]])
        return Swept(np.concatenate([self.points, other.points]), starts, self.rects)

    def until(self, count: int) -> "Swept":
        """Of its first segments."""
        starts = self.starts[: count * self.rects + 1]
        return Swept(self.points[: starts[-1]], starts, self.rects)


def swept_by(body: Body, places: Array, first: Any, last: Any, gap: float) -> Swept:
    """What a body, wider by a gap [m], sweeps between places of a path, (n, 4): from the first to the last
    of each segment.
    """
    from swath.fleet import ground_kernel

    parts = np.array([*body.own, *body.towed]) + np.array([-gap, gap, -gap, gap])
    count, first, last = len(parts), np.asarray(first, np.int32), np.asarray(last, np.int32)
    most = int((last - first).max() + 1) * 4
    numbers = np.array([body.hitch, body.drawbar, count, len(body.towed), len(first), len(places)], float)
    points = np.zeros((int((last - first + 1).sum()) * 4 * count + 2, 2))
    starts = np.zeros(len(first) * count + 1, np.int32)
    its = filled(
        ground_kernel.Sweep, numbers=numbers, places=places.ravel(),
        rectangles=parts.ravel(), first=first, last=last,
        room=np.zeros(2 * most), outlines=points.ravel(), starts=starts,
    )  # fmt: skip
    launch(ground_kernel.sweep_path, its)
    return Swept(points[: starts[-1]].copy(), starts, count)


class Rows:
    """Rows of an array that grows and shrinks at its end; `all` has room behind them."""

    def __init__(self, width: int, dtype: Any) -> None:
        self.all = np.zeros((1024, width), dtype)
        self.count = 0

    def add(self, rows: Any) -> None:
        """More at the end."""
        need = self.count + len(rows)
        if need > len(self.all):
            more = np.zeros((2 * need, self.all.shape[1]), self.all.dtype)
            more[: self.count] = self.all[: self.count]
            self.all = more
        self.all[self.count : need] = rows
        self.count = need


class Taken:
    """Outlines of all segments of a table, by their numbers, and who meets them."""

    def __init__(self) -> None:
        self.points, self.starts = Rows(2, np.float64), Rows(1, np.int32)
        self.boxes, self.blocks = Rows(4, np.float64), Rows(4, np.float64)
        self.first, self.machines = Rows(1, np.int32), Rows(1, np.int32)
        self.starts.add([[0]])
        self.first.add([[0]])
        self._number: dict[str, int] = {}
        self._found = np.zeros(2048, np.int32)

    def __len__(self) -> int:
        return self.boxes.count

    def add(self, machine: str, swept: Swept) -> None:
        """Segments of a machine."""
        number = self._number.setdefault(machine, len(self._number))
        self.starts.add(swept.starts[1:, None] + self.points.count)
        outlines = self.first.all[self.first.count - 1, 0] + swept.rects * np.arange(1, len(swept) + 1)
        self.first.add(outlines[:, None])
        self.points.add(swept.points)
        self.boxes.add(swept.boxes)
        self.machines.add(np.full((len(swept), 1), number))
        self._grow()

    def back(self, count: int) -> None:
        """Only so many."""
        self.boxes.count = self.machines.count = count
        self.first.count = count + 1
        self.starts.count = int(self.first.all[count, 0]) + 1
        self.points.count = int(self.starts.all[self.starts.count - 1, 0])
        self.blocks.count = min(self.blocks.count, count // BLOCK)
        self._grow()

    def _grow(self) -> None:
        """Boxes of blocks, the last one anew."""
        self.blocks.count = max(self.blocks.count - 1, 0)
        begins = np.arange(self.blocks.count * BLOCK, len(self), BLOCK)
        if len(begins):
            boxes = self.boxes.all[begins[0] : len(self)]
            low, high = boxes[:, :2], boxes[:, 2:]
            at = begins - begins[0]
            self.blocks.add(
                np.concatenate([np.minimum.reduceat(low, at), np.maximum.reduceat(high, at)], axis=1)
            )

    def met_by(self, swept: Swept, but: str) -> list[list[int]]:
        """Numbers of segments that sweep ground of each segment of a path, none of one machine."""
        from swath.fleet import ground_kernel

        own = len(swept), swept.rects, len(self), BLOCK, self._number.get(but, -1)
        while True:
            most = (len(self._found) - 1) // 2
            its = filled(
                ground_kernel.Meets, numbers=np.array([*own, most], float),
                found=self._found, own_points=swept.points.ravel(),
                own_starts=swept.starts, own_boxes=swept.boxes.ravel(),
                points=self.points.all.ravel(), starts=self.starts.all.ravel(),
                first_outline=self.first.all.ravel(), machines=self.machines.all.ravel(),
                boxes=self.boxes.all.ravel(), blocks=self.blocks.all.ravel(),
            )  # fmt: skip
            launch(ground_kernel.meet_all, its)
            count = int(self._found[0])
            if count <= most:
                break
            self._found = np.zeros(4 * count, np.int32)
        pairs = self._found[1 : 1 + 2 * count].reshape(-1, 2)
        ends = np.searchsorted(pairs[:, 0], np.arange(1, len(swept)))
        return [part.tolist() for part in np.split(pairs[:, 1], ends)]
