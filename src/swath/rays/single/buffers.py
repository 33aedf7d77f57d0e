"""The memory that single rays share with native code."""

from typing import Any

import numpy as np

from swath.field.memory_layout import Solids
from swath.field.solid.solids import NOTHING, solid_count
from swath.kernels import filled, repeatable
from swath.rays.device import start_warp
from swath.rays.geometry import make_solid_arrays

PACKET = 16  # beams side by side

NOT_FINITE, MISPLACED = 1, 2  # bits of `flags`
CLAMPED = 8  # its bits from here on: axes of a table that were left


class BeamBuffer:
    """A fixed number of beams; what is in the arrays is overwritten by the next scan.

    origins [m], directions (unit): (count, 3), world; normal: (2, room) standard normal numbers of each beam
    distance [m], kind, cosine, reflectance: of what was hit, score, cell: (room,); only the first `count`
    mean anything
    flags: (1,) what was wrong with some beam
    apart: (room,) angle to the neighbour on the line [rad]; reach: they end there [m]
    lines: of the scanner, beams ordered by azimuth, then by line; 0 = neighbours draw independently
    """

    def __init__(self, count: int, *, lines: int = 0, reach: float = 0.0) -> None:
        self.count, self.packet_count = count, -(-count // PACKET)
        room = max(1, self.packet_count) * PACKET
        self.origins, self.directions = np.zeros((room, 3)), np.zeros((room, 3))
        self.normal = np.zeros((2, room), np.float32)
        self.lines, self.reach = lines, reach
        self.distance, self.cosine, self.reflectance, self.score, self.apart = np.zeros((5, room), np.float32)
        self.kind, self.cell, self.flags = (np.zeros(n, np.int32) for n in (room, room, 1))
        self._struct: Any = None
        self._solids: tuple[Solids | None, Any] = (None, None)  # and as the kernel reads them

    def lie_in(self, origins: Any, flags: Any) -> None:
        """From now on these are in this memory, (room, 3) and (1,)."""
        self.origins, self.flags, self._struct = origins, flags, None

    def struct(self) -> Any:
        """`kernel.Beams`: the same memory."""
        if self._struct is None:
            from swath.rays.single.kernel import Beams

            arrays = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
            self._struct = filled(Beams, count=self.count, lines=self.lines, reach=self.reach, **arrays)
        return self._struct

    def record(self, kernel: Any, inputs: list[Any]) -> Any:
        """A launch that can be repeated, one thread per packet of beams."""
        return repeatable(kernel, inputs, threads=self.packet_count)

    def meet(self, solids: Solids | None, range_max: float) -> bool:
        """False where there are none; else distance, kind (organ), cosine, reflectance become those of the
        nearest solid of each beam, range_max [m] and 0 without one.
        """
        if solids is None or solids is NOTHING or solid_count(solids) == 0:
            return False
        wp = start_warp()
        from swath.rays.single.kernel import meet_solids

        if self._solids[0] is not solids:
            self._solids = solids, make_solid_arrays(wp, solids, "cpu")
        inputs = [self._solids[1], range_max, self.struct()]
        wp.launch(meet_solids, dim=self.count, inputs=inputs, device="cpu")
        return True

    def take_flags(self) -> int:
        """What was wrong with some beam, cleared. ValueError for numbers that are not finite."""
        found = int(self.flags[0])
        self.flags[0] = 0
        if found & NOT_FINITE:
            raise ValueError("expected finite origins and directions")
        return found
