"""Makes ROS 2 messages; definitions come from rosbags.

The message types of a simulation that ROS 2 lacks are made from the fields of the sample itself
(`swath_msgs/msg/...`); their definition travels in the recording, so a viewer needs no package.

Messages of one topic differ in a few numbers only: a `Template` writes them into the bytes of the first. The
layout is that of CDR in little-endian order (OMG DDS-RTPS 2.5, 10.2): numbers aligned to their size,
counted from the end of the four bytes of the encapsulation header; text and sequences after their length in
32 bits.

`Source` is what a recording knows of a machine, and where the messages of one of its outputs go. Frames (REP
105): `map` (world, axes of a UTM grid), `<machine>/odom` (the same place, in which odometry counts),
`<machine>/base_link` (ISO 8855, fixed axle on the ground), `<machine>/<sensor slot>`,
`<machine>/<camera slot>_optical` (x right, y down, z forward).
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from struct import Struct, calcsize
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.core.blocks import Block
from swath.core.frames import Pose
from swath.core.layout import Field, layout
from swath.core.schedule import NS
from swath.core.signal import per_signal
from swath.core.together import poses_of
from swath.field.edges.track import EdgeShape
from swath.field.maps.projection import Origin
from swath.record.samples import DEFINITION, MSGTYPE
from swath.signals import F64, Signal
from swath.signals.setup import MachineGeometry

STAMPS = ("header.stamp.sec", "clock.sec")
HEAD = 4  # bytes of the encapsulation header
CODES = {
    "bool": "?",
    "byte": "B",
    "octet": "B",
    "char": "b",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}


class Draft(NamedTuple):
    """A message that is only built when somebody wants it as an object.

    t: its stamp [ns]
    values: the numbers at `paths`; of many samples t and values are columns, (n,), and nothing is built
    build: makes the message itself
    paths: of fields, `pose.position.x`, `points.3.x`. All else is the same in every message of the topic.
    variant: which of the topic's forms it has, of messages whose other contents differ
    """

    t: Any
    paths: tuple[str, ...]
    values: Sequence[Any]
    build: Callable[[], Any]
    variant: Hashable = None


class Template:
    """The bytes of a message, and where its stamp and its numbers stand. data: of a whole message, CDR."""

    def __init__(self, store: Any, message: Any, data: bytes, paths: Sequence[str]) -> None:
        self._data = data
        places = {path: (at, code) for path, at, code in _leaves(store, message)}
        stamp = next(path for path in places if path.endswith(STAMPS))
        self._stamp, self._at = Struct("<iI"), places[stamp][0]
        numbers = [(self._at, "i"), (self._at + 4, "I"), *(places[path] for path in paths)]
        self._row = np.dtype({
            "names": [str(i) for i in range(len(numbers))],
            "formats": [f"<{code}" if code not in "?bB" else code for _, code in numbers],
            "offsets": [at for at, _ in numbers],
            "itemsize": len(data),
        })  # fmt: skip
        self._runs: list[tuple[Struct, int, slice]] = []
        first = 0
        for i, path in enumerate(paths):
            at, code = places[path]
            follows = i + 1 < len(paths) and places[paths[i + 1]][0] == at + calcsize(code)
            if not follows:
                codes = "".join(places[p][1] for p in paths[first : i + 1])
                self._runs.append((Struct("<" + codes), places[paths[first]][0], slice(first, i + 1)))
                first = i + 1

    def fill(self, t: int, values: Sequence[float]) -> bytes:
        """The bytes of the message with another stamp [ns] and other numbers."""
        data = bytearray(self._data)
        self._stamp.pack_into(data, self._at, *divmod(max(int(t), 0), NS))
        for numbers, at, part in self._runs:
            numbers.pack_into(data, at, *values[part])
        return bytes(data)

    def fill_all(self, t: NDArray[np.int64], columns: Sequence[Any]) -> list[bytes]:
        """The same of many messages; t and columns (n,)."""
        size, count = len(self._data), len(t)
        rows = np.frombuffer(bytearray(self._data) * count, self._row)
        for i, column in enumerate((*np.divmod(np.maximum(t, 0), NS), *columns)):
            rows[str(i)] = column
        data = rows.tobytes()
        return [data[at : at + size] for at in range(0, size * count, size)]


def _leaves(store: Any, message: Any) -> Iterator[tuple[str, int, str]]:
    """(path, offset in the bytes, struct code) of all numbers of a message."""
    walk = _Walk(store)
    yield from walk.fields("", message)


class _Walk:
    """Goes through a message as CDR does. at: offset behind the encapsulation header."""

    def __init__(self, store: Any) -> None:
        self.store, self.at = store, 0

    def fields(self, path: str, message: Any) -> Iterator[tuple[str, int, str]]:
        for name, kind in self.store.fielddefs[message.__msgtype__][1]:
            yield from self._field(f"{path}{name}", kind, getattr(message, name))

    def _field(self, path: str, kind: Any, value: Any) -> Iterator[tuple[str, int, str]]:
        from rosbags.interfaces import Nodetype

        node, detail = kind
        if node == Nodetype.NAME:
            yield from self.fields(path + ".", value)
        elif node == Nodetype.BASE:
            yield from self._number(path, detail[0], value)
        else:
            if node == Nodetype.SEQUENCE:
                self._skip(4)
            for i, element in enumerate(value):
                yield from self._field(f"{path}.{i}", detail[0], element)

    def _number(self, path: str, name: str, value: Any) -> Iterator[tuple[str, int, str]]:
        if name == "string":
            self._skip(4)
            self.at += len(value.encode()) + 1
            return
        size = calcsize(CODES[name])
        at = self._skip(size)
        yield path, HEAD + at, CODES[name]

    def _skip(self, size: int) -> int:
        at = self.at = -(-self.at // size) * size
        self.at += size
        return at


# Public definitions that rosbags' Jazzy set lacks, and that of swath which no sample type gives.
OWN_TYPES = {
    MSGTYPE: DEFINITION,
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\n"
    "float32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\n"
    "ackermann_msgs/AckermannDrive drive\n",
    "radar_msgs/msg/RadarReturn": "float32 range\nfloat32 azimuth\nfloat32 elevation\n"
    "float32 doppler_velocity\nfloat32 amplitude\n",
    "radar_msgs/msg/RadarScan": "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n",
}

_PUBLIC: dict[str, Any] = {}  # what rosbags compiled for public types, for all files of a process


class MessageFactory:
    """Makes messages of the types in its `store`."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in OWN_TYPES.items():
            self.store.register(_parsed(text, name))
        self._public = frozenset(self.store.fielddefs)
        self.store.cache.update(_PUBLIC)
        self._zeros: dict[str, dict[str, Any]] = {}
        self._kinds: dict[str, dict[str, str]] = {}

    def __call__(self, msgtype: str, **values: Any) -> Any:
        """A message, e.g. make("geometry_msgs/msg/Point", x=1.0); what is not given is 0 or empty."""
        if msgtype not in self._zeros:
            _, described = self.store.fielddefs[msgtype]
            self._zeros[msgtype] = {name: self._zero(kind) for name, kind in described}
        return self.store.types[msgtype](**{**self._zeros[msgtype], **values})

    def keep(self) -> None:
        """What has been compiled to write public types serves later files, too."""
        _PUBLIC.update((name, made) for name, made in self.store.cache.items() if name in self._public)

    def header(self, t: int, frame: str) -> Any:
        """std_msgs/Header of a simulated time [ns]; times before 0 count as 0."""
        sec, nanosec = divmod(max(int(t), 0), NS)
        stamp = self("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def point(self, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Point [m]."""
        return self("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        """geometry_msgs/Vector3."""
        return self("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def quaternion(self, pose: Pose) -> Any:
        """geometry_msgs/Quaternion of a pose's rotation."""
        x, y, z, w = pose.quaternion()
        return self("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, pose: Pose) -> Any:
        """geometry_msgs/Pose."""
        at = self.point(*pose.position)
        return self("geometry_msgs/msg/Pose", position=at, orientation=self.quaternion(pose))

    def twist(self, forward: float, leftward: float = 0.0, yaw_rate: float = 0.0) -> Any:
        """geometry_msgs/Twist [m/s, rad/s]."""
        linear, angular = self.vector(forward, leftward), self.vector(z=yaw_rate)
        return self("geometry_msgs/msg/Twist", linear=linear, angular=angular)

    def odometry(self, header: Any, child: str, pose: Pose, twist: Any, *covariances: F64) -> Any:
        """nav_msgs/Odometry of a frame `child`. covariances: of pose and twist, (36,) each, none = 0."""
        place, motion = covariances or (np.zeros(36), np.zeros(36))
        at = self("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(pose), covariance=place)
        moving = self("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=motion)
        return self("nav_msgs/msg/Odometry", header=header, child_frame_id=child, pose=at, twist=moving)

    def transform(self, t: int, parent: str, child: str, pose: Pose) -> Any:
        """geometry_msgs/TransformStamped: pose_parent_child at t [ns]."""
        turn, header = self.quaternion(pose), self.header(t, parent)
        move = self("geometry_msgs/msg/Transform", translation=self.vector(*pose.position), rotation=turn)
        return self("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=move)

    def marker(
        self,
        header: Any,
        name: str,
        kind: int,
        colour: Sequence[float],
        size: Sequence[float],
        *,
        pose: Pose | None = None,
        points: Iterable[Sequence[float]] = (),
        **more: Any,
    ) -> Any:
        """visualization_msgs/Marker of a namespace. colour: red, green, blue, alpha; size: along x, y, z."""
        return self(
            "visualization_msgs/msg/Marker",
            header=header,
            ns=name,
            type=kind,
            pose=self.pose(pose or Pose.identity()),
            scale=self.vector(*size),
            color=self("std_msgs/msg/ColorRGBA", **dict(zip("rgba", colour, strict=True))),
            points=[self.point(*point) for point in points],
            **more,
        )

    def of_signal(self, signal: Signal, frame: str) -> Any:
        """A `swath_msgs/msg/<Class>` with a header and the sample's own fields; arrays are flattened."""
        msgtype = f"swath_msgs/msg/{type(signal).__name__}"
        if msgtype not in self._kinds:
            self.store.register(_parsed(definition(type(signal)), msgtype))
            self._kinds[msgtype] = _field_kinds(type(signal))
        kinds = self._kinds[msgtype].items()
        values = {name: self._value(getattr(signal, name), kind) for name, kind in kinds}
        return self(msgtype, header=self.header(signal.t, frame), **values)

    def _value(self, value: Any, kind: str) -> Any:
        if kind.endswith("[]"):
            return np.ascontiguousarray(value, dtype=kind.removesuffix("[]")).ravel()
        if kind == "geometry_msgs/Pose":
            return self.pose(value)
        plain: dict[str, Any] = {"float64": float, "int64": int, "bool": bool, "string": str}
        return plain[kind](value)

    def _zero(self, kind: Any) -> Any:
        """The value of a field that is not given, from its description in rosbags."""
        from rosbags.interfaces import Nodetype

        node, detail = kind
        if node == Nodetype.NAME:
            return self(detail)
        if node == Nodetype.BASE:
            name = detail[0]
            return "" if name == "string" else False if name == "bool" else 0.0 if "float" in name else 0
        (inner, what), count = detail
        length = count if node == Nodetype.ARRAY else 0
        if inner == Nodetype.BASE and what[0] != "string":
            return np.zeros(length, dtype={"octet": "uint8", "byte": "uint8"}.get(what[0], what[0]))
        return [self._zero((inner, what)) for _ in range(length)]


@cache
def _parsed(text: str, name: str) -> Any:
    """Types that a definition gives."""
    from rosbags.typesys import get_types_from_msg

    return get_types_from_msg(text, name)


def definition(signal: type[Signal]) -> str:
    """The .msg text of a sample type: a header in place of `t`, then its fields by name.

    Fields that no ROS 2 type fits are left out.
    """
    lines = ["std_msgs/Header header"]
    lines += [f"{kind} {name}" for name, kind in _field_kinds(signal).items()]
    return "\n".join(lines) + "\n"


@per_signal
def plain_names(signal: type[Signal]) -> tuple[str, ...] | None:
    """The fields of the message of a sample type; None where not all of them are single numbers."""
    kinds = _field_kinds(signal)
    return tuple(kinds) if all(kind in ("float64", "int64", "bool") for kind in kinds.values()) else None


def _field_kinds(signal: type[Signal]) -> dict[str, str]:
    kinds = {name: _field_kind(field) for name, field in layout(signal).items()}
    return {name: kind for name, kind in kinds.items() if kind}


def _field_kind(field: Field) -> str:
    """Type of ROS 2; "" = none fits."""
    if field.kind == "pose":
        return "geometry_msgs/Pose"
    if field.kind == "object":
        return "string" if field.declared is str else ""
    number = field.number.name if field.number.name in CODES else ""
    return f"{number}[]" if number and field.kind == "array" else number


UNKNOWN = 1e6  # variance of what nobody knows
EXACT = 1e-12  # variance of what is exact: ROS 2 reads a covariance of zeros as unknown
OPTICAL_FRAME = "_optical"  # after the name of a camera's own frame, as REP 103 asks


@dataclass(frozen=True)
class RecordedMachine:
    """What the recording needs to know of a machine.

    name: its key in the scenario
    geometry: its data sheet
    edge_side: `left` or `right`
    mounting: sensor slot (without the machine's name) -> pose_machine_sensor
    origin: where on Earth the world's origin lies, if that is known
    outputs: `slot.output` -> type of its samples, in the order of the slots
    edge: the initial edge that it follows
    start: where it stood at first
    scanners: slot -> (time from scan to scan [s], least range, greatest range [m]) of its data sheet
    lines: what a viewer draws on the field, name -> points (n, 3) in the world [m]
    is_first: of the machines of the run
    errors: slot -> `KnowsErrors.errors` of its part, where that knows how far off it may be
    triangles: of its body where that is from a file, in the machine frame (n, 3, 3) [m]
    crop: `height` and `row_spacing` [m] as control knows them (`ControlSetup`)
    """

    name: str
    geometry: MachineGeometry
    edge_side: str
    mounting: Mapping[str, Pose] = field(default_factory=dict)
    origin: Origin | None = None
    outputs: Mapping[str, type[Signal]] = field(default_factory=dict)
    edge: EdgeShape | None = None
    start: Pose = field(default_factory=Pose.identity)
    scanners: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    errors: Mapping[str, Callable[[Any], Mapping[str, tuple[float, float]]]] = field(default_factory=dict)
    lines: Mapping[str, F64] = field(default_factory=dict)
    is_first: bool = True
    triangles: F64 = field(default_factory=lambda: np.zeros((0, 3, 3)))
    crop: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """An output of a slot of a machine, and what makes messages of its samples."""

    make: MessageFactory
    machine: RecordedMachine
    slot: str
    output: str

    @property
    def slot_topic(self) -> str:
        """`/machine/slot`."""
        return f"/{self.machine.name}/{self.slot.replace('.', '/')}"

    @property
    def topic(self) -> str:
        """`/machine/slot/output`."""
        return f"{self.slot_topic}/{self.output}"

    @property
    def base(self) -> str:
        """Frame of the machine."""
        return f"{self.machine.name}/base_link"

    @property
    def odom(self) -> str:
        """Frame in which odometry counts."""
        return f"{self.machine.name}/odom"

    @property
    def frame(self) -> str:
        """Frame of the sensor."""
        return f"{self.machine.name}/{self.slot}"

    def frame_of(self, signal: type[Signal]) -> str:
        """The frame that a signal declares."""
        frames = {"base": self.base, "sensor": self.frame, "world": "map"}
        return frames.get(signal.about.frame, self.frame + OPTICAL_FRAME)


class Sent(NamedTuple):
    """A message of a topic, or its draft.

    delivery: `latched` stays for late readers, `announced` only says it will come
    """

    topic: str
    message: Any
    delivery: Literal["", "latched", "announced"] = ""


class Many:
    """Samples of an output as one: each of its fields is a column, (n, ...), a pose as in `Block`."""

    def __init__(self, block: Block, which: Sequence[int]) -> None:
        self._block, self._which, self.kind = block, which, block.kind
        self.is_whole = len(which) == len(block)

    def __getattr__(self, name: str) -> NDArray[Any]:
        column = self._block[name]
        return column if self.is_whole else column[self._which]


class Uneven(Exception):
    """Many samples have no message in common."""


def common(value: Any) -> Any:
    """What a field of a sample holds, or that of many samples, all of which hold the same; else Uneven."""
    if not isinstance(value, np.ndarray):
        return value
    if (value != value[0]).any():
        raise Uneven
    return value[0].item()


def place_of(pose: Any) -> tuple[Any, ...]:
    """Position and quaternion (x, y, z, w) of a pose, seven numbers; of many seven columns."""
    if isinstance(pose, Pose):
        return (*pose.position.tolist(), *pose.quaternion())
    return (*pose[:, :3].T, *np.array([own.quaternion() for own in poses_of(pose)]).T)


Maker = Callable[[Source], Callable[[Any], Iterator[Sent]]]  # called with each sample of one output


def own_messages(source: Source, signal: Any) -> Iterator[Sent]:
    """Any sample as one `swath_msgs/msg/<Class>` with all its fields, in the frame that it declares."""
    kind = signal.kind if isinstance(signal, Many) else type(signal)
    names = plain_names(kind)

    def build() -> Any:
        return source.make.of_signal(signal, source.frame_of(kind))

    if names is None:
        yield Sent(source.topic, build())
    else:
        yield Sent(source.topic, Draft(signal.t, names, [getattr(signal, name) for name in names], build))
