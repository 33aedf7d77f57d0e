"""Measured plant heights in a position grid: what a replay looks at, and its file.

Local frame: the world turned by `yaw` about z and moved to `origin`, x along the path that was driven while
measuring. Square cells, TILE x TILE of them to a tile; only tiles with echoes are held. A cell keeps the
distribution of the heights that were measured in and around it as LEVELS quantiles, so a canopy with gaps
stays a canopy with gaps. The EVEN upper of the levels are quantiles of what beams from above see. What stands
further down stops a beam that comes in through the side, however much crop there is above. So the lower DEEP
levels hold how thick the crop above is, -log of the share of beams that get there, at even heights.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.whole_file import new_file
from swath.documents.packed import read_arrays, readable

Array = NDArray[np.float64]
FORMAT = "swath replay 2"
DEEP, EVEN = 12, 32
LEVELS = DEEP + EVEN
SHARES = (np.arange(EVEN) + 0.5) / EVEN  # of the heights that lie below the upper levels
THICK = -log(SHARES[0])  # thickness above the lowest of these
PER_THICKNESS = 50.0  # of the numbers held of it
THICKEST = 650.0
TILE = 32  # cells along a tile
NODE_CELLS = 8  # cells between two nodes of the ground lattice
NODES = TILE // NODE_CELLS
RATIO = 300  # unpacked to packed bytes of a file at most: of tiles with few measured cells about 140
NONE = -32768  # first quantile of a cell that was never measured
STORED: dict[str, tuple[str, type]] = {  # key in the file -> field of `HeightGrid`, its type
    "origin_m": ("origin", np.float64),
    "yaw_rad": ("yaw", np.float64),
    "cell_m": ("cell", np.float64),
    "table": ("table", np.int32),
    "height_quantiles_mm": ("quantiles", np.int16),
    "thickness": ("thickness", np.float32),
    "count": ("count", np.uint16),
    "intensity": ("intensity", np.float32),
    "ground_m": ("ground", np.float32),
}
LIMIT_M = 32.0  # heights beyond are not plants [m]


@dataclass(frozen=True)
class HeightGrid:
    """The grid. m = held tiles; tiles (ty, tx) cover the bounding box.

    origin: (3,) world place of the local frame's corner [m]; yaw [rad]
    cell: side of a cell [m]
    table: (ty, tx) row of the pools, -1 = nothing measured there
    quantiles: (m, TILE, TILE, LEVELS) int16. First the lowest height above ground [mm], NONE = never
        measured; from DEEP on the heights at SHARES [mm], rising; between the two the thickness times
        PER_THICKNESS at the heights that cut the range from the lowest to that at DEEP into equal parts
    thickness: (m, TILE, TILE) at the lowest height; < 0: nobody looked further down, its size counts
    count: (m, TILE, TILE) echoes in the cell itself (neighbours lend to cells with 0 of them)
    intensity: (m, TILE, TILE) mean of the echoes, nan = none
    ground: (ty * NODES + 1, tx * NODES + 1) height of the ground [m] above origin[2], bilinear
    about: where it comes from and what was counted, plain JSON values
    """

    origin: Array
    yaw: float
    cell: float
    table: NDArray[np.int32]
    quantiles: NDArray[np.int16]
    thickness: NDArray[np.float32]
    count: NDArray[np.uint16]
    intensity: NDArray[np.float32]
    ground: NDArray[np.float32]
    about: Mapping[str, Any]

    @property
    def is_measured(self) -> NDArray[np.bool_]:
        """(m, TILE, TILE): cells that have heights."""
        return np.asarray(self.quantiles[..., 0] != NONE)

    @property
    def node(self) -> float:
        """Spacing of the ground lattice [m]."""
        return self.cell * NODE_CELLS

    def to_local(self, x: Any, y: Any) -> tuple[Array, Array]:
        """World points in the local frame [m]."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        x, y = np.asarray(x, dtype=float) - self.origin[0], np.asarray(y, dtype=float) - self.origin[1]
        return c * x + s * y, c * y - s * x

    def to_world(self, u: Any, v: Any) -> tuple[Array, Array]:
        """Local points in the world [m]."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
        return self.origin[0] + c * u - s * v, self.origin[1] + s * u + c * v

    def ground_height(self, x: Any, y: Any) -> Array:
        """Height of the measured ground in the world [m]; beyond the box that of its border."""
        u, v = self.to_local(x, y)
        return np.asarray(self.origin[2] + lattice_height(self.ground, self.node, u, v))

    def save(self, path: Path) -> None:
        """Write the file in one go; the same grid gives the same bytes."""
        about = np.frombuffer(json.dumps(dict(self.about), sort_keys=True).encode(), np.uint8)
        arrays: dict[str, Any] = {key: np.asarray(getattr(self, name)) for key, (name, _) in STORED.items()}
        with new_file(path) as file:
            np.savez_compressed(file, format=np.array(FORMAT), **arrays, about=about)


def lattice_height(ground: NDArray[Any], node: float, u: Any, v: Any) -> Array:
    """Bilinear height [m] at local points; beyond the lattice that of its border."""
    ny, nx = ground.shape
    fu = np.clip(np.asarray(u, dtype=float) / node, 0.0, nx - 1)
    fv = np.clip(np.asarray(v, dtype=float) / node, 0.0, ny - 1)
    i, j = np.minimum(fu.astype(int), nx - 2), np.minimum(fv.astype(int), ny - 2)
    fu, fv = fu - i, fv - j
    low = ground[j, i] * (1 - fu) + ground[j, i + 1] * fu
    high = ground[j + 1, i] * (1 - fu) + ground[j + 1, i + 1] * fu
    return np.asarray(low * (1 - fv) + high * fv, dtype=np.float64)


def load_height_grid(path: Path) -> HeightGrid:
    """Read a file that `HeightGrid.save` wrote. InputError says what is wrong with another one."""

    def wrong(expected: str) -> InputError:
        return InputError("replay file", None, f"expected {expected}", file=path)

    what = f"a file made by `swath height-map build` ({FORMAT}), this one cannot be read"
    arrays = read_arrays(path, "replay file", what, RATIO)
    with readable("replay file", what, path):
        grid = _grid_of(arrays)
    if (fault := _fault(grid)) is not None:
        raise wrong(fault)
    return grid


def _grid_of(arrays: Mapping[str, NDArray[Any]]) -> HeightGrid:
    """The grid of a file's arrays. KeyError, TypeError or ValueError for others."""
    if str(arrays["format"]) != FORMAT:
        raise ValueError(f"it says {str(arrays['format'])[:40]!r}")

    def take(name: str, kind: Any) -> NDArray[Any]:
        if not np.can_cast(arrays[name].dtype, kind, casting="same_kind"):
            raise TypeError(f"{name} holds {arrays[name].dtype}")
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(arrays[name], kind)

    fields: dict[str, Any] = {name: take(key, kind) for key, (name, kind) in STORED.items()}
    fields |= {name: float(fields[name].item()) for name in ("yaw", "cell")}
    return HeightGrid(**fields, about=dict(json.loads(bytes(take("about", np.uint8)).decode())))


def _fault(g: HeightGrid) -> str | None:
    """What does not fit together, None when all does."""
    m = len(g.quantiles)
    if g.table.ndim != 2 or g.table.size == 0 or g.origin.shape != (3,):
        return "a table of tiles and an origin"
    ty, tx = g.table.shape
    if g.quantiles.shape != (m, TILE, TILE, LEVELS) or m == 0:
        return f"quantiles of shape (m, {TILE}, {TILE}, {LEVELS})"
    if g.thickness.shape != (m, TILE, TILE) or not np.isfinite(g.thickness).all():
        return "a finite thickness in the shape of the cells"
    if g.count.shape != (m, TILE, TILE) or g.intensity.shape != (m, TILE, TILE):
        return "counts and intensities in the shape of the cells"
    if sorted(g.table[g.table >= 0].tolist()) != list(range(m)):
        return "a table that names every tile once"
    if g.ground.shape != (ty * NODES + 1, tx * NODES + 1) or not np.isfinite(g.ground).all():
        return "a finite ground on every node"
    if not (np.isfinite(g.origin).all() and np.isfinite(g.yaw) and 0.005 <= g.cell <= 10.0):
        return "a finite origin and heading and cells of 0.005 to 10 m"
    return None
