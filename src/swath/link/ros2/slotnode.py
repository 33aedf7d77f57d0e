"""The swath side of a slot played by a ROS 2 node: sends every step, collects the answer with its stamp.

A scan goes as it is, beam by beam: sensor_msgs/PointCloud2, one row per beam and one column per echo.

LaserScan and a cloud of echoes, which the recording holds, are what ROS users know, but they round the angles
and leave out beams without an echo. This cloud keeps everything to the last bit: the fields `x`, `y`, `z`,
`intensity` (float32, what a viewer looks for), `range` (float32) and `azimuth`, `elevation`, `time` (float64)
of every beam; no echo is nan. The stamp is the end of the sweep.

Other samples go as stamped lists of named numbers, sensor_msgs/JointState with `name` and `position`: ROS 2
has no message for a crop edge or for what is in a threshing drum. JointState is its one stamped list of
named float64 numbers; every number of a sample goes over it exactly, and viewers plot it by name. A name is
`port.field`, e.g. `edge.offset`, `odometry.speed`, `state.pose.yaw`, and `port.t_ns` for the time the sample
is valid for [ns]. Booleans are 0 and 1. A sample that does not exist has no names.
"""

import logging
import time
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from swath.core.component import Inputs, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.schedule import NS
from swath.core.units import digits_in
from swath.link.ros2.middleware import close_node, latched_qos, open_node, set_stamp, stamp_ns, type_of
from swath.signals import Scan, Signal
from swath.signals.flat import build, flat_fields, is_bulky, read
from swath.signals.setup import LinkSetup

AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def numbers_of(prefix: str, sample: Signal) -> dict[str, float]:
    """Every number of a sample by name, with its time; an array as `name.0`, `name.1` ..."""
    found = {f"{prefix}.t_ns": float(sample.t)}
    for field in flat_fields(type(sample)).values():
        value = read(sample, field.name)
        if field.kind == "array":
            flat = np.ravel(value)
            found |= {f"{prefix}.{field.name}.{i}": float(v) for i, v in enumerate(flat)}
        else:
            found[f"{prefix}.{field.name}"] = float(value)
    return found


def numbers_of_inputs(inputs: Mapping[str, Any]) -> dict[str, float]:
    """Every number of a slot's inputs; of a scan or an image only its time, `scan.t_ns`.

    Of a port with history, `port.0.field` is the oldest sample's since the last step, and so on; `port.field`
    is the newest.
    """
    found: dict[str, float] = {}
    for port, value in inputs.items():
        samples = value if isinstance(value, tuple) else ((value,) if value is not None else ())
        if not samples:
            continue
        if is_bulky(type(samples[-1])):
            found[f"{port}.t_ns"] = float(samples[-1].t)
            continue
        found |= numbers_of(port, samples[-1])
        if isinstance(value, tuple):
            for index, sample in enumerate(samples):
                found |= numbers_of(f"{port}.{index}", sample)
    return found


def numbers_of_setup(setup: LinkSetup) -> dict[str, float]:
    """What a node gets first: geometry [m, rad], period [s], mountings of the sensors wired to the slot.

    The names of one mounting begin with `setup.mounting.`, of several with `setup.mounting.PORT.`; an
    inertial unit does not count and always is `setup.mounting.inertial.`.
    """
    control = setup.control
    names = ("wheelbase", "front_track", "rear_track", "max_steer", "header_width", "knife_x", "header_y")
    found = {
        "setup.period": control.period,
        "setup.edge_is_left": float(control.edge_side == "left"),
        **{f"setup.{name}": float(getattr(control.machine, name)) for name in names},
    }
    alone = len(control.mountings.keys() - {"inertial"}) == 1
    for port, pose in control.mountings.items():
        lead = "setup.mounting" if alone and port != "inertial" else f"setup.mounting.{port}"
        values = (*pose.position.tolist(), *pose.euler())
        found |= {f"{lead}.{axis}": float(v) for axis, v in zip(AXES, values, strict=True)}
    return found


def sample_of(port: Port, t: int, numbers: Mapping[str, float]) -> Signal | None:
    """The sample of an output port from an answer, None when no name of it is in there.

    It is valid at t [ns], or when `port.t_ns` says so.
    Raises SwathError that names what is missing or unknown.
    """
    lead = f"{port.name}."
    own = {name[len(lead) :]: value for name, value in numbers.items() if name.startswith(lead)}
    valid_at = round(own.pop("t_ns", t))
    if not own:
        return None
    fields = flat_fields(port.signal)
    values: dict[str, Any] = {}
    arrays: dict[str, dict[int, float]] = {}
    for name, value in own.items():
        first, _, index = name.rpartition(".")
        if digits_in(index) >= 0 and first in fields and fields[first].kind == "array":
            arrays.setdefault(first, {})[int(index)] = value
        else:
            values[name] = value
    values |= {name: [rows[i] for i in sorted(rows)] for name, rows in arrays.items()}
    try:
        return build(port.signal, valid_at, values)
    except InputError as error:
        raise SwathError(f"{port.name}: {error}") from error


def check_names(ports: Iterable[Port], numbers: Mapping[str, float]) -> None:
    """SwathError for a name that starts with none of the ports."""
    known = tuple(port.name for port in ports)
    for name in numbers:
        if name.partition(".")[0] not in known:
            raise SwathError(
                f"{name}: expected a name that starts with {' or '.join(f'{p}.' for p in known)}"
            )


LAYOUT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "intensity", "range")),
        ("pad", "<f4"),
        *((name, "<f8") for name in ("azimuth", "elevation", "time")),
    ]
)
FLOAT32, FLOAT64 = 7, 8  # sensor_msgs/PointField
NEEDED = ("range", "azimuth", "elevation", "time")


def table_of(scan: Scan) -> np.ndarray[Any, Any]:
    """The cloud's data, shape (beam_count, echo_count)."""
    table = np.zeros(scan.ranges.shape, dtype=LAYOUT)
    points = scan.points()
    for axis, name in enumerate("xyz"):
        table[name] = points[:, :, axis]
    table["intensity"], table["range"] = scan.intensity, scan.ranges
    for name, column in (("azimuth", scan.azimuth), ("elevation", scan.elevation), ("time", scan.beam_t)):
        table[name] = column[:, None]
    return table


def fill_cloud(message: Any, scan: Scan, make_field: Any) -> Any:
    """Fill a PointCloud2 but for its header. make_field: the class sensor_msgs.msg.PointField."""
    table = table_of(scan)
    message.height, message.width = table.shape
    message.fields = [
        make_field(
            name=name, offset=int(offset), datatype=FLOAT32 if kind.itemsize == 4 else FLOAT64, count=1
        )
        for name, (kind, offset, *_) in (LAYOUT.fields or {}).items()
        if name != "pad"
    ]
    message.is_bigendian, message.is_dense = False, False
    message.point_step, message.row_step = LAYOUT.itemsize, LAYOUT.itemsize * table.shape[1]
    message.data = table.tobytes()
    return message


def scan_of(message: Any, t: int) -> Scan:
    """The scan of such a cloud; fields may lie in any order and be float32 or float64.

    `intensity` may be missing (then nan). SwathError for a cloud that lacks another field.
    """
    kinds = {FLOAT32: "f4", FLOAT64: "f8"}
    order = ">" if message.is_bigendian else "<"
    fields = {f.name: (order + kinds[f.datatype], f.offset) for f in message.fields if f.datatype in kinds}
    if missing := [name for name in NEEDED if name not in fields]:
        raise SwathError(f"a scan's cloud has no field {missing[0]} of float32 or float64")
    formats, offsets = zip(*fields.values(), strict=True)
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": list(formats),
            "offsets": list(offsets),
            "itemsize": message.point_step,
        }
    )
    table = np.frombuffer(bytes(message.data), dtype=layout).reshape(message.height, message.width)
    ranges = np.array(table["range"], dtype=np.float32)
    bright = table["intensity"] if "intensity" in fields else np.full(ranges.shape, np.nan)
    beam_t, azimuth, elevation = (
        np.array(table[name][:, 0], dtype=np.float64) for name in ("time", "azimuth", "elevation")
    )
    return Scan(t, beam_t, azimuth, elevation, ranges, np.array(bright, dtype=np.float32))


JOINT_STATE, CLOUD = "sensor_msgs/msg/JointState", "sensor_msgs/msg/PointCloud2"
DEPTH = 10
POLL_S = 0.5
PATIENCE_S = 5.0  # without a node, until it is said which one is waited for
UNKNOWN = "_UNKNOWN_"  # in the name of a node of which only an end is known yet


class NodeSilent(SwathError):
    """A node that plays a slot did not answer in time."""


def topic_name(*parts: str) -> str:
    """`/combine/steer/step`, with what ROS 2 does not allow in a name replaced by `_`."""
    return "/" + "/".join(part.replace("-", "_") for part in parts)


class SlotNode:
    """Publisher of a slot's inputs, subscriber of its outputs.

    Raises MissingExtra without rclpy.
    """

    def __init__(self, setup: LinkSetup, inputs: tuple[Port, ...], outputs: tuple[Port, ...]) -> None:
        self._setup = setup
        machine, slot = setup.machine_name, setup.slot
        self._records = tuple(p for p in outputs if p.signal is not Scan)
        self._clouds = tuple(p for p in outputs if p.signal is Scan)
        self.step_topic = topic_name(machine, slot, "step")
        self.answer_topic = topic_name(machine, slot, "answer")
        name = f"swath_{machine}_{slot}".replace("-", "_")
        self._node = open_node(name, setup.name, start_parameter_services=False)
        from rclpy.executors import SingleThreadedExecutor

        self._record, self._cloud = type_of(JOINT_STATE), type_of(CLOUD)
        self._point_field = type_of("sensor_msgs/msg/PointField")
        self._asking = self._node.create_publisher(self._record, self.step_topic, DEPTH)
        self._sending = {
            p.name: self._node.create_publisher(self._cloud, f"{self.step_topic}/{p.name}", latched_qos())
            for p in inputs
            if p.signal is Scan
        }
        self._frames = {p: setup.sources.get(p, f"{machine}.{p}").replace(".", "/") for p in self._sending}
        self._answers: dict[str, Any] = {}  # "" (the record) or port (a cloud) -> newest message
        self._wanted = self._subscribe()
        self._executor = SingleThreadedExecutor(context=self._node.context)
        self._executor.add_node(self._node)
        self._names: list[str] = []

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        close_node(self._node)

    def find(self, deadline: float) -> None:
        """Wait until a node listens and answers, at most until `deadline` (time.monotonic).

        Raises NodeSilent when none came, SwathError when more than one would answer.
        """
        topics = list(self._wanted)
        self._answers.clear()
        told_at = time.monotonic() + PATIENCE_S
        while True:
            listens = self._asking.get_subscription_count() > 0
            talks = all(self._node.count_publishers(topic) > 0 for topic in topics)
            if listens and talks:
                break
            now = time.monotonic()
            what = f"publishes on {topics[0]}" if listens else f"listens on {self.step_topic}"
            if now > deadline:
                raise NodeSilent(
                    f"{self._setup.name}: no node {what}; one must play this slot (docs/how-to/ros2.md), "
                    "with the same ROS_DOMAIN_ID"
                )
            if now > told_at:
                told_at = deadline
                text = "swath: %s: no node %s yet, waiting for it for %.0f s more"
                logging.getLogger(__name__).warning(text, self._setup.name, what, deadline - now)
            time.sleep(0.01)
        self._names = self._speakers()
        while any(UNKNOWN in name for name in self._names) and time.monotonic() < deadline:
            time.sleep(0.01)  # an end may be known before the node that it belongs to
            self._names = self._speakers()
        if self._node.count_publishers(topics[0]) > 1:
            raise SwathError(
                f"{self._setup.name}: expected one node that publishes on {topics[0]}, "
                f"there are {', '.join(self._names)}"
            )

    def ask(self, t: int, dt: int, inputs: Inputs, *, is_reset: bool = False) -> None:
        """Publish the inputs of the step that ends at t [ns]."""
        for port, publisher in self._sending.items():
            value = inputs.get(port)
            for scan in value if isinstance(value, tuple) else (() if value is None else (value,)):
                message = self._cloud()
                set_stamp(message.header.stamp, scan.t)
                message.header.frame_id = self._frames[port]
                publisher.publish(fill_cloud(message, scan, self._point_field))
        numbers = {"step.dt": dt / NS, "step.reset": float(is_reset)}
        numbers |= numbers_of_setup(self._setup) if is_reset else numbers_of_inputs(inputs)
        message = self._record()
        set_stamp(message.header.stamp, t)
        message.header.frame_id = self._setup.name
        message.name, message.position = list(numbers), list(numbers.values())
        self._asking.publish(message)

    def answer(self, t: int, deadline: float) -> Outputs | None:
        """The outputs with stamp t [ns], None when they are not there by `deadline` (time.monotonic)."""
        while True:
            if all(self._is_for(key, t) for key in self._wanted.values()):
                return self._outputs_of(t)
            left = deadline - time.monotonic()
            if left <= 0.0:
                return None
            self._executor.spin_once(timeout_sec=min(left, POLL_S))

    def newest(self) -> Outputs | None:
        """The newest complete answer that came since the last call, of whatever step; None without one."""
        before = dict(self._answers)
        for _ in range(DEPTH * len(self._wanted)):
            self._executor.spin_once(timeout_sec=0.0)
        found = [self._answers.get(key) for key in self._wanted.values()]
        times = {stamp_ns(message.header.stamp) for message in found if message is not None}
        if None in found or len(times) != 1 or self._answers == before:
            return None
        return self._outputs_of(times.pop())

    def why_silent(self, t: int, waited_s: float) -> str:
        """One line for the error: which node did not answer which step."""
        present = self._speakers()
        if self._names and not present:
            missing = f"the node {self._names[0]} has ended"
        elif names := present or self._names:
            missing = f"the node {names[0]} is silent"
        else:
            missing = "no node publishes there"
        late = [topic for topic, key in self._wanted.items() if not self._is_for(key, t)]
        stamps = [stamp_ns(m.header.stamp) / NS for m in self._answers.values()]
        last = f"; its last answer was for {max(stamps):g} s" if stamps else "; it never answered"
        where = " and ".join(late)
        name = self._setup.name
        return f"{name}: no answer for {t / NS:g} s on {where} within {waited_s:g} s: {missing}{last}"

    def _subscribe(self) -> dict[str, str]:
        """Key by topic in `_answers`, of everything that makes an answer complete."""
        wanted = {self.answer_topic: ""} if self._records else {}
        wanted |= {f"{self.answer_topic}/{port.name}": port.name for port in self._clouds}
        for topic, key in wanted.items():
            kind = self._cloud if key else self._record
            self._node.create_subscription(kind, topic, partial(self._answers.__setitem__, key), DEPTH)
        return wanted

    def _is_for(self, key: str, t: int) -> bool:
        message = self._answers.get(key)
        return message is not None and stamp_ns(message.header.stamp) == t

    def _outputs_of(self, t: int) -> Outputs:
        try:
            return self._records_of(t) | {p.name: scan_of(self._answers[p.name], t) for p in self._clouds}
        except SwathError as error:
            missing = f"the answer of {', '.join(self._names) or 'a node'} for {t / NS:g} s"
            raise SwathError(f"{self._setup.name}: {missing}: {error}") from error

    def _records_of(self, t: int) -> Outputs:
        if not self._records:
            return {}
        message = self._answers[""]
        if len(message.name) != len(message.position):
            raise SwathError(f"{len(message.name)} names, but {len(message.position)} positions")
        numbers = dict(zip(message.name, message.position, strict=True))
        check_names(self._records, numbers)
        made: dict[str, Signal] = {}
        for port in self._records:
            sample = sample_of(port, t, numbers)
            if sample is None:
                raise SwathError(f"expected names that start with {port.name}.")
            made[port.name] = sample
        return made

    def _speakers(self) -> list[str]:
        """Full names of the nodes that publish answers."""
        infos = self._node.get_publishers_info_by_topic(next(iter(self._wanted)))
        return sorted({f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in infos})
