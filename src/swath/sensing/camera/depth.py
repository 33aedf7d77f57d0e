"""Camera level `depth`: a stereo camera: depth from the disparity between two pictures, with its error.

    d = f B / z + N(0, sd_d), rounded to the step of the matcher;  z = f B / d

so that the depth is off by z^2 sd_d / (f B) (Gallup et al. 2008, doi:10.1109/CVPR.2008.4587671, eq. 1). What
the second camera, to the right by the base, does not see has no depth, nor has what is nearer or farther than
the matcher looks. Matching itself is not done: no texture is needed, edges are sharp.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.component import Outputs
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing import CAMERA
from swath.sensing.camera.rays import Channel, SceneCamera, Sight, pinhole_of
from swath.sensing.camera.rays import Params as RaysParams
from swath.signals import F64

SAME = 0.02  # the second camera sees a point when its ray ends within this share of the way to it


@dataclass(frozen=True)
class Params(RaysParams):
    """A stereo camera.

    channels: what an image holds
    base_m: distance between the two cameras, the second one to the right
    disparity_sd_px: standard deviation of a disparity
    disparity_step_px: step of the matcher's disparities, 0 = none
    disparity_min_px: least disparity; what is farther has no depth
    disparity_max_px: greatest disparity; what is nearer has no depth
    holes: whether what the second camera does not see has no depth
    """

    channels: tuple[Channel, ...] = ("depth",)
    base_m: Annotated[float, Gt(0), Le(10)] = 0.12
    disparity_sd_px: Annotated[float, Ge(0), Le(20)] = 0.25
    disparity_step_px: Annotated[float, Ge(0), Le(10)] = 0.0625
    disparity_min_px: Annotated[float, Gt(0), Le(1000)] = 1.0
    disparity_max_px: Annotated[float, Gt(0), Le(1000)] = 96.0
    holes: bool = True


class DepthCamera(SceneCamera):
    """Depth, and labels of the same pixels if asked for."""

    kept: ClassVar[tuple[str, ...]] = ("_last", "_casts")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p = params
        if {"colour", "raw"} & set(params.channels):
            expected = "expected depth, label, instance: another camera gives colour"
            raise InputError("channels", list(params.channels), expected)
        if params.samples_per_pixel != 1:
            raise InputError("samples_per_pixel", params.samples_per_pixel, "expected 1")
        super().__init__(params, setup, pinhole_of(params, Lens()))

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._stream = stream
        return super().reset(stream)

    def picture_from(self, t: int, pose: Pose) -> Outputs:
        """Depths as the matcher gives them."""
        seen = self.sight(t, pose)
        depth = self._measured(seen.depth, t)
        if self._p.holes:
            depth = np.where(self._is_seen_twice(seen, pose, t), depth, np.float32(np.nan))
        return self.outputs_of(t, seen, **({"depth": depth} if "depth" in self._p.channels else {}))

    def _measured(self, depth: NDArray[np.float32], t: int) -> NDArray[np.float32]:
        """Depths (height, width) [m] of true ones, nan = none."""
        p, product = self._p, self.pinhole.focal * self._p.base_m
        noise = p.disparity_sd_px * self._stream.at(t).standard_normal(depth.shape)
        disparity: F64 = product / depth.astype(np.float64) + noise
        if p.disparity_step_px > 0.0:
            disparity = np.rint(disparity / p.disparity_step_px) * p.disparity_step_px
        is_known = (disparity >= p.disparity_min_px) & (disparity <= p.disparity_max_px)
        return (product / np.where(is_known, disparity, np.nan)).astype(np.float32)

    def _is_seen_twice(self, seen: Sight, pose: Pose, t: int) -> NDArray[np.bool_]:
        """Whether the second camera sees the points of pixels, (height, width)."""
        other = pose.apply(np.array([self._p.base_m, 0.0, 0.0]))
        found = seen.hits.is_hit
        distance = np.nan_to_num(seen.hits.distance.astype(np.float64))
        ray = seen.origins + distance[..., None] * seen.directions - other
        length = np.linalg.norm(ray, axis=-1)
        toward = np.where(found[..., None], ray / np.maximum(length, 1e-6)[..., None], seen.directions)
        hits = self.caster.cast_image(
            other, toward, range_max=self.params.reach_m + self._p.base_m, solids=seen.things.solids, t=t
        )
        self._casts += hits.organ.size
        return np.asarray(found & (np.abs(hits.distance - length) < SAME * length))


LEVEL = Level(
    DepthCamera,
    Params,
    "stereo camera: depth with noise of the disparity, steps, and holes that the second camera does not see",
    cost="about 0.15 s of one core per image of 320 x 240",
    tolerance="equal to rays within 0.5 px without noise; sd z^2 sd_d / (f B)",
    checked=CAMERA,
)
