"""What stands between a plan and /cmd_vel in Nav2, in one file: a planner and a controller (rclpy alone).

    python examples/nav2/controller_node.py &
    swath run examples/nav2/field.yaml --ros2 --real-time

The planner publishes nav_msgs/Path on /plan, latched, as planner_server does. The controller follows the
newest /plan from the pose on /odom by pure pursuit, as controller_server does, and publishes
geometry_msgs/Twist on /cmd_vel at 20 Hz.
With a Nav2 of your own start that instead: nav2_params.yaml beside this file has the names of frames and
topics.
"""

from contextlib import suppress
from math import atan2, cos, hypot, pi, sin

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry, Path
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
START, LENGTH, WAVE, AMPLITUDE, STEP = (6.0, -4.0), 90.0, 60.0, 1.5, 0.5  # of the plan, which goes north [m]


def way(north: float) -> tuple[float, float]:
    """Place x of the plan at y [m] and its heading: a gentle wave."""
    k = 2.0 * pi / WAVE
    along = k * (north - START[1])
    return START[0] + 0.5 * AMPLITUDE * (1.0 - cos(along)), atan2(1.0, 0.5 * AMPLITUDE * k * sin(along))


class Planner(Node):
    """Publishes one plan."""

    def __init__(self) -> None:
        super().__init__("planner_server")
        plan = Path()
        plan.header.frame_id = "map"
        for i in range(round(LENGTH / STEP) + 1):
            at = PoseStamped()
            at.header.frame_id = "map"
            north = START[1] + i * STEP
            east, heading = way(north)
            at.pose.position.x, at.pose.position.y = east, north
            at.pose.orientation.z, at.pose.orientation.w = sin(0.5 * heading), cos(0.5 * heading)
            plan.poses.append(at)
        self.publisher = self.create_publisher(Path, "/plan", LATCHED)
        self.publisher.publish(plan)


class Controller(Node):
    """Pure pursuit, with the parameters of Nav2's regulated one."""

    def __init__(self) -> None:
        super().__init__("controller_server")
        self.speed = self.declare_parameter("FollowPath.desired_linear_vel", 1.5).value
        self.lookahead = self.declare_parameter("FollowPath.lookahead_dist", 7.0).value
        odom = self.declare_parameter("odom_topic", "/combine/motion/state").value
        self.plan: list[tuple[float, float]] = []
        self.pose = (0.0, 0.0, 0.0)
        self.create_subscription(Path, "/plan", self.on_plan, LATCHED)
        self.create_subscription(Odometry, odom, self.on_odometry, 10)
        self.publisher = self.create_publisher(Twist, "/cmd_vel", 10)
        self.create_timer(0.05, self.on_time)

    def on_plan(self, plan: Path) -> None:
        self.plan = [(p.pose.position.x, p.pose.position.y) for p in plan.poses]

    def on_odometry(self, odometry: Odometry) -> None:
        at, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        yaw = atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
        self.pose = (at.x, at.y, yaw)

    def on_time(self) -> None:
        """The circle through the point of the plan that lies one lookahead away."""
        x, y, yaw = self.pose
        nearest = min(
            range(len(self.plan)), key=lambda i: hypot(self.plan[i][0] - x, self.plan[i][1] - y), default=0
        )
        far = (p for p in self.plan[nearest:] if hypot(p[0] - x, p[1] - y) >= self.lookahead)
        aim = next(far, None)
        command = Twist()
        if aim is not None:
            left = cos(yaw) * (aim[1] - y) - sin(yaw) * (aim[0] - x)
            curvature = 2.0 * left / hypot(aim[0] - x, aim[1] - y) ** 2
            command.linear.x, command.angular.z = self.speed, self.speed * curvature
        self.publisher.publish(command)


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    for node in (Planner(), Controller()):
        executor.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
