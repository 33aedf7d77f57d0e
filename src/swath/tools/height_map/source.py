"""What all measured data look like to the builder: sweeps of echoes, and a track of poses.

Tables are .npz with a matrix of ranges, .csv with a row per beam, poses in a .csv.

npz keys: `ranges_m` (scans, beams); `angle_deg` (beams,), in the scan plane from the sensor's x axis to its
y axis; `scan_time_s` (scans,); optional `elevation_deg` (beams,), `intensity` and `no_return` (scans, beams),
`beam_time_s` (beams,) after the scan's time. Poses per scan: `x_m`, `y_m` and optional `z_m`, `roll_deg`,
`pitch_deg`, `yaw_deg` (scans,); or `pos_along_m` (scans,), straight along x; or none, with a table of poses.
csv columns: `t_s`, and `range_m`, `azimuth_deg`, optional `elevation_deg`; or `x_m`, `y_m`, `z_m` in the
sensor frame; optional `intensity`.
Columns of a table of poses: `t_s`, `x_m`, `y_m`, optional `z_m`, `roll_deg`, `pitch_deg`, `yaw_deg`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.units import DEG
from swath.documents.number_table import column_names, number_blocks, read_numbers
from swath.documents.packed import read_arrays
from swath.signals import F64
from swath.tools.height_map.poses import PoseTrack, make_track


@dataclass(frozen=True)
class Echoes:
    """Some echoes, in the sensor frame. time [s] on the clock of the poses, (n,); points (n, 3) [m];
    intensity (n,), nan = not known; scan_count: scans they are of; silent_count: beams of these without echo.

    silent: how far beams went without meeting anything, (m, 3) [m], as far as that is known; silent_time (m,)
    mounting: pose_machine_sensor where it is not that of the source
    """

    time: F64
    points: F64
    intensity: F64
    silent_count: int = 0
    scan_count: int = 1
    silent: F64 = field(default_factory=lambda: np.zeros((0, 3)))
    silent_time: F64 = field(default_factory=lambda: np.zeros(0))
    mounting: Pose | None = None


@dataclass
class Source:
    """name: for messages; track: of the machine (or of the sensor itself); mounting: pose_machine_sensor.

    sweeps: starts a new pass through the echoes
    notes: what was left out, grows while reading
    frame_is_world: points are in the map already
    """

    name: str
    track: PoseTrack
    mounting: Pose
    sweeps: Callable[[], Iterator[Echoes]]
    notes: dict[str, int] = field(default_factory=dict)
    frame_is_world: bool = False

    def note(self, what: str, count: int = 1) -> None:
        """Count something that was left out."""
        if count:
            self.notes[what] = self.notes.get(what, 0) + count


@dataclass(frozen=True)
class Wanted:
    """What the user says about a source; None = find out.

    scans, poses: topics
    mount: pose_machine_sensor
    range_min, range_max [m]: other ranges are no echo
    to_local: longitude, latitude, height to local metres, None = the plane at the first fix
    antenna: x, y, z of the receiver on the machine [m], None = by /tf_static
    is_still: nothing moved, there are no poses
    """

    scans: str | None = None
    poses: str | None = None
    mount: Pose | None = None
    range_min: float = 0.05
    range_max: float = 200.0
    to_local: Callable[[F64], F64] | None = None
    antenna: tuple[float, float, float] | None = None
    is_still: bool = False


STILL = make_track([-1e11, 1e11], np.zeros((2, 3)), np.zeros((2, 3)))  # of what stands at one place


def polar_points(ranges: F64, azimuth: F64, elevation: F64 | float = 0.0) -> F64:
    """Points in the sensor frame [m], (n, 3)."""
    flat = ranges * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), ranges * np.sin(elevation)], axis=-1)


OPTIONAL_POSE = ("z_m", "roll_deg", "pitch_deg", "yaw_deg")
KNOWN = ("t_s", "range_m", "azimuth_deg", "elevation_deg", "x_m", "y_m", "intensity", *OPTIONAL_POSE)
FINITE = ("elevation_deg", "beam_time_s")  # a beam without them is nowhere
SCANS_AT_ONCE = 64


def open_npz(path: Path, wanted: Wanted, poses: Path | None) -> Source:
    """Scans as matrices. InputError names the key that is missing or has the wrong shape."""
    data = read_arrays(path, "scans", "a readable .npz")
    ranges = _array(data, "ranges_m", (-1, -1), path)
    scans, beams = ranges.shape
    angle = _array(data, "angle_deg", (beams,), path) * DEG
    time = _array(data, "scan_time_s", (scans,), path)
    elevation = _array(data, "elevation_deg", (beams,), path, 0.0) * DEG
    late = _array(data, "beam_time_s", (beams,), path, 0.0)
    intensity = _array(data, "intensity", ranges.shape, path, np.nan)
    silent = _array(data, "no_return", ranges.shape, path, 0.0) != 0.0
    track = STILL if wanted.is_still else _own_poses(data, time, path) if poses is None else read_poses(poses)

    def sweeps() -> Iterator[Echoes]:
        for first in range(0, scans, SCANS_AT_ONCE):
            part = slice(first, first + SCANS_AT_ONCE)
            with np.errstate(invalid="ignore"):
                far = silent[part] | (ranges[part] > wanted.range_max)
                good = ~far & (ranges[part] >= wanted.range_min)
            row, beam = np.nonzero(good)
            free, side = np.nonzero(far)
            yield Echoes(
                time[part][row] + late[beam],
                polar_points(ranges[part][row, beam], angle[beam], elevation[beam]),
                intensity[part][row, beam],
                good.size - len(row),
                len(good),
                polar_points(np.full(len(side), wanted.range_max), angle[side], elevation[side]),
                time[part][free] + late[side],
            )

    return Source(path.name, track, wanted.mount or Pose.identity(), sweeps)


def open_csv(path: Path, wanted: Wanted, poses: Path | None) -> Source:
    """A row per beam or point, read in blocks. InputError for missing columns or without a table of poses."""
    if poses is None and not wanted.is_still:
        raise InputError("--poses", None, "expected a table of poses beside a .csv of echoes", file=path)
    names = column_names(path)
    polar = ("range_m", "azimuth_deg")
    form = polar if all(n in names for n in polar) else ("x_m", "y_m", "z_m")
    for name in ("t_s", *form):
        if name not in names:
            expected = "expected columns t_s and range_m, azimuth_deg, or x_m, y_m, z_m"
            raise InputError("columns", ", ".join(names), expected, file=path)
    track = STILL if poses is None else read_poses(poses)
    source = Source(path.name, track, wanted.mount or Pose.identity(), lambda: iter(()))

    def sweeps() -> Iterator[Echoes]:
        line, azimuth = 2, np.zeros(0)
        for block in number_blocks(path, names, KNOWN):
            time = block["t_s"]
            if form == polar:
                if (below := np.flatnonzero(block["range_m"] < 0.0)).size:
                    said = float(block["range_m"][below[0]]), "expected >= 0, an empty cell for no echo"
                    raise InputError("range_m", *said, file=path, line=line + int(below[0]))
                elevation = block["elevation_deg"] * DEG if "elevation_deg" in block else 0.0
                points = polar_points(block["range_m"], block["azimuth_deg"] * DEG, elevation)
            else:
                points = np.stack([block[n] for n in form], axis=1)
            far = np.linalg.norm(points, axis=1)
            with np.errstate(invalid="ignore"):
                good = np.isfinite(time) & (far >= wanted.range_min) & (far <= wanted.range_max)
            bright = block.get("intensity", np.full(len(time), np.nan))
            scans = len(np.unique(time[good]))
            if form == polar:  # or by its beams, of which each may have a time of its own
                turns = np.diff(np.concatenate([azimuth[-1:], block["azimuth_deg"]]))
                azimuth, ahead = block["azimuth_deg"], np.sign(np.nanmedian(turns)) if len(turns) else 0.0
                scans = min(scans, int(np.count_nonzero(turns * ahead < 0.0)) + (line == 2))
            line += len(time)
            yield Echoes(time[good], points[good], bright[good], int(np.count_nonzero(~good)), scans)

    source.sweeps = sweeps
    return source


def read_poses(path: Path) -> PoseTrack:
    """A table of poses."""
    table = read_numbers(path, ("t_s", "x_m", "y_m"), OPTIONAL_POSE)
    return _track(table, table["t_s"], path)


def _own_poses(data: Mapping[str, Any], time: F64, path: Path) -> PoseTrack:
    if "pos_along_m" in data:
        along = _array(data, "pos_along_m", time.shape, path)
        table = {"x_m": along, "y_m": np.zeros_like(along)}
    elif "x_m" in data and "y_m" in data:
        table = {n: _array(data, n, time.shape, path) for n in ("x_m", "y_m", *OPTIONAL_POSE) if n in data}
    else:
        raise InputError("x_m", None, "expected poses: x_m and y_m, or pos_along_m, or --poses", file=path)
    return _track(table, time, path)


def _track(table: Mapping[str, F64], time: F64, path: Path) -> PoseTrack:
    zero = np.zeros(len(time))
    position = np.stack([table["x_m"], table["y_m"], table.get("z_m", zero)], axis=1)
    angle = np.stack([table.get(n, zero) for n in OPTIONAL_POSE[1:]], axis=1) * DEG
    try:
        return make_track(time, position, angle)
    except InputError as error:
        raise InputError(error.key, error.value, error.expected, file=path) from error


def _array(
    data: Mapping[str, Any], key: str, shape: tuple[int, ...], path: Path, default: float | None = None
) -> F64:
    """An array of numbers of a shape, in which -1 stands for any length but 0."""
    if key not in data and default is not None:
        return np.full(shape, default)
    expected = "numbers of shape " + str(shape).replace("-1", "any")
    if key not in data:
        raise InputError(key, None, f"missing, expected {expected}", file=path)
    value = data[key]
    fits = len(shape) == value.ndim and all(
        n == m or (m < 0 < n) for n, m in zip(value.shape, shape, strict=True)
    )
    if not fits or value.dtype.kind not in "biuf":
        raise InputError(key, str(value.shape), f"expected {expected}", file=path)
    numbers = np.asarray(value, dtype=np.float64)
    if key in FINITE and not np.isfinite(numbers).all():
        raise InputError(key, None, "expected finite numbers", file=path)
    if key == "angle_deg" and not (np.abs(numbers) <= 720.0).all():
        raise InputError(key, None, "expected angles within 720 degrees", file=path)
    return numbers
