"""Where the machine stands on the ground: height, roll and pitch from the ground under its tyres.

No suspension. The front axle is rigid with the body; the rear one is a pendulum axle, it follows the ground
but does not roll the body. A tyre bridges what is shorter than itself: it stands at the mean ground height
over its contact patch, so a wave of length l along the path is damped by sinc(patch_length / l).
"""

from collections.abc import Callable
from math import atan, atan2, cos, sin
from typing import Any, NamedTuple, Protocol

import numpy as np

from swath.core.frames import Pose
from swath.core.setup import MachineGeometry
from swath.machine.card import Axle, dynamics_of

ALONG, ACROSS = 4, 2  # ground samples of one contact patch
SAMPLES = ALONG * ACROSS


class Ground(Protocol):
    """The part of a field that carries machines."""

    def ground_height(self, x: Any, y: Any, /) -> Any:
        """Height of the ground [m] at world x, y [m]."""
        ...


class Stance(NamedTuple):
    """How the machine stands. z of the fixed axle's middle on the ground [m]; roll, pitch [rad].

    front_slope, rear_slope: rise of the ground to the left under the two axles [m/m]
    """

    z: float
    roll: float
    pitch: float
    front_slope: float
    rear_slope: float

    def pose(self, x: float, y: float, yaw: float) -> Pose:
        """pose_world_machine."""
        return Pose.from_euler((x, y, self.z), self.roll, self.pitch, yaw)


class TerrainFollower:
    """Reads the ground under four tyres."""

    def __init__(self, ground: Ground, machine: MachineGeometry) -> None:
        d = dynamics_of(machine)
        self._wheelbase, self._tracks = machine.wheelbase, (machine.front_track, machine.rear_track)
        front, rear = _patch(d.front), _patch(d.rear)
        half_f, half_r, back = 0.5 * machine.front_track, 0.5 * machine.rear_track, -machine.wheelbase
        places = np.array([(0.0, half_f), (0.0, -half_f), (back, half_r), (back, -half_r)])
        points = (places[:, None, :] + np.stack([front, front, rear, rear])).reshape(-1, 2)
        self._heights = _reader(ground, points)

    def at(self, x: float, y: float, yaw: float) -> Stance:
        """Stance at a place [m] and heading [rad].

        pitch = atan((rear - front) / wheelbase), roll = atan(front slope * cos(pitch)): on a plane the body's
        z axis is then exactly the plane's normal (intrinsic z-y'-x'' angles).
        """
        heights = self._heights(x, y, yaw).reshape(4, SAMPLES)
        sums: list[float] = np.add.reduce(heights, axis=1).tolist()
        front_left, front_right, rear_left, rear_right = (z / SAMPLES for z in sums)
        front, rear = 0.5 * (front_left + front_right), 0.5 * (rear_left + rear_right)
        pitch = atan2(rear - front, self._wheelbase)
        front_slope = (front_left - front_right) / self._tracks[0]
        rear_slope = (rear_left - rear_right) / self._tracks[1]
        return Stance(front, atan(front_slope * cos(pitch)), pitch, front_slope, rear_slope)


def _reader(ground: Ground, points: np.ndarray) -> Callable[[float, float, float], Any]:
    """Heights [m] under points of the machine (n, 2) at a place and heading; the field's quick way if any."""
    footprint = getattr(ground, "footprint", None)
    if footprint is not None:
        heights: Callable[[float, float, float], Any] = footprint(points).heights
        return heights
    px, py = points.T

    def read(x: float, y: float, yaw: float) -> Any:
        c, s = cos(yaw), sin(yaw)
        found = ground.ground_height(x + c * px - s * py, y + s * px + c * py)
        return np.asarray(found, dtype=float)

    return read


def _patch(axle: Axle) -> np.ndarray:
    """Sample points of a contact patch about its centre [m], shape (ALONG * ACROSS, 2): cell middles."""
    along = ((np.arange(ALONG) + 0.5) / ALONG - 0.5) * axle.patch_length
    across = ((np.arange(ACROSS) + 0.5) / ACROSS - 0.5) * axle.patch_width
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
