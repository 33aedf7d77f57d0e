"""Measured scans from a run folder, an MCAP file or a rosbag (1 and 2).

Scans: sensor_msgs/LaserScan (the stamp is that of the first beam) or sensor_msgs/PointCloud2 (x, y, z, and
if there `intensity` and `time`, seconds after the stamp). Poses: nav_msgs/Odometry, geometry_msgs/PoseStamped
or PoseWithCovarianceStamped. Mounting: from /tf_static, between the pose's frame and the scan's.

An MCAP file that ends in the middle is read up to there; so is whatever else breaks off while it is read.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.study.replay.poses import PoseTrack, euler_of, make_track, pose_of
from swath.study.replay.source import Echoes, Source, Wanted, polar_points

Array = NDArray[np.float64]
SCANS = ("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2")
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
WORLD = ("map", "world", "odom")
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # sensor_msgs/PointField
CUT_OFF = "recording broke off"
BROKEN = "messages not readable"


def open_bag(path: Path, wanted: Wanted) -> Source:
    """A recording. InputError says which topics there are when it is not clear which to take."""
    reader = make_reader(path)
    topics = reader.topics()
    if not topics:
        raise InputError("recording", path.name, "expected messages, there are none", file=path)
    scans = _choose("--scans", wanted.scans, topics, SCANS, ("/lidar/scan_points", "/lidar/scan"), path)
    poses = _choose("--poses", wanted.poses, topics, POSES, ("/motion/state",), path)
    track, body, mounts, scan_frame = _first_pass(reader, scans, poses, path)
    is_world = scan_frame in WORLD and wanted.mount is None
    mounting = wanted.mount or (Pose.identity() if is_world else _mounting(mounts, body, scan_frame, path))
    source = Source(path.name, track, mounting, lambda: iter(()), reader.notes, frame_is_world=is_world)
    source.sweeps = lambda: _sweeps(reader, scans, source, wanted)
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


def _first_pass(
    reader: Any, scans: str, poses: str, path: Path
) -> tuple[PoseTrack, str, dict[str, tuple[str, Pose]], str]:
    """Track, its frame, static transforms (child -> parent, pose_parent_child), the frame of the scans."""
    rows: list[tuple[float, ...]] = []
    body, frame = "", ""
    mounts: dict[str, tuple[str, Pose]] = {}
    for topic, message in reader.messages((poses, "/tf_static"), also_first=scans):
        if topic == scans:
            frame = frame or message.header.frame_id.lstrip("/")
        elif topic == "/tf_static":
            for link in message.transforms:
                move, turn = link.transform.translation, link.transform.rotation
                pose = pose_of((move.x, move.y, move.z), (turn.x, turn.y, turn.z, turn.w))
                mounts[link.child_frame_id.lstrip("/")] = (link.header.frame_id.lstrip("/"), pose)
        else:
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
            p, q = pose.position, pose.orientation
            rows.append((_seconds(message.header.stamp), p.x, p.y, p.z, q.x, q.y, q.z, q.w))
            body = body or getattr(message, "child_frame_id", "").lstrip("/")
    table = np.array(rows, dtype=float).reshape(-1, 8)
    try:
        track = make_track(table[:, 0], table[:, 1:4], euler_of(table[:, 4:8]))
    except InputError as error:
        raise InputError(poses, error.value, error.expected, file=path) from error
    return track, body, mounts, frame


def _mounting(mounts: dict[str, tuple[str, Pose]], body: str, frame: str, path: Path) -> Pose:
    pose, at = Pose.identity(), frame
    for _ in range(len(mounts) + 1):
        if at == body:
            return pose
        if at not in mounts:
            break
        parent, link = mounts[at]
        pose, at = link @ pose, parent
    expected = f"expected --mount, /tf_static does not lead from {body or 'the pose'!r} to {frame!r}"
    raise InputError("--mount", None, expected, file=path)


def _sweeps(reader: Any, topic: str, source: Source, wanted: Wanted) -> Iterator[Echoes]:
    reader.notes.clear()
    for _, message in reader.messages((topic,)):
        try:
            is_plane = message.__msgtype__ == SCANS[0]
            echoes = _of_scan(message) if is_plane else _of_cloud(message)
        except (ValueError, IndexError, KeyError, TypeError):
            source.note(BROKEN)
            continue
        far = np.linalg.norm(echoes.points, axis=1)
        with np.errstate(invalid="ignore"):
            good = np.isfinite(echoes.time) & np.isfinite(far)
            if not source.frame_is_world:
                good &= (far >= wanted.range_min) & (far <= wanted.range_max)
        silent = int(np.count_nonzero(~good))
        yield Echoes(echoes.time[good], echoes.points[good], echoes.intensity[good], silent)


def _of_scan(message: Any) -> Echoes:
    ranges = np.asarray(message.ranges, dtype=np.float64)
    beam = np.arange(len(ranges))
    azimuth = np.asarray(message.angle_min + beam * float(message.angle_increment), dtype=np.float64)
    outside = (ranges < message.range_min) | (ranges > message.range_max)
    ranges[outside] = np.nan
    intensity = np.asarray(message.intensities, dtype=np.float64)
    if len(intensity) != len(ranges):
        intensity = np.full(len(ranges), np.nan)
    time: Array = np.asarray(
        _seconds(message.header.stamp) + beam * float(message.time_increment), np.float64
    )
    with np.errstate(invalid="ignore"):  # inf: no echo
        return Echoes(time, polar_points(ranges, azimuth), intensity)


def _of_cloud(message: Any) -> Echoes:
    names = {f.name: f for f in message.fields}
    order = ">" if message.is_bigendian else "<"
    layout = np.dtype(
        {
            "names": list(names),
            "formats": [order + KINDS[f.datatype] for f in names.values()],
            "offsets": [f.offset for f in names.values()],
            "itemsize": message.point_step,
        }
    )
    count = message.width * message.height
    table = np.frombuffer(np.asarray(message.data).tobytes(), dtype=layout, count=count)
    points = np.stack([table[n].astype(np.float64) for n in ("x", "y", "z")], axis=1)
    time = np.full(count, _seconds(message.header.stamp))
    if "time" in names and layout["time"].kind == "f":
        time += table["time"]
    known = "intensity" in names
    intensity = table["intensity"].astype(np.float64) if known else np.full(count, np.nan)
    return Echoes(time, points, intensity)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


class McapReader:
    """Reads an MCAP file from its beginning, message by message, without its index."""

    def __init__(self, path: Path) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.notes: dict[str, int] = {}
        with path.open("rb") as file:
            if file.read(8) != b"\x89MCAP0\r\n":
                raise InputError("recording", path.name, "expected an MCAP file", file=path)

    def topics(self) -> dict[str, str]:
        """Topic -> type; from the channels, which stand before their first message."""
        found: dict[str, str] = {}
        for schema, channel, _ in self._records():
            found[channel.topic] = schema.name if schema is not None else ""
        return found

    def messages(self, wanted: Sequence[str], also_first: str = "") -> Iterator[tuple[str, Any]]:
        """(topic, message) of some topics, and the first one of another."""
        rest = also_first
        for schema, channel, message in self._records():
            if channel.topic not in wanted and channel.topic != rest:
                continue
            if channel.topic == rest:
                rest = ""
            try:
                made = self.store.deserialize_cdr(message.data, schema.name)
            except Exception:
                self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                continue
            yield channel.topic, made

    def _records(self) -> Iterator[tuple[Any, Any, Any]]:
        from mcap.exceptions import McapError
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        with self.path.open("rb") as file:
            try:
                records: Any = StreamReader(file).records
                for record in records:
                    if isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = record
                    elif isinstance(record, Message) and record.channel_id in channels:
                        channel = channels[record.channel_id]
                        yield schemas.get(channel.schema_id), channel, record
            except (McapError, *_read_errors()):
                self.notes[CUT_OFF] = 1


class BagReader:
    """Reads a rosbag 1 or 2 with its index."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.notes: dict[str, int] = {}
        self._make: Callable[[], Any] = lambda: AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        try:
            with self._make() as reader:
                self._topics = {c.topic: c.msgtype for c in reader.connections}
        except Exception as error:
            expected = f"expected a readable rosbag ({error}); a broken one needs a new index first"
            raise InputError("recording", path.name, expected, file=path) from error

    def topics(self) -> dict[str, str]:
        """Topic -> type."""
        return dict(self._topics)

    def messages(self, wanted: Sequence[str], also_first: str = "") -> Iterator[tuple[str, Any]]:
        """(topic, message) of some topics, and the first one of another."""
        rest = also_first
        with self._make() as reader:
            connections = [c for c in reader.connections if c.topic in wanted or c.topic == also_first]
            records = iter(reader.messages(connections=connections))
            while True:
                try:
                    connection, _, raw = next(records)
                except StopIteration:
                    return
                except Exception:  # what breaks off differs from format to format
                    self.notes[CUT_OFF] = 1
                    return
                if connection.topic not in wanted:
                    if connection.topic != rest:
                        continue
                    rest = ""
                try:
                    made = reader.deserialize(raw, connection.msgtype)
                except Exception:
                    self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                    continue
                yield connection.topic, made


def make_reader(path: Path) -> McapReader | BagReader:
    """The reader of a file or bag folder. A run folder is its run.mcap."""
    if (path / "run.mcap").is_file():
        path = path / "run.mcap"
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise InputError("recording", path.name, "expected a run folder or a rosbag folder", file=path)
    return McapReader(path) if path.suffix == ".mcap" and path.is_file() else BagReader(path)


def _read_errors() -> tuple[type[Exception], ...]:
    import struct
    import zlib

    errors: tuple[type[Exception], ...] = (OSError, EOFError, ValueError, struct.error, zlib.error, KeyError)
    try:
        import zstandard

        errors = (*errors, zstandard.ZstdError)
    except ImportError:
        pass
    try:
        import lz4.frame  # type: ignore[import-not-found,import-untyped,unused-ignore]  # noqa: F401

        errors = (*errors, RuntimeError)
    except ImportError:
        pass
    return errors
