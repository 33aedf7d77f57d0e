"""A process written only with rclpy: publishes the same Twist 20 times a second, like a teleoperation node.

python ros2_drive_node.py TOPIC SPEED YAW_RATE {plain,stamped}
"""

import sys
from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


def main(topic, speed, yaw_rate, form):
    rclpy.init()
    node = Node("teleop")
    publisher = node.create_publisher(TwistStamped if form == "stamped" else Twist, topic, 10)

    def publish():
        message = TwistStamped() if form == "stamped" else Twist()
        twist = message.twist if form == "stamped" else message
        twist.linear.x, twist.angular.z = float(speed), float(yaw_rate)
        publisher.publish(message)

    node.create_timer(0.05, publish)
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main(*sys.argv[1:])
