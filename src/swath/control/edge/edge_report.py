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

    rows: of ROW, (worlds,); steps, detectors, blocks, told, feet: their parts
    points: of the edge, as `EdgePoints` has them, (worlds, ROOM, COLUMNS)
    lines: as `near_line_kernel.Line`; edges: what is told
    """

    def __init__(self, worlds: int) -> None:
        self.rows, self.points = np.zeros(worlds, ROW), np.zeros((worlds, ROOM, COLUMNS))
        self.steps, self.detectors, self.blocks, self.told, self.feet = (self.rows[name] for name in ROWS)
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
        from swath.control.edge.line.near_line_kernel import Asked, Line
        from swath.control.edge.report_kernel import report

        n, wp = len(self.rows), start_warp()
        asks, lines = (wp.zeros(n, dtype=kind, device="cpu") for kind in (Asked, Line))
        self.lines = lines.numpy()
        rows, edges = self.rows.view(np.float64), self.edges.memory.view(np.uint8)
        fit = shared(self.points, wp.vec4d), shared(np.zeros((n, 8, ROOM + 1))), asks, lines
        given = [shared(rows.reshape(n, -1)), *fit, shared(edges.reshape(n, -1))]
        self._launches = [repeatable(report, [*given, stage], threads=n) for stage in range(ALL + 1)]

    def launch(self, stage: int) -> None:
        """A stage, or ALL that a report takes."""
        self.compile()
        self._launches[stage].launch()
