"""Scenes for the ray benchmark: hills with wheat, some of it cut, for our kernels and for flat Embree 4."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from tests.rays.triangles import capsule_triangles, own_primitives, ribbon_triangles, to_stand

from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import (
    PAGE_CUT_CELLS,
    PAGE_NODES,
    PAGE_TILES,
    STANDING,
    Organ,
    Pages,
    PlantLibrary,
    Shape,
)
from swath.field.prototypes import make_library
from swath.field.wind import Sway
from swath.rays.hits import Spots

SIDES = 8  # of a prism
STUBBLE = 15  # code of cut cells [cm]
ROWS, COLUMNS = 5, 6  # pages
FIRST_X, FIRST_Y = -1, -2  # index of the first page


@dataclass
class Scene:
    """A field as rays need it; state [ty, tx] from the first tile: 1 standing, 2 cut."""

    pages: Pages
    library: PlantLibrary
    state: np.ndarray
    stand_yaw: float = 0.0
    wind: Sway | None = None


@cache
def make_wheat(density: float) -> PlantLibrary:
    return make_library(
        load_crop("wheat"), density_max=density, row_spacing=0.125, seed=Stream(1, "bench"), tile_count=16
    )


def ground(x: Any, y: Any) -> np.ndarray:
    """Height of the soil [m]: 6 % slope and gentle waves."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    return 0.06 * (x - 10.0) - 0.03 * y + 0.12 * np.sin(0.9 * x + 0.4) * np.cos(0.7 * y)


def make_scene(
    density: float, *, cut: float = 0.3, first: tuple[int, int] = (7, -5), tiles: tuple[int, int] = (10, 10)
) -> Scene:
    """Hills with tiles[0] x tiles[1] tiles of wheat from tile `first`; the share `cut` is stubble."""
    library, count, n = make_wheat(density), ROWS * COLUMNS, PAGE_TILES
    shape = (count, n, n)
    state = np.zeros((ROWS * n, COLUMNS * n), int)
    y0, x0 = first[1] - FIRST_Y * n, first[0] - FIRST_X * n
    state[y0 : y0 + tiles[1], x0 : x0 + tiles[0]] = 1
    state[y0 + round((1.0 - cut) * tiles[1]) : y0 + tiles[1], x0 : x0 + tiles[0]] = 2
    node = np.arange(PAGE_NODES + 1) / 8.0
    at = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
    corner = (at + np.array([FIRST_X, FIRST_Y])) * n * library.tile_size
    height = ground(
        corner[:, 0, None, None] + node[None, None] * library.tile_size,
        corner[:, 1, None, None] + node[None, :, None] * library.tile_size,
    )
    plane, bump = _planes(height, library.tile_size)
    near = np.zeros_like(state)  # tiles that standing stems may reach into
    padded = np.pad(state == 1, 1)
    for dy in range(3):
        for dx in range(3):
            near |= padded[dy : dy + state.shape[0], dx : dx + state.shape[1]]
    top = np.where(near & (state > 0), library.height_max, np.where(state == 2, 0.01 * STUBBLE + 0.001, 0.0))
    rng = np.random.default_rng(1)
    blocks = _by_page(state)
    code = np.where(blocks == 2, STUBBLE, np.where(blocks == 1, STANDING, 0)).astype(np.uint8)
    mixed = np.array([len(np.unique(c)) > 1 for c in code])
    rows = np.cumsum(mixed) - 1
    cells = PAGE_CUT_CELLS // n
    pages = Pages(
        table=np.arange(count, dtype=np.int32).reshape(ROWS, COLUMNS),
        table_x=FIRST_X,
        table_y=FIRST_Y,
        ground=np.ascontiguousarray(height, np.float32),
        straw=np.zeros(height.shape, np.float32),
        tile_plane=plane.astype(np.float32),
        tile_stand=np.tile(np.array([1, 0, 0, 1], np.float32), (*shape, 1)),
        tile_top=_by_page(top).astype(np.float32),
        tile_prototype=(rng.integers(0, 16, shape) + (rng.integers(0, 4, shape) << 16)).astype(np.int32),
        cut_slot=np.where(mixed, rows, -1 - code[:, 0, 0].astype(int)).astype(np.int32),
        cut=np.ascontiguousarray(code[mixed].repeat(cells, 1).repeat(cells, 2)),
        tile_bump=bump.astype(np.float32),
    )
    return Scene(pages, library, state)


def _by_page(tiles: np.ndarray) -> np.ndarray:
    n = PAGE_TILES
    return tiles.reshape(ROWS, n, COLUMNS, n).swapaxes(1, 2).reshape(-1, n, n)


def _planes(height: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean plane of every tile, and how far its nodes rise above it."""
    n = PAGE_TILES
    plane, bump = np.zeros((len(height), n, n, 3)), np.zeros((len(height), n, n))
    u = (np.arange(9) / 8 - 0.5) * size
    for j in range(n):
        for i in range(n):
            part = height[:, 8 * j : 8 * j + 9, 8 * i : 8 * i + 9]
            slope = [
                (part * v).sum(axis=(1, 2)) / (9 * (u**2).sum()) for v in (u[None, None], u[None, :, None])
            ]
            plane[:, j, i] = np.stack([part.mean(axis=(1, 2)), *slope], axis=-1)
            flat = (
                plane[:, j, i, 0, None, None]
                + slope[0][:, None, None] * u
                + slope[1][:, None, None] * u[:, None]
            )
            bump[:, j, i] = (part - flat).max(axis=(1, 2))
    return plane, bump


def make_triangles(scene: Scene) -> tuple[np.ndarray, np.ndarray, int]:
    """(vertices, triangles, number of plants) of the same plants, cut ones as stubble, and of the ground."""
    library, pages, size = scene.library, scene.pages, scene.library.tile_size
    shapes = {
        (k, is_cut): _weld(_tile(library, k, is_cut))
        for k in range(library.tile_count)
        for is_cut in (False, True)
    }
    vertices, faces, total, plants = [], [], 0, 0
    for j, i in np.argwhere(scene.state > 0):
        slot = pages.table[j // PAGE_TILES, i // PAGE_TILES]
        place = slot, j % PAGE_TILES, i % PAGE_TILES
        kind = int(pages.tile_prototype[place])
        points, index = shapes[kind & 0xFFFF, bool(scene.state[j, i] == 2)]
        points = points.astype(float)
        for axis in (0, 1):
            if kind >> (16 + axis) & 1:
                points[:, axis] = size - points[:, axis]
        points = to_stand(
            points, pages.tile_plane[place].astype(float), pages.tile_stand[place].astype(float), size
        )
        corner = [(i + FIRST_X * PAGE_TILES) * size, (j + FIRST_Y * PAGE_TILES) * size, 0.0]
        vertices.append((points + corner).astype(np.float32))
        faces.append(index + total)
        total += len(points)
        plants += len(library.stem_xy) // library.tile_count
    for points, index in _soil(pages, size):
        vertices.append(points)
        faces.append(index + total)
        total += len(points)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.int32), plants


def _tile(library: PlantLibrary, tile: int, is_cut: bool) -> np.ndarray:
    """Triangles of a tile's plants; cut at STUBBLE: rods end there, leaves that reach above it are gone."""
    index, a, b = own_primitives(library, tile)
    top = 0.01 * STUBBLE if is_cut else 10.0
    rod = library.shape[index] == Shape.CAPSULE
    keep = np.where(rod, a[:, 2] < top, np.maximum(a[:, 2], b[:, 2]) < top)
    index, a, b, rod = index[keep], a[keep], b[keep], rod[keep]
    over = rod & (b[:, 2] > top)
    share = (top - a[over, 2]) / (b[over, 2] - a[over, 2])
    b[over] = a[over] + share[:, None] * (b[over] - a[over])
    radius, width = library.radius[index].astype(float), library.width[index].astype(float)
    return np.concatenate(
        [
            capsule_triangles(a[rod], b[rod], radius[rod], sides=SIDES, rings=0),
            ribbon_triangles(a[~rod], b[~rod], width[~rod]),
        ]
    )


def _soil(pages: Pages, size: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """The ground of every page as a mesh."""
    n, found = PAGE_NODES + 1, []
    row, column = np.meshgrid(np.arange(PAGE_NODES), np.arange(PAGE_NODES), indexing="ij")
    first = (row * n + column).ravel()
    index = np.concatenate([np.c_[first, first + 1, first + n + 1], np.c_[first, first + n + 1, first + n]])
    for j, i in np.argwhere(pages.table >= 0):
        side = PAGE_TILES * size
        x = (i + pages.table_x) * side + np.arange(n) * size / 8
        y = (j + pages.table_y) * side + np.arange(n) * size / 8
        u, v = np.meshgrid(x, y)
        points = np.stack([u, v, pages.ground[pages.table[j, i]]], axis=-1).reshape(-1, 3)
        found.append((points.astype(np.float32), index))
    return found


def _weld(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = np.ascontiguousarray(triangles.reshape(-1, 3), np.float32)
    key = np.ascontiguousarray(np.round(corners * 1e6).astype(np.int32)).view("i4,i4,i4").ravel()
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    return corners[first], index.reshape(-1, 3).astype(np.int32)


def make_spots(sub_rays: int, count: int = 60_000, beams: int = 180) -> Spots:
    """About `count` rays: lines of 6 mrad beams 1/6 deg apart, 14 to 22 deg down."""
    lines = max(1, count // (beams * sub_rays))
    depression = np.radians(14 + 8 * (np.arange(lines) + 0.5) / lines)
    azimuth = np.radians((np.arange(beams) - 0.5 * (beams - 1)) / 6)
    a, e = np.tile(azimuth, lines), -np.repeat(depression, beams)
    ahead = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
    left = np.stack([-np.sin(a), np.cos(a), 0 * a], axis=-1)
    axes = np.stack([ahead, left, np.cross(ahead, left)], axis=-1)
    ring = np.arange(sub_rays)
    radius, turn = 0.003 * np.sqrt(ring / max(sub_rays - 1, 1)), ring * 2.399963  # sunflower
    u, v = radius * np.cos(turn), radius * np.sin(turn)
    offsets = np.stack([0 * u, 0 * u, u, v, 1.0 / np.sqrt(1.0 + u**2 + v**2)], axis=-1)[None]
    origin = np.array([0.0, 0.0, float(ground(10.0, 0.0)) + 4.0])
    return Spots(np.tile(origin, (len(a), 1)), axes, offsets)


def make_beams(sub_rays: int, count: int = 60_000, beams: int = 180) -> tuple[np.ndarray, np.ndarray]:
    """The same as rays, (beams, sub_rays, 3)."""
    return make_spots(sub_rays, count, beams).rays()


def make_picture(wide: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """A camera of 640 x 480 pixels, `wide` degrees: origin (3,), directions (480, 640, 3)."""
    step = 2.0 * np.tan(np.radians(wide) / 2) / 640
    v, u = np.meshgrid(step * (np.arange(480) - 239.5), step * (np.arange(640) - 319.5), indexing="ij")
    tilt = np.radians(7.0)
    ahead, up = np.array([np.cos(tilt), 0, -np.sin(tilt)]), np.array([np.sin(tilt), 0, np.cos(tilt)])
    d = ahead - u[..., None] * np.array([0, 1.0, 0]) - v[..., None] * up
    origin = np.array([4.0, 0.0, float(ground(4.0, 0.0)) + 2.5])
    return origin, d / np.linalg.norm(d, axis=-1, keepdims=True)


def reduced(scene: Scene, **pages: Any) -> Scene:
    """The scene with some arrays of its pages exchanged."""
    return replace(scene, pages=replace(scene.pages, **pages))


def organs(hits: Any) -> dict[str, float]:
    """Shares of what was hit."""
    return {o.name.lower(): float(np.mean(hits.organ == o)) for o in Organ if (hits.organ == o).any()}
