"""Levels `ackermann` of the slots `steer` and `speed`: a node drives by AckermannDrive."""

from swath.core.registry import Level
from swath.link.ros2.drive_node import CommandStream, DriveNode, Params, of_ackermann
from swath.signals.setup import LinkSetup

STREAM = CommandStream(
    "ackermann", "/ackermann_cmd", "ackermann_msgs", "AckermannDrive", "drive", of_ackermann
)


class Ackermann(DriveNode):
    """Speed and steering angle, of which the slot takes its part."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        super().__init__(params, setup, STREAM)


LEVEL = Level(
    Ackermann,
    Params,
    summary="slots steer and speed: a ROS 2 node drives by AckermannDrive on /ackermann_cmd",
    cost="about 0.1 ms per step",
    tolerance="speed and steering angle of the message; depends on the clock on the wall",
    is_link=True,
)
