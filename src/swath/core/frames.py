"""Frames and poses.

World: ENU (x east, y north, z up). Bodies: ISO 8855 (x forward, y left, z up). Angles: intrinsic z-y'-x''
(yaw, pitch, roll); pitch > 0 turns the nose down, roll > 0 turns the left side up. `pose_a_b` takes points
of frame b to frame a. Its `position` is b's origin seen from a.
"""

from math import asin, atan2, cos, sin
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swath.core.frozen import frozen
from swath.core.packed_state import saved_type
from swath.core.portable import arcsin, arctan2, product

Array = NDArray[np.float64]
Numbers = tuple[list[float], list[list[float]]]
PARTS = ("x", "y", "z", "roll", "pitch", "yaw")  # of a pose


@saved_type()
@frozen
class Pose:
    """A rigid transform.

    position: (3,) [m]
    rotation: (3, 3), its columns are the body axes
    numbers: position and rows of the rotation as plain numbers. Of those and the arrays, which nobody
    changes, a
    pose holds what it was made of, and makes the others when somebody asks: most never do
    """

    position: Array
    rotation: Array
    numbers: ClassVar[Numbers]  # no field: it says the same

    def __getattr__(self, name: str) -> Any:
        held = self.__dict__
        if name == "numbers" and "rotation" in held:
            made: Any = self.position.tolist(), self.rotation.tolist()
        elif name in ("position", "rotation") and "numbers" in held:
            made = np.array(held["numbers"][name == "rotation"])
        else:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        held[name] = made
        return made

    @property
    def is_plain(self) -> bool:
        """Whether its plain numbers are at hand, and say all that its arrays would."""
        held = self.__dict__
        if "numbers" not in held or "rotation" not in held or "position" not in held:
            return "numbers" in held
        p, r = held["position"], held["rotation"]
        return bool(p.dtype == float and r.dtype == float and p.shape == (3,) and r.shape == (3, 3))

    def __getstate__(self) -> dict[str, Array]:
        return {"position": self.position, "rotation": self.rotation}

    @staticmethod
    def identity() -> "Pose":
        """No offset, no turn."""
        return Pose(np.zeros(3), np.eye(3))

    @staticmethod
    def from_euler(position: Any, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> "Pose":
        """Pose from a position [m] and angles [rad]."""
        place = position.tolist() if isinstance(position, np.ndarray) else position
        return Pose.of_numbers([float(v) for v in place], rotation_rows(roll, pitch, yaw))

    @staticmethod
    def of_numbers(position: list[float], rows: list[list[float]]) -> "Pose":
        """Pose from a position [m] and the rows of its rotation, as plain numbers that nobody changes."""
        made = object.__new__(Pose)
        made.__dict__["numbers"] = position, rows
        return made

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(
            self.position + product(self.rotation, other.position), product(self.rotation, other.rotation)
        )

    def inverse(self) -> "Pose":
        """The transform the other way round."""
        back = self.rotation.T
        return Pose(-product(back, self.position), back)

    def apply(self, points: Any) -> Array:
        """Points [m], shape (..., 3), of the inner frame in the outer frame."""
        return self.turn(points) + self.position

    def point(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """One point [m] of the inner frame in the outer frame, as plain numbers: quicker than `apply`."""
        (px, py, pz), ((a, b, c), (d, e, f), (g, h, i)) = self.numbers
        return a * x + b * y + c * z + px, d * x + e * y + f * z + py, g * x + h * y + i * z + pz

    def turn(self, directions: Any) -> Array:
        """Directions, shape (..., 3), of the inner frame in the outer frame."""
        return np.asarray(product(np.asarray(directions, dtype=float), self.rotation.T))

    def euler(self) -> tuple[float, float, float]:
        """(roll, pitch, yaw) [rad]."""
        (a, _, _), (b, _, _), (c, d, e) = self.numbers[1]
        return atan2(d, e), -asin(min(max(c, -1.0), 1.0)), atan2(b, a)

    def quaternion(self) -> tuple[float, float, float, float]:
        """(x, y, z, w), the order of ROS messages."""
        roll, pitch, yaw = (0.5 * a for a in self.euler())
        cr, sr, cp, sp = cos(roll), sin(roll), cos(pitch), sin(pitch)
        cy, sy = cos(yaw), sin(yaw)
        return (
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )


def angles_of(rotations: Array) -> Array:
    """(roll, pitch, yaw) [rad] of rotations (n, 3, 3), shape (n, 3), as `Pose.euler`."""
    roll = arctan2(rotations[:, 2, 1], rotations[:, 2, 2])
    pitch = -arcsin(np.clip(rotations[:, 2, 0], -1.0, 1.0))
    return np.stack([roll, pitch, arctan2(rotations[:, 1, 0], rotations[:, 0, 0])], axis=1)


def part_of(poses: Array, part: str) -> Array:
    """One of PARTS [m or rad] of poses as (n, 12) numbers, position and rows of the rotation."""
    axis = PARTS.index(part)
    return poses[:, axis] if axis < 3 else angles_of(poses[:, 3:].reshape(-1, 3, 3))[:, axis - 3]


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation, shape (3, 3), from angles [rad]."""
    return np.array(rotation_rows(roll, pitch, yaw))


def rotation_rows(roll: Any, pitch: Any, yaw: Any, cos: Any = cos, sin: Any = sin) -> list[list[Any]]:
    """Rows of the rotation (3, 3) from angles [rad]. cos, sin: of numbers, or of arrays."""
    cr, sr, cp, sp = cos(roll), sin(roll), cos(pitch), sin(pitch)
    cy, sy = cos(yaw), sin(yaw)
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def rotation_of(x: float, y: float, z: float, w: float) -> Array:
    """Rotation, shape (3, 3), of a quaternion of length 1."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_matrices(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Rotations, shape (n, 3, 3), from angles [rad], shape (n,) each."""
    return np.moveaxis(np.array(rotation_rows(roll, pitch, yaw, np.cos, np.sin)), 2, 0)


def wrapped(angle: float) -> float:
    """An angle [rad] within [-pi, pi]."""
    return atan2(sin(angle), cos(angle))


def wrap_angle(angle: Any) -> Any:
    """Angle [rad] brought into (-pi, pi]."""
    return -((np.pi - angle) % (2 * np.pi) - np.pi)
