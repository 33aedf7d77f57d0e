"""Rays through the group walk: index, solids, launches over threads."""

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import PlantLibrary
from swath.rays.device import start_warp
from swath.rays.groups.index import GroupIndex, make_index
from swath.rays.groups.lanes import Lanes

RAYS_PER_TASK = 2048  # fewer are not worth another thread


class Pool(Protocol):
    """Runs a function on every item, on several threads."""

    def map(self, work: Callable[[int], None], items: Any, /) -> Any:
        """As `concurrent.futures.Executor.map`."""


@cache
def can_walk() -> bool:
    """Does the native part compile here? The first call of a fresh installation takes some seconds."""
    wp = start_warp()
    from swath.rays.groups import kernel

    try:
        wp.load_module(kernel, device="cpu")
    except Exception:  # Warp raises a plain one
        return False
    return True


class GroupWalk:
    """The walk through one library: its index, made once, as the kernel reads it."""

    def __init__(self, wp: Any, library: PlantLibrary) -> None:
        from swath.rays.groups.kernel import Index

        self.library = library
        self.held: GroupIndex = make_index(library)
        index, held = Index(), self.held
        index.columns, index.bins = held.columns, held.bins
        index.side, index.bin_height, index.step = held.side, held.bin_height, held.step
        index.skirt = held.skirt
        index.reach = wp.vec3(*held.reach)
        index.start = wp.array(held.start, dtype=wp.int32, device="cpu", copy=False)
        index.primitive = wp.array(held.primitive, dtype=wp.int32, device="cpu", copy=False)
        index.coarse = wp.array(held.coarse, dtype=wp.int16, device="cpu", copy=False)
        self.index = index

    def cast(
        self,
        wp: Any,
        scene: Any,
        things: Any,
        rays: tuple[NDArray[np.float64], NDArray[np.float64]],
        lanes: Lanes,
        range_max: float,
        need: int,
        out: tuple[NDArray[Any], ...],
        pool: Pool | None,
        threads: int,
    ) -> None:
        """Fill `out` (distance, organ, cosine, reflectance), each (n,), for rays (origins, directions)."""
        from swath.rays.groups.kernel import cast_things, walk_groups

        def share(array: NDArray[Any], dtype: Any) -> Any:
            return wp.array(array, dtype=dtype, device="cpu", copy=False)

        n, groups = len(rays[0]), lanes.group_count
        ways = [share(a, wp.vec3d) for a in rays]
        found = [
            share(a, k) for a, k in zip(out, (wp.float32, wp.uint8, wp.float32, wp.float32), strict=True)
        ]
        table = [share(lanes.table, wp.int32), share(lanes.first, wp.int32)]

        def meet_things(first: int, count: int) -> None:
            wp.launch(cast_things, dim=count, inputs=[things, *ways, range_max, first, *found], device="cpu")

        def walk(first: int, count: int) -> None:
            inputs = [scene, self.index, *table, *ways, need, first, *found]
            wp.launch(walk_groups, dim=count, inputs=inputs, device="cpu")

        if things is not None:
            _spread(meet_things, n, RAYS_PER_TASK, pool, threads)
        else:
            for array, nothing in zip(out, (range_max, 0, 0.0, 0.0), strict=True):
                array[:] = nothing
        _spread(walk, groups, max(1, RAYS_PER_TASK * groups // max(n, 1)), pool, threads)
        out[0][out[1] == 0] = np.nan


def _spread(
    work: Callable[[int, int], None], count: int, least: int, pool: Pool | None, threads: int
) -> None:
    """Run work(first, count) over all, in pieces of `least` or more on the threads of the pool."""
    if pool is None or count < 2 * least:
        if count:
            work(0, count)
        return
    step = max(least, -(-count // (8 * threads)))
    list(pool.map(lambda first: work(first, min(step, count - first)), range(0, count, step)))
