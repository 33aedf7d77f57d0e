"""Tile prototypes full of plants: what stands where in each, with the search index that
single rays traverse.
"""

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.memory_layout import Organ, PlantLibrary, Primitives, Shape, primitive_rows, ranked
from swath.field.plants import Drawing, Plants, leaf_parts_of, make_plants
from swath.field.plants.drawing import Detail
from swath.field.plants.parts import joined

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PIECES = 4_000  # looked at together: their arrays stay in the processor's cache
PAD = 2e-5  # primitives grow by this in the overlap test, so that float32 rays never miss a listed cell [m]


@dataclass(frozen=True)
class _Pieces:
    """Primitives placed in tiles. source: index of the primitive in the plants; tile; a, b, base: placed.

    half: `width` in the plants
    pointed: triangles, which have no width at b.
    """

    source: Ints
    tile: Ints
    a: Array
    b: Array
    half: Array
    radius: Array
    base: Array
    pointed: NDArray[np.bool_]

    def take(self, order: Ints) -> "_Pieces":
        """The same pieces in another order."""
        return _Pieces(*(values[order] for values in vars(self).values()))


def _copies(plants: Plants, xy: Array, tile: Ints, size: float) -> _Pieces:
    """Every primitive at its place, and once more for every tile side it reaches over."""
    shift = np.concatenate([xy[plants.owner], np.zeros((len(plants.owner), 1))], axis=1)
    a, b = plants.a + shift, plants.b + shift
    reach = (plants.radius[:, None] + np.abs(plants.width) + PAD)[:, :2]
    low, high = np.minimum(a, b)[:, :2] - reach, np.maximum(a, b)[:, :2] + reach
    steps = (-2, -1, 0, 1, 2)
    sides = np.flatnonzero(((low < 0.0) | (high > size)).any(axis=1))  # what reaches over a side of its tile
    near, far = low[sides], high[sides]
    along = [[(near[:, k] + size * i < size) & (far[:, k] + size * i > 0.0) for i in steps] for k in (0, 1)]
    here = ((low < size) & (high > 0.0)).all(axis=1)
    found: list[Ints] = []
    for ix, in_x in zip(steps, along[0], strict=True):
        for iy, in_y in zip(steps, along[1], strict=True):
            found.append(sides[in_x & in_y] if ix or iy else np.flatnonzero(here))
    source = np.concatenate(found)
    moves = size * np.array([[ix, iy, 0.0] for ix in steps for iy in steps])
    move = np.repeat(moves, [len(index) for index in found], axis=0)
    owner = plants.owner[source]
    return _Pieces(
        source,
        tile[owner],
        a[source] + move,
        b[source] + move,
        plants.width[source],
        plants.radius[source],
        xy[owner] + move[:, :2],
        plants.shape[source] == Shape.TRIANGLE,
    )


@dataclass(frozen=True)
class Index:
    """The cells of all tiles: columns x columns x bins each."""

    size: float
    tile_count: int
    columns: int
    bins: int
    bin_height: float

    def _cells(self) -> tuple[Array, Array]:
        """Size of a cell [m]; the last one along each axis."""
        side = np.array([self.size / self.columns] * 2 + [self.bin_height])
        return side, np.array([self.columns - 1] * 2 + [self.bins - 1])

    def order(self, pieces: _Pieces) -> Ints:
        """Tile by tile, cell by cell of their middles: pieces near each other are stored near each other."""
        side, limit = self._cells()
        cell = np.clip(np.floor(0.5 * (pieces.a + pieces.b) / side), 0, limit).astype(np.int64)
        key = (pieces.tile * self.columns + cell[:, 1]) * self.columns + cell[:, 0]
        return np.argsort(key * self.bins + cell[:, 2], kind="stable")

    def fill(self, pieces: _Pieces) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """cell_start and cell_items: for each cell the pieces that overlap it, capsules first."""
        cells, items = [], []
        for first in range(0, len(pieces.source), PIECES):
            part = np.arange(first, min(first + PIECES, len(pieces.source)))
            cell, item = self._overlaps(pieces.take(part))
            cells.append(cell)
            items.append(item + first)
        cell, item = np.concatenate(cells), np.concatenate(items)
        order = np.argsort(2 * cell + (pieces.radius[item] == 0.0), kind="stable")  # items ascend already
        count = self.tile_count * self.columns * self.columns * self.bins
        start = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=count))])
        return start.astype(np.int32), item[order].astype(np.int32)

    def _overlaps(self, pieces: _Pieces) -> tuple[Ints, Ints]:
        side, limit = self._cells()
        grow = pieces.radius[:, None] + np.abs(pieces.half) + PAD
        low = np.floor((np.minimum(pieces.a, pieces.b) - grow) / side)
        high = np.floor((np.maximum(pieces.a, pieces.b) + grow) / side)
        low, high = np.clip(low, 0, limit).astype(np.int64), np.clip(high, 0, limit).astype(np.int64)
        span = high - low + 1
        item, rest = ranked(span.prod(axis=1))
        ix, rest = rest % span[item, 0], rest // span[item, 0]
        iy, iz = rest % span[item, 1], rest // span[item, 1]
        cell = low[item] + np.stack([ix, iy, iz], axis=-1)
        middle = (cell + 0.5) * side
        box = np.broadcast_to(0.5 * side, middle.shape).copy()
        bottom = cell[:, 2] == 0  # bin 0 also holds what reaches below zeta = 0
        middle[bottom, 2] -= 0.5
        box[bottom, 2] += 0.5
        keep = np.ones(len(item), bool)
        pointed = pieces.pointed[item]
        for which, meet in ((~pointed, _boxes_meet), (pointed, _triangles_meet)):
            if which.all():
                keep = meet(pieces, item, middle, box)
            elif which.any():
                keep[which] = meet(pieces, item[which], middle[which], box[which])
        cell, item = cell[keep], item[keep]
        flat = ((pieces.tile[item] * self.columns + cell[:, 1]) * self.columns + cell[:, 0]) * self.bins
        return flat + cell[:, 2], item


class PlacedPlants:
    """Plants, primitives and lists of cells, each made when it is first asked for.

    draw: plants whose stems stand at xy (n, 2) [m] in the tiles `tile` (n,)
    size: of a tile [m]
    counts: tiles, columns and bins of the index
    """

    def __init__(
        self,
        draw: Callable[[], Plants],
        xy: NDArray[np.float32],
        tile: Ints,
        size: float,
        counts: tuple[int, int, int],
    ) -> None:
        self._draw, self._xy, self._tile, self._size, self._counts = draw, xy, tile, size, counts

    @cached_property
    def _plants(self) -> Plants:
        return self._draw()

    @cached_property
    def _bounds(self) -> tuple[float, float]:
        return _bounds(self._plants)

    @cached_property
    def _index(self) -> Index:
        return Index(self._size, *self._counts, self._bounds[0] / self._counts[2])

    def _pieces(self) -> _Pieces:
        """Tile by tile, cell by cell."""
        pieces = _copies(self._plants, self._xy.astype(np.float64), self._tile, self._size)
        return pieces.take(self._index.order(pieces))

    @cached_property
    def _primitives(self) -> Primitives:
        pieces, plants = self._pieces(), self._plants
        source = pieces.source
        shape, own = plants.shape[source], plants.own_reflectance()
        rows = primitive_rows(len(shape))
        parts = ((pieces.a, 0), (pieces.radius, 3), (pieces.b, 4), (pieces.half, 8), (pieces.base, 12))
        for values, first in parts:
            values = values.reshape(len(shape), -1)
            rows[:, first : first + values.shape[1]] = values
        return Primitives(
            shape=shape,
            organ=plants.organ[source],
            a=rows[:, 0:3],
            b=rows[:, 4:7],
            radius=rows[:, 3].copy() if (shape == Shape.TRIANGLE).any() else rows[:, 3],
            width=rows[:, 8:11],
            owner=plants.owner[source],
            base=rows[:, 12:14],
            own_reflectance=own[source].astype(np.float32) if own.any() else np.zeros(0, np.float32),
        )

    @cached_property
    def _cells(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return self._index.fill(self._pieces())

    def bounds(self) -> tuple[float, float]:
        """Top of the tallest primitive, and how far one reaches aside from its stem's foot [m]."""
        return self._bounds

    def primitives(self) -> Primitives:
        """All primitives, with their copies."""
        return self._primitives

    def cells(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Lists of all cells; see `PlantLibrary`."""
        return self._cells


def _boxes_meet(pieces: _Pieces, item: Ints, middle: Array, box: Array) -> NDArray[np.bool_]:
    """Does the primitive `item` reach into the box? Separating axes: never a false no.

    A capsule is its axis grown by the radius, a ribbon a flat parallelogram with half edges e1 and e2.
    Axes: the ribbon's normal, and the cross products of its edges with those of the box. The box's own
    normals say nothing more: the boxes were chosen by the bounds of the primitive. Boxes that one
    axis separates are not tried on the next.
    """
    e1, e2 = (0.5 * (pieces.b - pieces.a)).T.copy(), pieces.half.T.copy()
    normal = np.cross(e1, e2, axis=0)
    radius = pieces.radius + PAD
    offset, half = (0.5 * (pieces.a + pieces.b)[item] - middle).T.copy(), box.T.copy()
    left = np.arange(len(item))
    for edge in (e1, e2):
        for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # edge x unit k; the other edge reaches |normal k|
            reach = np.abs(normal[k]) + radius * np.hypot(edge[i], edge[j])
            of = item[left]
            u, v, own = edge[i][of], edge[j][of], reach[of]
            apart = np.abs(offset[i, left] * v - offset[j, left] * u)
            own += np.abs(u) * half[j, left] + np.abs(v) * half[i, left]
            left = left[apart <= own]
        if edge is e1:
            whole = left[pieces.radius[item[left]] > 0.0]  # capsules: e2 is zero
            left = left[pieces.radius[item[left]] == 0.0]
    of = item[left]
    reach = (np.abs(normal[:, of]) * half[:, left]).sum(axis=0) + (radius * np.linalg.norm(normal, axis=0))[
        of
    ]
    left = left[np.abs((normal[:, of] * offset[:, left]).sum(axis=0)) <= reach]
    meets = np.zeros(len(item), bool)
    meets[whole], meets[left] = True, True
    return meets


def _triangles_meet(pieces: _Pieces, item: Ints, middle: Array, box: Array) -> NDArray[np.bool_]:
    """As `_boxes_meet`, for triangles: on each axis the span of three corners against that of the box.

    What one axis separates is not looked at on the next.
    """
    corners = np.stack([pieces.a - pieces.half, pieces.a + pieces.half, pieces.b])
    sides = np.roll(corners, -1, axis=0) - corners
    normal = np.cross(sides[0], sides[1])
    left = np.arange(len(item))
    unit = np.eye(3)
    axes = [unit[0], unit[1], unit[2], normal]
    axes += [np.cross(side, unit[k]) for side in sides for k in range(3)]
    for axis in axes:
        own = np.broadcast_to(axis, normal.shape)
        at = np.einsum("knj,nj->kn", corners, own)
        low, high = at.min(axis=0), at.max(axis=0)
        pad = PAD * np.linalg.norm(own, axis=1)
        of, where = item[left], own[item[left]]
        centre = np.einsum("nj,nj->n", where, middle[left])
        reach = np.einsum("nj,nj->n", np.abs(where), box[left]) + pad[of]
        left = left[(low[of] - centre <= reach) & (high[of] - centre >= -reach)]
    meets = np.zeros(len(item), bool)
    meets[left] = True
    return meets


FEW = 100  # plants per tile: below, a whole number of them would miss the density by a percent and more
MESH_TRIANGLES = 300_000  # of all prototypes; fewer prototypes are made rather than more triangles
MESH_TRIANGLES_MAX = 1_200_000  # some 300 MB
MESH_TILES_MIN = 3
MESH_FINE = 15_000  # triangles in a prototype from which on its cells are halved


def make_library(
    crop: Crop,
    *,
    density_max: float,
    row_spacing: float,
    seed: Stream,
    tile_count: int | None = None,
    columns: int | None = None,
    bins: int | None = None,
    leaves: bool = True,
    ears: bool = True,
    upright: bool = False,
    weeds: Crop | None = None,
    detail: Detail = "full",
) -> PlantLibrary:
    """Draw `tile_count` prototypes and index them.

    tile_count, columns, bins: None = 16, 20 and 16; of meshes with many triangles fewer prototypes with
    finer cells; InputError when three do not fit into some 300 MB
    density_max: stems/m2 in the prototypes (the densest place of the field), made a little more where a tile
    holds few, to be a whole number; row_spacing [m], 0 = stems anywhere, even and independent (Poisson but
    for the exact count per tile). The tile's side is the whole number of rows nearest to 1 m, two rows at
    least. leaves, ears, upright: see `plants.make_plants`. weeds: a second stand of its own density, of rank
    0, so that it is there wherever anything stands. detail: `reduced` = the same plants of fewer primitives
    """
    if not density_max > 0.0:
        raise InputError("density_max", density_max, "expected > 0 stems/m2")
    if not 0.0 <= row_spacing <= 1.0:
        raise InputError("row_spacing_m", row_spacing, "expected 0 (no rows) to 1 m")
    size = row_spacing * max(2, round(1.0 / row_spacing)) if row_spacing > 0.0 else 1.0
    per_tile = max(1, round(density_max * size * size))
    if density_max * size * size < FEW:
        per_tile = math.ceil(density_max * size * size * (1.0 - 1e-9))
        density_max = max(density_max, per_tile / size**2)
    tile_count, columns, bins = resolution(crop, per_tile, tile_count, columns, bins)
    count = per_tile * tile_count
    rng = seed.child("plants").at()
    xy = _places(crop, tile_count, per_tile, size, row_spacing, rng)
    order = np.argsort(rng.random((tile_count, per_tile)), axis=1, kind="stable")
    rank = ((order + rng.random((tile_count, 1))) / per_tile).ravel()
    leaf_parts = leaf_parts_of(crop, detail)
    how = Drawing(leaves=leaves, ears=ears, upright=upright, leaf_parts=leaf_parts)
    own, is_light = deepcopy(rng), weeds is None and crop.habit.fruit_only
    plants = make_plants(crop, count, rng, replace(how, fruit_only=is_light))
    tile = np.repeat(np.arange(tile_count), per_tile)
    if weeds is not None:
        plants, xy, rank, tile = _with_weeds(plants, xy, rank, tile, weeds, tile_count, size, seed)

    stem_xy = xy.astype(np.float32)  # exact, see `_places`
    drawn = partial(make_plants, crop, count, own, how) if is_light else lambda: plants  # holds no light ones
    placed = PlacedPlants(drawn, stem_xy, tile, size, (tile_count, columns, bins))
    reflectance = np.zeros(len(Organ), np.float32)
    for name, value in crop.reflectance.items():
        reflectance[Organ[name.upper()]] = value
    if weeds is not None:
        reflectance[Organ.WEED] = weeds.reflectance["weed"]
    is_weed = np.zeros(len(xy), dtype=bool)
    is_weed[plants.owner[plants.organ == Organ.WEED]] = True
    return PlantLibrary(
        tile_size=size,
        tile_count=tile_count,
        density_max=density_max,
        row_spacing=row_spacing,
        stem_start=np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=tile_count))]).astype(np.int32),
        stem_xy=stem_xy,
        stem_rank=rank.astype(np.float32),
        stem_height=plants.height.astype(np.float32),
        ear_height=_ear_heights(plants),
        is_weed=is_weed,
        grain_kg=plants.grain_kg,
        straw_kg=plants.straw_kg,
        columns=columns,
        bins=bins,
        bounds=placed.bounds,
        primitives=placed.primitives,
        cells=placed.cells,
        reflectance=reflectance,
    )


def _bounds(plants: Plants) -> tuple[float, float]:
    wide = plants.radius[:, None] + np.abs(plants.width)
    at_b = np.where((plants.shape == Shape.TRIANGLE)[:, None], 0.0, wide)
    top = np.maximum(plants.a[:, 2] + wide[:, 2], plants.b[:, 2] + at_b[:, 2]).max()
    aside = max(float((np.abs(end[:, :2]) + wide[:, :2]).max()) for end in (plants.a, plants.b))
    return float(top) + 1e-4, aside + PAD


def _ear_heights(plants: Plants) -> Array:
    """Height of the middle of each stem's ear, pods or cob [m], (n,); the tip where a stem has none."""
    ears = np.flatnonzero(np.isin(plants.organ, (Organ.EAR, Organ.POD, Organ.COB)))
    owner = plants.owner[ears]
    z = np.stack([plants.a[ears, 2], plants.b[ears, 2]]).astype(np.float32).astype(np.float64)
    low, high = np.full(len(plants.height), np.inf), np.full(len(plants.height), -np.inf)
    np.minimum.at(low, owner, z.min(axis=0))
    np.maximum.at(high, owner, z.max(axis=0))
    is_bare = low > high
    low[is_bare] = high[is_bare] = plants.height[is_bare].astype(np.float32)
    return np.asarray(0.5 * (low + high))


def resolution(
    crop: Crop, per_tile: int, tile_count: int | None, columns: int | None, bins: int | None
) -> tuple[int, int, int]:
    """Prototypes, columns and bins for so many plants per tile; what is given stays. See `make_library`."""
    usual = (16, 20, 16)
    if crop.habit.pieces is not None:
        mean = crop.habit.pieces(crop)
        triangles = per_tile * mean
        if MESH_TILES_MIN * triangles > MESH_TRIANGLES_MAX:
            limit = MESH_TRIANGLES_MAX / MESH_TILES_MIN / per_tile
            expected = f"expected at most {limit:.0f} triangles per plant at this density, it has {mean:.0f}"
            raise InputError("mesh.files", crop.name, expected)
        cells = (40, 32) if triangles > MESH_FINE else (20, 16)
        usual = (int(np.clip(MESH_TRIANGLES // triangles, MESH_TILES_MIN, 16)), *cells)
    return tile_count or usual[0], columns or usual[1], bins or usual[2]


def _places(
    crop: Crop, tile_count: int, per_tile: int, size: float, row_spacing: float, rng: np.random.Generator
) -> Array:
    """Feet of the stems in their tiles [m], (tile_count * per_tile, 2), in [0, size)."""
    shape = (tile_count, per_tile)
    if row_spacing == 0.0:
        xy = rng.random((*shape, 2)) * size
    else:
        plants = max(1, round(per_tile / crop.stand.stems_per_plant))
        rows = round(size / row_spacing)
        jitter = crop.stand.sowing_jitter * rng.random((tile_count, plants))
        slot = (np.arange(plants) + jitter) / plants * rows  # along all rows, even
        row, along = np.floor(slot), slot % 1.0
        member = _plant_of(np.argsort(rng.random(shape), axis=1, kind="stable"), per_tile, plants)
        foot = np.stack([along * size, (row + 0.5) * row_spacing], axis=-1)
        xy = np.take_along_axis(foot, member[..., None], axis=1)
        xy = xy + crop.stand.tiller_spread * np.clip(rng.standard_normal((*shape, 2)), -3.0, 3.0)
    xy = (xy.reshape(-1, 2) % size).astype(np.float32)
    return np.where(xy >= np.float32(size), np.float32(0.0), xy).astype(np.float64)


def _plant_of(stem: Ints, stems: int, plants: int) -> Ints:
    """The plant that each stem 0..stems - 1 belongs to.

    Every plant has stems // plants stems. The remaining ones go to plants at equal distances: plants are
    numbered along the rows, so giving them to the first plants would leave the last rows of a tile thin.
    """
    whole = stems // plants * plants
    rest = max(stems - whole, 1)
    return np.where(stem < whole, stem % plants, (stem - whole) * plants // rest)


def _with_weeds(
    plants: Plants,
    xy: Array,
    rank: Array,
    tile: Ints,
    weeds: Crop,
    tile_count: int,
    size: float,
    seed: Stream,
) -> tuple[Plants, Array, Array, Ints]:
    """Plants, feet, ranks and tiles with weeds among them, still sorted by tile."""
    rng = seed.child("weeds").at()
    number = np.floor(weeds.stand.density * size * size + rng.random(tile_count)).astype(np.int64)
    more = make_plants(weeds, int(number.sum()), rng)
    feet = (rng.random((len(more.height), 2)) * size).astype(np.float32).astype(np.float64)
    feet = np.where(feet >= np.float32(size), 0.0, feet)
    tile = np.concatenate([tile, np.repeat(np.arange(tile_count), number)])
    order = np.argsort(tile, kind="stable")
    xy, rank = np.concatenate([xy, feet])[order], np.concatenate([rank, np.zeros(len(feet))])[order]
    return joined(plants, more, order), xy, rank, tile[order]
