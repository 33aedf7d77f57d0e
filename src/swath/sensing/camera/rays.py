"""Camera level `rays`: a ray per pixel, or several, through a pinhole against every stem, ear and leaf.

All pixels at one time (global shutter), no lens distortion, no noise, no exposure: what a perfect camera
sees. A second ray per sample, from towards the sun back to what was seen, gives the angle to the sun and the
shadow.
The machine that carries the camera is in the picture where `own_machine` is set. So are its lamps' light and
shadows where `work_lights` has any, from where they are at the time of the picture.

Each sample sees things that go where they are at its own time. A thing with the velocity v that a ray meets s
seconds after the time of the picture is met at that time by the same ray from its origin less v s. So the
picture is cast without the things that go, then each of them alone from such origins, and the nearest of all
counts. Depth and time stay; light and shadow on the thing are those of the time of the picture. A turn within
the exposure is left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import acos, hypot, isqrt, pi, sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.signal import Signal
from swath.core.units import DEG, PERCENT
from swath.field.light import light
from swath.field.memory_layout import Organ, Solids
from swath.field.site_setup import SiteSetup
from swath.field.solid.contact import bounds, parts_of
from swath.field.weather import GREEN, Sun
from swath.rays.device import ThreadPool
from swath.rays.engine import RayCaster
from swath.rays.hits import Hits
from swath.sensing import CAMERA
from swath.sensing.camera.instances import Instances, instances_of
from swath.sensing.camera.lamps import WORK_DISTANCE, WorkLight
from swath.sensing.camera.lighting import SHADOW_REACH, Lighting, LightSetup
from swath.sensing.camera.orthophoto import Orthophoto
from swath.sensing.camera.pinhole import OPTICAL, Pinhole, focal_of
from swath.sensing.camera.shading import Daylight, encode
from swath.sensing.echo import Weather
from swath.sensing.mount import Mount, poses_at
from swath.signals import F64, OBSTACLE_KINDS, Image, MachineState
from swath.signals.image import ImageBoxes, ImageShares, empty_image

Moving = tuple[Solids, F64]  # what a thing consists of, and its velocity (3,) [m/s]
ROOM = 1.1  # of the ball around a thing in which rays are looked for


def over_moving(
    caster: RayCaster,
    hits: Hits,
    origins: F64,
    directions: F64,
    late: F64,
    moving: Sequence[Moving],
    reach: float,
) -> tuple[Hits, F64]:
    """Hits (rows, columns) of what stands, and those of things that go where these are nearer; origins as
    they are for each, (rows, columns, 3).

    origins, directions: (rows, columns, 3) or origins (3,); late: times of the samples after that of the
    picture [s], (rows, columns); reach: longest ray [m]
    """
    starts = np.array(np.broadcast_to(origins, directions.shape))
    made = Hits(*(array.copy() for array in hits.arrays))
    for solids, velocity in moving:
        chosen = np.flatnonzero(_near(solids, velocity, starts, directions, late, reach))
        if len(chosen) == 0:
            continue
        back = late.ravel()[chosen, None] * velocity
        eyes = np.broadcast_to(origins, directions.shape).reshape(-1, 3)[chosen] - back
        found = caster.cast_solids(
            eyes, directions.reshape(-1, 3)[chosen], range_max=reach, solids=solids, normals=True
        )
        before = made.distance.ravel()[chosen]
        nearer = found.is_hit & ~(before <= found.distance)  # before: nan = nothing
        for array, there in zip(made.arrays, found.arrays, strict=True):
            array.reshape(len(starts) * starts.shape[1], *there.shape[1:])[chosen[nearer]] = there[nearer]
        starts.reshape(-1, 3)[chosen[nearer]] = eyes[nearer]
    return made, starts


def _near(solids: Solids, velocity: F64, starts: F64, directions: F64, late: F64, reach: float) -> F64:
    """Whether rays pass the ball around a thing, wherever it is meanwhile: (rows, columns)."""
    middle, half = bounds(parts_of(solids))
    first, last = float(late.min()), float(late.max())
    middle = middle + 0.5 * (first + last) * velocity
    radius = ROOM * (hypot(*half.tolist()) + 0.5 * (last - first) * hypot(*velocity.tolist()))
    away = middle - starts
    along = (away * directions).sum(axis=-1)
    across = (away * away).sum(axis=-1) - along * along
    return np.asarray((across <= radius * radius) & (along > -radius) & (along < reach + radius))


def boxes_of(
    t: int, owner: NDArray[np.uint16], depth: NDArray[np.float32], things: Instances, per_side: int
) -> ImageBoxes:
    """The boxes of all things that at least one sample (rows, columns) shows."""
    v, u = np.nonzero(owner)
    if len(v) == 0:
        return no_boxes(t)
    number = owner[v, u].astype(np.int64)
    size = len(things.names) + 1
    low, high = (np.full((2, size), end) for end in (np.inf, -np.inf))
    near = np.full(size, np.inf)
    for axis, at in enumerate((u // per_side, v // per_side)):
        np.minimum.at(low[axis], number, at)
        np.maximum.at(high[axis], number, at)
    np.minimum.at(near, number, depth[v, u])
    count = np.bincount(number, minlength=size)
    seen = np.flatnonzero(count)
    kind = [OBSTACLE_KINDS.index(things.kinds[k - 1]) for k in seen.tolist()]
    edges = low[0, seen] - 0.5, low[1, seen] - 0.5, high[0, seen] + 0.5, high[1, seen] + 0.5
    columns = (seen.astype(np.float64), np.array(kind, np.uint8), *edges, count[seen] / per_side**2)
    return ImageBoxes(t, *columns, near[seen])


def no_boxes(t: int) -> ImageBoxes:
    """Boxes of a picture without objects."""
    nothing = np.zeros(0)
    return ImageBoxes(t, nothing, np.zeros(0, np.uint8), *[nothing] * 6)


Channel = Literal["colour", "depth", "label", "instance", "raw"]
USUAL_SUN = Sun(200.0 * DEG, 45.0 * DEG)  # where nobody says where it stands
RAYS_MAX = 10_000_000  # full HD with four samples per pixel
DEFAULT_FOV = 70.0  # [deg]


@dataclass(frozen=True)
class SceneParams:
    """The camera's place and what it sees.

    mount: where the camera sits; its x axis is the optical axis
    samples_per_pixel: samples spread over the pixel: its colour is their mean; label and instance are what
        most of them show, depth that of the nearest which shows it
    channels: what an image holds
    shares: whether `shares` is an output: how much of each pixel each thing fills
    reach_m: distance up to which rays are followed; what lies beyond is sky or far crop
    sun_azimuth_deg: direction of the sun, clockwise from north; none = that of field.weather, else 200
    sun_elevation_deg: elevation of the sun, none = that of field.weather, else 45; below the horizon, down to
        the end of nautical twilight, the sky alone gives light, as much of it as at level `error`
    cloud_percent: cloud cover, 0 clear to 100 overcast: no direct light; none = that of field.weather
    shadows: whether things up to 8 m away shade each other
    samples_per_sun_ray: samples of a pixel that share the ray towards the sun: fewer rays, coarser light
    texture: whether soil, straw and plants vary in colour
    own_machine: whether chassis and header of the machine that carries it are seen, as boxes
    work_lights: lamps of the machine; they light what this camera sees, not what others see
    green_percent: share of the colour of unripe plants in that of the crop
    weather: dust and rain between camera and scene; the puffs of near_returns are not for cameras
    orthophoto: GeoTIFF of three bands whose colours the ground has (extra `geo`)
    """

    mount: Mount = field(default_factory=Mount)
    samples_per_pixel: Literal[1, 4, 9, 16] = 1
    channels: Annotated[tuple[Channel, ...], MinLen(1)] = ("colour", "depth", "label")
    shares: bool = False
    reach_m: Annotated[float, Gt(0), Le(200)] = 60.0
    sun_azimuth_deg: Annotated[float, Ge(-360), Le(360)] | None = None
    sun_elevation_deg: Annotated[float, Ge(-12), Le(90)] | None = None
    cloud_percent: Annotated[float, Ge(0), Le(100)] | None = None
    shadows: bool = True
    samples_per_sun_ray: Literal[1, 2, 4] = 1
    texture: bool = True
    own_machine: bool = False
    work_lights: tuple[WorkLight, ...] = ()
    green_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    weather: Weather = field(default_factory=Weather)
    orthophoto: str | None = None


@dataclass(frozen=True)
class Params(SceneParams):
    """An ideal pinhole camera.

    width_px: width of the image
    height_px: height of the image
    horizontal_fov_deg: angle from the left to the right edge of the image; none = 70, or what focal_px gives
    focal_px: focal length over the side of a pixel, in place of horizontal_fov_deg
    """

    width_px: Annotated[int, Ge(1), Le(8192)] = 320
    height_px: Annotated[int, Ge(1), Le(8192)] = 240
    horizontal_fov_deg: Annotated[float, Gt(0), Le(160)] | None = None
    focal_px: Annotated[float, Gt(0), Le(1e5)] | None = None


@dataclass(frozen=True)
class Sight:
    """What all samples of an image see: hits, origins (3,) or (rows, columns, 3), directions (rows, columns,
    3) in the world; depth along the optical axis [m], (rows, columns), nan = nothing; things in sight;
    pose_world_optical at the time of the picture.
    """

    hits: Hits
    origins: F64
    directions: F64
    depth: NDArray[np.float32]
    things: Instances
    pose: Pose


class SceneCamera(KeepsState):
    """A camera on a machine: what every level shares. A level makes its outputs in `picture`.

    pinhole: its intrinsics; mounting, optical: pose_machine_sensor of the body frame (x forward) and of the
        optical frame (z forward); mtf: of the lens, as `through_lens` takes it
    """

    mtf = 1.0
    kept: ClassVar[tuple[str, ...]] = ("_last", "_casts")

    def __init__(self, params: SceneParams, setup: SiteSetup, pinhole: Pinhole) -> None:
        self.params, self.setup, self.pinhole = params, setup, pinhole
        check_samples(self.pinhole, params.samples_per_pixel)
        if params.samples_per_pixel % params.samples_per_sun_ray:
            expected = f"expected a divisor of samples_per_pixel, {params.samples_per_pixel}"
            raise InputError("samples_per_sun_ray", params.samples_per_sun_ray, expected)
        if params.weather.near_returns > 0.0:
            raise InputError("weather.near_returns", params.weather.near_returns, "expected 0 for a camera")
        self.mounting: Pose = params.mount.pose(setup.machine, setup.edge_side)
        if self.mounting.position[2] <= 0:
            raise InputError("mount.z_m", params.mount.z_m, "expected a sensor above the ground")
        self.optical = self.mounting @ OPTICAL
        self._lamps = [
            (w, self.optical.inverse() @ w.pose(setup.machine, setup.edge_side)) for w in params.work_lights
        ]
        brightest = max((w.candela for w in params.work_lights), default=0.0)
        self._lamplight = brightest / WORK_DISTANCE**2  # [lx]
        self.per_side = isqrt(params.samples_per_pixel)
        self._rays = self.pinhole.rays(self.per_side)  # unit directions in the optical frame
        self.caster = RayCaster(setup.field)
        self._photo = (
            None if params.orthophoto is None else Orthophoto(params.orthophoto, setup.base, setup.origin)
        )
        self._lighting = Lighting(self._light_setup(0), setup.field, ThreadPool(self.caster.threads))
        self._casts = 0
        self._last: MachineState | None = None
        self.inputs = (Port("state", MachineState, history=True),)
        more = (Port("shares", ImageShares),) if params.shares else ()
        self.outputs = (Port("image", Image), Port("boxes", ImageBoxes), *more)

    def sky(self, t: int) -> tuple[Sun, float]:
        """The sun, and the cloud cover from 0 to 1, at a time of the run [ns]: its own keys win."""
        p, weather = self.params, self.setup.field.weather
        sun = None if weather is None else weather.sun(t)
        azimuth, elevation = (
            (USUAL_SUN.azimuth, USUAL_SUN.elevation) if sun is None else (sun.azimuth, sun.elevation)
        )
        if p.sun_azimuth_deg is not None:
            azimuth = p.sun_azimuth_deg * DEG
        if p.sun_elevation_deg is not None:
            elevation = p.sun_elevation_deg * DEG
        if p.cloud_percent is not None:
            return Sun(azimuth, elevation), p.cloud_percent * PERCENT
        return Sun(azimuth, elevation), 0.0 if weather is None else weather.at(t).cloud

    def daylight(self, t: int) -> Daylight:
        """The light of a picture at a time of the run [ns]."""
        return Daylight(*self.sky(t), self._lamplight)

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """Its weather, with the dust that drifts past it, and the light on level ground and of its lamps."""
        field, (sun, cloud) = self.setup.field, self.sky(state.t)
        weather = self.params.weather.under(field.weather, state.t, GREEN)
        met = weather.met(field, state.pose.apply(self.mounting.position))
        return {**met, "light_lx": light(sun.elevation, cloud).lux + self._lamplight}

    def _light_setup(self, t: int) -> LightSetup:
        p = self.params
        return LightSetup(
            day=self.daylight(t),
            green=p.green_percent * PERCENT,
            shadows=p.shadows,
            per_side=isqrt(p.samples_per_pixel),
            shared=p.samples_per_sun_ray,
            texture=p.texture,
            extinction=p.weather.under(self.setup.field.weather, t, GREEN).extinction,
            pixel_angle=1.0 / self.pinhole.focal,
            seed=self.setup.field.maker.seed,
            photo=self._photo,
            film=self.setup.field.film(t),
        )

    @property
    def ray_count(self) -> int:
        """Rays cast since the start."""
        return self._casts + self._lighting.ray_count

    def reset(self, stream: Stream) -> Outputs:
        """A black image that shows nothing."""
        self._last, self._casts, self._lighting.ray_count = None, 0, 0
        made = {"image": empty_image(0, self.pinhole, self.params.channels), "boxes": no_boxes(0)}
        return made | self._shares(0, np.zeros(0), np.zeros((0, 0), np.uint16))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The image at t + dt, and where things are in it."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        return self.picture(t + dt, known)

    def picture(self, t: int, known: tuple[MachineState, ...]) -> Outputs:
        """The outputs at t [ns] of a machine that was in these states."""
        return self.picture_from(t, self.pose_at(t, known))

    def pose_at(self, t: int, known: tuple[MachineState, ...]) -> Pose:
        """pose_world_optical at t [ns] of a machine that was in these states."""
        position, rotation = poses_at(known, np.array([float(t)]))
        return Pose(position[0], rotation[0]) @ self.optical

    def picture_from(self, t: int, pose: Pose) -> Outputs:
        """The outputs at t [ns] of a camera that stands at the pose_world_optical."""
        raise NotImplementedError

    def image_from(self, t: int, pose: Pose) -> Image:
        """The image of `picture_from`."""
        image = self.picture_from(t, pose)["image"]
        assert isinstance(image, Image)
        return image

    def sight(self, t: int, pose: Pose) -> Sight:
        """What the samples see at t [ns] from one pose_world_optical."""
        return self.look(t, pose, pose.position, pose.turn(self._rays))

    def look(self, t: int, pose: Pose, origins: F64, directions: F64, late: F64 | None = None) -> Sight:
        """Cast rays (rows, columns, 3) of all samples from origins (3,) or of the same shape.

        pose: pose_world_optical at t
        late: times of the samples after t [s], (rows, columns), so that things are seen where they are then;
        None = all at t
        """
        eye = origins if origins.ndim == 1 else origins[len(origins) // 2, origins.shape[1] // 2]
        reach = self.params.reach_m
        self.setup.field.ensure(eye[0], eye[1], reach + SHADOW_REACH)
        bodies, own = self.setup.bodies, self.params.own_machine
        things = instances_of(bodies.in_sight(self.setup.name, itself=own))
        moving = [] if late is None else things.moving
        solids = things.standing if moving else things.solids
        hits = self.caster.cast_image(origins, directions, range_max=reach, solids=solids, t=t, normals=True)
        if late is not None and moving:
            hits, origins = over_moving(self.caster, hits, origins, directions, late, moving, reach)
        self._casts += hits.organ.size
        depth = (hits.distance * self._rays[..., 2]).astype(np.float32)
        return Sight(hits, origins, directions, depth, things, pose)

    def light(self, seen: Sight, t: int) -> F64:
        """Linear light of the pixels (height, width, 3): the mean of their samples."""
        if self.setup.field.weather is not None:
            self._lighting.setup = self._light_setup(t)
        lamps = [(w, seen.pose @ pose) for w, pose in self._lamps]
        rays = seen.hits, seen.origins, seen.directions
        return self.pixels(self._lighting.light(*rays, seen.things, self.caster, t, lamps))

    def pixels(self, samples: NDArray[Any]) -> F64:
        """What pixels (height, width, ...) take in of samples (rows, columns, ...)."""
        return through_lens(cells(samples, self.per_side).mean(axis=0, dtype=np.float64), self.mtf)

    def outputs_of(self, t: int, seen: Sight, **channels: Any) -> Outputs:
        """The outputs with these channels and those of the samples: what most of a pixel's samples show, of
        equals the nearest.
        """
        owner = seen.things.owners(seen.hits)
        boxes = boxes_of(t, owner, seen.depth, seen.things, self.per_side)
        own: dict[str, NDArray[Any]] = {"depth": seen.depth, "label": seen.hits.organ, "instance": owner}
        wide = {name: cells(array, self.per_side) for name, array in own.items()}
        things = wide["instance"].astype(np.int32)
        shown = np.where(things > 0, len(Organ) + things, wide["label"])
        votes = np.array([(shown == one).sum(axis=0) for one in shown])
        far = np.where(np.isnan(wide["depth"]), 2.0 * self.params.reach_m, wide["depth"])
        chosen = np.where(votes == votes.max(axis=0), far, np.inf).argmin(axis=0)[None]
        for name, array in wide.items():
            if name in self.params.channels:
                channels.setdefault(name, np.take_along_axis(array, chosen, axis=0)[0])
        image = empty_image(t, self.pinhole, (), **channels)
        return {"image": image, "boxes": boxes} | self._shares(t, boxes.instance, owner)

    def _shares(self, t: int, numbers: F64, owner: NDArray[np.uint16]) -> dict[str, Signal]:
        """The output `shares` of things where it is asked for. owner: of the samples (rows, columns)."""
        if not self.params.shares:
            return {}
        share = np.empty((self.pinhole.height, self.pinhole.width, len(numbers)), np.float32)
        for k, number in enumerate(numbers):
            share[..., k] = self.pixels(owner == number)
        return {"shares": ImageShares(t, self.pinhole.width, self.pinhole.height, numbers, share)}


class RaysCamera(SceneCamera):
    """The perfect camera."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if "raw" in params.channels:
            raise InputError("channels", list(params.channels), "expected no raw: level error has it")
        super().__init__(params, setup, pinhole_of(params, Lens()))

    def picture_from(self, t: int, pose: Pose) -> Outputs:
        """Every sample at once."""
        seen = self.sight(t, pose)
        if "colour" not in self.params.channels:
            return self.outputs_of(t, seen)
        return self.outputs_of(t, seen, colour=encode(self.light(seen, t)))


def pinhole_of(params: Params, lens: Lens) -> Pinhole:
    """The intrinsics that parameters ask for. InputError for a focal length beside a field of view."""
    if params.focal_px is None:
        fov = DEFAULT_FOV if params.horizontal_fov_deg is None else params.horizontal_fov_deg
        return Pinhole.centred(params.width_px, params.height_px, focal_of(params.width_px, fov * DEG), lens)
    if params.horizontal_fov_deg is not None:
        raise InputError("focal_px", params.focal_px, "expected no horizontal_fov_deg beside it")
    return Pinhole.centred(params.width_px, params.height_px, params.focal_px, lens)


def check_samples(pinhole: Pinhole, per_pixel: int) -> None:
    """InputError where an image has more samples than memory should hold."""
    if pinhole.width * pinhole.height * per_pixel > RAYS_MAX:
        raise InputError("width_px", pinhole.width, f"expected at most {RAYS_MAX} samples per image")


def cells(samples: NDArray[Any], per_side: int) -> NDArray[Any]:
    """Samples (rows, columns, ...) by pixel: (per_side^2, height, width, ...)."""
    rows, columns, *rest = samples.shape
    size = rows // per_side, columns // per_side
    cut = samples.reshape(size[0], per_side, size[1], per_side, *rest)
    return np.moveaxis(cut, (1, 3), (0, 1)).reshape(per_side**2, *size, *rest)


def through_lens(pixels: F64, mtf: float) -> F64:
    """Pixels (height, width, ...) through a lens that keeps the share mtf of a pattern that repeats every two
    pixels (its MTF at the Nyquist frequency): each gives (1 - mtf) / 4 to both neighbours in its column, then
    in its row, MTF 1 - (1 - mtf) sin^2(pi f); border pixels stand for what lies beyond.
    """
    if mtf == 1.0:
        return pixels
    aside = 0.25 * (1.0 - mtf)
    wide = np.concatenate([pixels[:1], pixels, pixels[-1:]])
    down = (1.0 - 2.0 * aside) * pixels + aside * (wide[:-2] + wide[2:])
    wide = np.concatenate([down[:, :1], down, down[:, -1:]], axis=1)
    return np.asarray((1.0 - 2.0 * aside) * down + aside * (wide[:, :-2] + wide[:, 2:]))


def diffraction_mtf(wavelength: float, f_number: float, pixel: float) -> float:
    """MTF at the Nyquist frequency 1 / (2 pixel) of a round lens without aberrations, all [m] but f_number
    (Goodman, Introduction to Fourier Optics, 3rd ed., eq. 6-33).
    """
    part = 0.5 * wavelength * f_number / pixel
    return 0.0 if part >= 1.0 else 2.0 / pi * (acos(part) - part * sqrt(1.0 - part * part))


LEVEL = Level(
    RaysCamera,
    Params,
    "pinhole camera: colour, depth, label and instance by rays against every stem, ear and leaf",
    cost="about 0.15 s of one core per image of 320 x 240",
    tolerance="pixels within 0.5 px of the pinhole formula, labels as ray by ray",
    checked=CAMERA,
)
