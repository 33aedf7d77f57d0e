"""Rays as packets through the crop: index, solids, launches over threads."""

from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import PlantLibrary
from swath.kernels import address, filled, repeatable
from swath.rays.device import ThreadPool, start_warp
from swath.rays.hits import Hits
from swath.rays.packets.index import PacketIndex, make_index
from swath.rays.packets.packing import Packing
from swath.rays.spots import Spots

F64 = NDArray[np.float64]
RAYS_PER_TASK = 2048  # fewer are not worth another thread
JOB = np.dtype(  # as in native/rays.cpp
    [(name, np.int64) for name in ("origins", "directions", "spots", "order", "first")]
    + [(name, np.int64) for name in ("distance", "organ", "cosine", "reflectance")]
    + [(name, np.int64) for name in ("solid", "solid_organ", "solid_cosine", "solid_reflectance")]
    + [(name, np.int64) for name in ("lanes", "groups", "sub_rays", "row", "spot_step", "origin_step")]
    + [(name, np.int64) for name in ("next", "flags")]
    + [("range_max", np.float64)]
)

_INDICES: WeakKeyDictionary[PlantLibrary, PacketIndex] = WeakKeyDictionary()


@cache
def can_compile() -> bool:
    """Does the native part compile here? The first call of a fresh installation takes some seconds."""
    wp = start_warp()
    from swath.rays.packets import kernel

    try:
        wp.load_module(kernel, device="cpu")
    except Exception:  # Warp raises a plain one
        return False
    return True


class PacketTraversal:
    """Casts packets of rays against one library of plants. index: made once, of all its primitives."""

    def __init__(self, wp: Any, library: PlantLibrary, pool: ThreadPool) -> None:
        from swath.rays.packets.kernel import Index

        self.library, self._pool = library, pool
        self.index: PacketIndex = _INDICES.get(library) or make_index(library)
        _INDICES[library] = self.index
        self._shared, self._job = filled(Index, **vars(self.index)), np.zeros(1, JOB)
        self._launch: Any = None
        self._version = -1

    def cast(
        self,
        scene: Any,
        version: int,
        rays: Spots | tuple[F64, F64],
        packing: Packing,
        range_max: float,
        solids: Any,
        hits: Hits,
    ) -> int:
        """Fill `hits`, (rays,), within range_max [m].

        scene, version: as the kernels read it, a new version where it has changed; rays: origins and
        directions (..., 3), contiguous, one origin (3,) for all, or spots; solids: as the kernels read them,
        None = none, and none with spots or one origin. Returns error flags, of which any asks for a closer
        look at the rays: 1 = some are not finite or not of unit length, of which nothing is known; 2 = some
        start where no page is known, or below the highest thing there, which are cast all the same.
        """
        wp = start_warp()
        before = () if solids is None else self._hit_solids(wp, solids, rays, range_max, hits)
        spots, subs, step = 0, 1, 0
        if not isinstance(rays, Spots):
            starts, ways = rays
        else:
            offsets = np.ascontiguousarray(rays.offsets)
            starts, ways, spots, subs = rays.origins, rays.axes, address(offsets), offsets.shape[1]
            step = 0 if len(offsets) == 1 else 5 * subs
        kept = np.ascontiguousarray(starts, np.float64), np.ascontiguousarray(ways, np.float64)
        o, d, *held = map(address, (*kept, *hits.arrays, *before))
        places = (o, d, spots, *packing.addresses, *held, *[0] * (8 - len(held)))
        sizes = packing.lanes, packing.group_count, subs, packing.row, step, 3 * (starts.ndim > 1)
        self._job[0] = (*places, *sizes, 0, 0, range_max)
        self._prepare(wp, scene, version)
        parts = min(self._pool.threads, packing.group_count, len(hits.organ) // RAYS_PER_TASK)
        self._pool.repeat(self._launch.launch, parts)
        return int(self._job["flags"][0])

    def _prepare(self, wp: Any, scene: Any, version: int) -> None:
        """The launch, with the scene as it is now."""
        from swath.rays.packets.kernel import traverse

        if self._launch is None:
            job = wp.array(self._job.view(np.uint8), dtype=wp.uint8, device="cpu", copy=False)
            inputs = [scene, self._shared, job]
            self._launch = repeatable(traverse, inputs)
        elif version != self._version:
            self._launch.set_param_at_index(0, scene)
        self._version = version

    def _hit_solids(
        self, wp: Any, solids: Any, rays: Any, range_max: float, hits: Hits
    ) -> tuple[NDArray[Any], ...]:
        """Nearest solid of every ray, in the memory of the hits."""
        from swath.rays.packets.kernel import hit_nearest_solid

        kinds = (wp.vec3d, wp.vec3d, wp.float32, wp.uint8, wp.float32, wp.float32)
        arrays = (*(a.reshape(-1, 3) for a in rays), *hits.arrays)
        shared = [
            wp.array(a, dtype=kind, device="cpu", copy=False) for a, kind in zip(arrays, kinds, strict=True)
        ]

        def run(first: int, count: int) -> None:
            inputs = [solids, *shared[:2], range_max, first, *shared[2:]]
            wp.launch(hit_nearest_solid, dim=count, inputs=inputs, device="cpu")

        self._pool.split(len(hits.organ), RAYS_PER_TASK, run)
        return hits.arrays
