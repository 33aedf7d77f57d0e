"""Speed and curvature from a node that drives by one stream: Twist on `/cmd_vel`, or AckermannDrive.

Such nodes (navigation stacks, teleoperation, teaching examples) know no slots: they publish whenever they
like, and the newest command counts. A command that stays out for `hold_s` of simulated time stops the machine
and releases the steering, as `cmd_vel_timeout` of ros2_controllers does.
"""

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Gt, Le

from swath.core.component import Inputs, KeptElsewhere, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.link.ros2.middleware import close_node, open_node, type_of
from swath.link.ros2.slotnode import DEPTH, PATIENCE_S, NodeSilent
from swath.signals import SpeedCommand, SteerCommand
from swath.signals.setup import LinkSetup

SLOTS = {"steer": Port("command", SteerCommand), "speed": Port("command", SpeedCommand)}
STANDSTILL = 0.05  # below it a yaw rate says nothing about a curvature [m/s]


@dataclass(frozen=True)
class Drive:
    """What a message asks for. speed [m/s]; curvature of the path at the fixed axle, > 0 left [1/m], None
    where the message leaves it open (a yaw rate at standstill).
    """

    speed: float
    curvature: float | None


@dataclass(frozen=True)
class CommandStream:
    """One kind of message.

    level: its name in a scenario
    topic: the usual one
    package, name: of the message
    field: in the stamped one, of the command
    read: the command and the wheelbase [m] to what it asks for
    """

    level: str
    topic: str
    package: str
    name: str
    field: str
    read: Callable[[Any, float], Drive]

    def msgtype(self, stamped: bool) -> str:
        """`package/msg/Name`."""
        return f"{self.package}/msg/{self.name}{'Stamped' if stamped else ''}"


@dataclass(frozen=True)
class Params:
    """topic: of the commands, none = `/cmd_vel` of twist, `/ackermann_cmd` of ackermann; the speed and the
    steer slot of a machine may share it
    stamped: the message with a header (TwistStamped, AckermannDriveStamped) instead of the plain one
    hold_s: simulated time that a command counts; then the machine stops and the steering is released
    start_timeout_s: by the clock on the wall, for the first command.
    """

    topic: str | None = None
    stamped: bool = False
    hold_s: Annotated[float, Gt(0), Le(60)] = 0.5
    start_timeout_s: Annotated[float, Gt(0), Le(3600)] = 30.0


class DriveNode(KeptElsewhere):
    """The slot `steer` or `speed` of a machine, driven by a stream of commands."""

    inputs: tuple[Port, ...] = ()

    def __init__(self, params: Params, setup: LinkSetup, stream: CommandStream) -> None:
        port = SLOTS.get(setup.slot)
        if port is None:
            raise InputError(
                "level", stream.level, f"expected one of the slots {', '.join(SLOTS)} for this level"
            )
        self._p, self._setup, self._stream = params, setup, stream
        self.outputs = (port,)
        self._msgtype, self._topic = stream.msgtype(params.stamped), params.topic or stream.topic
        self.whose = f"{setup.name}: a slot driven by {self._topic}"
        self._wheelbase = setup.control.machine.wheelbase
        self._arrived: list[Any] = []
        self._drive = Drive(0.0, 0.0)
        self._held_until = 0
        self._steps = self._silent = 0
        self._node: Any = open_node(
            f"swath_{setup.machine_name}_{setup.slot}".replace("-", "_"),
            setup.name,
            start_parameter_services=False,
        )
        from rclpy.executors import SingleThreadedExecutor

        try:
            kind = type_of(self._msgtype)
        except SwathError:
            close_node(self._node)
            raise
        self._node.create_subscription(kind, self._topic, self._arrived.append, DEPTH)
        self._executor = SingleThreadedExecutor(context=self._node.context)
        self._executor.add_node(self._node)

    @property
    def notes(self) -> list[str]:
        """Notes: the clock on the wall enters, and how often no command was in force."""
        if not self._steps:
            return []
        return [
            f"{self._setup.slot}: driven by {self._topic}, the result depends on the clock on the wall; "
            f"no command in force in {self._silent} of {self._steps} steps"
        ]

    def reset(self, stream: Stream) -> Outputs:
        """Wait for the first command. Raises NodeSilent where none comes in time."""
        self._steps = self._silent = 0
        self._drive = Drive(0.0, 0.0)
        started = time.monotonic()
        deadline, has_warned = started + self._p.start_timeout_s, False
        while not self._take(0):
            now = time.monotonic()
            if now >= deadline:
                raise NodeSilent(
                    f"{self._setup.name}: no {self._msgtype} on {self._topic} within "
                    f"{self._p.start_timeout_s:g} s; a node with the same ROS_DOMAIN_ID must publish it"
                )
            if now > started + PATIENCE_S and not has_warned:
                text = "swath: %s: nothing on %s yet, waiting for it for %.0f s more"
                logging.getLogger(__name__).warning(text, self._setup.name, self._topic, deadline - now)
                has_warned = True
            self._executor.spin_once(timeout_sec=min(0.1, deadline - now))
        return self._outputs(0)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The newest command, or a stop where it is older than `hold_s`."""
        for _ in range(DEPTH):
            self._executor.spin_once(timeout_sec=0.0)
        self._take(t + dt)
        self._steps += 1
        return self._outputs(t + dt)

    def close(self) -> None:
        """Leave the graph of ROS 2."""
        if self._node is not None:
            self._executor.remove_node(self._node)
            self._executor.shutdown()
            close_node(self._node)
            self._node = None

    def _take(self, t: int) -> bool:
        """Put the newest message in force from t [ns]; False without one."""
        if not self._arrived:
            return False
        message = self._arrived[-1]
        self._arrived.clear()
        command = getattr(message, self._stream.field) if self._p.stamped else message
        drive = self._stream.read(command, self._wheelbase)
        numbers = (drive.speed, drive.curvature or 0.0)
        if not all(math.isfinite(number) for number in numbers):
            raise SwathError(f"{self._setup.name}: {self._topic}: expected finite numbers, got {numbers}")
        curvature = self._drive.curvature if drive.curvature is None else drive.curvature
        self._drive = Drive(drive.speed, curvature)
        self._held_until = t + round(self._p.hold_s * NS)
        return True

    def _outputs(self, t: int) -> Outputs:
        is_held = t <= self._held_until
        self._silent += not is_held
        if self._setup.slot == "steer":
            return {"command": SteerCommand(t, (self._drive.curvature or 0.0) if is_held else 0.0, is_held)}
        return {"command": SpeedCommand(t, self._drive.speed if is_held else 0.0)}


def of_twist(twist: Any, wheelbase: float) -> Drive:
    """geometry_msgs/Twist in the machine's frame: linear.x [m/s], angular.z [rad/s]; curvature = yaw rate
    over speed (REP 103: x ahead, z up).
    """
    speed = float(twist.linear.x)
    return Drive(speed, float(twist.angular.z) / speed if abs(speed) > STANDSTILL else None)


def of_ackermann(drive: Any, wheelbase: float) -> Drive:
    """ackermann_msgs/AckermannDrive: speed [m/s] and the angle of the one wheel of a bicycle model [rad],
    > 0 turns left whichever axle steers; curvature = tan(angle) / wheelbase.
    """
    angle = float(drive.steering_angle)
    if not abs(angle) < 0.5 * math.pi:
        raise SwathError(f"steering_angle: expected between -90 and 90 deg, got {math.degrees(angle):g} deg")
    return Drive(float(drive.speed), math.tan(angle) / wheelbase)
