"""Tile prototypes full of plants: what stands where in each."""

import math

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.memory_layout import Organ, PlantLibrary, Shape
from swath.field.plants import Drawing, Plants, leaf_parts_of, make_plants
from swath.field.plants.drawing import Detail
from swath.field.plants.parts import joined
from swath.field.prototype_index import PAD, Index, PlacedPlants

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
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
    plants = make_plants(crop, count, rng, how)
    tile = np.repeat(np.arange(tile_count), per_tile)
    if weeds is not None:
        plants, xy, rank, tile = _with_weeds(plants, xy, rank, tile, weeds, tile_count, size, seed)
    top, reach = _bounds(plants)
    placed = PlacedPlants(Index(size, tile_count, columns, bins, top / bins), plants, xy, tile)
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
        height_max=top,
        reach=reach,
        stem_start=np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=tile_count))]).astype(np.int32),
        stem_xy=xy.astype(np.float32),
        stem_rank=rank.astype(np.float32),
        stem_height=plants.height.astype(np.float32),
        ear_height=_ear_heights(plants),
        is_weed=is_weed,
        grain_kg=plants.grain_kg,
        straw_kg=plants.straw_kg,
        columns=columns,
        bins=bins,
        bin_height=top / bins,
        primitives=placed.primitives,
        cells=placed.cells,
        reflectance=reflectance,
    )


def _bounds(plants: Plants) -> tuple[float, float]:
    """Top of the tallest primitive, and how far one reaches aside from its stem's foot [m]."""
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
    """The plant of each stem 0..stems - 1. All have as many; those that have one more lie even among them.

    Plants are numbered along the rows: were the first to have the rest, the last rows of a tile were thin.
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
