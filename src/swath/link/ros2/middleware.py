"""rclpy: found, started and stopped.

One context for the process, without rclpy's signal handlers: Ctrl-C stays swath's. ROS 2 does not ask who
somebody is, so nodes are on this machine only, unless they are opened inside `networked`.
"""

import importlib.util
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from importlib.resources import files
from typing import Any

from swath.core.errors import MissingExtra, SwathError
from swath.core.process.processes import in_environment

DEPTH = 100  # messages that a slow reader may lag behind before it loses some
CLOCK_PERIOD = 10_000_000  # simulated time between two /clock messages [ns]

WITHOUT_RANGE = ("foxy", "galactic", "humble")  # distributions that know ROS_LOCALHOST_ONLY instead

_context: Any = None
_users = 0
_is_networked: ContextVar[bool] = ContextVar("is_networked", default=False)


@contextmanager
def networked() -> Iterator[None]:
    """Inside the block nodes are on the network, as ROS 2 is set up; the first of a process decides."""
    token = _is_networked.set(True)
    try:
        yield
    finally:
        _is_networked.reset(token)


@contextmanager
def _within_reach() -> Iterator[None]:
    """The environment in which ROS 2 starts: nodes of this machine alone, unless inside `networked`.

    With Fast DDS, the default, its sockets are those of the loopback interface too, unless the user has a
    profile of his own; others only have to look for nobody elsewhere. A profile that lies in the working
    folder may name addresses and log files: it is left unread.
    """
    wanted = {"SKIP_DEFAULT_XML_FILE": "1"}
    if _is_networked.get():
        with in_environment(**wanted):
            yield
        return
    wanted["ROS_STATIC_PEERS"] = ""
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") != "OFF":
        wanted["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    if os.environ.get("ROS_DISTRO") in WITHOUT_RANGE:
        wanted["ROS_LOCALHOST_ONLY"] = "1"
    profile = str(files("swath.data") / "ros2" / "this_machine.xml")
    wanted["FASTRTPS_DEFAULT_PROFILES_FILE"] = os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE", profile)
    with in_environment(**wanted):
        yield


def need_rclpy(what: str) -> None:
    """Raises MissingExtra without rclpy, SwathError where it is there but does not load."""
    if importlib.util.find_spec("rclpy") is None:
        raise MissingExtra("ros2", what)
    try:
        import rclpy.executors  # noqa: F401
    except ImportError as error:
        raise SwathError(
            f"{what}: rclpy is installed but does not load ({error}); of a system ROS 2 its setup.bash must "
            "be sourced, of wheels this Python must be started by its own name (venv/bin/python)"
        ) from error


def has_type(msgtype: str) -> bool:
    """True when a message type such as `tf2_msgs/msg/TFMessage` is installed."""
    return _find(msgtype) is not None


def type_of(msgtype: str) -> Any:
    """The rclpy class of `package/msg/Name`. SwathError when it is not installed."""
    found = _find(msgtype)
    if found is None:
        raise SwathError(f"{msgtype}: this message type is not installed")
    return found


def _find(msgtype: str) -> Any:
    package, _, name = msgtype.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        return None


def open_node(name: str, what: str, **options: Any) -> Any:
    """A node in the context of this process; give it back with `close_node`. what: for the error message."""
    need_rclpy(what)
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions

    global _context, _users
    with _within_reach():
        if _context is None:
            _context = Context()
            rclpy.init(args=[], context=_context, signal_handler_options=SignalHandlerOptions.NO)
        _users += 1
        return Node(name, context=_context, enable_rosout=False, **options)


def close_node(node: Any) -> None:
    """Destroy a node; the last one takes the context along."""
    global _context, _users
    node.destroy_node()
    _users -= 1
    if _users == 0:
        _context.try_shutdown()
        _context = None


def latched_qos() -> Any:
    """Reliable, and what was sent is given to who comes later: as /tf_static wants it."""
    return stream_qos("TRANSIENT_LOCAL")


def stream_qos(durability: str = "VOLATILE") -> Any:
    """Reliable, so that best-effort and reliable readers both match; for topics that never rest."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy[durability],
    )


class Clock:
    """Publishes `/clock`, every 10 ms of simulated time. due: when next [ns]."""

    def __init__(self, node: Any) -> None:
        kind = type_of("rosgraph_msgs/msg/Clock")
        self._publisher, self._message = node.create_publisher(kind, "/clock", stream_qos()), kind()
        self.due = 0

    def publish(self, t: int) -> None:
        """The time t [ns]."""
        self.due = t + CLOCK_PERIOD
        set_stamp(self._message.clock, t)
        self._publisher.publish(self._message)


def stamp_ns(stamp: Any) -> int:
    """builtin_interfaces/Time as simulated time [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def set_stamp(stamp: Any, t: int) -> None:
    """Simulated time [ns] into a builtin_interfaces/Time; times before 0 count as 0."""
    stamp.sec, stamp.nanosec = divmod(max(int(t), 0), 1_000_000_000)
