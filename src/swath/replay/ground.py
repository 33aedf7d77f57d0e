"""Terrain and stand of an area as a page draws them, from the field's generators: nothing is taken from
memory that a run has changed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.field import Field
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, STANDING
from swath.replay.area import Area
from swath.signals import F64

FAR_STEP, FAR_REACH = 4.0, 150.0  # grid of the country around the area, and how far it goes [m]
FAR_NODES = 150  # along its longer side, at most
LEAN_UNIT = 1.0 / 100.0  # of the lean of a tile's stand
FLAGS = 16  # 16: mirrored in x, 32: mirrored in y, beside the number of a prototype


@dataclass(frozen=True)
class Ground:
    """heights: (ny + 1, nx + 1) at tile corners [m]; stand: (ny, nx, 5) uint8: scale, lean x, lean y, density
    share, prototype with flags; codes: (ny * cells, nx * cells) at the start, as in `field.memory_layout`
    scale_max: the scale that 255 stands for
    """

    heights: F64
    stand: NDArray[np.uint8]
    codes: NDArray[np.uint8]
    scale_max: float


def ground_of(field: Field, area: Area, prototypes: int) -> Ground:
    """Of an area, with the first `prototypes` of the field's tile prototypes in place of all."""
    (x0, y0), (ny, nx), tile = area.first, area.shape, area.tile
    u: F64 = (np.arange(nx + 1, dtype=np.float64) + x0) * tile
    v: F64 = (np.arange(ny + 1, dtype=np.float64) + y0) * tile
    heights = field.terrain.lattice(u, v, field.stand_yaw)
    tx, ty = np.meshgrid(np.arange(nx) + x0, np.arange(ny) + y0)
    x, y = field.maker.to_world((tx + 0.5) * tile, (ty + 0.5) * tile)
    stand = field.maker.stand_at(x, y)
    scale_max = max(float(stand[..., 0].max()), 1e-3)
    number = field.maker.prototypes(tx, ty)
    flags = FLAGS * ((number & MIRROR_X) > 0) + 2 * FLAGS * ((number & MIRROR_Y) > 0)
    share = np.where(area.shown, stand[..., 3], 0.0)
    values = [
        255.0 * stand[..., 0] / scale_max,
        128.0 + stand[..., 1] / LEAN_UNIT,
        128.0 + stand[..., 2] / LEAN_UNIT,
        255.0 * share,
        (number & (MIRROR_X - 1)) % prototypes + flags,
    ]
    bytes_ = np.clip(np.rint(np.stack(values, axis=-1)), 0, 255).astype(np.uint8)
    return Ground(np.asarray(heights, dtype=float), bytes_, _codes(field, area, x, y), scale_max)


def _codes(field: Field, area: Area, x: F64, y: F64) -> NDArray[np.uint8]:
    """Codes of the cells at the start; 0 where nothing is shown. x, y: world middles of the tiles [m]"""
    n, maker = area.cells, field.maker
    tiles = np.where(area.shown, maker.codes_within(x, y, area.tile * np.sqrt(0.5) + 1e-6), 0)
    cells = np.repeat(np.repeat(tiles, n, axis=0), n, axis=1)
    row, column = np.nonzero(tiles < 0)
    row, column = (a[:, None] * n + np.arange(n) for a in (row, column))
    u = area.first[0] * area.tile + (column + 0.5) * area.cell
    v = area.first[1] * area.tile + (row + 0.5) * area.cell
    at = maker.to_world(u[:, None, :], v[:, :, None])
    cells[row[:, :, None], column[:, None, :]] = maker.codes_at(*at)
    return cells.astype(np.uint8)


def far_ground(field: Field, area: Area) -> tuple[dict[str, Any], F64, NDArray[np.uint8]]:
    """The country around: where its grid lies (stand frame [m]), heights, and how far inside the crop its
    nodes lie: 128 at the edge, 255 three steps inside, 0 as far outside: a page finds the edge between them.
    """
    (x0, y0), (ny, nx), tile = area.first, area.shape, area.tile
    begin = np.array([x0 * tile - FAR_REACH, y0 * tile - FAR_REACH])
    sides = np.array([nx, ny]) * tile + 2 * FAR_REACH
    step = max(FAR_STEP, float(sides.max()) / FAR_NODES)
    u, v = (begin[k] + step * np.arange(int(np.ceil(sides[k] / step)) + 1) for k in (0, 1))
    heights = np.asarray(field.terrain.lattice(u, v, field.stand_yaw), dtype=float)
    x, y = field.maker.to_world(*np.meshgrid(u, v))
    inside = np.min([edge.shape.signed_distance(x, y) for edge in field.edges.values()], axis=0) / step
    is_crop = (field.maker.codes_at(x, y) == STANDING) & field.covers(x, y)
    inside = np.where(is_crop, np.maximum(inside, 0.0), np.where(inside < 0.0, inside, -0.5))
    code = np.clip(np.rint(128.0 + 127.0 / 3.0 * inside), 0, 255).astype(np.uint8)
    grid = {"x": float(begin[0]), "y": float(begin[1]), "step": step, "nx": len(u), "ny": len(v)}
    return grid, heights, code
