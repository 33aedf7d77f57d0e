"""A camera's geometry: which way each pixel looks, and where a point appears.

Optical frame (REP 103): x right, y down, z forward along the axis. Without a lens a point (x, y, z) appears
at u = f x / z + centre_x, v = f y / z + centre_y [px] (Hartley and Zisserman, Multiple View Geometry, eq.
6.2); a lens moves (x / z, y / z) first (`core/lens.py`). The middle of the upper left pixel is u = v = 0, as
OpenCV and ROS count.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from math import tan
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.signals import F64

# pose_sensor_optical: the optical frame in the sensor's, which has x forward, y left, z up (ISO 8855).
OPTICAL = Pose(np.zeros(3), np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


@dataclass(frozen=True)
class Pinhole:
    """width, height of the image, focal length and principal point (centre_x, centre_y), all [px]; lens."""

    width: int
    height: int
    focal: float
    centre_x: float
    centre_y: float
    lens: Lens = field(default_factory=Lens)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients of the lens, as OpenCV orders them."""
        return self.lens.coefficients

    @staticmethod
    def centred(width: int, height: int, focal: float, lens: Lens | None = None) -> "Pinhole":
        """A camera whose axis goes through the middle of the image."""
        return Pinhole(width, height, focal, 0.5 * (width - 1), 0.5 * (height - 1), lens or Lens())

    def rays(self, per_side: int = 1) -> F64:
        """Unit directions that the image's samples look in, in the optical frame.

        Shape (height * per_side, width * per_side, 3): in each pixel per_side x per_side samples, one in each
        cell of a grid, no two in a column or a row (Chiu, Shirley and Wang, Multi-jittered sampling, Graphics
        Gems IV, 1994, without jitter).
        """
        return _rays(self, per_side)

    def _own_rays(self, per_side: int) -> F64:
        i, j = np.indices((self.height * per_side, self.width * per_side), sparse=True)
        within = (np.arange(per_side) + 0.5) / per_side  # of a cell
        u = (j + within[i % per_side]) / per_side - 0.5
        v = (i + within[j % per_side]) / per_side - 0.5
        at = (u - self.centre_x) / self.focal, (v - self.centre_y) / self.focal
        return self.lens.directions(np.stack(at, axis=-1))

    def project(self, points: Any) -> F64:
        """Where points (..., 3) of the optical frame appear, (u, v) [px], (..., 2), nan without an image."""
        at = self.lens.distorted(points)
        u, v = self.focal * at[..., 0] + self.centre_x, self.focal * at[..., 1] + self.centre_y
        return np.stack([u, v], axis=-1)


@lru_cache(maxsize=4)
def _rays(camera: Pinhole, per_side: int) -> F64:
    """Kept, read-only: cameras of a data set are all alike."""
    rays = camera._own_rays(per_side)
    rays.setflags(write=False)
    return rays


def focal_of(width: int, fov: float) -> float:
    """Focal length [px] of an image that spans the angle fov [rad] without a lens, edge to edge."""
    return 0.5 * width / tan(0.5 * fov)
