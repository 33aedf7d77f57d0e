"""A field made by hand for the ray tests: pages filled directly."""

from dataclasses import dataclass, replace

import numpy as np

from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import PAGE_CUT_CELLS, PAGE_NODES, PAGE_TILES, STANDING, Pages, PlantLibrary
from swath.field.prototypes import make_library
from swath.field.wind import Sway


@dataclass
class HandField:
    pages: Pages
    library: PlantLibrary
    stand_yaw: float = 0.0
    wind: Sway | None = None
    profile: None = None


def make_pages(
    library: PlantLibrary,
    *,
    pages: int = 2,
    first: int = 0,
    slope: tuple[float, float] = (0.0, 0.0),
    lean: tuple[float, float] = (0.0, 0.0),
    scale: float = 1.0,
    density: float | None = None,
    mixed: int | None = None,
    ground: object = None,
    code: int = STANDING,
) -> Pages:
    """pages x pages of them from page `first`; ground(x, y) in the stand frame, default the tilted plane.

    mixed: seed for prototypes and mirrors drawn per tile; None = prototype 0 everywhere
    """
    size, count = library.tile_size, pages * pages
    table = np.arange(count, dtype=np.int32).reshape(pages, pages)
    span = PAGE_TILES * size
    corner = np.stack(np.meshgrid(np.arange(pages), np.arange(pages)), axis=-1).reshape(-1, 2) + first
    node = np.arange(PAGE_NODES + 1) * (span / PAGE_NODES)
    middle = (np.arange(PAGE_TILES) + 0.5) * size
    height = ground or (lambda x, y: slope[0] * x + slope[1] * y)
    lattice = height(
        (corner[:, 0] * span)[:, None, None] + node[None, None, :],
        (corner[:, 1] * span)[:, None, None] + node[None, :, None],
    ) * np.ones((count, PAGE_NODES + 1, PAGE_NODES + 1))
    plane = np.zeros((count, PAGE_TILES, PAGE_TILES, 3), np.float32)
    plane[..., 0] = height(
        (corner[:, 0] * span)[:, None, None] + middle[None, None, :],
        (corner[:, 1] * span)[:, None, None] + middle[None, :, None],
    )
    plane[..., 1:] = slope
    stand = np.zeros((count, PAGE_TILES, PAGE_TILES, 4), np.float32)
    stand[...] = (scale, *lean, 1.0 if density is None else density / library.density_max)
    shape = (count, PAGE_TILES, PAGE_TILES)
    prototype = np.zeros(shape, np.int32)
    if mixed is not None:
        rng = np.random.default_rng(mixed)
        prototype[...] = rng.integers(0, library.tile_count, shape) + (rng.integers(0, 4, shape) << 16)
    result = Pages(
        table=table,
        table_x=first,
        table_y=first,
        ground=np.ascontiguousarray(lattice, np.float32),
        straw=np.zeros_like(lattice, dtype=np.float32),
        tile_plane=plane,
        tile_stand=stand,
        tile_top=np.full(shape, library.height_max * scale, np.float32),
        tile_prototype=prototype,
        cut_slot=np.full(count, -1 - code, np.int32),
        cut=np.zeros((1, PAGE_CUT_CELLS, PAGE_CUT_CELLS), np.uint8),
        tile_bump=np.zeros(shape, np.float32),
    )
    set_bumps(result, size)
    return result


def set_bumps(pages: Pages, tile_size: float) -> None:
    """tile_bump from ground, straw and planes."""
    u = (np.arange(9) / 8 - 0.5) * tile_size
    surface = pages.ground + pages.straw
    for j in range(PAGE_TILES):
        for i in range(PAGE_TILES):
            part = surface[:, 8 * j : 8 * j + 9, 8 * i : 8 * i + 9]
            plane = pages.tile_plane[:, j, i]
            flat = (
                plane[:, 0, None, None] + plane[:, 1, None, None] * u + plane[:, 2, None, None] * u[:, None]
            )
            pages.tile_bump[:, j, i] = (part - flat).max(axis=(1, 2))


def wheat(**changes: object) -> Crop:
    """The wheat sheet, sections and organs changed by keyword: stem={'diameter_cv': 0}."""
    crop = load_crop("wheat")
    for name, values in changes.items():
        if name in crop.habit.organs:
            changed = replace(crop.organs[crop.habit.organs[name]], **values)
            crop = replace(crop, organs=crop.organs.replaced(changed))
        else:
            crop = replace(crop, **{name: replace(getattr(crop, name), **values)})
    return crop


def small_library(
    density: float = 500.0, *, tiles: int = 2, seed: int = 1, **options: object
) -> PlantLibrary:
    """A library of wheat."""
    crop = options.pop("crop", None) or load_crop("wheat")
    options.setdefault("row_spacing", 0.125)
    return make_library(crop, density_max=density, seed=Stream(seed, "test"), tile_count=tiles, **options)
