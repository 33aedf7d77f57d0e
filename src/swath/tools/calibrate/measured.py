"""Measured heights over known stands, and the spread table that they give.

From a table of beams (CSV or npz), or from a run folder, whose stand and ground its scenario tells.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.crop import Crop
from swath.rays.spread import SpreadTable
from swath.tools.calibrate.fit import FINE, RELATIVE_MAX, HeldOut, judge, table_cells
from swath.tools.calibrate.stand_rays import Place, Returns, StandRays
from swath.tools.distributions import GROUND_BELOW

F64 = NDArray[np.float64]
COLUMNS = ("stems_per_m2", "crop_height_m", "depression_deg", "spot_mm", "height_m")
NODES_MOST = (8, 8, 8, 4)  # nodes of an axis at most; where more values occur they are gathered
FEWEST = 50  # beams that make a cell
EVERY = 5  # each so many-th beam is held out
FROM_EDGE = 1.5  # beams nearer to the edge of the crop are left out [m]
TYPICAL_COSINE, TYPICAL_CORRELATION = 0.66, (0.0, 0.35)  # of the bundled wheat table, where nothing is known


@dataclass(frozen=True)
class Samples:
    """n beams over standing crop: place (n, 4) stems/m2, crop height [m], depression [rad], spot [m];
    height (n,): measured, above the ground [m]"""

    place: F64
    height: F64


def read_samples(path: Path) -> Samples:
    """A CSV with a header row, or an npz, with the columns COLUMNS. InputError says what is missing."""
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as data:
                columns = {
                    k: np.asarray(data[k], dtype=np.float64).ravel() for k in data.files if k in COLUMNS
                }
        else:
            table: Any = np.genfromtxt(path, delimiter=",", names=True, dtype=np.float64, encoding="utf-8")
            columns = {k: np.atleast_1d(table[k]) for k in table.dtype.names or () if k in COLUMNS}
    except (OSError, ValueError, IndexError) as error:
        raise InputError("source", str(path), f"expected a readable table: {error}", file=path) from error
    missing = [k for k in COLUMNS if k not in columns]
    if missing or len({len(c) for c in columns.values()}) != 1:
        raise InputError("source", missing or None, f"expected columns {', '.join(COLUMNS)}", file=path)
    units = np.array([1.0, 1.0, DEG, 1e-3])
    return _usable(np.stack([columns[k] for k in COLUMNS[:4]], axis=1) * units, columns["height_m"], path)


def read_run(folder: Path) -> tuple[Samples, str]:
    """Beams of a recorded run that looked at standing crop well inside its edge, and the name of the crop.

    Ground and stand are those of the run's scenario; the scanner's spot follows from its sheet and the range.
    """
    from swath.runtime.field_setup import build_field
    from swath.scenario.scenario import load_scenario
    from swath.sensing.lidar_sheet import load_lidar
    from swath.tools.height_map.bag import open_bag
    from swath.tools.height_map.source import Wanted

    scenario = load_scenario(str(folder), sets=[], flags={})
    base = scenario.file.parent if scenario.file is not None else folder
    field = build_field(scenario.field, stream=Stream(scenario.seed, "field"), base=base).field
    machine = next(iter(scenario.machines.values()))
    if "lidar" not in machine.slots:
        raise InputError("source", str(folder), "expected a run whose first machine has a lidar")
    beam = load_lidar(machine.slots["lidar"].params.sensor, base).beam
    source = open_bag(folder / "run.mcap", Wanted())
    crop_height = _crop_height(field.stand.crop)
    places, heights = [], []
    for echoes in source.sweeps():
        at, rotation, known = source.track.at(echoes.time)
        point = at + np.einsum("nij,nj->ni", rotation, source.mounting.apply(echoes.points))
        sensor = at + rotation @ source.mounting.position
        keep = known & (field.first_edge.signed_distance(point[:, 0], point[:, 1]) > FROM_EDGE)
        point, sensor = point[keep], sensor[keep]
        if not len(point):
            continue
        x, y = point[:, 0], point[:, 1]
        far = np.linalg.norm(point - sensor, axis=1)
        down = np.arcsin(np.clip((sensor[:, 2] - point[:, 2]) / far, -1.0, 1.0))
        spot = np.mean(beam.diameter(far), axis=-1)
        tall = field.stand.height_factor(x, y) * crop_height
        places.append(np.stack([field.stand.density(x, y), tall, down, spot], axis=1))
        heights.append(point[:, 2] - field.ground_height(x, y))
    if not heights:
        raise InputError("source", str(folder), "expected a run that looked at standing crop")
    return _usable(np.concatenate(places), np.concatenate(heights), folder), field.stand.crop


def fit_samples(
    crop: Crop, samples: Samples, seed: int, *, ground_below: float = GROUND_BELOW
) -> tuple[SpreadTable, list[HeldOut]]:
    """A table from measured beams; every fifth beam is held out and compared, cell by cell.

    Cells without enough beams take over the nearest ones that have. How crop adds up along a beam (the
    silhouette) and how far it leans over an edge are the crop sheet's; correlation and intensity are typical.
    """
    stream = Stream(seed, "measured")
    axes = [_nodes(samples.place[:, k], most) for k, most in enumerate(NODES_MOST)]
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
        seen.append(_returns(relative[mine] * place.height, ground_below) if mine.sum() >= FEWEST else None)
    filled = _filled(places, seen)
    stands = StandRays(crop, stream, tile_count=16)
    silhouette = stands.silhouette(stream, relative_max=RELATIVE_MAX, fine=FINE)
    table = SpreadTable(
        density=axes[0],
        height=axes[1],
        depression=axes[2],
        spot=axes[3],
        **table_cells(places, filled, shape, silhouette[0] / crop.stand.height),
        silhouette=silhouette,
        fine=FINE,
        lean=stands.tips(stream.child("tips")),
        cosine=TYPICAL_COSINE,
        correlation=TYPICAL_CORRELATION,
    )
    judged = []
    for c, place in enumerate(places):
        mine = (cell == c) & ~is_fit
        if seen[c] is not None and mine.sum() >= FEWEST // EVERY:
            returns = _returns(relative[mine] * place.height, ground_below)
            judged.append(HeldOut(place, judge(table, place, returns, stream.child(f"judge{c}"))))
    return table, judged


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


def _nearest(values: F64, nodes: F64) -> NDArray[np.int64]:
    """Index of the node that is nearest in the logarithm."""
    middle = 0.5 * (np.log(nodes[1:]) + np.log(nodes[:-1]))
    return np.searchsorted(middle, np.log(values)).astype(np.int64)


def _returns(height: F64, ground_below: float) -> Returns:
    line = height[None]
    return Returns(line, line < ground_below, np.zeros_like(line), np.full_like(line, np.nan))


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


def _crop_height(name: str) -> Any:
    from swath.field.crop import load_crop

    return load_crop(name).stand.height
