"""Scans of a crop as echoes over the ground, in a frame that follows a path.

Recordings and tables are read as for the height map; LAS and LAZ by laspy. A cloud without a path has none of
its own ground either: it is taken from the lowest echoes.
"""

import re
from dataclasses import dataclass, field
from math import atan2
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.apart.call import apart
from swath.core.errors import Extra, InputError, reason_of
from swath.core.files.read_file import check_readable
from swath.core.number_text import num, percent_of
from swath.field.maps.projection import transform
from swath.rays.height_grid import NODE_CELLS, TILE, lattice_height
from swath.signals import F64
from swath.tools.height_map.build import open_source
from swath.tools.height_map.gather import Samples
from swath.tools.height_map.ground import ground_of_poses, low_echoes
from swath.tools.height_map.place import TILES_MAX, Frame, batches, placed
from swath.tools.height_map.poses import PoseTrack, make_track
from swath.tools.height_map.source import Source, Wanted

LAS = (".las", ".laz")
LAS_WHITE = 65535.0  # LAS 1.4 R15: intensity is normalised to 16 bit
GROUND_CLASS, FEWEST_GROUND = 2, 100  # of ASPRS; points that make it a ground
CHUNK, MOST = 1 << 20, 20_000_000  # points that are read at once, and of a file in all
FARTHEST_M = 1e8  # of a coordinate in any system of the earth; Web Mercator ends at 2e7
CELL_M = 0.05  # of the frame whose nodes hold the ground
HIGHEST_M, LOWEST_M = 20.0, -1.0  # no crop is higher; nothing lies lower, noise aside
METRE = re.compile(r"^(metre|meter|metres|meters|m)$", re.IGNORECASE)


@dataclass(frozen=True)
class Cloud:
    """points: in the world (n, 3) [m]; height: above the ground (n,) [m]; intensity (n,), nan = unknown.

    track: of the machine, None = it has none
    white: intensity of a white target, nan = unknown
    silent_count: beams without echo, -1 = unknown
    scan_count: 0 = unknown
    notes: what was taken for granted
    """

    name: str
    points: F64
    height: F64
    intensity: F64
    track: PoseTrack | None
    white: float
    silent_count: int
    scan_count: int
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.height)


@dataclass(frozen=True)
class Reading:
    """How a cloud is read. ground: `pose` or `echoes`; poses: a table of them; reach_m: from the path."""

    wanted: Wanted
    poses: Path | None = None
    ground: str = "pose"
    reach_m: float = 30.0


def read_cloud(path: Path, how: Reading) -> Cloud:
    """A run folder, a recording, a table or a file of points. InputError for what cannot be judged."""
    cloud = _read_las(path, how) if path.suffix.lower() in LAS else _read_scans(path, how)
    if not len(cloud):
        raise InputError("scans", path.name, "expected echoes within reach of the path", file=path)
    _check_heights(cloud.height, path)
    return cloud


def _check_heights(height: F64, path: Path) -> None:
    """InputError where heights say that the frame or the unit is another one."""
    low = float(np.mean(height < LOWEST_M))
    if low > 0.5:
        where = f"{percent_of(low)} of the echoes lie {num(-LOWEST_M)} m or more below the ground"
        raise InputError("scans", path.name, f"expected z upwards and the right --mount: {where}", file=path)
    top = float(np.percentile(height, 95.0))
    if top > HIGHEST_M:
        expected = f"expected metres, 5 % of the echoes are {num(top)} or more above the ground"
        raise InputError("scans", path.name, expected, file=path)


def _read_scans(path: Path, how: Reading) -> Cloud:
    return cloud_of(open_source(path, how.wanted, how.poses), how)


def cloud_of(source: Source, how: Reading) -> Cloud:
    """The echoes of scans over the ground. InputError without a usable path."""
    frame = Frame(source.track, CELL_M, how.reach_m)
    lattice = frame.lay(lambda x, y: ground_of_poses(source.track, x, y))
    size = np.array([frame.width, frame.length]) * frame.cell
    parts, silent, scans, lost = [], 0, 0, 0
    for echoes in batches(source):
        here = placed(source, echoes, frame, lattice)
        inside = ((here.points[:, :2] >= 0.0) & (here.points[:, :2] < size)).all(axis=1)
        parts.append((here.points[inside], here.height[inside], here.intensity[inside]))
        silent, scans = silent + echoes.silent_count, scans + echoes.scan_count
        lost += here.unknown_count
    points, height, intensity = (np.concatenate(p) for p in zip(*parts, strict=True)) if parts else _NOTHING
    notes = [f"{what} ({count})" if count > 1 else what for what, count in source.notes.items()]
    if lost:
        notes.append(f"{lost} echoes at times without a pose were left out")
    if len(points):
        height = _grounded(frame, lattice, points, height, how.ground, notes)
    world = np.column_stack([*frame.to_world(points[:, 0], points[:, 1]), points[:, 2] + frame.z0])
    return Cloud(source.name, world, height, intensity, source.track, np.nan, silent, scans, notes)


_NOTHING = (np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def _grounded(frame: Frame, lattice: F64, points: F64, height: F64, ground: str, notes: list[str]) -> F64:
    """Heights above the lowest echoes, where these are to be the ground; else a note where they are not."""
    shift = _low(frame, points, height, lattice.shape)
    at = lattice_height(shift, frame.node, points[:, 0], points[:, 1])
    if ground == "echoes":
        return np.asarray(height - at)
    if (off := float(np.median(at))) < -0.1:
        where = f"the lowest echoes lie {num(-off)} m below the ground that the poses give"
        notes.append(f"{where}: --ground echoes takes theirs, --mount says where the scanner sits")
    return height


def _low(frame: Frame, points: F64, height: F64, shape: tuple[int, ...]) -> F64:
    column, row = np.floor(points[:, :2] / frame.cell).astype(np.int64).T
    key = row * frame.width + column
    order = np.argsort(key, kind="stable")
    none = np.zeros(0, np.int64)
    bounded = np.round(1e3 * np.clip(height, -32.0, 32.0)).astype(np.int16)
    samples = Samples(frame.width, key[order], bounded[order], none, none, np.zeros(0))
    return low_echoes(samples, shape, NODE_CELLS)


@apart("scans", "a readable LAS or LAZ file", libraries=("laspy", "lazrs"))
def _points_of_las(path: Path) -> tuple[F64, F64, NDArray[Any], str]:
    """Points [file units], (n, 3), intensities and classes, (n,), and the system as WKT."""
    with Extra("las", "reading LAS and LAZ"):
        import laspy
        import lazrs
    check_readable(path, "scans", "a LAS or LAZ file")
    parts: list[tuple[Any, ...]] = []
    try:
        with laspy.open(path) as file:
            if file.header.point_count > MOST:
                expected = f"expected at most {MOST // 10**6} million points: cut it to the strip to compare"
                raise InputError("scans", file.header.point_count, expected, file=path)
            wkt = _wkt(file.header)
            for part in file.chunk_iterator(CHUNK):
                xyz = np.stack([part.x, part.y, part.z], axis=1).astype(float)
                parts.append((xyz, np.asarray(part.intensity, float), np.asarray(part.classification)))
    except (laspy.errors.LaspyException, ValueError, OSError, lazrs.LazrsError) as error:
        expected = f"expected a LAS or LAZ file: {reason_of(error)}"
        raise InputError("scans", path.name, expected, file=path) from error
    if not parts or not sum(len(p[0]) for p in parts):
        raise InputError("scans", path.name, "expected points, there are none", file=path)
    points, intensity, classes = (np.concatenate(p) for p in zip(*parts, strict=True))
    return points, intensity, classes, wkt


def _read_las(path: Path, how: Reading) -> Cloud:
    points, intensity, classes, wkt = _points_of_las(path)
    notes: list[str] = []
    points = _in_metres(points, wkt, how.wanted.to_local, path, notes)
    is_placed = (np.abs(points) < FARTHEST_M).all(axis=1)
    if not is_placed.any():
        raise InputError("scans", path.name, "expected points at places on earth, none is", file=path)
    if not is_placed.all():
        notes.append(f"{num(int((~is_placed).sum()))} of {num(len(points))} points lie at no place on earth")
        points, intensity, classes = points[is_placed], intensity[is_placed], classes[is_placed]
    if not intensity.any():
        intensity = np.full(len(intensity), np.nan)
    height = _las_heights(points, classes, path, notes)
    return Cloud(path.name, points, height, intensity, None, LAS_WHITE, -1, 0, notes)


def _wkt(header: Any) -> str:
    texts = [getattr(v, "string", "") for v in header.vlrs if type(v).__name__ == "WktCoordinateSystemVlr"]
    if texts:
        return str(texts[0])
    try:
        crs = header.parse_crs()
    except Exception:  # laspy needs pyproj for that, and files say all kinds of things
        return ""
    return "" if crs is None else str(crs.to_wkt())


def _in_metres(points: F64, wkt: str, to_local: Any, path: Path, notes: list[str]) -> F64:
    """Points in metres of the ground, by what the file says of its system, or by what they look like."""
    with np.errstate(invalid="ignore"):  # of points at no place
        spread = np.ptp(points, axis=0)
    is_local = wkt.startswith(("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS")) or not wkt
    if wkt.startswith(("GEOGCS", "GEOGCRS")) or (not wkt and max(spread[:2]) < 0.02 * spread[2]):
        raise InputError("scans", path.name, "expected x and y in metres, they are degrees", file=path)
    units = re.findall(r'(?:LENGTH)?UNIT\["([^"]+)"', wkt)
    if lengths := [u for u in units if not u.lower().startswith(("degree", "radian", "grad", "unity"))]:
        if odd := [u for u in lengths if not METRE.match(u)]:
            raise InputError("scans", path.name, f"expected metres, its system has {odd[0]}", file=path)
    else:
        place = " of the field" if to_local is not None else ""
        notes.append(f"the file names no unit: its coordinates are taken as metres{place}")
    if to_local is None or is_local:
        return points
    lon_lat = transform(points[:, :2], wkt, "EPSG:4326")
    return np.asarray(to_local(np.column_stack([lon_lat, points[:, 2]])))


def _las_heights(points: F64, classes: Any, path: Path, notes: list[str]) -> F64:
    """Heights above the points of the ground class, or above the lowest echoes."""
    is_ground = classes == GROUND_CLASS
    has_ground = int(is_ground.sum()) >= FEWEST_GROUND
    base = points[is_ground] if has_ground else points
    middle = points.mean(axis=0)
    slopes, keep = np.zeros(3), np.ones(len(base), bool)
    columns = np.column_stack([np.ones(len(base)), base[:, :2] - middle[:2]])
    for _ in range(1 if has_ground else 4):  # the plane sinks to the lower half of what stands on it
        slopes = np.linalg.lstsq(columns[keep], base[keep, 2], rcond=None)[0]
        over = base[:, 2] - columns @ slopes
        keep = over <= np.median(over)
    height = points[:, 2] - slopes[0] - (points[:, :2] - middle[:2]) @ slopes[1:]
    _check_heights(np.maximum(height, LOWEST_M), path)
    track = axis_track(points)
    across = np.array([-np.sin(track.heading), np.cos(track.heading)])
    aside = (points[:, :2] - middle[:2]) @ across
    try:
        frame = Frame(track, CELL_M, 1.0 + float(np.abs(aside).max()))
    except InputError:
        most = TILES_MAX * (TILE * CELL_M) ** 2 / 1e6
        spread = f"they spread over {num(track.length)} x {num(np.ptp(aside))} m"
        expected = f"expected at most {num(most)} km2 of ground about the points, {spread}"
        raise InputError("scans", path.name, expected, file=path) from None
    local, chosen = frame.to_local(points), is_ground if has_ground else np.ones(len(points), bool)
    shift = _low(frame, local[chosen], height[chosen], frame.nodes()[0].shape)
    what = "the points of its ground class" if has_ground else "its lowest echoes"
    notes.append(f"heights are above {what}")
    return np.asarray(height - lattice_height(shift, frame.node, local[:, 0], local[:, 1]))


def axis_track(points: F64) -> PoseTrack:
    """A straight path along the longer axis of a cloud, towards growing x."""
    middle = points.mean(axis=0)
    flat = points[:, :2] - middle[:2]
    axis = np.linalg.eigh(flat.T @ flat)[1][:, -1]
    axis = axis if axis[0] >= 0.0 else -axis
    ends = np.percentile(flat @ axis, [0.0, 100.0])
    place = np.column_stack([middle[:2] + ends[:, None] * axis, np.full(2, middle[2])])
    yaw = atan2(axis[1], axis[0])
    return make_track([0.0, 1.0], place, [[0.0, 0.0, yaw]] * 2)
