"""Lens distortion: where a lens puts what a pinhole would put at (x, y) = (X / Z, Y / Z).

Two models with the formulas and the order of coefficients of OpenCV, so that a calibration done with it can
be written into a data sheet as it is:

- `brown_conrady` (OpenCV `calib3d`: k1, k2, p1, p2, k3, then k4, k5, k6 of the rational model; Brown 1971,
  Close-range camera calibration; ROS `plumb_bob` and `rational_polynomial`)
- `fisheye` (OpenCV `fisheye`: k1 to k4 of the angle; Kannala and Brandt 2006, doi:10.1109/TPAMI.2006.153,
  eq. 6; ROS `equidistant`)
"""

from dataclasses import dataclass
from math import atan2, pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.errors import InputError

Array = NDArray[np.float64]

LensModel = Literal["brown_conrady", "fisheye"]
ITERATIONS = 30
SHARP = 1e-9  # a ray is found when it comes out this near to where it should, at focal length 1
COUNTS: dict[str, tuple[int, ...]] = {"brown_conrady": (0, 5, 8), "fisheye": (4,)}


@dataclass(frozen=True)
class Lens:
    """model: whose formulas; coefficients: as OpenCV orders them, none = a pinhole."""

    model: LensModel = "brown_conrady"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        wanted = COUNTS[self.model]
        if len(self.coefficients) not in wanted:
            count = " or ".join(map(str, wanted))
            raise InputError("distortion", list(self.coefficients), f"expected {count} numbers: {self.model}")

    def distorted(self, points: Any) -> Array:
        """Where directions (..., 3) of the optical frame appear at focal length 1, (..., 2).

        nan where a direction has no image: behind a `brown_conrady` lens.
        """
        p = np.asarray(points, dtype=np.float64)
        if self.model == "fisheye":
            return self._fisheye(p)
        z = np.where(p[..., 2] > 0.0, p[..., 2], np.nan)
        return self._brown(np.stack([p[..., 0] / z, p[..., 1] / z], axis=-1))

    def directions(self, image: Array) -> Array:
        """Unit directions (..., 3) that appear at places (..., 2) of the image at focal length 1.

        InputError where the coefficients give some of these places no direction or two: the formulas fold.
        """
        found = self._fisheye_rays(image) if self.model == "fisheye" else self._brown_rays(image)
        with np.errstate(invalid="ignore"):
            off = np.abs(self.distorted(found) - image)
        if not (off < SHARP).all() or not self._is_upright(image):
            text = "expected coefficients whose image does not fold within the picture"
            raise InputError("distortion", list(self.coefficients), text)
        return found

    def _is_upright(self, image: Array) -> bool:
        """Whether what lies farther out in the world lies farther out in the picture, up to its corners."""
        far = float(np.hypot(image[..., 0], image[..., 1]).max(initial=0.0))
        rim = np.array([[far, 0.0]])
        if self.model == "fisheye":
            x, _, z = self._fisheye_rays(rim)[0].tolist()
            out = self._angle(np.linspace(0.0, atan2(x, z), 400))
        else:
            x, _, z = self._brown_rays(rim)[0].tolist()
            line = np.linspace(0.0, x / z, 400)
            out = self._brown(np.stack([line, np.zeros_like(line)], axis=-1))[:, 0]
        return bool((np.diff(out) > 0.0).all())

    def _brown(self, xy: Array) -> Array:
        if not self.coefficients:
            return xy
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, 0.0, 0.0, 0.0)[:8]
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def _brown_rays(self, image: Array) -> Array:
        """Rays by Newton's method with differences, from the middle out: the branch that a real lens has."""
        xy = np.array(image)
        step = 1e-6
        for _ in range(ITERATIONS if self.coefficients else 0):
            off = self._brown(xy) - image
            if np.abs(off).max(initial=0.0) < 1e-13:
                break
            ahead = [self._brown(xy + d) - self._brown(xy - d) for d in step * np.eye(2)]
            (a, c), (b, d) = ((v[..., 0] / (2.0 * step), v[..., 1] / (2.0 * step)) for v in ahead)
            whole = a * d - b * c
            whole = np.where(np.abs(whole) < 1e-6, 1e-6, whole)
            xy = xy - np.stack(
                [(d * off[..., 0] - b * off[..., 1]) / whole, (a * off[..., 1] - c * off[..., 0]) / whole], -1
            )
        ray = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
        return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))

    def _angle(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.coefficients
        t2 = theta * theta
        return np.asarray(theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))))

    def _fisheye(self, p: Array) -> Array:
        off = np.hypot(p[..., 0], p[..., 1])
        out = self._angle(portable.arctan2(off, p[..., 2]))
        scale = np.divide(out, off, out=np.zeros_like(off), where=off > 0.0)
        return np.asarray(p[..., :2] * scale[..., None])

    def _fisheye_rays(self, image: Array) -> Array:
        """The angle by Newton's method, from what an even fisheye lens would have."""
        k1, k2, k3, k4 = self.coefficients
        out = np.hypot(image[..., 0], image[..., 1])
        theta = np.minimum(out, pi)
        for _ in range(ITERATIONS):
            t2 = theta * theta
            slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
            step = (self._angle(theta) - out) / np.where(np.abs(slope) < 1e-3, 1e-3, slope)
            theta = np.clip(theta - step, 0.0, pi)
        across = np.divide(np.sin(theta), out, out=np.ones_like(out), where=out > 0.0)
        return np.stack([image[..., 0] * across, image[..., 1] * across, np.cos(theta)], axis=-1)
