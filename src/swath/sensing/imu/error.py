"""IMU with bias, a random walk of the bias, scale error, white noise, and what the machine shakes it.

`UNITS` is the noise of inertial units as their data sheets and tests give it. `Vibration` is what engine,
threshing drum and sieves add: lines at their frequencies. All three hang on the engine and turn with it. A
unit reports the mean over its period T, so a line of frequency f comes through with sinc(f T). Frequencies:
engine half a turn (six cylinders, four strokes: the strongest of the low orders on the frame), drum 9.2 Hz
(550 1/min), sieves 4.5 Hz (270 1/min), all at rated speed, from memory of machine data; sizes and axes are
estimates within 0.5 to 2 m/s2 RMS at 2 to 30 Hz.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi, sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.core.component import Port
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.schedule import NS
from swath.core.together import InWorlds, KeepsRows, Samples, plain
from swath.core.units import DEG, HOUR, PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated
from swath.sensing import CHECKED
from swath.sensing.imu.strapdown import GRAVITY, Place
from swath.sensing.normals import AllNormals
from swath.signals import F64, EngineState, Inertial, MachineState

Force = Annotated[float, Ge(0), Le(50)]
Rate = Annotated[float, Gt(0), Le(50)]
# How a line's force lies along x, y, z of the machine, and its rate about them; unit vectors.
AXES = {
    "engine": ((0.0, 0.6, 0.8), (1.0, 0.0, 0.0)),
    "drum": ((0.6, 0.0, 0.8), (0.0, 1.0, 0.0)),
    "sieves": ((0.8, 0.0, 0.6), (0.0, 1.0, 0.0)),
}
# A unit as imu_step.cpp has it. last: time [ns], place [m] and rotation of a state; velocity: its time [s],
# then it; both nan where there was none yet; reading: without errors; period: of samples [ns]; draw: of
# white noise, then of the bias
SIZES = {
    "last": 13, "velocity": 4, "reading": 6, "bias": 6, "scale": 6, "walk": 6, "density": 6,
    "phases": 3, "arm": (), "period": (), "lines": (3, 8), "mounting": 12, "draw": 12,
}  # fmt: skip
UNIT = np.dtype([(name, np.float64, size) for name, size in SIZES.items()])


@dataclass(frozen=True)
class Vibration:
    """Vibration at the unit.

    engine_m_s2: root mean square of the acceleration by the engine
    drum_m_s2: root mean square of the acceleration by the drum
    sieves_m_s2: root mean square of the acceleration by the sieves
    engine_hz: frequency of the engine's vibration at rated speed
    drum_hz: frequency of the drum's vibration at rated speed
    sieves_hz: frequency of the sieves' vibration at rated speed
    arm_m: lever arm: a force at frequency f is felt as a turn too, rate = force / (2 pi f arm)
    """

    engine_m_s2: Force = 0.4
    drum_m_s2: Force = 0.5
    sieves_m_s2: Force = 0.6
    engine_hz: Rate = 15.8
    drum_hz: Rate = 9.2
    sieves_hz: Rate = 4.5
    arm_m: Annotated[float, Gt(0), Le(100)] = 3.0


STANDARD_GRAVITY = 9.80665  # of the unit g in data sheets [m/s2]


@dataclass(frozen=True)
class Axis:
    """One kind of sensor; its unit is rad/s or m/s2.

    density: of its white noise [unit/sqrt(Hz)], as data sheets give it: the Allan deviation at 1 s
    instability: the least Allan deviation [unit]
    """

    density: float
    instability: float

    @property
    def walk(self) -> float:
        """Density K of a random walk of the bias [unit/sqrt(s)] that gives this least Allan deviation.

        White noise N and such a walk have the Allan variance N^2 / tau + K^2 tau / 3 (IEEE Std 952-1997,
        annex C), with the minimum 2 N K / sqrt(3).
        """
        return self.instability**2 * sqrt(3.0) / (2.0 * self.density) if self.density > 0.0 else 0.0


@dataclass(frozen=True)
class Unit:
    """An inertial unit: its gyroscopes [rad/s] and accelerometers [m/s2]."""

    gyro: Axis
    accel: Axis


def _unit(gyro_deg_s: float, gyro_deg_h: float, accel_ug: float, accel_mg: float) -> Unit:
    accel = Axis(accel_ug * 1e-6 * STANDARD_GRAVITY, accel_mg * 1e-3 * STANDARD_GRAVITY)
    return Unit(Axis(gyro_deg_s * DEG, gyro_deg_h * DEG / HOUR), accel)


# deg/s/sqrt(Hz), deg/h, ug/sqrt(Hz), mg; where they are from: docs/explanation/sensors.md
UNITS = {
    "mti-1": _unit(0.007, 10.0, 120.0, 0.03),
    "adis16470": _unit(0.34 / 60.0, 8.0, 0.037 / 60.0 / STANDARD_GRAVITY * 1e6, 0.013),
    "bmi088": _unit(0.014, 15.0, 175.0, 0.035),
}


Share = Annotated[float, Ge(0), Le(30)]
Factor = Annotated[float, Ge(0), Le(1000)]
MILLI_G = 1e-3 * STANDARD_GRAVITY


@dataclass(frozen=True)
class Params:
    """An inertial unit with errors.

    Each bias and scale error is drawn once per run and axis; their sizes are estimates.

    unit: unit whose noise counts (docs/explanation/sensors.md)
    mount: where the unit sits on the machine
    noise_factor: factor on its white noise [1]
    walk_factor: factor on the random walk of its bias [1]
    gyro_bias_deg_s: sd of the gyros' bias at the start
    accel_bias_mg: sd of the accelerometers' bias at the start, in thousandths of g
    gyro_scale_percent: sd of the gyros' scale error
    accel_scale_percent: sd of the accelerometers' scale error
    vibration: vibration of engine, drum and sieves; none = they do not shake
    """

    unit: Literal["mti-1", "adis16470", "bmi088"] = "mti-1"
    mount: Place = field(default_factory=Place)
    noise_factor: Factor = 1.0
    walk_factor: Factor = 1.0
    gyro_bias_deg_s: Annotated[float, Ge(0), Le(100)] = 0.1
    accel_bias_mg: Annotated[float, Ge(0), Le(1000)] = 2.0
    gyro_scale_percent: Share = 0.1
    accel_scale_percent: Share = 0.1
    vibration: Vibration | None = None


class ErrorImu(InWorlds):
    """The true rates and forces, scaled, biased and noisy."""

    inputs: tuple[Port, ...] = (Port("state", MachineState, history=True),)
    outputs = (Port("inertial", Inertial),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params, self.setup = params, setup
        self.mounting = params.mount.pose()
        if params.vibration is not None:
            self.inputs = (*self.inputs, Port("engine", EngineState, optional=True))
        unit, root = UNITS[params.unit], sqrt(setup.period)
        # of three gyroscopes, then three accelerometers
        p = params
        self.density = _six(p.noise_factor * unit.gyro.density, p.noise_factor * unit.accel.density)
        self.walk = _six(p.walk_factor * unit.gyro.walk, p.walk_factor * unit.accel.walk)
        self.bias_sd = _six(p.gyro_bias_deg_s * DEG, p.accel_bias_mg * MILLI_G)
        self.scale_sd = _six(PERCENT * p.gyro_scale_percent, PERCENT * p.accel_scale_percent)
        self.white_sd = self.density[0] / root, self.density[3] / root

    def errors(self, sample: Inertial) -> dict[str, tuple[float, float]]:
        """White noise, and the bias at the start of a run."""
        rate, force = self.white_sd
        return {"rate": (rate, self.bias_sd[0]), "force": (force, self.bias_sd[3])}

    @classmethod
    def together(cls, parts: Sequence["ErrorImu"]) -> "Units":
        """Make one object that steps these parts of many worlds together."""
        return Units(parts)


class Units(KeepsRows, Compiled):
    """The units of many worlds."""

    kept = ("_units",)
    reads: ClassVar = {"engine": EngineState}
    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[ErrorImu]) -> None:
        n = len(parts)
        super().__init__(n, {"inertial": row_of(Inertial, n)})
        self._parts, self._units = parts, np.zeros(n, UNIT)
        for unit, part in zip(self._units, parts, strict=True):
            unit["walk"], unit["density"], unit["mounting"] = part.walk, part.density, plain(part.mounting)
            if (v := part.params.vibration) is not None:
                unit["arm"] = v.arm_m
                unit["lines"] = [
                    (getattr(v, f"{name}_m_s2"), getattr(v, f"{name}_hz"), *force, *rate)
                    for name, (force, rate) in AXES.items()
                ]
        self._normals = AllNormals(self._units["draw"])
        self._table = self.sent["inertial"].memory.view(np.float64).reshape(n, -1)
        self._table[:, 6:] = [part.white_sd for part in parts]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """At rest, level; draws bias, scale and phases of the units."""
        self._normals.reset(streams)
        for unit, part, stream in zip(self._units, self._parts, streams, strict=True):
            draw = stream.at(0).standard_normal(12)
            unit["bias"], unit["scale"] = part.bias_sd * draw[:6], 1.0 + part.scale_sd * draw[6:]
            if part.params.vibration is not None:
                unit["phases"] = 2.0 * pi * stream.child("vibration").at(0).random(len(AXES))
            unit["last"] = unit["velocity"] = np.nan
            unit["period"] = round(part.setup.period * NS)
            up = part.setup.start.rotation[2] * GRAVITY
            unit["reading"] = 0.0, 0.0, 0.0, *product(up, part.mounting.rotation)
        self._table[:, :6] = self._units["reading"] * self._units["scale"] + self._units["bias"]
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """Normal numbers, then a sample with them."""
        from swath.sensing.imu.imu_step_kernel import sample_each

        trail = self.heard["state"]
        states = trail.head, trail.stamps, trail.memory["pose"]
        units = self._units.view(np.float64).reshape(self.worlds, -1)
        share = self.column("engine", "speed_ratio", otherwise=1.0)
        noise = self._normals.launch(self.clock[1:2], self.needs)
        return [noise, self.launch(sample_each, *states, self.clock, share, units, self._table)]

    def supply(self, stage: int) -> None:
        """Numbers that numpy draws."""
        self._normals.finish(int(self.clock[1]))


def _six(gyro: float, accel: float) -> F64:
    return np.repeat([gyro, accel], 3)


LEVEL = Level(
    ErrorImu,
    Params,
    "bias, its random walk, scale error and white noise of a MEMS unit",
    cost="12 us per sample",
    tolerance="equal to ideal with every error at 0",
    checked=CHECKED,
)
EXACT = (
    "noise_factor",
    "walk_factor",
    "gyro_bias_deg_s",
    "accel_bias_mg",
    "gyro_scale_percent",
    "accel_scale_percent",
)
PRESETS = {
    "ideal": LEVEL.preset(
        "true mean rate and specific force",
        cost="12 us per sample",
        unit="mti-1",
        vibration=None,
        **dict.fromkeys(EXACT, 0.0),
    )
}
