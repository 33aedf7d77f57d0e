"""What likelihood-ratio detectors tell in a step, in any number of worlds: rows, and launches over them."""

from collections.abc import Sequence

import numpy as np

from swath.control.edge.line.near_line import COLUMNS
from swath.control.edge.report_rows import ALL, ROOM, ROW, ROWS
from swath.core.rows import row_of
from swath.kernels import Repeated, repeatable, shared, start_warp
from swath.signals import F64, CropEdge


class EdgeReports:
    """Reports of detectors, one in each world.

    rows: of ROW, (worlds,); steps, detectors, blocks, told, lines, feet: their parts
    points: of the edge, as `EdgePoints` has them, (worlds, ROOM, COLUMNS)
    edges: what is told
    """

    def __init__(self, worlds: int) -> None:
        self.rows, self.points = np.zeros(worlds, ROW), np.zeros((worlds, ROOM, COLUMNS))
        parts = (self.rows[name] for name in ROWS)
        self.steps, self.detectors, self.blocks, self.told, self.lines, self.feet = parts
        self.edges = row_of(CropEdge, worlds)
        self._launches: Sequence[Repeated] = ()

    def learn(self, world: int, row: Sequence[float], points: F64, returns: Sequence[float]) -> None:
        """What is new after a block.

        row: of it, but for the last two numbers; points: (n, COLUMNS); returns: as `EdgePoints` has them
        """
        back = self.rows["back"][world]
        points, returns = points[-ROOM:], returns[-len(back) :]
        self.blocks[world] = (*row, len(points), len(returns))
        self.points[world, : len(points)], back[: len(returns)] = points, returns

    def compile(self) -> None:
        """Load what is compiled, before a run is in step with a clock."""
        if self._launches:
            return
        from swath.control.edge.report_kernel import report

        n = len(self.rows)
        numbers, edges = self.rows.view(np.float64), self.edges.memory.view(np.uint8)
        points = shared(self.points, start_warp().vec4d)
        given = [shared(numbers.reshape(n, -1)), points, shared(edges.reshape(n, -1))]
        self._launches = [repeatable(report, [*given, stage], threads=n) for stage in range(ALL + 1)]

    def launch(self, stage: int) -> None:
        """A stage, or ALL that a report takes."""
        self.compile()
        self._launches[stage].launch()
