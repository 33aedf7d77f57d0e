"""One MCAP file of ROS 2 (CDR) messages, readable up to its last whole chunk whatever happens.

The container is written by the `mcap` package, messages and their definitions come from rosbags. The message
types of a simulation that ROS 2 lacks are made from the fields of the sample itself (`swath_msgs/msg/...`);
their definition travels in the file, so a viewer needs no package.
"""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.record.samples import DEFINITION, MSGTYPE
from swath.signals import F32, F64, Signal

CHUNK_BYTES = 256 * 1024
Tap = Callable[[str, int, Any, bytes, bool], None]  # topic, t [ns], message, its CDR bytes, is_latched
FIELD_TYPES = {
    float: "float64",
    int: "int64",
    bool: "bool",
    str: "string",
    F64: "float64[]",
    F32: "float32[]",
    Pose: "geometry_msgs/Pose",
}
# Public definitions of ROS packages that rosbags' Jazzy set lacks, and our own that no sample type gives.
OWN_TYPES = {
    MSGTYPE: DEFINITION,
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\n"
    "float32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\n"
    "ackermann_msgs/AckermannDrive drive\n",
}
LATCHED = (
    "- history: keep_last\n  depth: 1\n  reliability: reliable\n  durability: transient_local\n"
    "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  liveliness: automatic\n  liveliness_lease_duration:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  avoid_ros_namespace_conventions: false\n"
)


class McapFile:
    """Writer of one file. Topics and types are declared by their first message.

    Raises OSError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        from mcap.writer import CompressionType, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in OWN_TYPES.items():
            self.store.register(get_types_from_msg(text, name))
        self.path = path
        self._stream = path.open("wb")
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="swath")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._kinds: dict[str, dict[str, str]] = {}
        self._flushed = 0
        self._is_torn = False
        self.taps: list[Tap] = []  # called with every message that is written

    def make(self, msgtype: str, **values: Any) -> Any:
        """A message, e.g. make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)."""
        return self.store.types[msgtype](**values)

    def write(self, topic: str, t: int, message: Any, *, is_latched: bool = False) -> None:
        """Append a message, logged at simulated time t [ns]; nothing after an interruption within one."""
        if self._is_torn:
            return
        msgtype = message.__msgtype__
        if topic not in self._channels:
            self._declare(topic, msgtype, is_latched)
        data = bytes(self.store.serialize_cdr(message, msgtype))
        count = self._counts[topic] = self._counts.get(topic, 0) + 1
        self._is_torn = True  # until the message is whole: Ctrl-C may come in between
        self._writer.add_message(self._channels[topic], log_time=t, data=data, publish_time=t, sequence=count)
        self._is_torn = False
        for tap in self.taps:
            tap(topic, t, message, data, is_latched)
        if self._stream.tell() != self._flushed:  # a chunk was completed: hand it to the system now
            self._stream.flush()
            self._flushed = self._stream.tell()

    def announce(self, topic: str, message: Any) -> None:
        """Let the taps that publish know of a topic whose first message is still to come; writes nothing."""
        for tap in self.taps:
            if callable(declare := getattr(tap, "declare", None)):
                declare(topic, message, False)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the file, readable from here on."""
        self._writer.add_attachment(0, 0, name, media_type, data)
        self._stream.flush()
        self._flushed = self._stream.tell()

    def close(self) -> None:
        """Write the index and close. Calling it again does nothing.

        After an interruption within a message the file ends with its last whole chunk, without an index.
        """
        if not self._stream.closed:
            if not self._is_torn:
                self._writer.finish()
            self._stream.close()

    def header(self, t: int, frame: str) -> Any:
        """std_msgs/Header of a simulated time [ns]; times before 0 count as 0."""
        sec, nanosec = divmod(max(int(t), 0), NS)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def point(self, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Point [m]."""
        return self.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        """geometry_msgs/Vector3."""
        return self.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def quaternion(self, pose: Pose) -> Any:
        """geometry_msgs/Quaternion of a pose's rotation."""
        x, y, z, w = pose.quaternion()
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, pose: Pose) -> Any:
        """geometry_msgs/Pose."""
        at = self.point(*pose.position)
        return self.make("geometry_msgs/msg/Pose", position=at, orientation=self.quaternion(pose))

    def of_signal(self, signal: Signal, frame: str) -> Any:
        """A `swath_msgs/msg/<Class>` with a header and the sample's own fields; arrays are flattened."""
        msgtype = f"swath_msgs/msg/{type(signal).__name__}"
        if msgtype not in self.store.types:
            from rosbags.typesys import get_types_from_msg

            self.store.register(get_types_from_msg(definition(type(signal)), msgtype))
        values: dict[str, Any] = {"header": self.header(signal.t, frame)}
        if msgtype not in self._kinds:
            self._kinds[msgtype] = _field_kinds(type(signal))
        for name, kind in self._kinds[msgtype].items():
            values[name] = self._value(getattr(signal, name), kind)
        return self.make(msgtype, **values)

    def _value(self, value: Any, kind: str) -> Any:
        if kind.endswith("[]"):
            return np.ascontiguousarray(value, dtype=kind.removesuffix("[]")).ravel()
        if kind == "geometry_msgs/Pose":
            return self.pose(value)
        plain: dict[str, Any] = {"float64": float, "int64": int, "bool": bool, "string": str}
        return plain[kind](value)

    def _declare(self, topic: str, msgtype: str, is_latched: bool) -> None:
        if msgtype not in self._schemas:
            text, _ = self.store.generate_msgdef(msgtype, ros_version=2)
            self._schemas[msgtype] = self._writer.register_schema(msgtype, "ros2msg", text.encode())
        metadata = {"offered_qos_profiles": LATCHED if is_latched else ""}
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[msgtype], metadata)


def definition(signal: type[Signal]) -> str:
    """The .msg text of a sample type: a header in place of `t`, then its fields by name.

    Fields that no ROS 2 type fits (see FIELD_TYPES) are left out.
    """
    lines = ["std_msgs/Header header"]
    lines += [f"{kind} {name}" for name, kind in _field_kinds(signal).items()]
    return "\n".join(lines) + "\n"


def _field_kinds(signal: type[Signal]) -> dict[str, str]:
    hints = get_type_hints(signal)
    kinds: dict[str, str] = {}
    for field in fields(signal):
        if field.name != "t" and hints[field.name] in FIELD_TYPES:
            kinds[field.name] = FIELD_TYPES[hints[field.name]]
    return kinds
