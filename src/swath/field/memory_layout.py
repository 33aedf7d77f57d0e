"""How the field lies in memory: the arrays that the field writes and the ray kernel reads.

Stand frame: the world turned about z so that x runs along the drilled rows. Everything here is in it.

The ground is divided into square tiles of side T (about 1 m, a whole number of rows). A few tile prototypes
hold real plants; a hash of (seed, tile index) says which prototype stands on a tile and how it is mirrored.
A tile bends its prototype to the ground and the maps by one affine map, q = stand-frame point minus the
tile's lower corner:

    zeta = (q_z - plane(q_x, q_y)) / scale          prototype height coordinate
    xi   = (q_x - lean_x * zeta, q_y - lean_y * zeta)   prototype plane coordinates, periodic with T

with plane(q_x, q_y) = ground + slope_x (q_x - T/2) + slope_y (q_y - T/2). Mirroring in x replaces xi_x by
T - xi_x. 8 x 8 tiles make a page, the unit of memory; pages exist near machines and where crop was changed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

PAGE_TILES = 8
PAGE_NODES = 64  # ground lattice intervals along a page; the lattice has one node more
PAGE_CUT_CELLS = 512  # cut cells along a page: T / 64, 15.6 mm for T = 1 m
STANDING = 255  # code of a cut cell whose stems stand; below: stubble height [cm], 0 = bare
MIRROR_X, MIRROR_Y = 1 << 16, 1 << 17  # flags beside the prototype number in `tile_prototype`


class Organ(IntEnum):
    """What a ray hit."""

    NONE = 0
    GROUND = 1
    STRAW = 2
    STEM = 3
    EAR = 4
    LEAF = 5
    STUBBLE = 6
    SOLID = 7
    WEED = 8
    AWN = 9
    BRANCH = 10
    POD = 11
    COB = 12


class Shape(IntEnum):
    """Kind of a primitive."""

    CAPSULE = 0
    RIBBON = 1
    TRIANGLE = 2


@dataclass(frozen=True, eq=False)
class Primitives:
    """What plants are made of (m of them), sorted by tile, each copied to every tile side it overlaps
    (periodic tile).

    shape: Shape
    organ: Organ
    a, b: ends [m], (m, 3); capsule: radius [m], width unused; ribbon: parallelogram with corners a - w, a +
        w, b + w, b - w, w = width (m, 3) [m]; triangle: corners a - w, a + w, b
    owner: index of the stem
    base: (m, 2) base of that stem as seen from this copy [m]; may lie outside [0, T) for copies
    own_reflectance: of a primitive where parts of one organ differ (meshes), (m,), 0 = its organ's; empty =
        none has its own
    """

    shape: NDArray[np.uint8]
    organ: NDArray[np.uint8]
    a: NDArray[np.float32]
    b: NDArray[np.float32]
    radius: NDArray[np.float32]
    width: NDArray[np.float32]
    owner: NDArray[np.int32]
    base: NDArray[np.float32]
    own_reflectance: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PlantLibrary:
    """Tile prototypes with their plants, primitives and search index.

    Read-only after making, so that what was made of it can be kept.

    tile_size T [m]; tile_count K; density_max: stems/m2 in the prototypes; row_spacing [m], 0 = no rows

    Stems, sorted by tile; tile k owns stem_start[k]:stem_start[k + 1].
    stem_xy: base in the tile [m], (n, 2), in [0, T); stem_rank: (n,) in [0, 1): the stem exists on a tile
    whose density fraction exceeds it; stem_height [m]: tip of the plant; ear_height [m]: middle of its ear,
    pods or cob, the tip without any; is_weed: (n,); grain_kg, straw_kg: (n,) masses

    bounds, primitives: plants are drawn when these are first asked for: not every run looks at plants; the
        properties below are theirs.

    Search index: columns x columns x bins cells per tile, cell = ((k * columns + iy) * columns + ix) * bins
    + iz, column side T / columns, bin height bin_height [m] from zeta = 0; cell c lists primitives
    cell_items[cell_start[c]:cell_start[c + 1]]. Everything that overlaps a cell is listed in it; what reaches
    below zeta = 0 is listed in bin 0. `cells` makes both when the first ray asks for them.

    reflectance: of each Organ at 905 nm
    """

    tile_size: float
    tile_count: int
    density_max: float
    row_spacing: float
    stem_start: NDArray[np.int32]
    stem_xy: NDArray[np.float32]
    stem_rank: NDArray[np.float32]
    stem_height: NDArray[np.float32]
    ear_height: NDArray[np.float64]
    is_weed: NDArray[np.bool_]
    grain_kg: NDArray[np.float64]
    straw_kg: NDArray[np.float64]
    columns: int
    bins: int
    bounds: Callable[[], tuple[float, float]]
    primitives: Callable[[], Primitives]
    cells: Callable[[], tuple[NDArray[np.int32], NDArray[np.int32]]]
    reflectance: NDArray[np.float32] = field(default_factory=lambda: np.zeros(len(Organ), np.float32))

    @property
    def height_max(self) -> float:
        """Top of the tallest primitive [m]."""
        return self.bounds()[0]

    @property
    def reach(self) -> float:
        """How far a primitive reaches aside from its stem's foot [m]."""
        return self.bounds()[1]

    @property
    def bin_height(self) -> float:
        """Height of a bin of the search index [m]."""
        return self.height_max / self.bins

    @property
    def shape(self) -> NDArray[np.uint8]:
        """Shape of each primitive."""
        return self.primitives().shape

    @property
    def organ(self) -> NDArray[np.uint8]:
        """Organ of each primitive."""
        return self.primitives().organ

    @property
    def a(self) -> NDArray[np.float32]:
        """First ends [m], (m, 3)."""
        return self.primitives().a

    @property
    def b(self) -> NDArray[np.float32]:
        """Last ends [m], (m, 3)."""
        return self.primitives().b

    @property
    def radius(self) -> NDArray[np.float32]:
        """Radii of capsules [m]."""
        return self.primitives().radius

    @property
    def width(self) -> NDArray[np.float32]:
        """Half widths of ribbons and triangles [m], (m, 3)."""
        return self.primitives().width

    @property
    def owner(self) -> NDArray[np.int32]:
        """The stem of each primitive."""
        return self.primitives().owner

    @property
    def base(self) -> NDArray[np.float32]:
        """Foot of that stem as seen from the copy [m], (m, 2)."""
        return self.primitives().base

    @property
    def own_reflectance(self) -> NDArray[np.float32]:
        """Reflectances of primitives that have their own, else empty."""
        return self.primitives().own_reflectance

    @property
    def cell_start(self) -> NDArray[np.int32]:
        """Where the list of each cell begins in `cell_items`, and where the last one ends."""
        return self.cells()[0]

    @property
    def cell_items(self) -> NDArray[np.int32]:
        """Primitives, cell by cell."""
        return self.cells()[1]


def primitive_rows(count: int) -> NDArray[np.float32]:
    """Zeros (count, 16): a cache line of 64 bytes for each primitive, as ray kernels read them."""
    room = np.zeros((count + 1) * 16, np.float32)
    first = (-room.ctypes.data % 64) // 4
    rows: NDArray[np.float32] = room[first : first + count * 16].reshape(count, 16)
    return rows


def ranked(count_of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of so many things of each owner, one after the other: the owner, and which of its own each is."""
    owner = np.repeat(np.arange(len(count_of)), count_of)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count_of) - count_of, count_of)


def shared_rows(library: PlantLibrary) -> NDArray[np.float32] | None:
    """The rows that a, radius, b, width and base of a library are views of; None where they are not."""
    views = ((library.a, 0), (library.radius, 3), (library.b, 4), (library.width, 8), (library.base, 12))
    start = library.a.ctypes.data
    if any(v.ctypes.data != start + 4 * i or v.strides[0] != 64 for v, i in views) or start % 64:
        return None
    rows: NDArray[np.float32] = np.lib.stride_tricks.as_strided(library.a, (len(library.a), 16), (64, 4))
    return rows


# Counters of pages: changes of what they hold (a copy on another device is then stale); how often pools or
# the table were put elsewhere in memory; pages that left memory; tiles from which stems can lean over another
# one, the most of all pages so far; rows of `PageStore.touched`.
REVISION, MOVED, DROPPED, STEM_REACH, TOUCHED = range(5)


@dataclass
class Pages:
    """Pools of page data. The first axis of a pool is the page slot; pools grow by doubling.

    table: (ny, nx) int32, page slot or -1 (nothing known there: a ray that gets there is lost)
    table_x, table_y: page index of table[0, 0]; page (i, j) covers [i, i + 1] x [j, j + 1] * 8 T
    ground: (n, 65, 65) height of the soil [m], float32, [iy, ix]
    straw: (n, 65, 65) depth of straw on it [m]. Both are bilinear between nodes, T / 8 apart; the surface a
        ray hits is ground + straw.
    tile_plane: (n, 8, 8, 3) ground, slope_x, slope_y
    tile_stand: (n, 8, 8, 4) scale, lean_x, lean_y [m per m of zeta], density fraction (of density_max)
    tile_top: (n, 8, 8) highest live crop above the tile's plane [m], 0 = bare
    tile_prototype: (n, 8, 8) prototype number with mirror flags
    tile_bump: (n, 8, 8) the most that ground + straw rises above the tile's plane, over the tile's 9 x 9
        nodes [m]: rays that stay above it skip the tile's ground
    cut_slot: (n,) >= 0: row of `cut`; < 0: the whole page has code -1 - cut_slot
    cut: (m, 512, 512) uint8 codes, [iy, ix]
    counters: (5,) see REVISION; compiled code reads and keeps them
    made: pages that came into memory so far
    """

    table: NDArray[np.int32]
    table_x: int
    table_y: int
    ground: NDArray[np.float32]
    straw: NDArray[np.float32]
    tile_plane: NDArray[np.float32]
    tile_stand: NDArray[np.float32]
    tile_top: NDArray[np.float32]
    tile_prototype: NDArray[np.int32]
    cut_slot: NDArray[np.int32]
    cut: NDArray[np.uint8]
    tile_bump: NDArray[np.float32]
    counters: NDArray[np.int64] = field(default_factory=lambda: np.zeros(5, np.int64))
    made: int = 0

    def slots_at(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        """Slots of pages by their indices, -1 where one is not in memory."""
        column, row = i - self.table_x, j - self.table_y
        ny, nx = self.table.shape
        known = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        if known.all():
            return self.table[row, column].astype(np.int64)
        if self.table.size == 0:
            return np.full(known.shape, -1)
        return np.where(known, self.table[row.clip(0, ny - 1), column.clip(0, nx - 1)], -1).astype(np.int64)


def different_pages(i: NDArray[np.int64], j: NDArray[np.int64]) -> list[tuple[int, int]]:
    """The different pairs of two arrays (n,) of indices, sorted.

    Neighbours in it are mostly equal: of those one is sorted.
    """
    if not i.size:
        return []
    low, count = int(j.min()), int(j.max() - j.min()) + 1
    code = i * count + (j - low)
    first = np.concatenate([[True], code[1:] != code[:-1]])
    return [(int(c // count), int(c % count) + low) for c in np.unique(code[first])]


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """The surface of a thing, in a frame of its own whose origin is the middle of its box.

    corners: (n, 3, 3) [m]; never changed, so that what was made of it (a search tree) can be kept
    """

    corners: NDArray[np.float32]


@dataclass
class Solids:
    """Things that are not crop, world frame. Any count may be 0.

    boxes: box_centre (n, 3) [m], box_axes (n, 3, 3) columns are the box axes in the world, box_half (n, 3)
    half sizes [m]; capsules (posts): capsule_a, capsule_b (m, 3) [m], capsule_radius (m,) [m]; ellipsoids
    (stones): ellipsoid_centre (k, 3), ellipsoid_axes (k, 3, 3), ellipsoid_half (k, 3) [m]; meshes:
    mesh_shape, one or several times the same, mesh_centre (j, 3) [m] and mesh_axes (j, 3, 3) of their frames
    reflectance of each at 905 nm
    """

    box_centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    box_axes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    box_half: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    box_reflectance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    capsule_a: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    capsule_b: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    capsule_radius: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    capsule_reflectance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    ellipsoid_centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    ellipsoid_axes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    ellipsoid_half: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    ellipsoid_reflectance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    mesh_shape: tuple[SolidMesh, ...] = ()
    mesh_centre: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    mesh_axes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    mesh_reflectance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def boxes(self) -> Iterator[tuple[NDArray[np.float64], ...]]:
        """Centre, axes and half size of each box."""
        return zip(self.box_centre, self.box_axes, self.box_half, strict=True)

    @property
    def ellipsoids(self) -> Iterator[tuple[NDArray[np.float64], ...]]:
        """The same of each ellipsoid."""
        return zip(self.ellipsoid_centre, self.ellipsoid_axes, self.ellipsoid_half, strict=True)
