"""A steering law of your own as a ROS 2 node: only rclpy, standard messages and the law.

    machines:
      combine:
        steer: {level: ros2}

swath asks on /combine/steer/step and waits for the answer on /combine/steer/answer. Both are
sensor_msgs/JointState: named numbers, `name[i]` is `position[i]`. Copy this file and change `Law`.
"""

from contextlib import suppress
from math import isfinite

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState


class Law:
    """Pure pursuit of the crop edge by the header's end, with a limit on how fast the curvature changes."""

    lookahead_m = 9.0
    overlap_m = 0.1  # how far the header's end stays outside the crop
    rate = 0.05  # of the curvature [1/m/s]

    def reset(self, setup: dict[str, float]) -> None:
        side = 1.0 if setup["setup.edge_is_left"] else -1.0
        self.target = setup["setup.header_y"] + side * (0.5 * setup["setup.header_width"] - self.overlap_m)
        self.curvature = 0.0

    def step(self, numbers: dict[str, float]) -> tuple[float, bool]:
        """(curvature [1/m], > 0 left; whether the law steers) from the numbers of one step."""
        found = numbers.get("edge.confidence", 0.0) > 0.0 and isfinite(numbers["edge.offset"])
        wanted = 0.0
        if found:
            d, heading = self.lookahead_m, numbers["edge.heading"]
            beside = numbers["edge.offset"] - numbers["edge.reference_x"] * heading - self.target
            wanted = 2.0 * (beside + d * heading) / d**2
        most = self.rate * numbers["step.dt"]
        self.curvature += min(max(wanted - self.curvature, -most), most)
        return self.curvature, found


class SteeringNode(Node):
    """Answers every step with the law's curvature."""

    def __init__(self, machine: str = "combine") -> None:
        super().__init__("my_steering")
        self.law = Law()
        self.answer = self.create_publisher(JointState, f"/{machine}/steer/answer", 10)
        self.create_subscription(JointState, f"/{machine}/steer/step", self.on_step, 10)

    def on_step(self, step: JointState) -> None:
        numbers = dict(zip(step.name, step.position, strict=True))
        curvature, engaged = 0.0, False
        if numbers["step.reset"]:
            self.law.reset(numbers)  # the first question of a run: what machine this is
        else:
            curvature, engaged = self.law.step(numbers)
        answer = JointState()
        answer.header.stamp = step.header.stamp  # says which question this answers
        answer.name = ["command.curvature", "command.is_engaged"]
        answer.position = [curvature, float(engaged)]
        self.answer.publish(answer)


def main() -> None:
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(SteeringNode())


if __name__ == "__main__":
    main()
