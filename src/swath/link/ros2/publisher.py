"""Publishes the recording: the same topics, frames, times and bytes as run.mcap.

A message whose type is installed is sent as the CDR bytes of the file. Where a type is not installed (the
wheels lack tf2_msgs and ackermann_msgs, swath_msgs exists in recordings only) a standard message is sent:

    tf2_msgs/TFMessage on /tf, /tf_static        geometry_msgs/TransformStamped, one per transform, on
                                                 /transforms, /transforms_static
    ackermann_msgs/AckermannDriveStamped         sensor_msgs/JointState: steering angle and its rate
    swath_msgs/<Class>                           sensor_msgs/JointState: fields by name

An installed type with other fields than the recording's (an old distribution's Marker) is left out: a warning
names it. `/clock` is left to whoever publishes the recording, who keeps its pace.
"""

import logging
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from swath.link.ros2.middleware import has_type, latched_qos, stream_qos, type_of

JOINT_STATE = "sensor_msgs/msg/JointState"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
CLOCK = "/clock"
TRANSFORM_TOPICS = {"/tf": "/transforms", "/tf_static": "/transforms_static"}

Substitute = Callable[[Any, Any], Iterator[Any]]
Route = Callable[[bytes, Callable[[], Any]], None]


class Publisher:
    """A tap of the recording (`McapFile.taps`). node: of rclpy; store: the recording's message types.

    count: messages published so far; left_out: topics that are not published -> why; replaced: those of which
    standard messages are sent
    """

    def __init__(self, node: Any, store: Any) -> None:
        self._node, self._store = node, store
        self._routes: dict[str, Route | None] = {}
        self._publishers: dict[str, Any] = {}
        self.count = 0
        self.left_out: dict[str, str] = {}
        self.replaced = set[str]()

    def __call__(self, topic: str, t: int, data: bytes, build: Callable[[], Any], is_latched: bool) -> None:
        """Publish one message."""
        if topic not in self._routes:
            self.declare(topic, build(), is_latched)
        if (route := self._routes[topic]) is not None:
            route(data, build)

    def declare(self, topic: str, message: Any, is_latched: bool) -> None:
        """Create the publisher of a topic; does nothing where there is one."""
        if topic not in self._routes:
            self._routes[topic] = self._route(topic, message, is_latched)

    def close(self) -> None:
        """Withdraw every topic."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()
        self._routes.clear()

    def _route(self, topic: str, message: Any, is_latched: bool) -> Route | None:
        msgtype = message.__msgtype__
        if topic == CLOCK:
            return None
        if has_type(msgtype):
            # of ROS 2, where constants alone are in capitals; rosbags keeps them beside the fields
            wanted = [name for name in vars(message) if not (name.startswith("_") or name.isupper())]
            if list(type_of(msgtype).get_fields_and_field_types()) != wanted:
                self._leave_out(topic, f"the installed {msgtype} has other fields")
                return None
            publisher = self._publisher(topic, msgtype, is_latched)
            return lambda data, _: self._send(publisher, data)
        found = _substitute_of(msgtype, message)
        if found is None:
            self._leave_out(topic, f"{msgtype} is not installed, and no standard message replaces it")
            return None
        other, make = found
        self.replaced.add(topic)
        publisher = self._publisher(TRANSFORM_TOPICS.get(topic, topic), other, is_latched)

        def send(_: bytes, build: Callable[[], Any]) -> None:
            for made in make(self._store, build()):
                self._send(publisher, bytes(self._store.serialize_cdr(made, other)))

        return send

    def _leave_out(self, topic: str, why: str) -> None:
        is_new = why not in self.left_out.values()
        self.left_out[topic] = why
        if is_new:
            text = "swath: %s is not published: %s (all such topics: `ros2.left_out` of summary.json)"
            logging.getLogger(__name__).warning(text, topic, why)

    def _publisher(self, topic: str, msgtype: str, is_latched: bool) -> Any:
        if topic not in self._publishers:
            qos = latched_qos() if is_latched else stream_qos()
            name = topic.replace("-", "_")
            self._publishers[topic] = self._node.create_publisher(type_of(msgtype), name, qos)
        return self._publishers[topic]

    def _send(self, publisher: Any, data: bytes) -> None:
        publisher.publish(data)
        self.count += 1


def _substitute_of(msgtype: str, message: Any) -> tuple[str, Substitute] | None:
    if msgtype == "tf2_msgs/msg/TFMessage":
        return TRANSFORM, lambda store, given: iter(given.transforms)
    if msgtype == "ackermann_msgs/msg/AckermannDriveStamped":
        return JOINT_STATE, _steering
    is_plain = all(_is_number(v) for name, v in vars(message).items() if not _is_frame(name))
    return (JOINT_STATE, _numbers) if is_plain else None


def _steering(store: Any, given: Any) -> Iterator[Any]:
    drive = given.drive
    angle, rate = np.array([drive.steering_angle]), np.array([drive.steering_angle_velocity])
    yield _joint_state(store, given.header, ["steering"], angle, rate)


def _numbers(store: Any, given: Any) -> Iterator[Any]:
    names: list[str] = []
    values: list[float] = []
    for name, value in vars(given).items():
        if _is_frame(name):
            continue
        if isinstance(value, np.ndarray):
            names += [f"{name}.{i}" for i in range(value.size)]
            values += [float(v) for v in value.ravel()]
        else:
            names.append(name)
            values.append(float(value))
    yield _joint_state(store, given.header, names, np.array(values))


def _joint_state(store: Any, header: Any, names: list[str], position: Any, velocity: Any = None) -> Any:
    none = np.zeros(0)
    velocity = none if velocity is None else velocity
    made = store.types[JOINT_STATE]
    return made(header=header, name=names, position=position, velocity=velocity, effort=none)


def _is_frame(name: str) -> bool:
    return name == "header" or name.startswith("__")


def _is_number(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return str(value.dtype) in ("float32", "float64")
    return isinstance(value, (bool, int, float))
