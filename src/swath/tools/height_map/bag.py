"""Measured scans from a run folder, an MCAP file or a rosbag (1 and 2).

Scans: sensor_msgs/LaserScan (the stamp is that of the first beam) or sensor_msgs/PointCloud2, read as by the
level `log`. Poses: nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped, or
sensor_msgs/NavSatFix, which gives local metres and a course; those of another frame of the machine are
brought to its own. Mounting: from /tf_static, of each scanner that writes on the topic.

An MCAP file that ends in the middle is read up to there; so is whatever else breaks off while it is read.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.record.read.fields import Context
from swath.record.read.files import Log, open_log
from swath.record.read.fixes import poses_of_fixes, read_fixes
from swath.record.read.frames import (
    Links,
    frame_of,
    ground_frame,
    pose_between,
    static_links,
    static_mounting,
)
from swath.record.read.mcap_log import BROKEN
from swath.record.read.scans import beam_times, cloud_points
from swath.signals import F64
from swath.tools.height_map.poses import PoseTrack, make_track
from swath.tools.height_map.source import STILL, Echoes, Source, Wanted, polar_points

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
    is_posed = not wanted.is_still
    poses = _choose("--poses", wanted.poses, topics, POSES, ("/motion/state",), path) if is_posed else ""
    links, first = static_links(reader, scans)
    context = Context(0.0, wanted.to_local, {} if wanted.mount else links)
    try:
        if wanted.is_still:
            track, body = STILL, frame_of(first)
        elif topics[poses] == FIX:
            body = ground_frame(links, frame_of(first)) or ""
            track = _track_of_fixes(reader, poses, wanted, context, links, body)
        else:
            track, body = _track(reader, poses, context)
    except InputError as error:
        raise InputError(poses, error.value, error.expected, file=path) from error
    frame, notes = frame_of(first), dict(context.notes)
    is_world = frame in WORLD and wanted.mount is None
    context.notes.clear()
    mounting = wanted.mount or (
        Pose.identity() if is_world else _mounting(links, body, frame_of(first), path)
    )
    source = Source(path.name, track, mounting, lambda: iter(()), frame_is_world=is_world)

    def sweeps() -> Iterator[Echoes]:
        source.notes.clear()
        source.notes.update(notes)
        return _sweeps(reader, scans, source, wanted, replace(context, notes=source.notes).again(), body)

    source.sweeps = sweeps
    return source


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


def _track(reader: Log, topic: str, context: Context) -> tuple[PoseTrack, str]:
    """The poses of the machine, and its frame."""
    body, rows = None, list[tuple[float, ...]]()
    for _, t, message in reader.messages((topic,)):
        child = frame_of(message, own=True)
        body = child if body is None else body
        if child != body:
            context.note(f"poses of {child} on {topic} left out beside those of {body}")
            continue
        pose = context.pose(message)
        rows.append((context.time(message, t) / NS, *pose.position, *pose.euler()))
    table = np.array(rows, dtype=float).reshape(-1, 7)
    known = static_mounting(context.links, body or "", context.machine)
    return make_track(table[:, 0], table[:, 1:4], table[:, 4:]), known[0] if known else body or ""


def _track_of_fixes(
    reader: Log, topic: str, wanted: Wanted, context: Context, links: Links, body: str
) -> PoseTrack:
    """Positions of a receiver as the track of a level machine that drives forward."""
    antenna = wanted.antenna
    if antenna is None:
        first = next((message for _, _, message in reader.messages((topic,))), None)
        found = pose_between(links, body, frame_of(first))
        x, y, z = antenna = (0.0, 0.0, 0.0) if found is None else tuple(found.position.tolist())
        where = "taken at the machine's origin on the ground, see --antenna"
        place = f"at {', '.join(map(num, (x, y, z)))} m by /tf_static"
        context.note(f"antenna {where if found is None else place}")
    fixes = read_fixes(reader.messages((topic,)), context)
    position, yaw = poses_of_fixes(fixes, wanted.to_local, antenna)
    return make_track(fixes.t / NS, position, np.stack([0 * yaw, 0 * yaw, yaw], axis=1))


def _mounting(links: Links, body: str, frame: str, path: Path) -> Pose:
    found = pose_between(links, body, frame)
    if found is None:
        expected = f"expected --mount, /tf_static does not lead from {body or 'the pose'!r} to {frame!r}"
        raise InputError("--mount", None, expected, file=path)
    return found


def _sweeps(
    reader: Log, topic: str, source: Source, wanted: Wanted, context: Context, body: str
) -> Iterator[Echoes]:
    reader.forget_notes()
    mountings: dict[str, Pose | None] = {}
    for _, t, message in reader.messages((topic,)):
        frame = frame_of(message)
        if frame not in mountings:
            is_first = not mountings or wanted.mount is not None
            mountings[frame] = source.mounting if is_first else pose_between(context.links, body, frame)
        mounting = mountings[frame]
        if mounting is None:
            context.note(f"scans of {frame} left out, /tf_static does not lead there from {body}")
            continue
        try:
            is_plane = message.__msgtype__ == SCANS[0]
            begun = context.time(message, t) / NS
            echoes = (_of_scan if is_plane else _of_cloud)(message, begun, context.note)
        except (ValueError, IndexError, KeyError, TypeError):
            context.note(BROKEN)
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
        yield Echoes(*found, count, 1, free, echoes.silent_time, mounting)
    for what, number in reader.notes.items():
        source.note(what, number)


def _of_scan(message: Any, begun: float, note: Callable[[str], None]) -> Echoes:
    ranges = np.asarray(message.ranges, dtype=np.float64)
    beam = np.arange(len(ranges))
    azimuth = np.asarray(message.angle_min + beam * float(message.angle_increment), dtype=np.float64)
    gone = ranges > message.range_max  # inf: no echo
    ranges[gone | (ranges < message.range_min)] = np.nan
    intensity = np.asarray(message.intensities, dtype=np.float64)
    if len(intensity) != len(ranges):
        intensity = np.full(len(ranges), np.nan)
    time: F64 = begun + beam_times(message, note)
    reach = np.full(int(gone.sum()), min(float(message.range_max), FARTHEST))
    free = polar_points(reach, azimuth[gone])
    with np.errstate(invalid="ignore"):
        return Echoes(time, polar_points(ranges, azimuth), intensity, silent=free, silent_time=time[gone])


def _of_cloud(message: Any, begun: float, note: Callable[[str], None]) -> Echoes:
    cloud = cloud_points(message, note)
    return Echoes(begun + cloud.late, cloud.points, cloud.intensity, cloud.left_out)
