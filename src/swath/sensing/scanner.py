"""A scanner on its machine: what every LiDAR level shares, whatever it looks at.

Beams of a sweep, where each starts, ports, and what the electronics add to a distance. A level decides only
which distance a beam has. Noise is that of the data sheet: range, constant bias, angle; and drop-outs.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.number_text import num
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG, rounded
from swath.field.light import light
from swath.field.site_setup import SiteSetup
from swath.field.weather import SUN_STEP_S
from swath.rays.sight import Sight
from swath.sensing.echo import LIGHT_SPEED, AirBefore, ScannerWeather, least_energy, merging_gap
from swath.sensing.haze import haze_along
from swath.sensing.labels import Label
from swath.sensing.lidar_sheet import LidarSheet, load_lidar
from swath.sensing.mount import Mount
from swath.sensing.sweep import Sweep
from swath.sensing.window import Params as WindowParams
from swath.sensing.window import Window
from swath.signals import F32, F64, U8, MachineState, Scan, ScanTruth, WindowState, beam_directions

FULL_DAY = 100_000.0  # light of a full day [lx]
PULSE_BANDWIDTH = 0.44  # bandwidth times length of a gaussian pulse


class Noise:
    """What one instance of a scanner adds.

    is_on: False = no range noise, bias, resolution and angle noise of the sheet
    angle: one sigma of the direction in the scan plane [rad], None = the sheet's
    dropout: chance that a beam is lost
    """

    def __init__(self, sheet: LidarSheet, *, is_on: bool, angle: float | None, dropout: float) -> None:
        self.sheet, self.is_on, self.dropout = sheet, is_on, dropout
        self.angle = angle if angle is not None else sheet.angle_noise if is_on else 0.0
        self.bias = 0.0
        self._stream = Stream(0, "noise")

    def reset(self, stream: Stream) -> None:
        """Draws the constant range bias [m] of this instance, uniform in the data sheet's band."""
        band = self.sheet.systematic if self.is_on else 0.0
        self.bias = float(stream.at(0).uniform(-band, band))
        self._stream = stream

    def measure(self, distance: F64, rng: np.random.Generator, signal: F64 | None = None) -> F64:
        """Reported ranges [m] of true ones, any shape, nan stays nan.

        signal: received energy over the least detectable, same shape
        """
        if not self.is_on:
            return distance
        sigma = self.sheet.noise_sigma(distance, signal)
        noisy = distance + self.bias + sigma * rng.standard_normal(distance.shape)
        step = self.sheet.resolution
        return np.round(noisy / step) * step if step > 0 else noisy

    def swing(self, t: int, count: int) -> F64 | None:
        """Azimuth errors of the beams in the sweep that ends at t [rad], (count,), None = no angle noise."""
        if self.angle == 0.0:
            return None
        return self.angle * self._stream.child("angle").at(t).standard_normal(count)

    def dropped(self, t: int, count: int) -> NDArray[np.bool_] | None:
        """Which beams of the sweep that ends at t are lost, (count,), None = none ever."""
        if self.dropout == 0.0:
            return None
        return np.asarray(self._stream.child("drop_out").at(t).uniform(size=count) < self.dropout)


@dataclass(frozen=True)
class ScannerParams:
    """The scanner and its mounting.

    sensor: name in data/sensors, or the user's own YAML
    mount: where the sensor sits
    sector_deg: first and last azimuth used; none = the sensor's whole field of view
    step_deg: angle between beams; none = the data sheet's
    reach_m: distance up to which rays are followed
    noise: `data_sheet` = range noise and constant bias as in the data sheet, or `none`
    """

    sensor: str = "sick-lms511-hr"
    mount: Mount = field(default_factory=Mount)
    sector_deg: tuple[float, float] | None = None
    step_deg: Annotated[float, Ge(0.01), Le(10)] | None = None
    reach_m: Annotated[float, Gt(0), Le(200)] = 40.0
    noise: Literal["data_sheet", "none"] = "data_sheet"


class Scanner:
    """sheet: data sheet; mounting: pose_machine_sensor; azimuth, elevation [rad], beam_t [s]: (beam_count,).

    axes: beam frames in the sensor frame, (beam_count, 3, 3), columns beam direction, across (left), along
    line_count: beams of a firing, at one azimuth but for what it turns meanwhile
    reach: no echo comes from further away [m]
    echo_count: echoes per beam of a scan; angle_noise: one sigma of the beams' direction [rad], None = the
    sheet's; dropout: chance that a beam is lost
    noise: what the electronics add; sweep: where the beams of a sweep start
    is_lit: its receiver knows light; least_energy: that is detected [1/m2]; least: the same for kernels, (1,)
    false_per_m: echoes that noise makes on a metre of a beam
    """

    def __init__(
        self,
        params: ScannerParams,
        setup: SiteSetup,
        *,
        echo_count: int = 1,
        angle_noise: float | None = None,
        dropout: float = 0.0,
    ) -> None:
        self.params, self.setup = params, setup
        self.echo_count = echo_count
        self.sheet = load_lidar(params.sensor, setup.base)
        if isinstance(params, OutdoorParams):
            self.sheet = self.sheet.instance(spot=params.spot_factor, noise=params.noise_factor)
        self.mounting = params.mount.pose(setup.machine, setup.edge_side)
        if self.mounting.position[2] <= 0:
            raise InputError("mount.z_m", params.mount.z_m, "expected a sensor above the ground")
        first, last, self._cut = _sector(params.sector_deg, self.sheet)
        self.step = self.sheet.step if params.step_deg is None else params.step_deg * DEG
        azimuth = self.sheet.azimuths(first, last, self.step)
        lines = self.sheet.line_elevation
        self.line_count = len(lines)
        delay = np.tile(self.sheet.line_delay, len(azimuth))
        turned = delay * (2 * np.pi / setup.period)  # of the sensor meanwhile
        self.azimuth = np.repeat(azimuth, len(lines))
        self.elevation = np.tile(lines, len(azimuth)).copy()
        is_left = self.sheet.turns == "left"
        to_go = self.azimuth - azimuth[-1] if is_left else azimuth[0] - self.azimuth  # of the sweep, <= 0
        self.beam_t = to_go / (2 * np.pi) * setup.period - (delay.max() - delay)
        self.azimuth += turned if is_left else -turned
        for held in (self.azimuth, self.elevation, self.beam_t):  # every scan has them
            held.setflags(write=False)
        self.axes = _beam_axes(self.azimuth, self.elevation)
        self.reach = min(params.reach_m, self.sheet.range_max)
        self.inputs = (Port("state", MachineState, history=True),)
        self.outputs: tuple[Port, ...] = (
            Port("scan", Scan, unit="m", shape=(len(self.azimuth),)),
            Port("truth", ScanTruth),
        )
        self.sweep = Sweep(self.mounting, self.beam_t)
        self.is_lit = isinstance(params, OutdoorParams) and params.daylight.shot_noise > 0.0
        self.least_energy, self.false_per_m, self._lit_at = least_energy(self.sheet.range_10), 0.0, -1
        self.least = np.full(1, self.least_energy, np.float32)
        self.see_light(0)
        dirt = params.window if isinstance(params, OutdoorParams) else None
        wide = max(self.sheet.beam.exit_diameter)
        self.window = None if dirt is None else Window(dirt, len(self.azimuth), wide)
        if self.window is not None:
            self.outputs = (*self.outputs, Port("window", WindowState))
        self._blind_scans, self._has_echo = 0, False
        self.noise = Noise(self.sheet, is_on=params.noise == "data_sheet", angle=angle_noise, dropout=dropout)

    def see_light(self, t: int) -> None:
        """Take the light at a time of the run [ns] into the receiver; it stays as long as the sun does."""
        if self.is_lit and (step := t // (SUN_STEP_S * NS)) != self._lit_at:
            self._lit_at = step
            self.least_energy, self.false_per_m = self._in_daylight(step * SUN_STEP_S * NS)
            self.least[0] = self.least_energy

    def _in_daylight(self, t: int) -> tuple[float, float]:
        """Least detectable energy [1/m2], and false echoes per metre of a beam, at a time of the run [ns].

        The light's shot noise adds to the amplifier's variance, x times it: a threshold that rises with both
        leaves (1 + x)^-1/4 of the reach; one that stays is crossed B / sqrt(3) exp(-threshold^2 / (2 (1 +
        x))) times a second, B the bandwidth of the pulse (Rice 1944, Bell System Technical Journal 23, 282).
        """
        dark, given = least_energy(self.sheet.range_10), self.params
        assert isinstance(given, OutdoorParams)
        weather = self.setup.field.weather
        now, full = None if weather is None else weather.light(t), light(0.5 * np.pi)
        if now is None:
            expected = "expected field.weather with a sun: sun_elevation_deg and sun_azimuth_deg, or time"
            raise InputError("daylight.shot_noise", given.daylight.shot_noise, expected)
        share = now.at(self.sheet.wavelength, now.level) / full.at(self.sheet.wavelength, full.level)
        x = given.daylight.shot_noise * share * full.lux / FULL_DAY
        if given.daylight.threshold_sd is None:
            sheet = given.daylight.shot_noise * 1e3 * self.sheet.reach_klx / FULL_DAY
            return dark * sqrt((1.0 + x) / (1.0 + sheet)), 0.0
        bandwidth = PULSE_BANDWIDTH / self.sheet.pulse
        often = bandwidth / sqrt(3.0) * exp(-(given.daylight.threshold_sd**2) / (2.0 * (1.0 + x)))
        return dark, often * 2.0 / LIGHT_SPEED

    @property
    def notes(self) -> list[str]:
        """What a user should know: a sector wider than its view, a sensor that saw nothing at all."""
        found = [] if self.window is None else self.window.notes
        if self._cut:
            found.append(self._cut)
        if self._blind_scans > 0:
            hint = "see mount (pitch_deg > 0 looks down), sector_deg and reach_m"
            found.append(f"lidar: no beam met anything in the whole run; {hint}")
        return found

    def reset(self, stream: Stream) -> Outputs:
        """An empty scan; draws the constant range bias of this instance, uniform in the data sheet's band."""
        self._blind_scans, self._has_echo = 0, False
        self.noise.reset(stream)
        if self.window is not None:
            self.window.reset()
        nothing = np.full((len(self.azimuth), self.echo_count), np.nan)
        points = np.full((len(self.azimuth), self.echo_count, 3), np.nan)
        return self.outputs_of(0, nothing, nothing, points, np.full((len(self.azimuth), 3), np.nan))

    def sight(self) -> Sight:
        """The pages that its beams can get to."""
        wide, grows = self.sheet.beam.exit_diameter, self.sheet.beam.divergence
        return Sight(self.setup.field, reach=self.reach, exit_diameter=max(wide), divergence=max(grows))

    def axes_at(self, t: int) -> F64:
        """Beam frames of the sweep that ends at t [ns]: where the beams really point."""
        swing = self.noise.swing(t, len(self.azimuth))
        return self.axes if swing is None else _beam_axes(self.azimuth + swing, self.elevation)

    def seen(self, t: int, ranges: F64 | F32) -> NDArray[np.bool_] | None:
        """Which beams of the sweep that ends at t drop out, None = none; counts sweeps without any echo."""
        if t > 0 and not self._has_echo:
            self._has_echo = not np.isnan(ranges).all()
            self._blind_scans = 0 if self._has_echo else self._blind_scans + 1
        return self.noise.dropped(t, len(self.azimuth))

    @property
    def looks(self) -> bool:
        """Whether `seen` may still say something of a sweep."""
        return not self._has_echo or self.noise.dropout != 0.0

    def outputs_of(
        self, t: int, ranges: F64 | F32, intensity: F64 | F32, points: F64, origins: F64
    ) -> Outputs:
        """The two outputs of a scan, less the beams that drop out; nan = no echo.

        ranges, intensity: (beam_count,) or (beam_count, echo_count); points: world, with 3 more; origins:
        (beam_count, 3)
        """
        lost = self.seen(t, ranges)
        if ranges.ndim == 1:
            ranges, intensity, points = ranges[:, None], intensity[:, None], points[:, None, :]
        if lost is not None:
            ranges, intensity, points = (
                np.where(lost.reshape(-1, *[1] * (a.ndim - 1)), np.nan, a)
                for a in (ranges, intensity, points)
            )
        scan = Scan(
            t,
            self.beam_t,
            self.azimuth,
            self.elevation,
            ranges.astype(np.float32, copy=False),
            intensity.astype(np.float32, copy=False),
        )
        found: Outputs = {"scan": scan, "truth": ScanTruth(t, points, origins)}
        if self.window is not None:
            found["window"] = self.window.told
        return found


def _sector(sector_deg: tuple[float, float] | None, sheet: LidarSheet) -> tuple[float, float, str]:
    """First and last azimuth [rad] of a sector within the field of view, and what was cut off, in words."""
    (low, high), cut = sheet.fov, ""
    if sector_deg is None:
        return low, high, cut
    first, last = (a * DEG for a in sector_deg)
    is_within = low - 1e-9 <= first and last <= high + 1e-9
    wide = _ends(low / DEG, high / DEG)
    if not (first < last and first < high and last > low and last - first <= 2.0 * np.pi + 1e-9):
        raise InputError("sector_deg", list(sector_deg), f"expected [first, last] within {wide}")
    if not is_within:
        first, last = max(first, low), min(last, high)
        asked, left = _ends(*sector_deg), _ends(first / DEG, last / DEG)
        cut = f"lidar: sector_deg {asked} is wider than the view of the {sheet.name}, {wide}: {left} is used"
    return first, last, cut


def _ends(first: float, last: float) -> str:
    """A sector [deg], without what conversion left."""
    return f"[{num(rounded(first, 6))}, {num(rounded(last, 6))}]"


def _beam_axes(azimuth: F64, elevation: F64) -> F64:
    """Beam frames in the sensor frame, shape (n, 3, 3): columns beam direction, across (left), along (up)."""
    forward = beam_directions(azimuth, elevation)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    return np.stack([forward, across, np.cross(forward, across)], axis=2)


@dataclass(frozen=True)
class Daylight:
    """Light of the sun and the sky in the receiver, of `field.weather`.

    shot_noise: variance of its shot noise at 100 klx over that of the amplifier; 2 to 60 for an avalanche
        diode behind a filter of 20 nm; 0 = the receiver knows no light
    threshold_sd: threshold over the amplifier's noise, one sigma, of a receiver whose threshold stays: noise
        makes false echoes; none = it rises with the noise: the reach falls
    """

    shot_noise: Annotated[float, Ge(0), Le(10_000)] = 0.0
    threshold_sd: Annotated[float, Gt(1), Le(30)] | None = None


@dataclass(frozen=True)
class OutdoorParams(ScannerParams):
    """angle_noise_deg: one sigma of the beams' direction; none = the data sheet's.

    drop_out_percent: beams lost
    spot_factor: width of the spot over the data sheet's [1]
    noise_factor: range noise over the data sheet's, bias and resolution apart [1]
    weather: dust, chaff and rain in the air
    daylight: light in the receiver
    window: dust on its window; none = it stays clean
    """

    angle_noise_deg: Annotated[float, Ge(0), Le(5)] | None = None
    drop_out_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    spot_factor: Annotated[float, Gt(0), Le(10)] = 1.0
    noise_factor: Annotated[float, Ge(0), Le(100)] = 1.0
    weather: ScannerWeather = field(default_factory=ScannerWeather)
    daylight: Daylight = field(default_factory=Daylight)
    window: WindowParams | None = None


class ScanningLidar(KeepsState, ABC):
    """A scanner on a moving machine; a level says what its beams meet.

    scanner: its beams, noise and sheet; ray_count: rays since the start
    """

    kept: ClassVar[tuple[str, ...]] = ("_last", "ray_count", "_window")

    def __init__(self, params: ScannerParams, setup: SiteSetup, *, echo_count: int = 1) -> None:
        angle_noise, dropout = None, 0.0
        if isinstance(params, OutdoorParams):
            angle_noise = None if params.angle_noise_deg is None else params.angle_noise_deg * DEG
            dropout = 0.01 * params.drop_out_percent
        self.setup = setup
        self.scanner = Scanner(params, setup, echo_count=echo_count, angle_noise=angle_noise, dropout=dropout)
        self.sheet, self.mounting = self.scanner.sheet, self.scanner.mounting
        self.azimuth, self.elevation = self.scanner.azimuth, self.scanner.elevation
        self.inputs, self.outputs = self.scanner.inputs, self.scanner.outputs
        self.ray_count = 0
        self._last: MachineState | None = None

    @property
    def goes_with(self) -> tuple[bytes, ...]:
        """The times and directions of its beams, and whether it says something of its window."""
        beams = self.scanner.beam_t, self.azimuth, self.elevation
        return (*(a.tobytes() for a in beams), bytes(self.scanner.window is not None))

    def reset(self, stream: Stream) -> Outputs:
        """An empty scan; draws the constant range bias of this instance, uniform in the data sheet's band."""
        self._stream = stream
        self._last = None
        self.ray_count = 0
        return self.scanner.reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The sweep that ends at t + dt, every beam from where the sensor was at its own time."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        end = t + dt
        return self.scan_from(end, *self.scanner.sweep(known, end))

    @property
    def _own_weather(self) -> ScannerWeather:
        given = self.scanner.params
        return given.weather if isinstance(given, OutdoorParams) else ScannerWeather()

    def weather_at(self, t: int) -> ScannerWeather:
        """What is in the air before it at a time of the run [ns]."""
        return self._own_weather.under(self.setup.field.weather, t, self.sheet.wavelength)

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """Its weather, with the dust that drifts past it, and the light that its receiver knows."""
        weather = self.setup.field.weather
        light = weather.light(state.t) if self.scanner.is_lit and weather is not None else None
        met = self.weather_at(state.t).met(self.setup.field, state.pose.apply(self.mounting.position))
        return {**met, "receiver_light_lx": 0.0 if light is None else light.lux}

    @property
    def may_be_disturbed(self) -> bool:
        """Whether `air` may ever give something."""
        scanner, weather = self.scanner, self.setup.field.weather
        has_dust = weather is not None and (weather.may_be_dim or bool(self.setup.field.plumes))
        return has_dust or scanner.is_lit or scanner.window is not None or not self._own_weather.is_clear

    def air(self, t: int, origins: F64, directions: F64, met: F64) -> AirBefore | None:
        """What is between it and what its beams meet in the sweep that ends at t [ns], None = nothing.

        origins, directions: world (beam_count, 3)
        met: distances of what the sub-rays meet [m], (beam_count, s), nan = nothing
        """
        self.scanner.see_light(t)
        weather, field, haze = self.weather_at(t), self.setup.field, None
        reach, uniform = self.scanner.reach, weather.extinction_per_m or 0.0
        dusty = any(len(puffs.rows) for puffs in field.plumes.values())
        if field.weather is not None and (dusty or uniform > 0.0):
            step = merging_gap(self.sheet.pulse)
            far = np.where(np.isnan(met), reach, met).max(axis=1)
            haze = haze_along(field, origins, directions, uniform, far, step)
        false = self.scanner.false_per_m
        window, glass = self.scanner.window, None
        if window is not None:
            drops = self._stream.child("drops")
            glass = window.step(t, field, origins.mean(axis=0), directions, drops)
        if weather.is_clear and haze is None and false == 0.0 and glass is None:
            return None
        rng = self._stream.child("weather").at(t)
        return AirBefore(weather, haze, glass, false, self.sheet.range_min, reach, rng)

    @abstractmethod
    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""

    def labels(self) -> U8:
        """What each echo of the newest scan is of (beam_count, echo_count): a level that knows says it."""
        return np.full((len(self.azimuth), self.scanner.echo_count), Label.UNKNOWN, np.uint8)

    @property
    def _window(self) -> Window | None:
        return self.scanner.window

    @_window.setter
    def _window(self, value: Window | None) -> None:
        self.scanner.window = value

    @property
    def range_limits(self) -> tuple[float, float]:
        """Least and greatest range of the data sheet [m]."""
        return self.sheet.range_min, self.sheet.range_max

    @property
    def offered(self) -> tuple[str, Sequence[float]]:
        """Name and rates [Hz] of the data sheet."""
        return self.sheet.name, self.sheet.rates_hz

    @property
    def identity(self) -> str:
        """What the scanner answers to DeviceIdent, by its data sheet."""
        return self.sheet.device_ident

    @property
    def notes(self) -> list[str]:
        """What the user of a run should know of the scanner."""
        return self.scanner.notes
