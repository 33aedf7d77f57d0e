"""A data set of labelled scans: what a detector is given in the loop, and the truth beside it, as parquet.

A drive is a function of the settings and its number, and has a file of its own, a row a scan: what the
scanner sent, what each echo is of (`sensing/labels.py`), where the machine stood, what odometry and inertial
units said, and where the edge lay at places ahead of the knife. The scenario's own parts drive. A drive whose
file is there is not driven again.
"""

import io
import json
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError, SwathError
from swath.core.files.place import own_folder
from swath.core.files.whole_file import write_whole
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.documents.packed import open_parquet
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.runtime.assembly import assemble
from swath.runtime.loop import ticks
from swath.runtime.workers import Lost, in_workers
from swath.runtime.world import World
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.sensing.edge.truth import Params as EdgeParams
from swath.sensing.edge.truth import TruthEdge
from swath.sensing.labels import Label
from swath.sensing.lidar.replay import ReplayLidar
from swath.sensing.scanner import OutdoorParams, ScanningLidar
from swath.signals import F64, MachineState, Scan
from swath.signals.flat import POSE, flat_fields, is_bulky, pose_number, read
from swath.tools.dataset.dataset import (
    CROPS,
    VARIED,
    View,
    check_same,
    eye_of,
    lay_straw,
    left_of,
    scene_of,
    things_of_view,
)
from swath.tools.scan.scan import scanning_machine

FORMAT = "swath scans 1"  # metadata `format`
APART, AHEAD, ASIDE = (
    15.0,
    25.0,
    1.5,
)  # of looks for things; how far they reach; of a thing from the header [m]
HALF_VIEW = 1.0  # of a look for things [rad]
SPREAD = -0.3, 0.7  # of the overlap that a drive is steered with, at most [m]
TOLD = "odometry", "imu", "ground_speed"  # kinds of slots whose numbers a row has


@dataclass(frozen=True)
class Settings:
    """scenario: bundled name or path; sets: its changes; machine, lidar: whose scans.

    varies: of `terrain`, `stand`, `dust`, `things`, `overlap`
    places: where the true edge is told, ahead of the knife [m]
    count, seed: of all drives
    """

    scenario: str
    sets: tuple[str, ...]
    machine: str
    lidar: str
    varies: tuple[str, ...]
    places: tuple[float, ...]
    count: int
    seed: int


def settings_of(
    scenario: str,
    *,
    count: int,
    seed: int = 1,
    sets: tuple[str, ...] = (),
    places: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0),
) -> Settings:
    """What a data set is made of: the first scanner of the first machine that has one.

    InputError for a scenario without one that is simulated.
    """
    if count < 1:
        raise InputError("--count", count, "expected >= 1")
    if not places or not all(isfinite(x) and 0.0 < x <= 40.0 for x in places):
        raise InputError("--places-m", list(places), "expected some of 0 to 40 m ahead of the knife")
    made = load_scenario(scenario, sets=list(sets))
    machine, lidar = scanning_machine(made)
    slots, own = made.machines[machine].slots, made.machines[machine].slots[lidar]
    scanner = own.found.component
    if not (isinstance(scanner, type) and issubclass(scanner, ScanningLidar)):
        raise InputError(f"{machine}.{lidar}.level", own.level, "expected a scanner that is simulated")
    varies = [part for part, of in VARIED.items() if getattr(getattr(made.field, part), "level", "") in of]
    if "stand" in varies and getattr(getattr(made.field.stand, "params", None), "crop", "") not in CROPS:
        varies.remove("stand")  # a row crop stays one
    if issubclass(scanner, ReplayLidar):
        varies = []  # heights that were measured stay as they are
    is_plain = own.level == "profile"  # a level that refuses whatever is not in its profile
    if isinstance(own.params, OutdoorParams) and not is_plain:
        varies.append("dust")
    if not is_plain and not made.field.obstacles:
        varies.append("things")
    if "steer" in slots and hasattr(slots["steer"].params, "overlap_m"):
        varies.append("overlap")
    return Settings(scenario, sets, machine, lidar, tuple(varies), places, count, seed)


def drawn_of(settings: Settings, drive: int) -> list[str]:
    """What was drawn of the scenario of a drive, where the user's changes do not say it."""
    s = settings
    own = [*scene_of(s.seed, drive, s.machine, s.lidar, varies=s.varies).sets]
    if "overlap" in s.varies:
        low, high = SPREAD
        drawn = Stream(s.seed, "dataset.overlap").at(drive).uniform(low, high)
        own.append(f"{s.machine}.steer.overlap_m={drawn:.3f}")
    return left_of(own, s.sets)


def rows_of(settings: Settings, drive: int, about: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The rows of a drive, a scan each. about: gets what all of them share."""
    s, drawn = settings, drawn_of(settings, drive)
    scenario = load_scenario(s.scenario, sets=layered(drawn, s.sets))
    with closing(assemble(scenario)) as world:
        machine = world.machines[s.machine]
        lidar, knife = machine.parts[s.lidar], machine.sheet.knife_x
        places = knife + np.array(s.places)
        truth = TruthEdge(EdgeParams(reference_x_m=float(places.max())), lidar.setup)
        told = [slot for slot, choice in machine.slots.items() if choice.kind.name in TOLD]
        about |= {
            "drive": drive,
            "seed": scenario.seed,
            "sets": drawn,
            "level": machine.slots[s.lidar].level,
            "labels": [label.name.lower() for label in Label],
            "azimuth_rad": lidar.azimuth.tolist(),
            "elevation_rad": lidar.elevation.tolist(),
            "beam_t_s": lidar.scanner.beam_t.tolist(),
            "echo_count": lidar.scanner.echo_count,
            "mount": {k: pose_number(lidar.mounting, k) for k in POSE},
            "edge_side": machine.section.common.edge_side,
            "header_end_m": [*machine.sheet.header_end(lidar.setup.edge_side)],
            "edge_x_m": places.tolist(),
        }
        last: Any = None
        for k, _ in enumerate(ticks(world)):
            if k == 0:
                dress(settings, drive, lidar)
            scan = world.graph.latest(f"{s.machine}.{s.lidar}", "scan")
            state = world.graph.latest(f"{s.machine}.motion", "state")
            if isinstance(scan, Scan) and isinstance(state, MachineState) and scan.t > 0 and scan is not last:
                held = last if machine.slots[s.lidar].common.fault is not None else None
                is_held = held is not None and np.array_equal(scan.ranges, held.ranges, equal_nan=True)
                is_known, last = scan.t == state.t and not is_held, scan
                numbers = {n: v for slot in told for n, v in _numbers(world, s.machine, slot).items()}
                yield {**_row(scan, state, lidar, is_known), "edge_m": _edge(truth, state, places), **numbers}


def dress(settings: Settings, drive: int, lidar: ScanningLidar) -> None:
    """Lay straw and set things beside the way of a drive that is about to begin."""
    s, setup = settings, lidar.setup
    scene = scene_of(s.seed, drive, s.machine, s.lidar, varies=s.varies)
    if scene.straw and "stand" in s.varies and "things" in s.varies:
        lay_straw(setup)
    if "things" not in s.varies or setup.edge is None:
        return
    found: list[SheetObstacle] = []
    _, way = setup.edge.project(*setup.start.position[:2])
    half = 0.5 * setup.machine.header_width + ASIDE
    for k, along in enumerate(np.arange(0.0, setup.edge.length, APART).tolist()):
        eye = eye_of(setup, View(along, 0.0, Pose.identity()))
        for thing in things_of_view(s.seed, 1000 * drive + k, eye, HALF_VIEW, AHEAD):
            _, aside = setup.edge.project(thing.x_m, thing.y_m)
            if abs(float(aside) - float(way)) > half:
                found.append(thing)
    setup.bodies.set_things(things_of(tuple(found), setup.field))


def _row(scan: Scan, state: MachineState, lidar: ScanningLidar, is_known: bool) -> dict[str, Any]:
    """What was sent and what it was of, unless it was not the newest sweep."""
    heard = np.isfinite(scan.ranges)
    label = lidar.labels() if is_known else np.full(heard.shape, Label.UNKNOWN)
    points = lidar.mounting.apply(scan.points().reshape(-1, 3))
    return {
        "t_s": state.t / NS,
        "scan_t_s": scan.t / NS,
        **{f"pose.{name}": pose_number(state.pose, name) for name in POSE},
        "ranges_m": scan.ranges.ravel(),
        "intensity": scan.intensity.ravel(),
        "label": np.where(heard, label, Label.NONE).astype(np.uint8).ravel(),
        "points_m": points.astype(np.float32).ravel(),
    }


def _numbers(world: World, machine: str, slot: str) -> dict[str, float]:
    """The plain numbers that a slot sent last, in SI."""
    found: dict[str, float] = {}
    for port in world.machines[machine].parts[slot].outputs:
        sample = world.graph.latest(f"{machine}.{slot}", port.name)
        if sample is not None and not is_bulky(type(sample)):
            plain = [n for n, field in flat_fields(type(sample)).items() if field.kind != "array"]
            found |= {f"{slot}.{name}": float(read(sample, name)) for name in plain}
    return found


def _edge(truth: TruthEdge, state: MachineState, places: F64) -> F64:
    """How far left of the machine's axis the true edge lies at places ahead [m], nan = none there."""
    x, y = truth.follow(state)
    if len(x) < 2:
        return np.full(len(places), np.nan)
    return np.interp(places, x, y, left=np.nan, right=np.nan)


def file_of(out: Path, drive: int) -> Path:
    """The file of a drive."""
    return out / f"drive-{drive + 1:06d}.parquet"


def write_drive(settings: Settings, out: Path, drive: int) -> "int | str":
    """Drive and write; what was wrong."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    about: dict[str, Any] = {"format": FORMAT}
    try:
        rows = list(rows_of(settings, drive, about))
    except SwathError as error:
        return str(error)
    if not rows:
        return "it ended before the first scan"
    table = pa.table({name: [row[name] for row in rows] for name in rows[0]})
    table = table.replace_schema_metadata({"swath": json.dumps(about)})
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd", use_dictionary=False)
    write_whole(file_of(out, drive), file.getvalue())
    return drive


def is_there(out: Path, drive: int) -> bool:
    """Whether the file of a drive is there, and whole; else it is made again."""
    what = "a drive of swath dataset --scans"
    try:
        with open_parquet(file_of(out, drive), "drive", what) as file:
            return bool(json.loads(file.schema_arrow.metadata[b"swath"])["drive"] == drive)
    except Exception:  # what is in damaged files may raise anything
        return False


def make_scans(
    settings: Settings, out: Path, *, workers: int, progress: Callable[[int, int], None] | None = None
) -> list[Path]:
    """Make the drives that are missing in the folder `out`; returns the paths of all.

    progress: given (drives there, all of them)
    InputError where the folder holds a data set of other settings; SwathError where a drive cannot be made.
    """
    own_folder(out)
    check_same(settings, out)
    jobs = [drive for drive in range(settings.count) if not is_there(out, drive)]
    there = settings.count - len(jobs)
    for drive, found in in_workers(jobs, partial(partial, write_drive, settings, out), workers):
        if isinstance(found, Lost | str):
            raise SwathError(f"drive {drive + 1}: {found}")
        there += 1
        if progress is not None:
            progress(there, settings.count)
    return [file_of(out, drive) for drive in range(settings.count)]
