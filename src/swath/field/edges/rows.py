"""Row crops: where their edge is.

In a row crop the ground up to half a spacing to both sides of a row is that row's. So where the edge runs
along the rows it lies midway between the outer row and the one that would stand next: at the outer row less
half the spacing. There the divider of a header goes between two rows, passes lie side by side without a rest,
and a machine may stray by nearly half a spacing before it takes a row too many or leaves one; the foot of the
outer row would be a line over plants. Where the edge crosses the rows it is where they end.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.edges.edge import edge_key
from swath.field.edges.edge_defects import BrokenEdge
from swath.field.edges.track import EdgeShape

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
PLANTED_M = 0.35  # rows farther apart are planted and cut as rows: planters from 38 cm (15 in), drills to 30
ALONG_M = 10.0  # an edge that stays between the same two rows for so long runs along them
STRAYS = 0.25  # of the spacing, up to which all of a line may lie off its middle and still be one along a row
SAMPLES = 256  # along an edge
SAME_M = 1e-6  # an edge is not moved by less


@dataclass(frozen=True)
class Rows:
    """Rows `spacing` [m] apart, one of them half a spacing left of the origin.

    heading: their direction in the world [rad]
    """

    spacing: float
    heading: float

    def left(self, x: Any, y: Any) -> Array:
        """How far places lie left of the origin, seen along the rows [m]; of vectors the part across them."""
        return np.asarray(np.cos(self.heading) * y - np.sin(self.heading) * x)

    def are_along(self, x: float, y: float) -> bool:
        """Whether a direction (unit vector in the world) runs along the rows."""
        return abs(float(self.left(x, y))) * ALONG_M < self.spacing

    def whole(self, crop: Bits, begins: Array, step: float) -> Bits:
        """Whether the row stands whose the ground is, on lines across the rows.

        crop: (n, k), whether crop stands at the middles of k steps; begins: `left` of each line's begin (n,);
        step: `left` of a step [m]
        """
        count = crop.shape[1]
        at = begins[:, None] + step * (np.arange(count) + 0.5)
        row = self.spacing * (np.floor(at / self.spacing) + 0.5)
        index = np.floor((row - begins[:, None]) / step).astype(np.intp)
        index = np.where((index >= 0) & (index < count), index, np.arange(count))
        return np.take_along_axis(crop, index, axis=1)

    def beside(self, shape: EdgeShape) -> EdgeShape:
        """The line of an edge that runs along the rows moved to midway between two; any other as it is.

        The outer row is the first one on the crop side of the line.
        """
        x, y = shape.point_at(np.linspace(0.0, shape.length, SAMPLES)).T
        across = self.left(x, y)
        middle = float(np.mean(across))
        if np.ptp(across) > 2.0 * STRAYS * self.spacing or shape.is_closed:
            return shape
        is_along = np.cos(shape.heading_at(0.5 * shape.length) - self.heading) > 0.0
        inwards = 1.0 if (shape.crop_side == "left") == bool(is_along) else -1.0
        outer = np.ceil(inwards * middle / self.spacing - 0.5 - SAME_M)
        move = inwards * self.spacing * float(outer) - middle
        if abs(move) <= SAME_M:
            return shape
        dx, dy = -np.sin(self.heading) * move, np.cos(self.heading) * move
        pieces = [replace(p, x=p.x + float(dx), y=p.y + float(dy)) for p in shape.pieces]
        return EdgeShape(pieces, shape.crop_side)


def rows_of(spacing: float, heading: float) -> Rows | None:
    """The rows of a crop, None where it is none that is cut in rows. spacing: 0 = no rows."""
    return Rows(spacing, heading) if spacing >= PLANTED_M else None


def moved_edges(
    edges: Mapping[str, BrokenEdge], rows: Rows | None
) -> tuple[dict[str, BrokenEdge], list[str]]:
    """Edges midway between rows where they run along them, and of each that was moved what was done."""
    found, notes = {}, []
    for name, edge in edges.items():
        shape = edge.shape if rows is None else rows.beside(edge.shape)
        found[name] = edge if shape is edge.shape else replace(edge, shape=shape)
        if shape is not edge.shape:
            off = float(np.hypot(*(shape.point_at(0.0) - edge.shape.point_at(0.0))))
            notes.append(f"{edge_key(name)}: moved by {off:.2f} m to midway between two rows")
    return found, notes
