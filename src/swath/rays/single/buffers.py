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
    """

    def __init__(self, count: int) -> None:
        self.count, self.packet_count = count, -(-count // PACKET)
        room = max(1, self.packet_count) * PACKET
        self.origins, self.directions = np.zeros((room, 3)), np.zeros((room, 3))
        self.normal = np.zeros((2, room), np.float32)
        self.distance, self.cosine, self.reflectance, self.score = (
            np.zeros(room, np.float32) for _ in range(4)
        )
        self.kind, self.cell, self.flags = (np.zeros(n, np.int32) for n in (room, room, 1))
        self._struct: Any = None
        self._solids: tuple[Solids | None, Any] = (None, None)  # and as the kernel reads them

    def lie_in(self, origins: Any, flags: Any, others: "BeamBuffer") -> None:
        """From now on these are in this memory, (room, 3) and (1,), and the others in that of another buffer:
        of many worlds, scanned one after the other, what a scan needs meanwhile then stays in the cache. What
        a scan met stays with its world.
        """
        kept = {"origins": origins, "flags": flags}
        kept |= {name: getattr(self, name) for name in ("directions", "distance", "kind")}
        arrays = {name: value for name, value in vars(others).items() if isinstance(value, np.ndarray)}
        vars(self).update({**arrays, **kept, "_struct": None})

    def struct(self) -> Any:
        """`kernel.Beams`: the same memory."""
        if self._struct is None:
            from swath.rays.single.kernel import Beams

            arrays = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
            self._struct = filled(Beams, count=self.count, **arrays)
        return self._struct

    def record(self, kernel: Any, inputs: list[Any], *, threads: int | None = None) -> Any:
        """A launch that can be repeated, one thread per packet of beams unless said otherwise."""
        threads = self.packet_count if threads is None else threads
        return repeatable(kernel, inputs, threads=threads)

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


def share(array: Any) -> Any:
    """A contiguous numpy array as Warp's, the same memory; (n, 3) of float64 as vectors."""
    wp = start_warp()
    kinds = {"float32": wp.float32, "int32": wp.int32, "int16": wp.int16, "uint8": wp.uint8}
    kinds |= {"float64": wp.vec3d if array.shape[1:] == (3,) else wp.float64, "uint64": wp.uint64}
    return wp.array(array, dtype=kinds[array.dtype.name], device="cpu", copy=False)
