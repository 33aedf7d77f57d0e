"""A camera as its pictures are used: which way each pixel looks, and where a point appears."""

from dataclasses import dataclass

import numpy as np

from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.core.portable import product
from swath.signals import F64, Image

# pose_sensor_optical: x right, y down, z forward (REP 103) in the frame of the mounting
OPTICAL = Pose(np.zeros(3), np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
FISHEYE = 4  # coefficients of a fisheye lens
LEAST_DEPTH = 0.1  # nearer than this nothing is in the picture [m]


@dataclass(frozen=True)
class View:
    """pose: pose_machine_optical; the rest as of the picture, all [px]"""

    pose: Pose
    width: int
    height: int
    focal: float
    centre_x: float
    centre_y: float
    lens: Lens

    @staticmethod
    def of(image: Image, mounting: Pose) -> "View":
        """Of a camera whose pictures are such."""
        every = tuple(float(k) for k in image.distortion)
        lens = Lens("fisheye" if len(every) == FISHEYE else "brown_conrady", every)
        size = image.width, image.height, image.focal, image.centre_x, image.centre_y
        return View(mounting @ OPTICAL, *size, lens)

    def rays(self) -> F64:
        """Unit directions of the pixels in the machine's frame, (height, width, 3)."""
        u, v = np.meshgrid(np.arange(float(self.width)), np.arange(float(self.height)))
        at = np.stack([(u - self.centre_x) / self.focal, (v - self.centre_y) / self.focal], axis=-1)
        return self.pose.turn(self.lens.directions(at))

    def project(self, points: F64) -> F64:
        """Where points (..., 3) of the machine's frame appear [px], (..., 2), nan outside the picture."""
        own = product(points - self.pose.position, self.pose.rotation)
        at = self.lens.distorted(np.where(own[..., 2:] > LEAST_DEPTH, own, np.nan))
        place = np.stack(
            [self.focal * at[..., 0] + self.centre_x, self.focal * at[..., 1] + self.centre_y], -1
        )
        most = np.array([self.width - 1.0, self.height - 1.0])
        inside = np.all((place >= 0.0) & (place <= most), axis=-1, keepdims=True)
        return np.where(inside, place, np.nan)


def sampled(picture: F64, place: F64) -> F64:
    """Values of a picture (height, width) at places (..., 2) [px], between pixels by both neighbours, nan
    where the place is.
    """
    known = np.isfinite(place[..., 0])
    u, v = np.where(known, place[..., 0], 0.0), np.where(known, place[..., 1], 0.0)
    i, j = (
        np.minimum(u.astype(np.int64), picture.shape[1] - 2),
        np.minimum(v.astype(np.int64), picture.shape[0] - 2),
    )
    a, b = u - i, v - j
    flat, at = picture.ravel(), j * picture.shape[1] + i
    low = flat[at] * (1.0 - a) + flat[at + 1] * a
    high = flat[at + picture.shape[1]] * (1.0 - a) + flat[at + picture.shape[1] + 1] * a
    return np.where(known, low * (1.0 - b) + high * b, np.nan)
