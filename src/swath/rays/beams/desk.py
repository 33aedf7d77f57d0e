"""The memory that single rays share with native code."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.device import start_warp

PACK = 16  # beams side by side

NOT_FINITE, ASTRAY = 1, 2  # bits of `fault`
CLAMPED = 8  # its bits from here on: axes of a table that were left


class Desk:
    """A fixed number of beams; what is in the arrays is overwritten by the next scan.

    origins [m], directions (unit): (count, 3), world; normal: (2, room) standard normal numbers of each beam
    distance [m], kind, cosine, reflectance: of what was hit, score: (room,); only the first
    `count` mean anything
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
        self.kind, self.fault = np.zeros(room, np.int32), np.zeros(1, np.int32)
        self._shared: dict[str, Any] = {}

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
