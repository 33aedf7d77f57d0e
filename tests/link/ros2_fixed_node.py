"""A process written only with rclpy and standard messages: answers each step of a slot with the next numbers
of a list, and all further ones with the last.

python ros2_fixed_node.py NODE_NAME /combine/process '[{"load.tank_grain": 1.0, ...}, ...]'
"""

import json
import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState


def main(name, slot, answers):
    rclpy.init()
    node = Node(name)
    publisher = node.create_publisher(JointState, f"{slot}/answer", 10)

    def on_step(step):
        numbers = answers.pop(0) if len(answers) > 1 else answers[0]
        answer = JointState()
        answer.header.stamp = step.header.stamp
        answer.name, answer.position = list(numbers), [float(v) for v in numbers.values()]
        publisher.publish(answer)

    node.create_subscription(JointState, f"{slot}/step", on_step, 10)
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], json.loads(sys.argv[3]))
