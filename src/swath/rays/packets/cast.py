"""Rays through the group walk: index, solids, launches over threads."""

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import PlantLibrary
from swath.rays.device import start_warp
from swath.rays.packets.index import GroupIndex, make_index
from swath.rays.packets.packing import Lanes

RAYS_PER_TASK = 2048  # fewer are not worth another thread


F32 = NDArray[np.float32]
Room = tuple[F32, NDArray[np.uint8], F32, F32]
Hits = tuple[NDArray[Any], ...]
WRONG, LOW = 1, 2  # doubts
JOB = np.dtype(  # as in native/rays.cpp
    [(name, np.int64) for name in ("origins", "directions", "spots", "lanes", "first_pack")]
    + [(name, np.int64) for name in ("distance", "organ", "cosine", "reflectance")]
    + [(name, np.int64) for name in ("solid", "solid_organ", "solid_cosine", "solid_reflectance")]
    + [(name, np.int64) for name in ("width", "groups", "sub_rays", "need", "only")]
    + [(name, np.int64) for name in ("spot_step", "next", "doubts")]
    + [("range_max", np.float64)]
)


@dataclass(frozen=True)
class Crew:
    """Threads that work on one cast; workers: none = the caller's own thread."""

    workers: Executor | None
    threads: int


@dataclass(frozen=True)
class Task:
    """What is asked for.

    rays: origins, directions (rays, 3), contiguous; or origins (beams, 3), axes (beams, 3, 3) and spots (1 or
    beams, sub_rays, 5) as in `Spots`; out: distance, organ, cosine, reflectance, each (rays,),
    or, where need > 0, the so many nearest hits of each bundle of sub_rays rays (bundles * need,); only: of
    these the last alone (bundles,)
    """

    rays: tuple[NDArray[np.float64], NDArray[np.float64]]
    sub_rays: int
    lanes: Lanes
    range_max: float
    need: int
    only: bool
    out: Hits
    spots: NDArray[np.float64] | None = None

    @property
    def ray_count(self) -> int:
        """Rays that are cast."""
        return len(self.rays[0]) * (1 if self.spots is None else self.sub_rays)


@cache
def can_walk() -> bool:
    """Does the native part compile here? The first call of a fresh installation takes some seconds."""
    wp = start_warp()
    from swath.rays.packets import kernel

    try:
        wp.load_module(kernel, device="cpu")
    except Exception:  # Warp raises a plain one
        return False
    return True


class GroupWalk:
    """The walk through one library: its index, made once, as the kernel reads it."""

    def __init__(self, wp: Any, library: PlantLibrary) -> None:
        from swath.rays.packets.kernel import Index

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
        self.job = np.zeros(1, JOB)
        self.launch: Any = None
        self.version = -1

    def cast(self, wp: Any, scene: Any, version: int, things: Any, task: Task, pool: Crew) -> int:
        """Fill `task.out`; version: of the scene, a new one where it has changed.

        Returns doubts, which rays are to be looked at again.
        WRONG: rays that are not finite or not of unit length, of which nothing is known; LOW: rays that start
        where no page is known, or below the highest thing there, which are cast all the same.
        """
        from swath.rays.packets.kernel import walk_groups

        before = () if things is None else self._meet(wp, things, task, pool)
        lanes, job = task.lanes, self.job
        o, d, *held = [a.ctypes.data for a in (*task.rays, *task.out, *before)]
        spots = 0 if task.spots is None else task.spots.ctypes.data
        step = 0 if task.spots is None or len(task.spots) == 1 else 5 * task.sub_rays
        places = (o, d, spots, *lanes.places, *held, *[0] * (8 - len(held)))
        sizes = (lanes.table.shape[1], lanes.group_count, task.sub_rays, task.need, task.only)
        job[0] = (*places, *sizes, step, 0, 0, task.range_max)
        if self.launch is None:
            shared = wp.array(job.view(np.uint8), dtype=wp.uint8, device="cpu", copy=False)
            inputs = [scene, self.index, shared]
            self.launch = wp.launch(walk_groups, dim=1, inputs=inputs, device="cpu", record_cmd=True)
        elif version != self.version:
            self.launch.set_param_at_index(0, scene)
        self.version = version
        run = self.launch.launch
        parts = min(pool.threads, lanes.group_count, task.ray_count // RAYS_PER_TASK)
        if pool.workers is None or parts < 2:
            run()
        else:
            list(pool.workers.map(lambda _: run(), range(parts)))
        return int(job["doubts"][0])

    def _meet(self, wp: Any, things: Any, task: Task, pool: Crew) -> Hits:
        """Nearest solid of every ray: distance, organ, cosine, reflectance, each (rays,)."""
        from swath.rays.packets.kernel import cast_things

        n = len(task.rays[0])
        found = no_hits(n) if task.need else task.out
        kinds = (wp.vec3d, wp.vec3d, wp.float32, wp.uint8, wp.float32, wp.float32)
        shared = [
            wp.array(a, dtype=kind, device="cpu", copy=False)
            for a, kind in zip((*task.rays, *found), kinds, strict=True)
        ]

        def meet(first: int, count: int) -> None:
            inputs = [things, *shared[:2], task.range_max, first, *shared[2:]]
            wp.launch(cast_things, dim=count, inputs=inputs, device="cpu")

        if pool.workers is None or n < 2 * RAYS_PER_TASK:
            meet(0, n)
        else:
            step = max(RAYS_PER_TASK, -(-n // (8 * pool.threads)))
            list(pool.workers.map(lambda first: meet(first, min(step, n - first)), range(0, n, step)))
        return found


def no_hits(shape: int | tuple[int, int]) -> Room:
    """Room for hits: distance, organ, cosine, reflectance."""
    return tuple(np.empty(shape, t) for t in (np.float32, np.uint8, np.float32, np.float32))  # type: ignore[return-value]
