"""Levels `twist` of the slots `steer` and `speed`: a node drives by Twist on `/cmd_vel` (REP 103)."""

from dataclasses import dataclass

from swath.core.registry import Level
from swath.link.ros2.drive_node import CommandStream, DriveNode, of_twist
from swath.link.ros2.drive_node import Params as DriveParams
from swath.signals.setup import LinkSetup


@dataclass(frozen=True)
class Params(DriveParams):
    """topic: of the commands; the speed and the steer slot of a machine may share it
    stamped: the message with a header (TwistStamped) instead of the plain one
    hold_s: simulated time that a command counts; then the machine stops and the steering is released
    start_timeout_s: by the clock on the wall, for the first command
    """

    topic: str = "/cmd_vel"


class Twist(DriveNode):
    """Speed and yaw rate, of which the slot takes its part."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        super().__init__(params, setup, CommandStream("twist", "geometry_msgs", "Twist", "twist", of_twist))


LEVEL = Level(
    Twist,
    Params,
    summary="slots steer and speed: a ROS 2 node drives by Twist on /cmd_vel",
    cost="about 0.1 ms per step",
    tolerance="speed and yaw rate of the message; depends on the clock on the wall",
    is_link=True,
)
