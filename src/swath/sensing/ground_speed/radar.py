"""Ground speed level `radar`: the Doppler shift of ground that a slanted beam looks at.

    f = 2 f0 / c  v . u

u is the direction of the beam's middle, v the velocity of the sensor; the unit divides by the cosine of the
depression that it was fitted with. So a machine that pitches changes its own speed, by tan(depression) per
radian. Ground scatters into the whole beam: the spectrum is wide, and its mean, over a finite time, noisy.
"""

from dataclasses import dataclass, field
from math import cos, exp, pi, sin, sqrt, tan
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.portable import product
from swath.core.random import Normals, Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.documents.data_sheets import read_sheet
from swath.documents.sheet_fields import Quantity
from swath.field.site_setup import SiteSetup
from swath.sensing import SPEED
from swath.sensing.mount import Length, LevelMount, poses_at
from swath.signals import GroundSpeed, MachineState

LIGHT = 299_792_458.0  # m/s
WINDOW = 20_000_000  # a velocity is the mean over this long before its time [ns]
FWHM = 2.355  # width at half of a Gauss curve over its standard deviation


@dataclass(frozen=True, kw_only=True)
class GroundRadarSheet:
    """frequency [Hz]; depression: of the beam below the horizontal [rad]; beam_width: one way, at half power
    [rad]; averaging: time over which a spectrum is taken [s]; lag: time constant behind it [s]
    mean_error, error_sd: of the scale over machines and fields, shares; speed_min: below it the unit says 0
    [m/s].
    """

    format: str
    kind: Literal["ground_radar"] = "ground_radar"
    name: str
    note: str = ""
    frequency: Annotated[float, Quantity("ghz", 1, 200)]
    depression: Annotated[float, Quantity("deg", 5, 80)]
    beam_width: Annotated[float, Quantity("deg", 0, 60)]
    averaging: Annotated[float, Quantity("s", 0.005, 5)]
    lag: Annotated[float, Quantity("s", 0, 5)]
    mean_error: Annotated[float, Quantity("percent", -20, 20)]
    error_sd: Annotated[float, Quantity("percent", 0, 20)]
    speed_min: Annotated[float, Quantity("m_s", 0, 2)]


def load_ground_radar(name: str, base: Path | None = None) -> GroundRadarSheet:
    """A bundled unit by name, or the user's own YAML file."""
    return read_sheet("sensors", name, base).read(GroundRadarSheet)


def doppler(speed: float, depression: float, frequency: float) -> float:
    """Shift [Hz] of ground ahead at a speed [m/s], seen under a depression [rad]."""
    return 2.0 * frequency / LIGHT * speed * cos(depression)


def relative_noise(speed: float, sheet: GroundRadarSheet) -> float:
    """Standard deviation of one spectrum's mean over that mean.

    A beam with a spread sd_a of depressions gives a Doppler spectrum of f tan(depression) sd_a; its mean over
    a time T has 4 sqrt(pi) sd_f T independent looks (Gaussian spectrum; Doviak and Zrnic 1993, Doppler Radar
    and Weather Observations, section 6.4.1), at least one.
    """
    spread = sheet.beam_width / FWHM / sqrt(2.0)  # there and back
    share = tan(sheet.depression) * spread
    width = share * doppler(abs(speed), sheet.depression, sheet.frequency)
    return share / sqrt(max(4.0 * sqrt(pi) * width * sheet.averaging, 1.0))


@dataclass(frozen=True)
class BellyMount(LevelMount):
    """Below the body, behind the fixed axle.

    x_m: forward
    z_m: above ground
    """

    x_m: Length = -1.0
    z_m: Length = 0.9


@dataclass(frozen=True)
class Params:
    """A radar that measures ground speed.

    sensor: name in data/sensors, or the user's own YAML
    mount: where the radar sits; its x axis is the level direction in which it looks down
    pitch_error_deg: how much steeper it is fitted than it believes
    noise: `data_sheet` = noise and scale error as in the data sheet, or `none`
    """

    sensor: str = "ground-radar-24ghz"
    mount: BellyMount = field(default_factory=BellyMount)
    pitch_error_deg: Annotated[float, Ge(-20), Le(20)] = 0.0
    noise: Literal["data_sheet", "none"] = "data_sheet"


class GroundRadar(KeepsState):
    """mounting: pose_machine_sensor of the level frame of the unit."""

    kept = ("_last", "_smooth", "_distance")

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("speed", GroundSpeed),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._sheet = load_ground_radar(params.sensor, setup.base)
        self.mounting = params.mount.pose(setup.machine, setup.edge_side)
        down = self._sheet.depression + params.pitch_error_deg * pi / 180.0
        self._beam = self.mounting.turn(np.array([cos(down), 0.0, -sin(down)]))
        self._is_noisy = params.noise == "data_sheet"
        self._last: tuple[MachineState, ...] = ()

    def reset(self, stream: Stream) -> Outputs:
        """Draw the scale error; at rest."""
        s = self._sheet
        self._normals = Normals(stream)
        error = s.mean_error + s.error_sd * float(stream.at(0).standard_normal(1)[0])
        self._scale = 1.0 + (error if self._is_noisy else 0.0)
        self._last, self._smooth, self._distance = (), float("nan"), 0.0
        return {"speed": GroundSpeed(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Give one sample at t + dt."""
        s, now = self._sheet, t + dt
        known = (*self._last, *inputs["state"])
        self._last = tuple(state for state in known if state.t >= now - 2 * WINDOW)[-8:] or known[-1:]
        raw = self._along(known, now) / cos(s.depression) * self._scale
        if self._is_noisy:
            raw *= 1.0 + relative_noise(raw, s) * float(self._normals.at(now, 1)[0])
        kept = exp(-dt / NS / s.lag) if s.lag > 0.0 and self._smooth == self._smooth else 0.0
        self._smooth = raw + kept * (self._smooth - raw) if kept else raw
        speed = self._smooth if abs(self._smooth) >= s.speed_min else 0.0
        self._distance += abs(speed) * dt / NS
        return {"speed": GroundSpeed(now, speed, self._distance)}

    def _along(self, states: tuple[MachineState, ...], now: int) -> float:
        """Velocity of the sensor along the beam [m/s]."""
        begin = max(now - WINDOW, states[0].t)
        if now <= begin:
            return 0.0
        at, rotation = poses_at(states, np.array([float(begin), float(now)]))
        place = at + product(rotation, self.mounting.position)
        velocity = (place[1] - place[0]) / ((now - begin) / NS)
        return float(product(velocity, product(rotation[1], self._beam)))


LEVEL = Level(
    GroundRadar,
    Params,
    summary="Doppler shift of the ground in a slanted beam, with pitch, scale error and noise",
    cost="60 us per sample",
    tolerance="f = 2 f0 v cos(depression) / c; equal to ideal without noise on level ground",
    checked=(SPEED,),
)
