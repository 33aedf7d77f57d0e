"""Tracks of the edge from blocks of rays, in any number of worlds: rows, and the look at full blocks.

Where an edge begins, goes on, breaks off, or cannot be seen is in block_track.cpp; what a break is in
line/edge_breaks.cpp, which crop is lodged in feet/lodging.cpp, which edge has bites in line/line_fits.cpp.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.control.edge.block_rows import BLOCK_TRACK, USUAL_HEIGHT
from swath.control.edge.feet.canopy_offset import shapes_of, tables_of
from swath.kernels import filled, of_worlds

APART = 0.3  # m from row to row: nearer ones are a closed stand
PARTS = 3  # parts of plants that make an echo together


def spacing_of(rows: float) -> float:
    """Of rows so far apart [m], 0 where they stand so near that they are none."""
    return rows if rows > APART else 0.0


class BlockTracks:
    """rows: of BLOCK_TRACK, (worlds,)."""

    def __init__(self, worlds: int) -> None:
        self.rows = np.zeros(worlds, BLOCK_TRACK)
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        rows = self.rows
        rows[:] = 0
        rows["height"], rows["bends"] = USUAL_HEIGHT, -np.inf
        rows["breaks"]["hole"] = rows["lodging"]["usual"] = np.nan
        rows["jagged"]["usual"] = rows["feet"]["overhang"] = np.nan

    def given(self) -> Sequence[Any]:
        """What the launch of the look takes after the memories of the worlds."""
        from swath.control.edge.feet.canopy_offset_kernel import Offset

        tables = tables_of(PARTS)
        self._held = filled(Offset, **tables)  # whose arrays the launch reads
        places, _, scratch = shapes_of(tables)
        n, feet = len(self.rows), self.rows["feet"]
        counts = feet["seen"].reshape(n, *places), feet["heights"]
        return (
            self.rows.view(np.float64).reshape(n, -1),
            of_worlds(Offset, [self._held]),
            *counts,
            np.zeros(scratch),
        )
