"""The memory that single rays share with native code."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids
from swath.field.solids import NOTHING, solid_count
from swath.rays.device import start_warp
from swath.rays.geometry import make_things

PACK = 16  # beams side by side

NOT_FINITE, ASTRAY = 1, 2  # bits of `fault`
CLAMPED = 8  # its bits from here on: axes of a table that were left


class Desk:
    """A fixed number of beams; what is in the arrays is overwritten by the next scan.

    origins [m], directions (unit): (count, 3), world; normal: (2, room) standard normal numbers of each beam
    distance [m], kind, cosine, reflectance: of what was hit, score, cell: (room,); only the first `count`
    mean anything
    fault: (1,) what was wrong with some beam
    """

    def __init__(self, count: int) -> None:
        self.count, self.pack_count = count, -(-count // PACK)
        room = max(1, self.pack_count) * PACK
        self.origins, self.directions = np.zeros((room, 3)), np.zeros((room, 3))
        self.normal = np.zeros((2, room), np.float32)
        self.distance, self.cosine, self.reflectance, self.score = (
            np.zeros(room, np.float32) for _ in range(4)
        )
        self.kind, self.cell, self.fault = (np.zeros(n, np.int32) for n in (room, room, 1))
        self._shared: dict[str, Any] = {}
        self._solids: tuple[Solids | None, Any] = (None, None)  # and as the kernel reads them

    def shared(self, *names: str) -> list[Any]:
        """Arrays as Warp's, the same memory."""
        wp = start_warp()
        vectors = ("origins", "directions")
        kinds = {np.dtype(np.float32): wp.float32, np.dtype(np.int32): wp.int32}
        for name in names:
            if name not in self._shared:
                array: NDArray[Any] = getattr(self, name)
                kind = wp.vec3d if name in vectors else kinds[array.dtype]
                self._shared[name] = wp.array(array, dtype=kind, device="cpu", copy=False)
        return [self._shared[name] for name in names]

    def meet(self, solids: Solids | None, range_max: float) -> bool:
        """False where there are none; else distance, kind (organ), cosine, reflectance become those of the
        nearest solid of each beam, range_max [m] and 0 without one."""
        if solids is None or solids is NOTHING or solid_count(solids) == 0:
            return False
        wp = start_warp()
        from swath.rays.single.kernel import meet_things

        if self._solids[0] is not solids:
            self._solids = solids, make_things(wp, solids, "cpu")
        rays = self.shared("origins", "directions", "distance", "kind", "cosine", "reflectance")
        wp.launch(meet_things, dim=self.count, inputs=[self._solids[1], range_max, *rays], device="cpu")
        return True

    def take_fault(self) -> int:
        """What was wrong with some beam, cleared. ValueError for numbers that are none."""
        found = int(self.fault[0])
        self.fault[0] = 0
        if found & NOT_FINITE:
            raise ValueError("expected finite origins and directions")
        return found
