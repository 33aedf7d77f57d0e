"""Camera level `rays`: a ray per pixel, or four, through a pinhole against every stem, ear and leaf.

All pixels at one time (global shutter), no lens distortion, no noise, no exposure: what a perfect camera
sees. A second ray per sample, from towards the sun back to what was seen, gives the angle to the sun and the
shadow.
The machine that carries the camera is not in the picture.
"""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.memory_layout import Solids
from swath.field.site_setup import SiteSetup
from swath.rays.engine import RayCaster
from swath.rays.hits import Hits
from swath.sensing.camera.pinhole import OPTICAL, Pinhole, focal_of
from swath.sensing.camera.shading import encode, sky_light, sun_direction, surface_light
from swath.sensing.mount import Mount, poses_at
from swath.signals import F64, Image, MachineState

Channel = Literal["colour", "depth", "label"]
RAYS_MAX = 10_000_000  # full HD with four samples per pixel
DEFAULT_FOV = 70.0  # [deg]
SHADOW_REACH = 8.0  # nothing further from a surface than this throws a shadow on it [m]
SKIN = 0.02  # without shadows: how far from the surface the ray from the sun starts [m]
NO_DEPTH, NO_LABEL = np.zeros((0, 0), np.float32), np.zeros((0, 0), np.uint8)
NO_COLOUR = np.zeros((0, 0, 3), np.uint8)
SAME_PLACE = 5e-4  # a ray from the sun that ends this near to where it should has met the surface seen [m]


@dataclass(frozen=True)
class Params:
    """mount: where it sits; its x axis is the optical axis.

    width_px, height_px: size of the image
    horizontal_fov_deg: from the left to the right edge of the image; none = 70, or what focal_px gives
    focal_px: focal length over the side of a pixel, in place of horizontal_fov_deg
    samples_per_pixel: 1, or 4 on a grid within the pixel: colours are their mean, depth and label those of
    the nearest
    channels: what an image holds
    reach_m: rays are not followed further than this; what lies beyond shows as sky
    sun_azimuth_deg: clockwise from north; sun_elevation_deg: above the horizon
    shadows: things up to 8 m away shade each other
    """

    mount: Mount = field(default_factory=Mount)
    width_px: Annotated[int, Ge(1), Le(8192)] = 320
    height_px: Annotated[int, Ge(1), Le(8192)] = 240
    horizontal_fov_deg: Annotated[float, Gt(0), Le(160)] | None = None
    focal_px: Annotated[float, Gt(0), Le(1e5)] | None = None
    samples_per_pixel: Literal[1, 4] = 1
    channels: Annotated[tuple[Channel, ...], MinLen(1)] = ("colour", "depth", "label")
    reach_m: Annotated[float, Gt(0), Le(200)] = 60.0
    sun_azimuth_deg: Annotated[float, Ge(-360), Le(360)] = 200.0
    sun_elevation_deg: Annotated[float, Gt(0), Le(90)] = 45.0
    shadows: bool = True


class RaysCamera(KeepsState):
    """A camera on a machine.

    pinhole: its intrinsics; mounting, optical: pose_machine_sensor of the body frame (x forward) and of the
    optical frame (z forward)
    """

    kept = ("_last", "ray_count")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params, self.setup = params, setup
        self.pinhole = _pinhole(params)
        self.mounting: Pose = params.mount.pose(setup.machine, setup.edge_side)
        if self.mounting.position[2] <= 0:
            raise InputError("mount.z_m", params.mount.z_m, "expected a sensor above the ground")
        self.optical = self.mounting @ OPTICAL
        self.per_side = 2 if params.samples_per_pixel == 4 else 1
        rays = self.pinhole.rays(self.per_side)
        self._length = np.linalg.norm(rays, axis=-1)  # of a ray per depth
        self._rays = rays / self._length[..., None]
        self._sun = sun_direction(params.sun_azimuth_deg * DEG, params.sun_elevation_deg * DEG)
        self.ray_count = 0
        self.caster = RayCaster(setup.field)
        self._last: MachineState | None = None
        self.inputs = (Port("state", MachineState, history=True),)
        self.outputs = (Port("image", Image),)

    def reset(self, stream: Stream) -> Outputs:
        """A black image that shows nothing."""
        self._last, self.ray_count = None, 0
        high, wide = self.pinhole.height, self.pinhole.width
        depth, label = np.full((high, wide), np.nan, np.float32), np.zeros((high, wide), np.uint8)
        return {"image": self._image(0, depth, label, np.zeros((high, wide, 3), np.uint8))}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The image at t + dt."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        position, rotation = poses_at(known, np.array([float(t + dt)]))
        return {"image": self.image_from(t + dt, Pose(position[0], rotation[0]) @ self.optical)}

    def image_from(self, t: int, pose: Pose) -> Image:
        """The image at t [ns] from the pose_world_optical."""
        reach = self.params.reach_m
        solids = self.setup.solids()
        self.setup.field.ensure(pose.position[0], pose.position[1], reach + SHADOW_REACH)
        directions = pose.turn(self._rays)
        hits = self.caster.cast_image(pose.position, directions, range_max=reach, solids=solids, t=t)
        self.ray_count += hits.organ.size
        colour = NO_COLOUR
        if "colour" in self.params.channels:
            light = self._light(hits, pose.position, directions, solids, t)
            colour = encode(_cells(light, self.per_side).mean(axis=2))
        depth = hits.distance / self._length
        if self.per_side == 1:
            return self._image(t, depth.astype(np.float32), hits.organ, colour)
        depths, labels = _cells(depth, self.per_side), _cells(hits.organ, self.per_side)
        nearest = np.where(np.isnan(depths), np.inf, depths).argmin(axis=2)[..., None]
        depth, label = (np.take_along_axis(a, nearest, axis=2)[..., 0] for a in (depths, labels))
        return self._image(t, depth.astype(np.float32), label, colour)

    def _light(self, hits: Hits, eye: F64, directions: F64, solids: Solids, t: int) -> F64:
        """Linear light that comes along each ray, (..., 3)."""
        light = sky_light(directions[..., 2])
        seen = hits.is_hit
        points = eye + hits.distance[seen].astype(np.float64)[:, None] * directions[seen]
        light[seen] = surface_light(hits.organ[seen], self._sun_cosine(points, solids, t))
        return light

    def _sun_cosine(self, points: F64, solids: Solids, t: int) -> F64:
        """Cosine of the angle between the surfaces at points (n, 3) and the sun, 0 in shadow."""
        length = SHADOW_REACH if self.params.shadows else SKIN
        starts = points + length * self._sun
        cosine = np.zeros(len(points))
        free = np.flatnonzero(starts[:, 2] >= self.setup.field.ground_height(starts[:, 0], starts[:, 1]))
        if len(free) == 0:
            return cosine
        back = np.broadcast_to(-self._sun, (len(free), 3))
        found = self.caster.cast(starts[free], back, range_max=length + SAME_PLACE, solids=solids, t=t)
        self.ray_count += len(free)
        is_lit = np.abs(found.distance - length) < SAME_PLACE
        cosine[free[is_lit]] = found.cosine[is_lit]
        return cosine

    def _image(
        self, t: int, depth: NDArray[np.float32], label: NDArray[np.uint8], colour: NDArray[np.uint8]
    ) -> Image:
        """An image with the channels that were asked for."""
        p, channels = self.pinhole, self.params.channels
        depth = depth if "depth" in channels else NO_DEPTH
        label = label if "label" in channels else NO_LABEL
        colour = colour if "colour" in channels else NO_COLOUR
        for channel in (depth, label, colour):
            channel.setflags(write=False)
        return Image(t, p.width, p.height, p.focal, p.centre_x, p.centre_y, depth, colour, label)


def _pinhole(params: Params) -> Pinhole:
    count = params.width_px * params.height_px * params.samples_per_pixel
    if count > RAYS_MAX:
        raise InputError("width_px", params.width_px, f"expected at most {RAYS_MAX} samples per image")
    if params.focal_px is None:
        fov = DEFAULT_FOV if params.horizontal_fov_deg is None else params.horizontal_fov_deg
        return Pinhole.centred(params.width_px, params.height_px, focal_of(params.width_px, fov * DEG))
    if params.horizontal_fov_deg is not None:
        raise InputError("focal_px", params.focal_px, "expected no horizontal_fov_deg beside it")
    return Pinhole.centred(params.width_px, params.height_px, params.focal_px)


def _cells(samples: NDArray[Any], per_side: int) -> NDArray[Any]:
    """Samples (rows, columns, ...) by pixel: (height, width, per_side^2, ...)."""
    rows, columns, *rest = samples.shape
    cut = samples.reshape(rows // per_side, per_side, columns // per_side, per_side, *rest)
    return cut.swapaxes(1, 2).reshape(rows // per_side, columns // per_side, per_side**2, *rest)


LEVEL = Level(
    RaysCamera,
    Params,
    "pinhole camera: colour, depth and label by rays against every stem, ear and leaf",
    cost="about 0.12 s of one core per image of 320 x 240",
    tolerance="the only level; pixels within 0.5 px of the pinhole formula, labels as ray by ray",
)
