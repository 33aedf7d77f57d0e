"""Rays as packets through the crop: index, solids, launches over threads.

The plain kernel lists a primitive in every cell that it reaches into. A group of packets looks at many
cells at once and would meet it again and again, so here it is listed once and the search is widened by how
far a primitive extends around its middle. Long ones are listed in pieces, so that this extent stays small; a
piece is only a place to look, what is hit is always the whole primitive.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import PlantLibrary, Shape
from swath.kernels import address, filled, repeatable
from swath.rays.device import ThreadPool, start_warp
from swath.rays.hits import Hits, Spots
from swath.rays.packets.packing import Packing

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
COLUMNS_PER_M = 8.0
BIN_HEIGHT = 0.033  # aimed at [m]
PIECE = 0.06  # pieces extend no further than this around their middle, along the primitive [m]
PAD = 2e-5  # as in field/prototypes.py: float32 rays never miss what they hit [m]
LANES = 16  # the traversal reads this many entries at once, so the arrays are longer by as much
RANKS = 32767  # steps of the packed rank


@dataclass(frozen=True)
class PacketIndex:
    """Entries sorted by cell; cell = ((tile * columns + iy) * columns + ix) * bins + iz.

    start: (cells + 1,) first entry of a cell
    primitive: (n,) what an entry lists
    coarse: (n, 8) ends a and b of a piece in steps of `step` [m], half width, rank (rounded down); the half
        width covers all rounding, so the coarse piece contains the true one
    extent: (3,) how far pieces extend around their middle [m]; side, bin_height of the cells [m]
    halo: the foot of a piece lies at most so many columns from the one that it is listed in
    """

    columns: int
    bins: int
    side: float
    bin_height: float
    halo: int
    step: float
    extent: tuple[float, float, float]
    start: NDArray[np.int32]
    primitive: NDArray[np.int32]
    coarse: NDArray[np.int16]

    @property
    def byte_count(self) -> int:
        """Memory [bytes]."""
        return self.start.nbytes + self.primitive.nbytes + self.coarse.nbytes


def make_index(library: PlantLibrary) -> PacketIndex:
    """Index of a library."""
    size = library.tile_size
    columns = max(1, round(size * COLUMNS_PER_M))
    bins = max(1, round(library.height_max / BIN_HEIGHT))
    bin_height = library.height_max / bins
    owner_tile = np.repeat(np.arange(library.tile_count), np.diff(library.stem_start))
    item, a, b, at_a, at_b = _pieces(library)
    half = np.abs(library.width.astype(np.float64))[item]
    radius = np.maximum(library.radius, 0.0).astype(np.float64)[item]
    grow_a, grow_b = ((radius[:, None] + part[:, None] * half) + PAD for part in (at_a, at_b))
    low, high = np.minimum(a - grow_a, b - grow_b), np.maximum(a + grow_a, b + grow_b)
    width = radius + at_a * np.linalg.norm(half, axis=1)
    low[:, :2], high[:, :2] = np.maximum(low[:, :2], 0.0), np.minimum(high[:, :2], size)
    keep = (low <= high).all(axis=1)  # a piece beyond the tile's side is not seen there
    item = item[keep]
    a, b, width, low, high = (v[keep] for v in (a, b, width, low, high))
    middle = 0.5 * (low + high)
    side = np.array([size / columns, size / columns, bin_height])
    cell = np.clip(np.floor(middle / side), 0, np.array([columns, columns, bins]) - 1).astype(np.int64)
    tile = owner_tile[library.owner[item]]
    flat = ((tile * columns + cell[:, 1]) * columns + cell[:, 0]) * bins + cell[:, 2]
    order = np.lexsort((item, flat))
    count = np.bincount(flat, minlength=library.tile_count * columns * columns * bins)
    coarse, step = _coarse(a, b, width, library.stem_rank[library.owner[item]])
    spare = np.zeros(LANES, np.int32)
    away = np.abs(middle[:, :2] - library.base[item]).max(initial=0.0)
    extent = 0.5 * (high - low).max(axis=0, initial=0.0) + 1e-6
    return PacketIndex(
        columns=columns,
        bins=bins,
        side=size / columns,
        bin_height=bin_height,
        halo=int(np.ceil(away * columns / size + 1e-3)),
        step=step,
        extent=(float(extent[0]), float(extent[1]), float(extent[2])),
        start=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        primitive=np.concatenate([item[order].astype(np.int32), spare]),
        coarse=np.ascontiguousarray(np.concatenate([coarse[:, order].T, np.zeros((LANES, 8), np.int16)])),
    )


def _pieces(library: PlantLibrary) -> tuple[Ints, Array, Array, Array, Array]:
    """(primitive, a, b, share of the width at a, at b) of the pieces; a triangle has no width at its b."""
    a, b = library.a.astype(np.float64), library.b.astype(np.float64)
    pieces = np.maximum(np.ceil(0.5 * np.abs(b - a).max(axis=1, initial=0.0) / PIECE), 1).astype(np.int64)
    item = np.repeat(np.arange(len(a)), pieces)
    number = np.arange(len(item)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    low, high = number / pieces[item], (number + 1) / pieces[item]
    along, taper = (b - a)[item], (library.shape[item] == Shape.TRIANGLE).astype(np.float64)
    first, last = a[item] + low[:, None] * along, a[item] + high[:, None] * along
    return item, first, last, 1.0 - taper * low, 1.0 - taper * high


def _coarse(a: Array, b: Array, width: Array, rank: NDArray[np.float32]) -> tuple[NDArray[np.int16], float]:
    """Entries in steps, and the step [m]."""
    step = max(float(np.abs(v).max(initial=1.0)) for v in (a, b, width)) / 32000.0
    rows = [np.round(end / step).T for end in (a, b)]
    half = np.ceil(width / step + 0.5 * np.sqrt(3.0) + 0.01)[None]
    floor = np.floor(rank.astype(np.float64) * RANKS)[None]
    return np.concatenate([*rows, half, floor]).astype(np.int16), step


F64 = NDArray[np.float64]
RAYS_PER_TASK = 2048  # fewer are not worth another thread
JOB = np.dtype(  # as in native/rays.cpp
    [(name, np.int64) for name in ("origins", "directions", "spots", "order", "first")]
    + [(name, np.int64) for name in ("distance", "organ", "cosine", "reflectance", "normal")]
    + [(name, np.int64) for name in ("lanes", "groups", "sub_rays", "row")]
    + [(name, np.int64) for name in ("spot_step", "origin_step", "direction_step", "solids", "next", "flags")]
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
        has_solids: bool,
        hits: Hits,
    ) -> int:
        """Fill `hits`, (rays,), within range_max [m]; has_solids: those of the nearest solids are in it.

        scene, version: as the kernels read it, a new version where it has changed; rays: origins and
        directions (..., 3), contiguous, one of them (3,) for all, or spots. Returns error flags, of which any
        asks for a closer look at the rays: 1 = some are not finite or not of unit length, of which nothing is
        known; 2 = some start where no page is known, or below the highest thing there, which are cast all the
        same.
        """
        spots, subs, step = 0, 1, 0
        if not isinstance(rays, Spots):
            starts, ways = rays
        else:
            offsets = np.ascontiguousarray(rays.offsets)
            starts, ways, spots, subs = rays.origins, rays.axes, address(offsets), offsets.shape[1]
            step = 0 if len(offsets) == 1 else 5 * subs
        kept = np.ascontiguousarray(starts, np.float64), np.ascontiguousarray(ways, np.float64)
        held = [address(a) if a.size else 0 for a in hits.arrays]
        places = (*map(address, kept), spots, *packing.addresses, *held)
        steps = step, 3 * (starts.ndim > 1), 3 * (ways.ndim > 1)
        sizes = packing.lanes, packing.group_count, subs, packing.row, *steps, has_solids
        self._job[0] = (*places, *sizes, 0, 0, range_max)
        self._prepare(start_warp(), scene, version)
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
