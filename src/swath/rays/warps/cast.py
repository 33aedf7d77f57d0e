"""Rays through the group walk of a card: index, solids, launches over blocks of groups."""

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import PlantLibrary
from swath.rays.device import start_warp
from swath.rays.groups.cast import LOW, WRONG, Task
from swath.rays.groups.index import make_index
from swath.rays.groups.lanes import Lanes

I32 = NDArray[np.int32]
WARP = 32  # lanes, and threads of a block: of all kernels here, or all is compiled once more
ROOM = 384  # slots of a group, as in store.cu
RECORD = 5  # vectors that are kept of a ray while its group walks, as in store.cu
SLOTS_AT_ONCE = 1 << 22  # of a launch: 335 MB of the card's memory
SUB_RAYS_MAX = ROOM  # of a bundle that goes through the walk


@cache
def can_walk(device: str) -> bool:
    """Does the native part compile for this device? The first call of all takes some seconds."""
    wp = start_warp()
    from swath.rays.warps import kernel

    try:
        wp.load_module(kernel, device=device, block_dim=WARP)
    except Exception:  # Warp raises a plain one
        return False
    return True


def split_groups(lanes: Lanes) -> I32:
    """First pack of each group that a warp has room for, (groups + 1,): groups of `lanes` in even parts."""
    packs = np.diff(lanes.first)
    parts = -(-packs // (ROOM // lanes.table.shape[1]))
    group = np.repeat(np.arange(len(packs)), parts)
    part = np.arange(len(group)) - np.repeat(np.cumsum(parts) - parts, parts)
    first = lanes.first[group] + part * packs[group] // parts[group]
    return np.append(first, lanes.first[-1]).astype(np.int32)


class WarpWalk:
    """The walk through one library on one device.

    device: a Warp device as `cuda:0`; `cpu` runs the same text slowly, its lanes one after the other in a
    sequence that `order` picks (0 rising, 1 falling, others shuffled): for tests
    """

    def __init__(self, wp: Any, library: PlantLibrary, device: str, *, order: int = 0) -> None:
        from swath.rays.groups.kernel import Index

        self.library, self.device, self.order = library, device, order
        self.held = held = make_index(library)
        index = Index()
        for name in ("columns", "bins", "side", "bin_height", "skirt", "step"):
            setattr(index, name, getattr(held, name))
        index.reach = wp.vec3(*held.reach)
        index.start = wp.array(held.start, dtype=wp.int32, device=device)
        index.primitive = wp.array(held.primitive, dtype=wp.int32, device=device)
        index.coarse = wp.array(held.coarse, dtype=wp.int16, device=device)
        self.index = index
        self._lanes: Lanes | None = None
        self._table: Any = None
        self._memory: Any = None

    def load(self, wp: Any, task: Task) -> "Batch":
        """The rays of a task on the device, with room for what they hit."""
        lanes = task.lanes
        if lanes is not self._lanes:
            self._lanes, self._first = lanes, split_groups(lanes)
            self._table = [
                wp.array(a, dtype=wp.int32, device=self.device) for a in (lanes.table, self._first)
            ]
        return Batch(wp, self.device, task, self._table, self._first)

    def walk(self, wp: Any, scene: Any, things: Any, batch: "Batch") -> None:
        """Find what the rays of a batch hit. The work is queued on the device, not waited for."""
        from swath.rays.kernel.scene import Things
        from swath.rays.warps.kernel import meet_things, pick, walk_warps

        device, task, first = self.device, batch.task, batch.first
        things = Things() if things is None else things
        inputs = [scene, things, *batch.rays, task.range_max, *batch.found, batch.doubts]
        wp.launch(meet_things, dim=len(task.rays[0]), inputs=inputs, device=device, block_dim=WARP)
        threads, width = (1 if device == "cpu" else WARP), task.lanes.table.shape[1]
        for begin, end in _blocks(first, max(1, SLOTS_AT_ONCE // width)):
            slots = int(first[end] - first[begin]) * width
            if self._memory is None or len(self._memory) < slots * RECORD:
                self._memory = wp.empty(slots * RECORD, dtype=wp.vec4, device=device)
            inputs = [scene, self.index, *batch.table, begin, threads, *batch.rays, task.need, self.order]
            inputs += [self._memory, *batch.found]
            wp.launch(walk_warps, dim=(end - begin) * threads, inputs=inputs, device=device, block_dim=WARP)
        if task.need > 0:
            inputs = [task.sub_rays, task.need, int(task.only), *batch.found, *batch.picked]
            wp.launch(pick, dim=len(task.rays[0]), inputs=inputs, device=device, block_dim=WARP)

    def cast(self, wp: Any, scene: Any, version: int, things: Any, task: Task, pool: object) -> int:
        """As `GroupWalk.cast`; its version and pool are of no use here."""
        batch = self.load(wp, task)
        self.walk(wp, scene, things, batch)
        return batch.fetch()


class Batch:
    """The rays of a task on a device; what they hit: distance, organ (0 = nothing), cosine, reflectance.

    found: of each ray, at first its nearest solid; picked: of each bundle, where not all is asked for
    """

    def __init__(self, wp: Any, device: str, task: Task, table: list[Any], first: I32) -> None:
        self.task, self.table, self.first = task, table, first
        self.rays = [wp.array(a, dtype=wp.vec3d, device=device) for a in task.rays]
        kinds = (wp.float32, wp.uint8, wp.float32, wp.float32)
        self.found = [wp.empty(len(task.rays[0]), dtype=kind, device=device) for kind in kinds]
        self.picked = self.found
        if task.need > 0:
            self.picked = [wp.empty(len(task.out[0]), dtype=kind, device=device) for kind in kinds]
        self.doubts = wp.zeros(2, dtype=wp.int32, device=device)

    def fetch(self) -> int:
        """Fill `task.out`, nan where nothing was hit; returns doubts as `GroupWalk.cast`."""
        out = self.task.out
        for array, target in zip(self.picked, out, strict=True):
            target[:] = array.numpy()
        out[0][out[1] == 0] = np.nan
        wrong, low = self.doubts.numpy()
        return WRONG * int(wrong) + LOW * int(low)


def _blocks(first: I32, packs: int) -> list[tuple[int, int]]:
    """Groups from, to, of about so many packs each."""
    cuts = np.searchsorted(first, np.arange(0, int(first[-1]), packs), side="left")
    edges = np.unique(np.append(cuts, len(first) - 1)).tolist()
    return list(pairwise(edges))
