"""A crop-edge detector of your own as a ROS 2 node: only rclpy, standard messages, numpy and the algorithm.

    machines:
      combine:
        edge: {level: ros2}

swath sends the scan on /combine/edge/step/scan (sensor_msgs/PointCloud2), asks on /combine/edge/step and
waits for the answer on /combine/edge/answer (both sensor_msgs/JointState: named numbers). Copy this file and
change `Detector`. It does what `examples/my_edge_detector.py` does: every echo above a fixed height is crop.
"""

from contextlib import suppress
from math import cos, isfinite, nan, sin

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2

FORMATS = {7: "f4", 8: "f8"}  # sensor_msgs/PointField


class Detector:
    """A fixed height threshold, scan by scan. Machine frame: x forward, y left, z up from the ground."""

    threshold_m = 0.45
    smoothing = 0.2

    def reset(self, setup: dict[str, float]) -> None:
        roll, pitch, yaw = (setup[f"setup.mounting.{name}"] for name in ("roll", "pitch", "yaw"))
        self.place = np.array([setup[f"setup.mounting.{axis}"] for axis in "xyz"])
        self.turn = rotation(roll, pitch, yaw)
        self.crop_left = not setup["setup.edge_is_left"]  # the crop lies on the machine's side of the edge
        self.offset, self.reference_x = nan, 8.0

    def step(self, scan: np.ndarray) -> None:
        """Look at one scan: an array with fields `range`, `azimuth`, `elevation`, shape (beams, echoes)."""
        first = scan[:, 0]
        flat, up = np.cos(first["elevation"]), np.sin(first["elevation"])
        rays = np.stack([flat * np.cos(first["azimuth"]), flat * np.sin(first["azimuth"]), up], axis=1)
        x, y, z = (first["range"][:, None] * rays @ self.turn.T + self.place).T
        is_crop, is_low = z > self.threshold_m, z <= self.threshold_m  # nan (no echo) is neither
        if is_crop.sum() < 5 or is_low.sum() < 5:
            self.offset = nan
            return
        places = np.sort(y[is_crop | is_low])
        places = 0.5 * (places[1:] + places[:-1])
        left, right = (is_crop, is_low) if self.crop_left else (is_low, is_crop)
        wrong = (y[left, None] < places).sum(axis=0) + (y[right, None] > places).sum(axis=0)
        new = float(places[np.argmin(wrong)])
        self.offset = self.offset + self.smoothing * (new - self.offset) if isfinite(self.offset) else new
        self.reference_x = float(np.median(x[is_crop | is_low]))

    def edge(self) -> dict[str, float]:
        """The edge in the machine frame, as the answer names it."""
        found = isfinite(self.offset)
        return {
            "edge.offset": self.offset,
            "edge.heading": 0.0 if found else nan,
            "edge.curvature": 0.0,
            "edge.reference_x": self.reference_x,
            "edge.confidence": 0.5 if found else 0.0,
            "edge.crop_height": nan,
            "edge.stubble_height": nan,
        }


class DetectorNode(Node):
    """Answers every step once the scan that belongs to it is there."""

    def __init__(self, machine: str = "combine") -> None:
        super().__init__("my_detector")
        self.detector = Detector()
        self.scan: PointCloud2 | None = None
        self.step: JointState | None = None
        self.answer = self.create_publisher(JointState, f"/{machine}/edge/answer", 10)
        kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(PointCloud2, f"/{machine}/edge/step/scan", self.on_scan, kept)
        self.create_subscription(JointState, f"/{machine}/edge/step", self.on_step, 10)

    def on_scan(self, scan: PointCloud2) -> None:
        self.scan = scan
        self.work()

    def on_step(self, step: JointState) -> None:
        self.step = step
        self.work()

    def work(self) -> None:
        if self.step is None:
            return
        numbers = dict(zip(self.step.name, self.step.position, strict=True))
        if numbers["step.reset"]:
            self.detector.reset(numbers)  # the first question of a run: what machine this is
        elif self.scan is None or time_of(self.scan) != int(numbers["scan.t_ns"]):
            return  # the scan of this step is still on its way
        else:
            self.detector.step(table_of(self.scan))
        answer, edge = JointState(), self.detector.edge()
        answer.header.stamp = self.step.header.stamp  # says which question this answers
        answer.name, answer.position = list(edge), list(edge.values())
        self.step = None
        self.answer.publish(answer)


def time_of(message: PointCloud2) -> int:
    """Stamp [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def table_of(cloud: PointCloud2) -> np.ndarray:
    """The cloud as an array with named fields, shape (height, width)."""
    fields = [f for f in cloud.fields if f.datatype in FORMATS]
    layout = {
        "names": [f.name for f in fields],
        "formats": [FORMATS[f.datatype] for f in fields],
        "offsets": [f.offset for f in fields],
        "itemsize": cloud.point_step,
    }
    return np.frombuffer(cloud.data, dtype=np.dtype(layout)).reshape(cloud.height, cloud.width)


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix of yaw, pitch, roll about z, y', x'' [rad]."""
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def main() -> None:
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(DetectorNode())


if __name__ == "__main__":
    main()
