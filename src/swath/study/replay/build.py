"""The builder: poses give the ground and the frame of the grid, echoes give the heights in its cells."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.rays.height_grid import LIMIT_M, NODE_CELLS, NODES, NONE, TILE, HeightGrid, lattice_height
from swath.study.replay import ground
from swath.study.replay.bag import open_bag
from swath.study.replay.gather import BLOCK, Gatherer, Samples, pool
from swath.study.replay.source import Source, Wanted
from swath.study.replay.tables import open_csv, open_npz

Array = NDArray[np.float64]
LOWEST_M = -1.0  # an echo further below the ground is none
TILES_MAX = 1 << 22
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Settings:
    """cell_m: side of a cell; along_m, across_m: heights within this window share a distribution

    per_cell: heights that are kept of one cell; reach_m: echoes further from the way are left out
    ground: where the wheels stood (`pose`), or that corrected by the lowest `echoes`; seed: of the choice
    """

    cell_m: float = 0.1
    along_m: float = 0.9
    across_m: float = 0.1
    per_cell: int = 32
    reach_m: float = 30.0
    ground: Literal["pose", "echoes"] = "pose"
    seed: int = 1

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        limits = {
            "cell_m": (0.01, 5.0),
            "along_m": (0.0, 20.0),
            "across_m": (0.0, 20.0),
            "reach_m": (1.0, 200.0),
        }
        for key, (low, high) in limits.items():
            if not low <= getattr(self, key) <= high:
                option = "--" + key.replace("_", "-")
                raise InputError(option, getattr(self, key), f"expected {low:g} to {high:g}")
        if not 1 <= self.per_cell <= 1024:
            raise InputError("--per-cell", self.per_cell, "expected 1 to 1024")


def open_source(path: Path, wanted: Wanted, poses: Path | None = None) -> Source:
    """A source by its kind: .npz, .csv, or a recording. poses: a .csv of poses for the first two."""
    if not path.exists():
        raise InputError("source", str(path), "expected a run folder, .mcap, .bag, .npz or .csv")
    if path.suffix == ".npz":
        return open_npz(path, wanted, poses)
    if path.suffix == ".csv":
        return open_csv(path, wanted, poses)
    return open_bag(path, wanted)


def build_replay(
    source: Source, settings: Settings = Settings(), progress: Progress | None = None
) -> HeightGrid:
    """The grid of a source. progress is called with the share that is done, 0 to 1.

    Raises InputError when nothing usable was measured.
    """
    frame = _Frame(source, settings)
    base = ground.ground_of_poses(source.track, *frame.nodes())
    z0 = float(np.floor(base.min()))
    lattice = base - z0
    samples, counts = _gather(source, settings, frame, lattice, z0, progress)
    if settings.ground == "echoes":
        lattice, samples = _corrected(lattice, samples)
    table, (quantiles, count, intensity) = _cells(samples, settings, frame)
    about = {
        "source": source.name,
        "driven_m": round(source.track.length, 3),
        **counts,
        "measured_cells": int(np.count_nonzero(quantiles[..., 0] != NONE)),
        "settings": {k: getattr(settings, k) for k in settings.__dataclass_fields__},
    }
    return HeightGrid(
        origin=np.array([*frame.origin, z0]),
        yaw=frame.yaw,
        cell=settings.cell_m,
        table=table,
        quantiles=quantiles,
        count=count,
        intensity=intensity,
        ground=lattice.astype(np.float32),
        about=about,
    )


class _Frame:
    """Local frame of the grid: x along the way, corner below everything within reach. tiles: (ty, tx)"""

    def __init__(self, source: Source, settings: Settings) -> None:
        self.yaw, self.cell = source.track.heading, settings.cell_m
        self._c, self._s = np.cos(self.yaw), np.sin(self.yaw)
        path = source.track.position[:, :2] @ np.array([[self._c, -self._s], [self._s, self._c]])
        side = TILE * self.cell
        low = path.min(axis=0) - settings.reach_m
        self.tiles = tuple(int(n) for n in np.ceil((np.ptp(path, axis=0) + 2 * settings.reach_m) / side))[
            ::-1
        ]
        if self.tiles[0] * self.tiles[1] > TILES_MAX:
            raise InputError("poses", None, "expected a way within one region, or larger cells (--cell-m)")
        self.origin = np.array([self._c * low[0] - self._s * low[1], self._s * low[0] + self._c * low[1]])
        self.width, self.length = self.tiles[1] * TILE, self.tiles[0] * TILE

    def to_local(self, x: Array, y: Array) -> tuple[Array, Array]:
        x, y = x - self.origin[0], y - self.origin[1]
        return self._c * x + self._s * y, self._c * y - self._s * x

    def nodes(self) -> tuple[Array, Array]:
        """World x, y of the lattice nodes."""
        node = self.cell * NODE_CELLS
        u, v = np.meshgrid(
            np.arange(self.tiles[1] * NODES + 1) * node, np.arange(self.tiles[0] * NODES + 1) * node
        )
        return self.origin[0] + self._c * u - self._s * v, self.origin[1] + self._s * u + self._c * v


def _gather(
    source: Source, settings: Settings, frame: _Frame, lattice: Array, z0: float, progress: Progress | None
) -> tuple[Samples, dict[str, Any]]:
    gatherer = Gatherer(frame.width, settings.per_cell, settings.seed)
    begin, span = source.track.time[0], max(np.ptp(source.track.time), 1e-9)
    sweeps = silent = unplaced = 0
    left = {"far": 0, "below": 0, "high": 0}
    for echoes in source.sweeps():
        sweeps += echoes.scan_count
        silent += echoes.silent_count
        place, rotation, known = source.track.at(echoes.time)
        points = echoes.points
        if not source.frame_is_world:
            points = place + np.einsum("nij,nj->ni", rotation, source.mounting.apply(points))
        else:
            known = np.ones(len(points), bool)
        unplaced += int(np.count_nonzero(~known))
        u, v = frame.to_local(points[:, 0], points[:, 1])
        height = points[:, 2] - z0 - lattice_height(lattice, frame.cell * NODE_CELLS, u, v)
        column, row = np.floor(u / frame.cell).astype(np.int64), np.floor(v / frame.cell).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < frame.width) & (row < frame.length)
        good = known & inside & (height >= LOWEST_M) & (height <= LIMIT_M)
        left["far"] += int(np.count_nonzero(known & ~inside))
        left["below"] += int(np.count_nonzero(known & inside & (height < LOWEST_M)))
        left["high"] += int(np.count_nonzero(known & inside & (height > LIMIT_M)))
        gatherer.add(column[good], row[good], height[good] * 1e3, echoes.intensity[good])
        if progress is not None and len(echoes.time):
            progress(float(np.clip((echoes.time[-1] - begin) / span, 0.0, 1.0)))
    if gatherer.echo_count == 0:
        what = f"{sweeps} scans, {silent} beams without echo, {unplaced} echoes outside the poses' times"
        raise InputError("source", source.name, f"expected echoes near the way; found {what}")
    counts = {
        "scans": sweeps,
        "echoes": gatherer.echo_count,
        "beams_without_echo": silent,
        "echoes_without_pose": unplaced,
        "echoes_too_far": left["far"],
        "echoes_below_ground": left["below"],
        "echoes_too_high": left["high"],
        "notes": dict(source.notes),
    }
    return gatherer.finish(), counts


def _corrected(lattice: Array, samples: Samples) -> tuple[Array, Samples]:
    """The ground moved to the lowest echoes, heights counted from there."""
    shape = (lattice.shape[0], lattice.shape[1])
    shift = ground.low_echoes(samples, shape, NODE_CELLS)
    r, c = np.divmod(samples.key, samples.width)
    moved = samples.height - 1e3 * lattice_height(shift, float(NODE_CELLS), c + 0.5, r + 0.5)
    height = np.clip(np.round(moved), -32000, 32000).astype(np.int16)
    order = np.lexsort((height, samples.key))
    changed = Samples(
        samples.width, samples.key[order], height[order], samples.cells, samples.counts, samples.intensity
    )
    return lattice + shift, changed


def _cells(samples: Samples, settings: Settings, frame: _Frame) -> tuple[NDArray[np.int32], tuple[Any, ...]]:
    """The table of tiles and their pools: quantiles, counts, intensities."""
    along = round(0.5 * (settings.along_m / settings.cell_m - 1.0) - 1e-9) if settings.along_m > 0 else 0
    across = round(0.5 * (settings.across_m / settings.cell_m - 1.0) - 1e-9) if settings.across_m > 0 else 0
    along, across = max(along, 0), max(across, 0)
    table = np.full(frame.tiles, -1, np.int32)
    quantiles: list[NDArray[np.int16]] = []
    counts: list[NDArray[np.uint16]] = []
    bright: list[NDArray[np.float32]] = []
    for ty in range(frame.tiles[0]):
        low, high = np.searchsorted(
            samples.cells, [(ty * TILE - 1) * samples.width, ((ty + 1) * TILE + 1) * samples.width]
        )
        if low == high:
            continue
        columns = samples.cells[low:high] % samples.width
        for first in range(0, frame.width, BLOCK):
            if not ((columns >= first - 1) & (columns <= first + BLOCK)).any():
                continue
            block = pool(samples, first, ty * TILE, along=along, across=across)
            count, light = _own(samples, first, ty * TILE)
            for k in range(min(BLOCK, frame.width - first) // TILE):
                part = np.s_[:, k * TILE : (k + 1) * TILE]
                if (block[part][..., 0] != NONE).any():
                    table[ty, first // TILE + k] = len(quantiles)
                    quantiles.append(block[part])
                    counts.append(count[part])
                    bright.append(light[part])
    return table, (np.stack(quantiles), np.stack(counts), np.stack(bright))


def _own(samples: Samples, column: int, row: int) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Echoes in the cells of a block, and their mean intensity, lent to neighbours without."""
    count = np.zeros((TILE + 2, BLOCK + 2), np.uint16)
    light = np.full((TILE + 2, BLOCK + 2), np.nan, np.float32)
    low, high = np.searchsorted(samples.cells, [(row - 1) * samples.width, (row + TILE + 1) * samples.width])
    r, c = np.divmod(samples.cells[low:high], samples.width)
    near = (c >= column - 1) & (c <= column + BLOCK)
    at = r[near] - row + 1, c[near] - column + 1
    count[at] = np.minimum(samples.counts[low:high][near], 65535)
    light[at] = samples.intensity[low:high][near]
    mean = ground.around(light.astype(np.float64))
    light = np.where(np.isnan(light), mean, light).astype(np.float32)
    return count[1:-1, 1:-1], light[1:-1, 1:-1]
