"""A process written only with rclpy, standard messages and numpy: plays the scanner, a fan over flat ground.

python ros2_scan_node.py
"""

from contextlib import suppress

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2, PointField

LAYOUT = np.dtype(
    [("range", "<f4"), ("intensity", "<f4"), ("azimuth", "<f8"), ("elevation", "<f8"), ("time", "<f8")]
)


def main():
    rclpy.init()
    node = Node("scanner")
    publisher = node.create_publisher(PointCloud2, "/combine/lidar/answer/scan", 10)

    def on_step(step):
        numbers = dict(zip(step.name, step.position, strict=True))
        table = np.zeros((41, 1), LAYOUT)
        table["azimuth"] = np.linspace(-0.7, 0.7, 41)[:, None]
        table["elevation"] = -0.35
        table["range"] = np.nan if numbers["step.reset"] else 3.0 + numbers["state.distance"]
        cloud = PointCloud2(height=41, width=1, point_step=LAYOUT.itemsize, row_step=LAYOUT.itemsize)
        cloud.header.stamp = step.header.stamp
        cloud.fields = [
            PointField(name=name, offset=offset, datatype=7 if kind.itemsize == 4 else 8, count=1)
            for name, (kind, offset) in LAYOUT.fields.items()
        ]
        cloud.data = table.tobytes()
        publisher.publish(cloud)

    node.create_subscription(JointState, "/combine/lidar/step", on_step, 10)
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main()
