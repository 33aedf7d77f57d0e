"""Radar level `error`: each thing in view by the radar equation, as the detector of one look gives it.

    SNR = SNR_ref + s - s_ref - 40 lg(R / R_ref) - 2 (stand + rain) + 2 G(azimuth, elevation) - losses

A target's echo fluctuates from look to look (Swerling 1): power over noise has an exponential distribution
of mean 1 + SNR, a detection is above -ln Pfa, so Pd = Pfa^(1 / (1 + SNR)) (Richards 2014, Fundamentals of
Radar Signal Processing, chapter 6). What shares a resolution cell is one detection; a thing that fills
several may give several, and raises its own threshold.

An extended thing: the sides that a thing turns to a radar throw back evenly, as seen from there. Which sides
these are is looked up in steps of 5 deg around it, seen from afar, level; where they lie is exact. Echoes of
one resolution cell have random phases; they shift its apparent place (glint) by a normal error with the
standard deviation

    sd_of_the_echoes * sqrt(mean / (2 power))

for a look of this power: the quotient of two Gaussian sums (Delano 1953, A theory of target glint or angular
scintillation in radar tracking, Proc. IRE 41). It is never larger than the thing.

The threshold of a detector that averages cells (CFAR): its training bins, half a resolution cell each, lie to
both sides in distance behind a guard; the power of an echo in them counts there with the window of its place,
azimuth and speed (detector.py). So what is longer than the guard raises its own threshold, and a wall that of
a person some cells before it.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import atan2, hypot, log, log10, pi, sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs
from swath.core.frames import Pose
from swath.core.portable import arctan2, product
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import PERCENT
from swath.field.site_setup import Body, SiteSetup
from swath.field.solid.solids import moved
from swath.sensing import RADAR
from swath.sensing.radar.detector import GUARD, Grid, processing_loss, window
from swath.sensing.radar.ideal import IdealRadar, Target, entry
from swath.sensing.radar.ideal import Params as IdealParams
from swath.sensing.radar.solid_rays import aimed, distances
from swath.sensing.radar.stand_loss import DB, StandLoss, wave_factor
from swath.signals import F64, MachineState
from swath.signals.radar import RadarTargets, radar_targets_of

TRAINING = 16  # bins on both sides together, as level `rays` has by default


def in_training(places: F64, cell: tuple[float, float, float]) -> F64:
    """Mean power in the training bins of each echo, from each other one of power 1: (n, n), row: whose bins.

    places: distance [m], azimuth [rad] and radial speed [m/s] of the echoes, (n, 3)
    """
    apart = (places[None, :, :] - places[:, None, :]) / np.array(cell)
    reach = GUARD + TRAINING // 2
    bins = 0.5 * np.array([k for k in range(-reach, reach + 1) if abs(k) > GUARD])
    along = (window(apart[:, :, :1] - bins) ** 2).sum(axis=2) / TRAINING
    beside = window(apart[:, :, 1]) ** 2 * window(apart[:, :, 2]) ** 2
    ratio = (places[None, :, 0] / places[:, None, 0]) ** 2
    slope = ratio * ratio  # the detector levels the echo of flat ground
    return np.asarray(along * beside * slope * (1.0 - np.eye(len(places))))


ASPECTS = 72  # around a thing
AFAR = 1000.0  # from where its sides are looked at [m]


class Scatterers:
    """The scatterers of things, kept by the thing's name, size and aspect once they are known."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, bytes, int], F64] = {}

    def of(self, body: Body, eye: F64) -> F64:
        """Points of the sides that a body turns to an eye (3,), each for the same share: world (n, 3)."""
        x, y, _ = (body.pose.inverse().apply(eye) - body.middle).tolist()
        aspect = round(atan2(y, x) * ASPECTS / (2.0 * pi)) % ASPECTS
        key = body.name, body.half.tobytes(), aspect
        if key not in self._known:
            self._known[key] = _facing(body, 2.0 * pi * aspect / ASPECTS)
        return body.pose.apply(self._known[key])


def _facing(body: Body, aspect: float) -> F64:
    """Points in the body's frame (n, 3) that rays from an aspect [rad] meet; its middle where none does."""
    own = replace(body, solids=moved(body.solids, body.pose.inverse()), pose=Pose.identity())
    eye = body.middle + AFAR * np.array([np.cos(aspect), np.sin(aspect), 0.0])
    directions = aimed(own, eye)
    far = distances(own.solids, eye, directions)
    meets = np.isfinite(far)
    return np.asarray(eye + far[meets, None] * directions[meets]) if meets.any() else body.middle[None]


def glint(mean: float, power: float) -> float:
    """Standard deviation of the apparent place over that of the echoes. mean, power: over noise."""
    return sqrt(min(1.0, mean / (2.0 * max(power, 1e-9))))


PARTS = 5  # heights of a thing that have a way through the crop each
RAIN = {"low": (0.148, 1.0), "high": (1.08, 0.72)}  # dB/km = k R^a: 3.7 and 11 dB/km at 25 mm/h, uncited


@dataclass(frozen=True)
class Params(IdealParams):
    """What weakens a radar's echoes, and its noise.

    straw_moisture_percent: water of the straw, of its wet mass; none = the stand's at the start
    straw_wall: thickness of the stems' walls, 0 thin to 1 thick [1]
    stand_loss_percent: share of the derived loss in the crop that counts; 0 = the radar sees through the crop
    rain_mm_h: rain, which weakens echoes over the distance; none = that of field.weather
    loss_db: loss of all echoes, such as by a dirty cover
    noise: `data_sheet` = as in the data sheet; `none` = what is above the threshold by its mean is given
        exactly, without false alarms
    """

    straw_moisture_percent: Annotated[float, Ge(0), Le(80)] | None = None
    straw_wall: Annotated[float, Ge(0), Le(1)] = 0.5
    stand_loss_percent: Annotated[float, Ge(0), Le(300)] = 100.0
    rain_mm_h: Annotated[float, Ge(0), Le(300)] | None = None
    loss_db: Annotated[float, Ge(0), Le(100)] = 0.0
    noise: Literal["data_sheet", "none"] = "data_sheet"


@dataclass(frozen=True)
class Echo:
    """What comes back from a resolution cell. snr: mean, linear; the others as in `Target`, of the mean echo.

    distance_sd [m], azimuth_sd [rad]: of the echoes in it
    """

    distance: float
    azimuth: float
    elevation: float
    radial_speed: float
    snr: float
    distance_sd: float = 0.0
    azimuth_sd: float = 0.0


class ErrorRadar(IdealRadar):
    """Every look draws anew."""

    kept: ClassVar[tuple[str, ...]] = ("_last", "_waiting")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._e, self._is_noisy = params, params.noise == "data_sheet"
        high = self.sheet.frequency > 50e9
        own = params.straw_moisture_percent
        self._moisture = setup.field.moisture.of_straw(0) if own is None else own * PERCENT
        wave = self.sheet.frequency, self.sheet.polarisation
        factor = wave_factor(*wave, self._moisture, params.straw_wall)
        self.wave = factor * params.stand_loss_percent * PERCENT
        self._loss_of_rain = RAIN["high" if high else "low"]
        self._rain = self._loss_at(0)
        self.threshold = -self.sheet.false_alarm_lg * log(10.0)
        self.stand = StandLoss(setup.field) if self.wave > 0.0 else None
        self._scatterers = Scatterers()
        per_look = 10.0**self.sheet.false_alarm_lg
        per_bin = per_look * self.sheet.cells / Grid.of(self.sheet).count
        self.gain = processing_loss(TRAINING, per_bin, per_look)  # of a threshold from training bins

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._stream = stream
        late = round(self.sheet.latency / self.setup.period)
        self._waiting: deque[RadarTargets] = deque([radar_targets_of(0, [])] * late)
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The detections of a look some time ago; the sample carries the time of the look."""
        seen, draw = self.look(t + dt, inputs), self._stream.at(t + dt)
        echoes = merged([echo for s in seen for echo in self.echoes(s, seen)], self.cell)
        rows = self.rows(echoes, draw)
        if self._is_noisy:
            rows += self._false_alarms(draw)
        strongest = sorted(rows, key=lambda row: -row[5])[: self.sheet.target_max]
        self._waiting.append(radar_targets_of(t + dt, strongest))
        return {"targets": self._waiting.popleft()}

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """Its rain, and the straw that it was told."""
        return {
            "rain_mm_h": self._rain_at(state.t),
            "straw_moisture_percent": self._moisture / PERCENT,
        }

    def _rain_at(self, t: int) -> float:
        """Rain at a time of the run [ns], [mm/h]."""
        weather, rain = self.setup.field.weather, self._e.rain_mm_h
        return rain if rain is not None else 0.0 if weather is None else weather.at(t).rain

    def _loss_at(self, t: int) -> float:
        """Loss in the rain at a time of the run [ns], one way [dB/m]."""
        k, a = self._loss_of_rain
        return float(k * self._rain_at(t) ** a / 1000.0)

    def locate(self, now: int, inputs: Inputs) -> tuple[F64, F64, F64]:
        """As the ideal one, and in the rain of that time."""
        self._rain = self._loss_at(now)
        return super().locate(now, inputs)

    @property
    def cell(self) -> tuple[float, float, float]:
        """Resolution of range [m], azimuth [rad] and speed [m/s]."""
        return self.sheet.range_resolution, self.sheet.azimuth_resolution, self.sheet.speed_resolution

    def echo(self, seen: Target, all_seen: list[Target]) -> Echo:
        """Mean power of a thing over noise: its parts by height, each through its own crop."""
        eye, ray = self._eye, seen.place - self._eye
        ends = np.repeat(seen.place[None], PARTS, axis=0)
        middle = float(seen.body.pose.apply(seen.body.middle)[2])
        ends[:, 2] = middle + float(seen.body.half[2]) * (2.0 * np.arange(PARTS) + 1.0 - PARTS) / PARTS
        ground = float(self.setup.field.ground_height(*seen.place[:2].tolist()))
        ends = ends[ends[:, 2] > ground]
        depth = np.zeros(len(ends)) if self.stand is None else self.stand.depth(eye, ends)
        far = hypot(*ray[:2].tolist())
        total = 0.0
        for end, through in zip(ends, depth.tolist(), strict=True):
            if any(hides(other, seen, eye, end) for other in all_seen):
                continue
            tilt = seen.elevation + (float(end[2]) - float(seen.place[2])) / far
            gain = self.sheet.gain(seen.azimuth, tilt)
            total += 10.0 ** ((2.0 * gain - 2.0 * DB * self.wave * through) / 10.0) / PARTS
        if not len(ends) or total == 0.0:
            return Echo(seen.distance, seen.azimuth, seen.elevation, seen.radial_speed, 0.0)
        total *= PARTS / len(ends)
        lost = 2.0 * self._rain * seen.distance + self._e.loss_db
        snr = 10.0 ** ((self.sheet.snr(seen.rcs, seen.distance) - lost) / 10.0) * total
        return Echo(seen.distance, seen.azimuth, seen.elevation, seen.radial_speed, snr)

    def echoes(self, seen: Target, all_seen: list[Target]) -> list[Echo]:
        """The echoes of a thing: one for each half of a resolution cell that its sides fill.

        All of them lose in the crop what it loses where the line to its middle enters it. Without noise it is
        one point.
        """
        whole = self.echo(seen, all_seen)
        if not self._is_noisy or whole.snr == 0.0:
            return [whole]
        rays = self._scatterers.of(seen.body, self._eye) - self._eye
        level = np.hypot(rays[:, 0], rays[:, 1])
        x, y, _ = (seen.place - self._eye).tolist()
        distance = np.hypot(level, float(seen.place[2] - self._eye[2]))
        azimuth = seen.azimuth + arctan2(x * rays[:, 1] - y * rays[:, 0], x * rays[:, 0] + y * rays[:, 1])
        radial = product(rays, seen.body.velocity - self._velocity) / np.hypot(level, rays[:, 2])
        s = self.sheet
        bins = np.floor(np.stack([2.0 * distance / s.range_resolution, 2.0 * azimuth / s.azimuth_resolution]))
        inside = (np.abs(azimuth) <= 0.5 * s.azimuth_fov) & (distance <= s.range_max)
        found = []
        for place in np.unique(bins[:, inside], axis=1).T:
            here = inside & (bins == place[:, None]).all(axis=0)
            share = float(np.count_nonzero(here)) / len(rays)
            far, aside, rate = (float(v[here].mean()) for v in (distance, azimuth, radial))
            deep, wide = (float(v[here].std()) for v in (distance, azimuth))
            found.append(Echo(far, aside, whole.elevation, rate, share * whole.snr, deep, wide))
        return found

    def rows(self, echoes: list[Echo], draw: np.random.Generator) -> list[list[float]]:
        """Rows of the sample: echoes above the threshold."""
        if not self._is_noisy:
            return [self.row(e, e.snr, 1.0, [0.0] * 6) for e in echoes if e.snr > self.threshold]
        snr = np.array([e.snr for e in echoes])
        swing = draw.standard_exponential(len(echoes))
        places = np.array([[e.distance, e.azimuth, e.radial_speed] for e in echoes]).reshape(-1, 3)
        around = 1.0 + self.gain * (in_training(places, self.cell) * (snr * swing)).sum(axis=1)
        powers = ((1.0 + snr) * swing).tolist()
        rows = zip(echoes, powers, around.tolist(), draw.standard_normal((len(snr), 6)), strict=True)
        return [
            self.row(echo, power, background, noise.tolist())
            for echo, power, background, noise in rows
            if power > self.threshold * background
        ]

    def row(self, echo: Echo, power: float, around: float, noise: list[float]) -> list[float]:
        """Errors as from an echo of this power over thermal noise, with a background `around`, and the cross
        section that it looks like.
        """
        s, snr = self.sheet, max(power / around - 1.0, 1e-3) if self._is_noisy else power
        sds = [
            deviation(snr, cell, floor)
            for cell, floor in (
                (s.range_resolution, s.range_floor),
                (s.azimuth_resolution, s.azimuth_floor),
                (s.elevation_resolution, 0.0),
                (s.speed_resolution, s.speed_floor),
            )
        ]
        wanders = glint(echo.snr, snr)
        far = echo.distance + sds[0] * noise[0] + wanders * echo.distance_sd * noise[4]
        distance = max(far, s.range_min)
        azimuth = echo.azimuth + sds[1] * noise[1] + wanders * echo.azimuth_sd * noise[5]
        elevation = echo.elevation + sds[2] * noise[2] if s.elevation_resolution > 0.0 else np.nan
        speed = echo.radial_speed + sds[3] * noise[3]
        level = 10.0 * log10(snr)
        beam = 2.0 * s.gain(azimuth, 0.0)
        rcs = level + 10.0 * log10(around) - beam - s.snr(0.0, distance)
        return [distance, azimuth, elevation, speed, rcs, level, sds[0], sds[1], sds[3]]

    def _false_alarms(self, draw: np.random.Generator, share: float = 1.0) -> list[list[float]]:
        """Noise above the threshold in a share of the cells: as many as them times their probability, on
        average.
        """
        s, rows = self.sheet, []
        for _ in range(int(draw.poisson(10.0**s.false_alarm_lg * s.cells * share))):
            a, b, c, d = (2.0 * draw.random(4) - 1.0).tolist()
            distance = s.range_min + (s.range_max - s.range_min) * 0.5 * (1.0 + a)
            place = 0.5 * b * s.azimuth_fov, 0.5 * d * s.elevation_fov
            power = self.threshold + float(draw.standard_exponential())
            rows.append(self.row(Echo(distance, *place, c * s.speed_max, 0.0), power, 1.0, [0.0] * 6))
        return rows


def deviation(snr: float, cell: float, floor: float) -> float:
    """Standard deviation in the unit of a resolution cell. snr: linear."""
    return cell / sqrt(2.0 * snr) + floor


def merged(echoes: list[Echo], cell: tuple[float, float, float]) -> list[Echo]:
    """The strongest first, each with all that lies in its cell: powers add, the place is their mean."""
    remaining, found = sorted(echoes, key=lambda e: -e.snr), []
    while remaining:
        first = remaining[0]
        inside = [
            e
            for e in remaining
            if abs(e.distance - first.distance) < cell[0]
            and abs(e.azimuth - first.azimuth) < cell[1]
            and abs(e.radial_speed - first.radial_speed) < cell[2]
        ]
        remaining = [e for e in remaining if e not in inside]
        total = float(np.array([e.snr for e in inside]).sum())
        if total > 0.0:
            values = np.array([[e.distance, e.azimuth, e.elevation, e.radial_speed] for e in inside])
            share = np.array([e.snr for e in inside])[:, None] / total
            distance, azimuth, elevation, speed = (values * share).sum(axis=0).tolist()
            own = np.array([[e.distance_sd, e.azimuth_sd] for e in inside])
            apart = values[:, :2] - np.array([distance, azimuth])
            along, across = np.sqrt(((own**2 + apart**2) * share).sum(axis=0)).tolist()
            found.append(Echo(distance, azimuth, elevation, speed, total, along, across))
    return found


def hides(other: Target, seen: Target, eye: F64, end: F64) -> bool:
    """Whether another thing that looks wider stands in the way to a point (3,) of one."""
    if other is seen or other.distance >= seen.distance:
        return False
    wide = [hypot(*t.body.half[:2].tolist()) / t.distance for t in (other, seen)]
    if wide[0] < wide[1]:
        return False
    inverse = other.body.pose.inverse()
    middle = other.body.middle
    return entry(inverse.apply(eye) - middle, inverse.apply(end) - middle, other.body.half) is not None


LEVEL = Level(
    ErrorRadar,
    Params,
    summary="radar equation, fluctuation, loss in the crop, resolution cells, noise and false alarms",
    cost="10 ms per look at ten things behind crop",
    tolerance="equal to ideal without noise and latency; Pd = Pfa^(1 / (1 + SNR))",
    checked=RADAR,
)
