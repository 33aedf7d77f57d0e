"""The builder: poses give the ground and the frame of the grid, echoes give the heights in its cells."""

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, check_within
from swath.core.number_text import num
from swath.rays.height_grid import LIMIT_M, NODE_CELLS, NONE, TILE, HeightGrid, lattice_height
from swath.signals import F32, F64, U16
from swath.tools.height_map.bag import open_bag
from swath.tools.height_map.gather import BLOCK, Gatherer, Samples, pool
from swath.tools.height_map.ground import Params as GroundParams
from swath.tools.height_map.ground import around, ground_of_poses, low_echoes
from swath.tools.height_map.passing import Passing
from swath.tools.height_map.place import Frame, batches, left_above, placed
from swath.tools.height_map.source import Echoes, Source, Wanted, open_csv, open_npz

TIMES_MAX = 1 << 25  # numbers that are held of how often beams passed
COUNTED = (
    "scans",
    "echoes",
    "beams_without_echo",
    "echoes_without_pose",
    "echoes_too_far",
    "echoes_below_ground",
    "echoes_too_high",
)
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Settings:
    """cell_m: side of a cell; along_m, across_m: heights within this window share a distribution.

    fill_m: a cell counts as measured when there is an echo this near

    per_cell: heights that are kept of one cell
    reach_m: echoes further from the way are left out
    ground: where the wheels stood (`pose`), or that corrected by the lowest `echoes`
    seed: of the choice
    passing: correct for the beams that went through a cell without an echo
    grounds: what counts as ground
    """

    cell_m: float = 0.05
    along_m: float = 1.0
    across_m: float = 0.05
    fill_m: float = 0.1
    per_cell: int = 32
    reach_m: float = 30.0
    ground: Literal["pose", "echoes"] = "pose"
    passing: bool = True
    seed: int = 1
    grounds: GroundParams = field(default_factory=GroundParams)

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        limits = {
            "cell_m": (0.01, 5.0),
            "along_m": (0.0, 20.0),
            "across_m": (0.0, 20.0),
            "fill_m": (0.0, 5.0),
            "reach_m": (1.0, 200.0),
        }
        for key, (low, high) in limits.items():
            check_within("--" + key.replace("_", "-"), getattr(self, key), low, high)
        if not 1 <= self.per_cell <= 1024:
            raise InputError("--per-cell", self.per_cell, "expected 1 to 1024")


def open_source(path: Path, wanted: Wanted, poses: Path | None = None) -> Source:
    """A source by its kind: .npz, .csv, or a recording. poses: a .csv of poses for the first two."""
    if not os.path.exists(path):
        raise InputError("source", str(path), "expected a run folder, .mcap, .bag, .npz or .csv")
    if path.suffix == ".npz":
        return open_npz(path, wanted, poses)
    if path.suffix == ".csv":
        return open_csv(path, wanted, poses)
    return open_bag(path, wanted)


def build_height_map(
    source: Source, settings: Settings = Settings(), progress: Progress = lambda share: None
) -> HeightGrid:
    """The grid of a source. progress is called with the share that is done of a pass, 0 to 1.

    Raises InputError when nothing usable was measured.
    """
    frame = Frame(source.track, settings.cell_m, settings.reach_m)
    lattice = frame.lay(lambda x, y: ground_of_poses(source.track, x, y, settings.grounds))
    samples, counts = _gather(source, settings, frame, lattice, progress)
    if settings.ground == "echoes":
        lattice, samples = _corrected(lattice, samples, settings.grounds)
    else:
        _check_ground(counts["notes"], lattice, samples, settings.grounds)
    pools = _cells(source, samples, settings, frame, lattice, progress)
    stacks = pools.stacked()
    about = {
        "source": source.name,
        "driven_m": round(source.track.length, 3),
        **counts,
        "measured_cells": int(np.count_nonzero(stacks["quantiles"][..., 0] != NONE)),
        "settings": asdict(settings),
    }
    return HeightGrid(
        origin=np.array([*frame.origin, frame.z0]),
        yaw=frame.yaw,
        cell=settings.cell_m,
        table=pools.table,
        ground=lattice.astype(np.float32),
        about=about,
        **stacks,
    )


def _gather(
    source: Source, settings: Settings, frame: Frame, lattice: F64, progress: Progress
) -> tuple[Samples, dict[str, Any]]:
    """The heights in the cells, and what was counted."""
    gatherer = Gatherer(frame.width, settings.per_cell, settings.seed)
    counts = dict.fromkeys(COUNTED, 0)
    for echoes in batches(source):
        here = placed(source, echoes, frame, lattice)
        cell = np.floor(here.points[:, :2] / frame.cell).astype(np.int64)
        inside = ((cell >= 0) & (cell < (frame.width, frame.length))).all(axis=1)
        is_low, is_high = here.height < settings.grounds.lowest_m, here.height > LIMIT_M
        good = inside & ~is_low & ~is_high
        counts["scans"] += echoes.scan_count
        counts["beams_without_echo"] += echoes.silent_count
        counts["echoes_without_pose"] += here.unknown_count
        counts["echoes_too_far"] += int(np.count_nonzero(~inside))
        counts["echoes_below_ground"] += int(np.count_nonzero(inside & is_low))
        counts["echoes_too_high"] += int(np.count_nonzero(inside & is_high))
        gatherer.add(cell[good, 0], cell[good, 1], here.height[good] * 1e3, here.intensity[good])
        _tell(progress, echoes, source)
    counts["echoes"] = gatherer.echo_count
    if gatherer.echo_count == 0:
        what = ", ".join(f"{k.replace('_', ' ')} {n}" for k, n in counts.items() if n) or "no scan"
        expected = "; ".join((f"expected echoes near the path; found {what}", *source.notes))
        raise InputError("source", source.name, expected)
    return gatherer.finish(), {**counts, "notes": dict(source.notes)}


def _check_ground(notes: dict[str, int], lattice: F64, samples: Samples, by: GroundParams) -> None:
    """Notes where echoes lie below what the wheels stood on: no crop is there."""
    low = float(np.median(low_echoes(samples, lattice.shape, NODE_CELLS, by)))
    if low < -by.below_m:
        where = f"the lowest echoes lie {num(-low)} m below the ground that the poses give"
        notes[f"{where}: poses above the ground, or --mount; --ground echoes takes theirs"] = 1


def _tell(progress: Progress, echoes: Echoes, source: Source) -> None:
    if len(echoes.time):
        begin, span = source.track.time[0], max(float(np.ptp(source.track.time)), 1e-9)
        progress(float(np.clip((np.nanmax(echoes.time) - begin) / span, 0.0, 1.0)))


def _corrected(lattice: F64, samples: Samples, by: GroundParams) -> tuple[F64, Samples]:
    """The ground moved to the lowest echoes, heights counted from there."""
    shift = low_echoes(samples, lattice.shape, NODE_CELLS, by)
    r, c = np.divmod(samples.key, samples.width)
    moved = samples.height - 1e3 * lattice_height(shift, float(NODE_CELLS), c + 0.5, r + 0.5)
    height = np.clip(np.round(moved), -32000, 32000).astype(np.int16)
    order = np.lexsort((height, samples.key))
    changed = Samples(
        samples.width, samples.key[order], height[order], samples.cells, samples.counts, samples.intensity
    )
    return lattice + shift, changed


class _Pools:
    """Tiles as they are finished."""

    def __init__(self, tiles: tuple[int, int]) -> None:
        self.table = np.full(tiles, -1, np.int32)
        self._tiles: list[list[NDArray[Any]]] = []

    def add(self, samples: Samples, row: int, column: int, *found: NDArray[Any]) -> None:
        """The tiles of a block whose first is (row, column). found: its heights and thickness."""
        block = (*found, *_own(samples, column * TILE, row * TILE))
        for k in range(min(BLOCK // TILE, self.table.shape[1] - column)):
            tile = [values[:, k * TILE : (k + 1) * TILE] for values in block]
            if (tile[0][..., 0] != NONE).any():
                self.table[row, column + k] = len(self._tiles)
                self._tiles.append(tile)

    def stacked(self) -> dict[str, NDArray[Any]]:
        """All tiles by what a grid calls it."""
        stacks = map(np.stack, zip(*self._tiles, strict=True))
        return dict(zip(("quantiles", "thickness", "count", "intensity"), stacks, strict=True))


def _cells(
    source: Source, samples: Samples, settings: Settings, frame: Frame, lattice: F64, progress: Progress
) -> _Pools:
    """Distributions of all cells, some columns at a time; each time the source is read again."""
    along, across = (_half(m, settings.cell_m) for m in (settings.along_m, settings.across_m))
    fill = max(int(np.ceil(settings.fill_m / settings.cell_m - 1e-9)), 1)
    pools = _Pools(frame.tiles)
    rows, columns = np.divmod(samples.cells, samples.width)
    low, high = int(rows.min()) - fill, int(rows.max()) + fill + 1
    top = float(samples.height.max()) * 1e-3
    layers = Passing(0, 0, 0, 0, top).times.shape[2]
    wide = max(TIMES_MAX // ((high - low) * layers * BLOCK), 1) * BLOCK
    for first in range(0, frame.width, wide):
        if not ((columns >= first - fill) & (columns < first + wide + fill)).any():
            continue
        passing = None
        if settings.passing and not source.frame_is_world:
            margin = max(along, fill)
            passing = Passing(first - margin, wide + 2 * margin, low, high - low, top)
            for echoes in batches(source):
                passing.add(placed(source, echoes, frame, lattice), frame, lattice)
                passing.add(left_above(source, echoes, frame, lattice, top), frame, lattice)
                _tell(progress, echoes, source)
        for row in range(max(low // TILE, 0), min((high - 1) // TILE + 1, frame.tiles[0])):
            for column in range(first, min(first + wide, frame.width), BLOCK):
                window = {"along": along, "across": across, "fill": fill}
                found = pool(samples, column, row * TILE, passing=passing, **window)
                pools.add(samples, row, column // TILE, *found)
    return pools


def _half(length: float, cell: float) -> int:
    """Cells on each side of the middle one in a window of a length."""
    return max(round(0.5 * (length / cell - 1.0) - 1e-9), 0)


def _own(samples: Samples, column: int, row: int) -> tuple[U16, F32]:
    """Echoes in the cells of a block, and their mean intensity, lent to neighbours without."""
    count = np.zeros((TILE + 2, BLOCK + 2), np.uint16)
    light = np.full((TILE + 2, BLOCK + 2), np.nan, np.float32)
    low, high = np.searchsorted(samples.cells, [(row - 1) * samples.width, (row + TILE + 1) * samples.width])
    r, c = np.divmod(samples.cells[low:high], samples.width)
    near = (c >= column - 1) & (c <= column + BLOCK)
    at = r[near] - row + 1, c[near] - column + 1
    count[at] = np.minimum(samples.counts[low:high][near], 65535)
    light[at] = samples.intensity[low:high][near]
    mean = around(light.astype(np.float64))
    light = np.where(np.isnan(light), mean, light).astype(np.float32)
    return count[1:-1, 1:-1], light[1:-1, 1:-1]
