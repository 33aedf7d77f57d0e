"""The spread table fitted to measured heights over known stands: a table of beams (CSV)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG
from swath.documents.number_table import read_numbers
from swath.field.crop import Crop
from swath.rays.spread import SpreadTable
from swath.signals import F64, I64
from swath.tools.calibrate.fit import RELATIVE_MAX, Design, Designs, Fitting, HeldOut, Progress, compare_place
from swath.tools.calibrate.stand_scans import EchoSettings, Place, Returns, SampleStands
from swath.tools.distributions import GROUND_BELOW

COLUMNS = ("stems_per_m2", "crop_height_m", "depression_deg", "spot_mm", "height_m")
NODES_MOST = (8, 8, 8, 4)  # nodes of an axis at most; where more values occur they are gathered
FEWEST = 50  # beams that make a cell
EVERY = 5  # each so many-th beam is held out
TYPICAL: dict[str, Any] = {"cosine": 0.66, "correlation": (0.0, 0.35)}
"""Of the bundled wheat table, where nothing is known."""


@dataclass(frozen=True)
class Samples:
    """n beams over standing crop: place (n, 4) stems/m2, crop height [m], depression [rad], spot [m];
    height (n,): measured, above the ground [m].
    """

    place: F64
    height: F64


def read_samples(path: Path) -> Samples:
    """A CSV with a header row and the columns COLUMNS. InputError says what is missing."""
    columns = read_numbers(path, COLUMNS)
    units = np.array([1.0, 1.0, DEG, 1e-3])
    return _usable(np.stack([columns[k] for k in COLUMNS[:4]], axis=1) * units, columns["height_m"], path)


def fit_samples(
    crop: Crop,
    samples: Samples,
    design: Design,
    echo: EchoSettings,
    seed: int,
    *,
    progress: Progress | None = None,
) -> tuple[SpreadTable, list[HeldOut]]:
    """A table from measured beams; every fifth beam is held out and compared, cell by cell.

    Cells without enough beams take over the nearest ones that have. How crop adds up along a beam (the
    silhouette) and how far it leans over an edge are the crop sheet's; correlation and intensity are typical.
    The grid of stubble is that of the level `plants` under an echo rule, over the places of a design.
    """
    stream = Stream(seed, "measured")
    axes = tuple(_nodes(samples.place[:, k], most) for k, most in enumerate(NODES_MOST))
    index = np.stack([_nearest(samples.place[:, k], axis) for k, axis in enumerate(axes)], axis=1)
    shape = tuple(len(a) for a in axes)
    cell = np.ravel_multi_index(tuple(index.T), shape)
    is_fit = np.arange(len(cell)) % EVERY != EVERY - 1
    places = [Place(*(float(a[i]) for a, i in zip(axes, np.unravel_index(c, shape), strict=True)))
              for c in range(int(np.prod(shape)))]  # fmt: skip
    relative = samples.height / samples.place[:, 1]
    seen: list[Returns | None] = []
    for c, place in enumerate(places):
        mine = (cell == c) & is_fit
        seen.append(_returns(relative[mine] * place.height) if mine.sum() >= FEWEST else None)
    filled = _filled(places, seen)
    stands = SampleStands(crop, stream, tile_count=16)
    fitting = Fitting.of(stands, Designs(design, design), echo, stream, progress)
    table = fitting.table(fitting.grid(axes, places, filled), **TYPICAL)
    held_out = []
    for c, place in enumerate(places):
        mine = (cell == c) & ~is_fit
        if seen[c] is not None and mine.sum() >= FEWEST // EVERY:
            returns = _returns(relative[mine] * place.height)
            found = compare_place(table.standing, place, returns, stream.child(f"judge{c}"))
            held_out.append(HeldOut(place, found))
    return table, held_out


def _usable(place: F64, height: F64, path: Path) -> Samples:
    ok = np.isfinite(place).all(axis=1) & np.isfinite(height) & (place > 0.0).all(axis=1)
    ok &= (place[:, 2] < 89.0 * DEG) & (height > -1.0) & (height < RELATIVE_MAX * place[:, 1])
    if int(ok.sum()) < FEWEST:
        raise InputError(
            "source", str(path), f"expected at least {FEWEST} usable beams, found {int(ok.sum())}"
        )
    return Samples(place[ok], height[ok])


def _nodes(values: F64, most: int) -> F64:
    """Nodes of an axis: the values that occur, or the medians of equally filled parts when they are many."""
    found = np.unique(np.round(values, 6))
    if len(found) <= most:
        return found
    parts = np.array_split(np.sort(values), most)
    return np.unique([float(np.median(p)) for p in parts])


def _nearest(values: F64, nodes: F64) -> I64:
    """Index of the node that is nearest in the logarithm."""
    middle = 0.5 * (np.log(nodes[1:]) + np.log(nodes[:-1]))
    return np.searchsorted(middle, np.log(values)).astype(np.int64)


def _returns(height: F64) -> Returns:
    line = height[None]
    return Returns(line, line < GROUND_BELOW, np.zeros_like(line), np.full_like(line, np.nan))


def _filled(places: list[Place], seen: list[Returns | None]) -> list[Returns]:
    """Empty cells filled from the nearest cell with beams, heights scaled with the crop."""
    at = np.log([[p.density, p.height, np.tan(p.depression), p.spot] for p in places])
    full = np.array([k for k, s in enumerate(seen) if s is not None])
    if not len(full):
        raise InputError(
            "source", None, f"expected {FEWEST} beams of the same stand, angle and spot somewhere"
        )
    result = []
    for k, place in enumerate(places):
        near = int(full[np.argmin(np.sum((at[full] - at[k]) ** 2, axis=1))])
        taken = seen[near]
        assert taken is not None
        scale = place.height / places[near].height
        result.append(Returns(taken.height * scale, taken.is_ground, taken.gap, taken.albedo))
    return result
