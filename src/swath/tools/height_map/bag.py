"""Measured scans from a run folder, an MCAP file or a rosbag (1 and 2).

Scans: sensor_msgs/LaserScan (the stamp is that of the first beam) or sensor_msgs/PointCloud2, read as by the
level `log`. Poses: nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped, or
sensor_msgs/NavSatFix, which gives local metres and a course. Mounting: from /tf_static, between the pose's
frame and the scan's; poses are brought down to base_footprint where there is one.

An MCAP file that ends in the middle is read up to there; so is whatever else breaks off while it is read.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.record.read.files import Log, open_log
from swath.record.read.fixes import poses_of_fixes, read_fixes
from swath.record.read.frames import GROUND, Links, ground_frame, links_of, pose_between
from swath.record.read.mcap_log import BROKEN
from swath.record.read.scans import beam_times, cloud_points
from swath.tools.height_map.poses import PoseTrack, carried, euler_of, make_track
from swath.tools.height_map.source import Echoes, Source, Wanted, polar_points

Array = NDArray[np.float64]
FIX = "sensor_msgs/msg/NavSatFix"
SCANS = ("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2")
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    FIX,
)
FARTHEST = 200.0  # no scanner that matters here looks further [m]
WORLD = ("map", "world", "odom")


def open_bag(path: Path, wanted: Wanted) -> Source:
    """A recording. InputError says which topics there are when it is not clear which to take."""
    reader = open_log(path)
    topics = reader.topics()
    if not topics:
        raise InputError("recording", path.name, "expected messages, there are none", file=path)
    scans = _choose("--scans", wanted.scans, topics, SCANS, ("/lidar/scan_points", "/lidar/scan"), path)
    poses = _choose("--poses", wanted.poses, topics, POSES, ("/motion/state",), path)
    is_fix = topics[poses] == FIX
    rows, body, links, scan_frame = _first_pass(reader, scans, poses, is_fix)
    told: list[str] = []
    body = body if not is_fix else ground_frame(links, scan_frame) or ""
    if is_fix:
        track = _track_of_fixes(reader, poses, wanted, links, body, told, path)
    else:
        track = _track(rows, poses, path)
    is_world = scan_frame in WORLD and wanted.mount is None
    mounting = wanted.mount or (Pose.identity() if is_world else _mounting(links, body, scan_frame, path))
    ground = ground_frame(links, body)
    if wanted.mount is None and not is_world and ground not in (None, body) and _stands(ground):
        below = pose_between(links, body, ground or "")
        assert below is not None
        track, mounting = carried(track, below), below.inverse() @ mounting
        told.append(f"poses of {body} brought down to {ground}, {-below.position[2]:.2f} m below it")
    source = Source(path.name, track, mounting, lambda: iter(()), frame_is_world=is_world)
    source.sweeps = lambda: _sweeps(reader, scans, source, wanted, told)
    return source


def _stands(frame: str | None) -> bool:
    """Whether a frame lies on the ground by its name."""
    return (frame or "").endswith(GROUND[0])


def _choose(
    option: str,
    asked: str | None,
    topics: dict[str, str],
    types: Sequence[str],
    usual: Sequence[str],
    path: Path,
) -> str:
    found = [t for t, kind in topics.items() if kind in types]
    listed = ", ".join(sorted(found)) or "none"
    if asked is not None:
        if asked not in found:
            raise InputError(option, asked, f"expected one of {listed}", file=path)
        return asked
    for end in usual:
        if len(match := [t for t in found if t.endswith(end)]) == 1:
            return match[0]
    found = [t for t in found if not t.endswith("/truth")] if len(found) > 1 else found
    if len(found) != 1:
        kinds = ", ".join(k.rpartition("/")[2] for k in types)
        raise InputError(option, None, f"expected one topic of {kinds}; there are: {listed}", file=path)
    return found[0]


def _first_pass(
    reader: Log, scans: str, poses: str, is_fix: bool
) -> tuple[Array, str, dict[str, tuple[str, Pose]], str]:
    """Poses, their frame, static transforms (child -> parent, pose_parent_child), the frame of the scans."""
    rows: list[tuple[float, ...]] = []
    body, frame = "", ""
    links: dict[str, tuple[str, Pose]] = {}
    for topic, _, message in reader.messages((poses, "/tf_static"), also_first=scans):
        if topic == scans:
            frame = frame or message.header.frame_id.lstrip("/")
        elif topic == "/tf_static":
            links |= links_of(message)
        elif not is_fix:
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
            p, q = pose.position, pose.orientation
            rows.append((_seconds(message.header.stamp), p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            body = body or getattr(message, "child_frame_id", "").lstrip("/")
    return np.array(rows, dtype=float).reshape(-1, 8), body, links, frame


def _track(rows: Array, topic: str, path: Path) -> PoseTrack:
    try:
        return make_track(rows[:, 0], rows[:, 1:4], euler_of(rows[:, 4:8]))
    except InputError as error:
        raise InputError(topic, error.value, error.expected, file=path) from error


def _track_of_fixes(
    reader: Log, topic: str, wanted: Wanted, links: Links, body: str, told: list[str], path: Path
) -> PoseTrack:
    """Positions of a receiver as the track of a level machine that drives forward."""
    antenna = wanted.antenna
    if antenna is None:
        first = next((message for _, _, message in reader.messages((topic,))), None)
        frame = "" if first is None else first.header.frame_id.lstrip("/")
        found = pose_between(links, body, frame)
        x, y, z = antenna = (0.0, 0.0, 0.0) if found is None else tuple(found.position.tolist())
        where = "taken at the machine's origin on the ground, see --antenna"
        told.append(f"antenna {where if found is None else f'at {x:g}, {y:g}, {z:g} m by /tf_static'}")
    try:
        fixes = read_fixes(reader.messages((topic,)))
        position, yaw = poses_of_fixes(fixes, wanted.to_local, antenna)
        return make_track(fixes.t / NS, position, np.stack([0 * yaw, 0 * yaw, yaw], axis=1))
    except InputError as error:
        raise InputError(topic, error.value, error.expected, file=path) from error


def _mounting(links: Links, body: str, frame: str, path: Path) -> Pose:
    found = pose_between(links, body, frame)
    if found is None:
        expected = f"expected --mount, /tf_static does not lead from {body or 'the pose'!r} to {frame!r}"
        raise InputError("--mount", None, expected, file=path)
    return found


def _sweeps(reader: Log, topic: str, source: Source, wanted: Wanted, told: Sequence[str]) -> Iterator[Echoes]:
    reader.forget_notes()
    source.notes.clear()
    source.notes.update(dict.fromkeys(told, 1))
    for _, _, message in reader.messages((topic,)):
        try:
            is_plane = message.__msgtype__ == SCANS[0]
            echoes = (_of_scan if is_plane else _of_cloud)(message, source.note)
        except (ValueError, IndexError, KeyError, TypeError):
            source.note(BROKEN)
            continue
        far = np.linalg.norm(echoes.points, axis=1)
        with np.errstate(invalid="ignore"):
            good = np.isfinite(echoes.time) & np.isfinite(far)
            if not source.frame_is_world:
                good &= (far >= wanted.range_min) & (far <= wanted.range_max)
        found = echoes.time[good], echoes.points[good], echoes.intensity[good]
        count, free = int(np.count_nonzero(~good)) + echoes.silent_count, echoes.silent
        if len(free):  # not known further than where echoes are not taken any more
            length = np.linalg.norm(free, axis=1, keepdims=True)
            free = free * np.minimum(wanted.range_max / np.maximum(length, 1e-9), 1.0)
        yield Echoes(*found, count, 1, free, echoes.silent_time)
    for what, number in reader.notes.items():
        source.note(what, number)


def _of_scan(message: Any, note: Callable[[str], None]) -> Echoes:
    ranges = np.asarray(message.ranges, dtype=np.float64)
    beam = np.arange(len(ranges))
    azimuth = np.asarray(message.angle_min + beam * float(message.angle_increment), dtype=np.float64)
    gone = ranges > message.range_max  # inf: no echo
    ranges[gone | (ranges < message.range_min)] = np.nan
    intensity = np.asarray(message.intensities, dtype=np.float64)
    if len(intensity) != len(ranges):
        intensity = np.full(len(ranges), np.nan)
    time: Array = _seconds(message.header.stamp) + beam_times(message, note)
    reach = np.full(int(gone.sum()), min(float(message.range_max), FARTHEST))
    free = polar_points(reach, azimuth[gone])
    with np.errstate(invalid="ignore"):
        return Echoes(time, polar_points(ranges, azimuth), intensity, silent=free, silent_time=time[gone])


def _of_cloud(message: Any, note: Callable[[str], None]) -> Echoes:
    stamp = message.header.stamp
    cloud = cloud_points(message, int(stamp.sec) * NS + int(stamp.nanosec), note)
    return Echoes(_seconds(stamp) + cloud.late, cloud.points, cloud.intensity, cloud.left_out)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
