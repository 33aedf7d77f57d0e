"""What is asked: sensors on a standing machine before a crop edge, a person at places before and behind it.

After REDA, a person on a grid of places under changing conditions (doi:10.3390/s22155745); the places, crop
and weather here are our own.

Of each sensor is counted how often it reports a person at a place, and of one that is not there.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from math import asin, atan2, cos, exp, hypot, inf, log10, pi, tan
from pathlib import Path
from typing import Any

import numpy as np

from swath.control.objects import cluster
from swath.core.errors import InputError, check_once, check_within
from swath.core.frames import Pose
from swath.core.number_text import num, percent_of
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import StraightEdge
from swath.field.field import Field
from swath.field.light import light
from swath.field.maps.projection import origin_at
from swath.field.memory_layout import Organ
from swath.field.site_setup import Body, SiteSetup
from swath.field.solid.obstacles import Path as ObstaclePath
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.field.weather import GREEN, SiteWeather, Weather
from swath.rays.engine import RayCaster
from swath.sensing.camera import thermal
from swath.sensing.camera.camera_sheet import load_camera
from swath.sensing.camera.error import photon_rate
from swath.sensing.camera.pinhole import OPTICAL
from swath.sensing.echo import ScannerWeather
from swath.sensing.echo import Weather as SensorWeather
from swath.sensing.lidar import plants
from swath.sensing.mount import Mount
from swath.sensing.radar import rays
from swath.sensing.radar.detector import surroundings
from swath.sensing.radar.ideal import RadarMount
from swath.sensing.radar.solid_rays import aimed, distances
from swath.signals import F64, MachineState
from swath.signals.setup import ControlSetup, MachineGeometry
from swath.tools.level_stand import level_stand

EDGE_M = 6.0  # the crop begins so far ahead of the sensors, which stand above the knife
KNIFE_M = 0.5
NAME, TARGET = "rig", "person"
RIG = MachineGeometry(3.0, 2.0, 2.0, 0.5, 6.0, KNIFE_M, 0.0, 0.5, 0.5, (-3.0, 0.0, 1.0, 0.5, 3.0))
WEATHERS = {"clear": (0.0, 0.0), "dust": (0.1, 0.0), "rain": (0.0, 10.0)}  # extinction [1/m], rain [mm/h]
INSIDE = (-3.0, -1.0, 1.0, 3.0, 5.0, 8.0, 11.0, 14.0, 18.0)  # places behind the crop edge [m], < 0 before it
ASIDE = (-8.0, -4.0, 0.0, 4.0, 8.0)
SENSORS = ("lidar", "radar-24ghz", "radar-77ghz-corner", "camera", "thermal")
DAY, PLACE = "2026-07-25", (52.3, 8.0)  # of the hours: a clear day of harvest in the north of Germany
MEAN_C, SWING_C, WARMEST_H, VAPOUR_HPA = 18.0, 7.0, 16.0, 12.0  # air of that day, an estimate
LEAST_WIND, DAY_WIND = 0.5, 2.0  # at night and at noon [m/s], an estimate


@dataclass(frozen=True)
class Condition:
    """height: of the crop [m]; density [stems/m2]; weather: a key of WEATHERS.

    hour: of DAY, summer time; None = by day, nothing is warm
    """

    height: float
    density: float
    weather: str
    hour: float | None = None

    @property
    def name(self) -> str:
        """Such as `wheat 0.85 m, 500/m2, dust` without the crop."""
        hour = "" if self.hour is None else f", {num(self.hour)} h"
        return f"{num(self.height)} m, {num(self.density)} stems/m2, {self.weather}{hour}"

    @property
    def file(self) -> str:
        """Name of its figure."""
        hour = "" if self.hour is None else f"-{self.hour:g}h"
        return f"reda-{100 * self.height:.0f}cm-{self.density:.0f}-{self.weather}{hour}.png"


@dataclass(frozen=True)
class Settings:
    """heights [m], densities [stems/m2], weathers, hours: every combination is a condition.

    sensors: of SENSORS
    target: a sheet of `data/obstacles/`
    target_height: None = its sheet's
    low_height: of the same one lower, for the table alone [m]
    crop: sheet
    moisture: of the straw [%]
    camera_px: width of the picture
    camera_least_px: height of what is seen of the person that a detector needs
    least: share of looks from which on a place counts as covered
    repeats: at each place, within 0.3 m
    looks: of a radar at each of them
    """

    heights: tuple[float, ...] = (0.6, 0.85)
    densities: tuple[float, ...] = (300.0, 500.0)
    weathers: tuple[str, ...] = tuple(WEATHERS)
    hours: tuple[float, ...] = ()
    sensors: tuple[str, ...] = SENSORS[:-1]
    target: str = TARGET
    target_height: float | None = None
    low_height: float = 0.8
    crop: str = "wheat"
    moisture: float = 12.0
    camera_px: int = 1280
    camera_least_px: float = 40.0
    least: float = 0.9
    repeats: int = 2
    looks: int = 8
    seed: int = 1
    base: Path = field(default_factory=Path)

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        for key, values, low, high in (
            ("--crop-height-m", self.heights, 0.2, 3.0),
            ("--stems-per-m2", self.densities, 10.0, 1500.0),
            ("--hour", self.hours, 0.0, 24.0),
            ("--moisture-percent", (self.moisture,), 0.0, 80.0),
            ("--camera-px", (self.camera_px,), 64.0, 20000.0),
            ("--camera-least-px", (self.camera_least_px,), 1.0, 2000.0),
            ("--least", (self.least,), 0.01, 1.0),
            ("--repeats", (self.repeats,), 1.0, 100.0),
            ("--seed", (self.seed,), 0.0, 2.0**31),
        ):
            for value in values:
                check_within(key, value, low, high)
        for key, names, known in (
            ("--weather", self.weathers, tuple(WEATHERS)),
            ("--sensor", self.sensors, SENSORS),
        ):
            for name in names:
                if name not in known:
                    raise InputError(key, name, f"expected one of {', '.join(known)}")
            check_once(key, names)
        if "thermal" in self.sensors and not self.hours:
            raise InputError(
                "--hour", None, "expected one or more for thermal: what is warm goes by the hour"
            )

    def conditions(self) -> list[Condition]:
        """All conditions, the weather last."""
        every = product(self.heights, self.densities, self.weathers, self.hours or (None,))
        return [Condition(*values) for values in every]


class Scene:
    """The field of a condition, with a person who can be put anywhere. setup: what sensors are given."""

    def __init__(self, settings: Settings, condition: Condition) -> None:
        self.settings, self.condition = settings, condition
        self.stream = Stream(settings.seed, "reda")
        self.field = _field(settings, condition, self.stream)
        self.setup = SiteSetup(self.field, RIG, Pose.identity(), "left", 0.1, NAME, base=settings.base)
        self.field.ensure(0.0, 0.0, 60.0)
        self.height: float | None = settings.target_height

    @property
    def weather(self) -> tuple[float, float]:
        """Extinction of the dust [1/m] and rain [mm/h]."""
        return WEATHERS[self.condition.weather]

    def put(self, inside: float, aside: float, *, repeat: int = 0) -> Body:
        """The person at a place behind the crop edge, within 0.3 m of it after the first time."""
        moved = np.zeros(2)
        turn = 0.0
        if repeat:
            draw = self.stream.child(f"place {inside:g} {aside:g}").at(repeat)
            moved, turn = draw.uniform(-0.3, 0.3, 2), float(draw.uniform(-180.0, 180.0))
        x, y = EDGE_M + inside + float(moved[0]), aside + float(moved[1])
        kind, _, posture = self.settings.target.partition("-")
        thing = SheetObstacle(
            kind=kind,  # type: ignore[arg-type]
            posture=posture or None,  # type: ignore[arg-type]
            name=TARGET,
            x_m=x,
            y_m=y,
            height_m=self.height,
            heading_deg=turn,
            path=ObstaclePath(to=((x - 1.0, y),)),  # what can go is not part of the standing obstacles
        )
        self.clear()
        self.setup.bodies.set_things(things_of([thing], self.field))
        return next(body for body in self.setup.bodies.around(NAME) if body.name == TARGET)

    def clear(self) -> None:
        """Nobody there."""
        self.setup.bodies.set_things(())


def places() -> Iterator[tuple[float, float]]:
    """All places of the grid, (inside, aside) [m]."""
    return product(INSIDE, ASIDE)


def _field(settings: Settings, condition: Condition, stream: Stream) -> Field:
    crop = load_crop(settings.crop, settings.base)
    edge = StraightEdge(x_m=EDGE_M, y_m=-200.0, length_m=400.0, crop_begins_m=None, stubble_height_m=0.15)
    air = None if condition.hour is None else air_at(condition.hour)
    own = stream.child("stand")
    return level_stand(
        crop, condition.density, own, height=condition.height, sheet=settings.crop, edge=edge, weather=air
    )


def air_at(hour: float) -> SiteWeather:
    """Sun, air and wind of DAY at an hour of summer time."""
    warm = MEAN_C + SWING_C * cos(2.0 * pi * (hour - WARMEST_H) / 24.0)
    saturated = 6.108 * exp(17.27 * warm / (warm + 237.3))  # FAO Irrigation and Drainage Paper 56, eq. 11
    light = max(cos(2.0 * pi * (hour - 13.5) / 24.0), 0.0)
    told = Weather(
        time=f"{DAY}T{int(hour) % 24:02d}:{int(60.0 * (hour % 1.0)):02d}+02:00",
        temperature_c=warm,
        humidity_percent=min(100.0 * VAPOUR_HPA / saturated, 98.0),
        wind_m_s=LEAST_WIND + (DAY_WIND - LEAST_WIND) * light,
    )
    return SiteWeather(told, origin_at(*PLACE, 0.0))


GATE_M = 1.0  # a report so far from the person is one of it
SCANS = 4  # of a LiDAR at each place; the first ones make a thing count
EMPTY_LOOKS = 24  # without a person
ROOF_M, HOOD_M = 3.8, 1.6  # heights of LiDAR and camera, and of radars
FOV_DEG = 70.0  # of the camera, across
LEAST_SNR = 3.0  # of a person's contrast in a pixel: an estimate
PAPER, CONTRAST = 0.4, 0.3  # usual reflectance of a scene, and contrast of clothes or fur in it: estimates
BAND_NM = 100.0  # of green light
THERMAL_PX, WINDOW_PX = 640, 64  # of the picture, and of what is looked at around the target
LEAST_PX, LEAST_OVER_CLUTTER = 6.0, 3.0  # pixels and contrast over clutter that a detector needs: estimates
LEAST_CONTRAST = 0.05  # of a dark thing before the horizon: Koschmieder's threshold of visibility
SEEN_FROM = 13.0  # dB over noise or clutter from which on a radar detects half of the looks, Pfa some 1e-6


@dataclass(frozen=True)
class Answer:
    """detected: share of the looks at the person; why: what decides it, in words with numbers."""

    detected: float
    why: str


def make_sensor(name: str, scene: Scene) -> "Sensor":
    """A sensor by its name in SENSORS."""
    if name == "lidar":
        return LidarSensor(scene)
    if name == "thermal":
        return ThermalSensor(scene)
    return CameraSensor(scene) if name == "camera" else RadarSensor(scene, name)


def visible(scene: Scene, caster: RayCaster, body: Body, eye: F64) -> tuple[float, F64]:
    """Share of a body's silhouette that crop does not hide from an eye (3,), and its points there (n, 3)."""
    ways = aimed(body, eye, (12, 12), (35, 35))
    whole = np.isfinite(distances(body.solids, eye, ways))
    ways = ways[whole]
    hits = caster.cast(np.repeat(eye[None], len(ways), axis=0), ways, range_max=60.0, solids=body.solids)
    seen = hits.organ == Organ.SOLID
    points = eye + hits.distance[seen, None].astype(np.float64) * ways[seen]
    return float(np.count_nonzero(seen)) / max(len(ways), 1), points


class LidarSensor:
    """A 16-line scanner on the roof, level `plants`, and what level `objects: cluster` makes of its scans."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        dust, rain = scene.weather
        params = plants.Params(
            sensor="velodyne-vlp16",
            mount=Mount(at="axle", z_m=ROOF_M, pitch_deg=20.0),
            sector_deg=(-60.0, 60.0),
            step_deg=0.4,
            sub_rays=7,
            weather=ScannerWeather(extinction_per_m=dust, rain_mm_h=rain),
        )
        self._lidar = plants.PlantsLidar(params, scene.setup)
        self._eye = self._lidar.mounting.position
        mountings = {"scan": self._lidar.mounting}
        self._control = ControlSetup(RIG, mountings, "left", 0.1)
        self._extinction = params.weather.extinction
        self._empty: list[list[tuple[float, float]]] | None = None

    def look(self, inside: float, aside: float) -> Answer:
        """How the sensor answers to a person so far inside and beside [m]."""
        found, count, shares = 0, 0, []
        for repeat in range(self._scene.settings.repeats):
            body = self._scene.put(inside, aside, repeat=repeat)
            x, y, _ = body.pose.position.tolist()
            for objects in self._objects(SCANS, repeat):
                found += any(hypot(a - x, b - y) < GATE_M for a, b in objects)
                count += 1
            shares.append(visible(self._scene, self._lidar.caster, body, self._eye)[0])
        share, far = float(np.mean(shares)), hypot(x, y)
        left = exp(-2.0 * self._extinction * far)
        why = f"{percent_of(share)} of the body in sight"
        if left < 0.9:
            why += f", {percent_of(left)} of an echo's energy comes through the air"
        return Answer(found / count, why)

    def false_share(self, inside: float, aside: float) -> float:
        """Share of looks with a false alarm."""
        if self._empty is None:
            self._scene.clear()
            self._empty = self._objects(EMPTY_LOOKS, 0)
        x, y = EDGE_M + inside, aside
        return float(np.mean([any(hypot(a - x, b - y) < GATE_M for a, b in o) for o in self._empty]))

    def _objects(self, scans: int, repeat: int) -> list[list[tuple[float, float]]]:
        """Places of objects after each scan from the one on that can make a thing count."""
        self._lidar.reset(self._scene.stream.child("lidar"))
        part = cluster.Cluster(cluster.Params(reach_m=40.0, side_m=12.0), self._control)
        part.reset(self._scene.stream.child("objects"))
        found = []
        for k in range(scans):
            t = (100 * repeat + k) * NS // 10
            states = tuple(_standing(at) for at in (t, t + NS // 10))
            scan = self._lidar.step(t, NS // 10, {"state": states})["scan"]
            inputs = {"scan": scan, "odometry": None, "edge": None}
            objects: Any = part.step(t, NS // 10, inputs)["objects"]
            found.append(list(zip(objects.x.tolist(), objects.y.tolist(), strict=True)))
        return found[cluster.Params().confirm - 1 :]


class RadarSensor:
    """A radar above the header, level `rays`: single looks, no following."""

    def __init__(self, scene: Scene, name: str) -> None:
        self._scene = scene
        params = rays.Params(
            sensor=name,
            mount=RadarMount(x_m=0.0, z_m=HOOD_M),
            straw_moisture_percent=scene.settings.moisture,
            rain_mm_h=scene.weather[1],
        )
        self._radar = rays.RaysRadar(params, scene.setup)
        self._bare = rays.RaysRadar(replace(params, stand_loss_percent=0.0), scene.setup)
        self._quiet = rays.RaysRadar(replace(params, noise="none"), scene.setup)
        self._training = params.training
        self._stream = scene.stream.child(name)
        for radar in (self._radar, self._bare):
            radar.reset(self._stream)
        states = tuple(_standing(t) for t in (0, NS // 20))
        self._here = self._radar.locate(NS // 20, {"state": states})
        self._clutter = self._radar.clutter(*self._here)
        self._count = 0
        self._empty: list[list[list[float]]] | None = None

    def look(self, inside: float, aside: float) -> Answer:
        """How the sensor answers to a person so far inside and beside [m]."""
        found, reasons = [], []
        for repeat in range(self._scene.settings.repeats):
            body = self._scene.put(inside, aside, repeat=repeat)
            parts = self._radar.parts(*self._here)
            x, y, _ = body.pose.position.tolist()
            looks = range(self._scene.settings.looks)
            found += [self._is_near(self._detections(parts), x, y) for _ in looks]
            reasons.append(self._levels(parts, x, y))
        return Answer(float(np.mean(found)), _why(*np.mean(reasons, axis=0).tolist()))

    def false_share(self, inside: float, aside: float) -> float:
        """Share of looks with a false alarm."""
        if self._empty is None:
            self._scene.clear()
            nobody = self._radar.parts(*self._here)
            self._empty = [self._detections(nobody) for _ in range(EMPTY_LOOKS)]
        return float(np.mean([self._is_near(rows, EDGE_M + inside, aside) for rows in self._empty]))

    def _detections(self, parts: rays.Parts) -> list[list[float]]:
        self._count += 1
        return self._radar.detections(parts, self._clutter, self._stream.at(self._count))

    def _is_near(self, rows: list[list[float]], x: float, y: float) -> bool:
        far, azimuth = hypot(x, y), atan2(y, x)
        s = self._radar.sheet
        across = max(GATE_M, s.azimuth_resolution * far)
        along = max(GATE_M, s.range_resolution)
        return any(abs(r[0] - far) < along and abs(r[1] - azimuth) * far < across for r in rows)

    def _levels(self, parts: rays.Parts, x: float, y: float) -> tuple[float, float, float]:
        """Echo in its strongest bin, loss in the crop, mean of the bins beside that [dB over noise]."""
        bare, echo = (float(p.snr.sum()) for p in (self._bare.parts(*self._here), parts))
        radar, (mean, speed, spread), draw = self._radar, self._clutter, self._stream.at(0)
        alone, whole = (self._quiet.columns(parts, m, speed, spread, draw) for m in (0.0 * mean, mean))
        strongest = around = 0.0
        if len(parts.snr):
            column, place = np.unravel_index(alone.power.argmax(), alone.power.shape)
            a, s, p = (np.array([v]) for v in (alone.azimuth[column], alone.speed[column], place))
            strongest = float(alone.power[column, place] - 1.0)
            around = float(surroundings(whole, radar.grid, a, s, p, self._training).mean())
        loss = _decibel(bare) - _decibel(echo)
        return _decibel(strongest / radar.gain), loss, _decibel(around / radar.gain)


class Picture:
    """What looks at pictures."""

    def false_share(self, inside: float, aside: float) -> float:
        """Share of looks with a false alarm."""
        return 0.0  # a picture's geometry makes no mistakes; a detector would


class CameraSensor(Picture):
    """A camera on the roof: height of the person in pixels times the share that the crop leaves in sight, and
    contrast through the air.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._caster = scene, RayCaster(scene.field)
        self._focal = 0.5 * scene.settings.camera_px / tan(0.5 * FOV_DEG * DEG)
        self._eye = np.array([0.0, 0.0, ROOF_M])
        dust, rain = scene.weather
        self._extinction = SensorWeather(extinction_per_m=dust, rain_mm_h=rain).extinction
        self._light = self._snr()

    def _snr(self) -> float:
        """Contrast over noise of a pixel at the longest exposure; inf without an hour."""
        weather = self._scene.field.weather
        sun = None if weather is None else weather.sun(0)
        if sun is None:
            return inf
        s, day = load_camera("camera-global-3um45"), light(sun.elevation)
        image = PAPER * BAND_NM * day.at(GREEN, day.level) * s.transmission / (4.0 * s.f_number**2)
        count = s.efficiency(1) * s.exposure_max * float(photon_rate(image, s.pixel, GREEN))
        return CONTRAST * count / hypot(count**0.5, s.dark_noise)

    def look(self, inside: float, aside: float) -> Answer:
        """How the sensor answers to a person so far inside and beside [m]."""
        found, pixels, contrasts = [], [], []
        for repeat in range(self._scene.settings.repeats):
            body = self._scene.put(inside, aside, repeat=repeat)
            share, _ = visible(self._scene, self._caster, body, self._eye)
            x, y, _ = body.pose.position.tolist()
            high = share * self._focal * 2.0 * float(body.half[2]) / x
            contrast = exp(-self._extinction * hypot(x, y))
            in_view = abs(atan2(y, x)) < 0.5 * FOV_DEG * DEG
            need = self._scene.settings.camera_least_px
            is_clear = contrast >= LEAST_CONTRAST and contrast * self._light >= LEAST_SNR
            found.append(in_view and high >= need and is_clear)
            pixels.append(high)
            contrasts.append(contrast)
        why = f"{num(np.mean(pixels))} px of height in sight, contrast {num(np.mean(contrasts))}"
        why += ", too dark" if self._light < LEAST_SNR else ""
        return Answer(float(np.mean(found)), why if in_view else why + ", out of view")


class ThermalSensor(Picture):
    """A thermal camera on the roof, level `thermal`: how much is seen of the target, and how it differs from
    what is around it over the spread of that; no detector is run.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._eye = scene, np.array([0.0, 0.0, ROOF_M])
        self._focal = 0.5 * THERMAL_PX / tan(0.5 * FOV_DEG * DEG)

    def look(self, inside: float, aside: float) -> Answer:
        """How the sensor answers to a target so far inside and beside [m]."""
        found, pixels, overs = [], [], []
        for repeat in range(self._scene.settings.repeats):
            body = self._scene.put(inside, aside, repeat=repeat)
            ahead = body.pose.apply(body.middle) - self._eye
            in_view = abs(atan2(ahead[1], ahead[0])) < 0.5 * FOV_DEG * DEG
            count, over = self._seen(body, ahead)
            found.append(in_view and count >= LEAST_PX and over >= LEAST_OVER_CLUTTER)
            pixels.append(count)
            overs.append(over)
        why = f"{num(np.mean(pixels))} px in sight, {num(np.mean(overs))} times the spread around it"
        return Answer(float(np.mean(found)), why if in_view else why + ", out of view")

    def _seen(self, body: Body, ahead: F64) -> tuple[float, float]:
        """Pixels of the camera that show a body, and its contrast over the clutter."""
        far = hypot(*ahead.tolist())
        wide = 2.0 * hypot(*body.half.tolist())
        focal = min(self._focal, 0.5 * WINDOW_PX * far / wide)  # the window holds it, and what is around it
        yaw, pitch = atan2(ahead[1], ahead[0]), -asin(ahead[2] / far)
        params = thermal.Params(
            mount=Mount(at="axle", z_m=ROOF_M),
            width_px=WINDOW_PX,
            height_px=WINDOW_PX,
            focal_px=focal,
            channels=("label", "raw"),
            shares=True,
        )
        camera = thermal.ThermalCamera(params, self._scene.setup)
        camera.reset(self._scene.stream.child("thermal"))
        out: Any = camera.picture_from(NS, Pose.from_euler(self._eye, yaw=yaw, pitch=pitch) @ OPTICAL)
        image, area = out["image"], float(out["boxes"].area.sum())
        kelvin, share = image.raw[..., 0] / thermal.CENTIKELVIN, out["shares"].share.sum(axis=2, dtype=float)
        around = kelvin[(share == 0.0) & (image.label > 0)]
        if not share.any() or len(around) < WINDOW_PX:
            return 0.0, 0.0
        contrast = abs(float((share * kelvin).sum() / share.sum() - around.mean()))
        return area * (self._focal / focal) ** 2, contrast / max(float(around.std()), 0.01)


Sensor = LidarSensor | RadarSensor | CameraSensor | ThermalSensor


def _why(echo: float, loss: float, clutter: float) -> str:
    text = f"echo {num(echo)} dB over noise, crop takes {num(loss)} dB, {num(clutter)} dB around it"
    if echo < SEEN_FROM:
        return text + (": lost in the crop" if echo + loss > SEEN_FROM else ": too weak")
    return text + (": crop and ground are as strong" if echo - max(clutter, 0.0) < SEEN_FROM else "")


def _decibel(power: float) -> float:
    return 10.0 * log10(max(power, 1e-9))


def _standing(t: int) -> MachineState:
    return MachineState(t, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)
