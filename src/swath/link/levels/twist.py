"""Levels `twist` of the slots `steer` and `speed`: a node drives by Twist on `/cmd_vel` (REP 103)."""

from swath.core.registry import Level
from swath.link.ros2.drive_node import CommandStream, DriveNode, Params, of_twist
from swath.signals.setup import LinkSetup

STREAM = CommandStream("twist", "/cmd_vel", "geometry_msgs", "Twist", "twist", of_twist)


class Twist(DriveNode):
    """Speed and yaw rate, of which the slot takes its part."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        super().__init__(params, setup, STREAM)


LEVEL = Level(
    Twist,
    Params,
    summary="slots steer and speed: a ROS 2 node drives by Twist on /cmd_vel",
    cost="about 0.1 ms per step",
    tolerance="speed and yaw rate of the message; depends on the clock on the wall",
    is_link=True,
)
