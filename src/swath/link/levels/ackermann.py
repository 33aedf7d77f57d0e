"""Levels `ackermann` of the slots `steer` and `speed`: a node drives by AckermannDrive."""

from dataclasses import dataclass

from swath.core.registry import Level
from swath.link.ros2.drive_node import CommandStream, DriveNode, of_ackermann
from swath.link.ros2.drive_node import Params as DriveParams
from swath.signals.setup import LinkSetup


@dataclass(frozen=True)
class Params(DriveParams):
    """topic: of the commands; the speed and the steer slot of a machine may share it
    stamped: the message with a header (AckermannDriveStamped) instead of the plain one
    hold_s: simulated time that a command counts; then the machine stops and the steering is released
    start_timeout_s: by the clock on the wall, for the first command
    """

    topic: str = "/ackermann_cmd"


class Ackermann(DriveNode):
    """Speed and steering angle, of which the slot takes its part."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        super().__init__(
            params,
            setup,
            CommandStream("ackermann", "ackermann_msgs", "AckermannDrive", "drive", of_ackermann),
        )


LEVEL = Level(
    Ackermann,
    Params,
    summary="slots steer and speed: a ROS 2 node drives by AckermannDrive on /ackermann_cmd",
    cost="about 0.1 ms per step",
    tolerance="speed and steering angle of the message; depends on the clock on the wall",
    is_link=True,
)
