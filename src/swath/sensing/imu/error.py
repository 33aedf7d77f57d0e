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
from math import cos, pi, sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.core.component import KeepsState, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, Samples, in_world
from swath.core.units import DEG, HOUR, PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, repeatable, shared
from swath.sensing import CHECKED
from swath.sensing.imu.imu_step import DRAW, READING, SIZE, ImuStep
from swath.sensing.imu.strapdown import Place, Reading, back
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
LINES = tuple(AXES)


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


class Shaking(KeepsState):
    """Three lines whose phases run on with the engine."""

    kept = ("_phases",)

    def __init__(self, v: Vibration) -> None:
        self._v = v
        self._lines = [(name, getattr(v, f"{name}_m_s2"), getattr(v, f"{name}_hz")) for name in LINES]
        self._phases = [0.0] * len(LINES)

    def reset(self, draws: list[float]) -> None:
        """draws: uniform numbers of [0, 1), one for each line's phase."""
        self._phases = [2.0 * pi * d for d in draws]

    def take(self, seconds: float, share: float) -> Reading:
        """(rate [rad/s], force [m/s2]) of the machine's axes, the mean over so many seconds.

        share: engine speed over rated speed
        """
        rate, force = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        for i, (name, size, frequency) in enumerate(self._lines):
            turn = 2.0 * pi * frequency * share * seconds
            begin = self._phases[i]
            self._phases[i] = (begin + turn) % (2.0 * pi)
            if turn <= 0.0:
                continue
            mean = size * share**2 * sqrt(2.0) * (cos(begin) - cos(begin + turn)) / turn
            about = mean / (2.0 * pi * frequency * share * self._v.arm_m)
            for axis in range(3):
                force[axis] += AXES[name][0][axis] * mean
                rate[axis] += AXES[name][1][axis] * about
        return (rate[0], rate[1], rate[2]), (force[0], force[1], force[2])


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


class UnitStep(KeepsState):
    """The unit of one world, and its step in Python. memory: (SIZE,) of `ImuStep`."""

    kept = ("_bias", "_motion", "_shaking")

    def __init__(self, part: ErrorImu, memory: F64) -> None:
        vibration = part.params.vibration
        self._part, self._motion = part, ImuStep(part.mounting, memory)
        self._shaking = None if vibration is None else Shaking(vibration)
        self._turn = part.mounting.rotation.tolist()
        self.spread(round(part.setup.period * NS))

    def reset(self, stream: Stream) -> list[float]:
        """At rest, level; draws bias and scale of this unit. Its first sample."""
        part, draw = self._part, stream.at(0).standard_normal(12).tolist()
        self._bias = [sd * d for sd, d in zip(part.bias_sd, draw[:6], strict=True)]
        self._motion.scale[:] = [1.0 + sd * d for sd, d in zip(part.scale_sd, draw[6:], strict=True)]
        if self._shaking is not None:
            self._shaking.reset(stream.child("vibration").at(0).random(3).tolist())
        return self._read(self._motion.reset(part.setup.start), [0.0] * 6)

    def step(self, dt: int, states: Sequence[MachineState], engine: EngineState | None) -> list[float]:
        """The sample of a step of dt [ns], with the normal numbers that lie in the memory."""
        motion = self._motion
        draw = motion.draw.tolist()
        walk = zip(self._bias, motion.steps.tolist(), draw[6:], strict=True)
        self._bias = [bias + step * d for bias, step, d in walk]
        truth = motion.take(states)
        if self._shaking is not None:
            truth = self._shaken(self._shaking, truth, dt / NS, engine)
        return self._read(truth, draw[:6])

    def spread(self, dt: int) -> None:
        """Standard deviations of what is drawn for a step of dt [ns]."""
        root = sqrt(dt / NS)
        self._motion.steps[:] = [walk * root for walk in self._part.walk]
        self._motion.white[:] = [density / root for density in self._part.density]

    @property
    def _bias(self) -> list[float]:
        bias: list[float] = self._motion.bias.tolist()
        return bias

    @_bias.setter
    def _bias(self, values: Sequence[float]) -> None:
        self._motion.bias[:] = values

    def _shaken(self, by: Shaking, truth: Reading, seconds: float, engine: EngineState | None) -> Reading:
        """The reading and what shakes the machine, in the axes of the unit."""
        more = by.take(seconds, 1.0 if engine is None else engine.speed_ratio)
        return tuple(
            tuple(a + b for a, b in zip(own, back(self._turn, extra), strict=True))
            for own, extra in zip(truth, more, strict=True)
        )  # type: ignore[return-value]

    def _read(self, truth: Reading, draw: Sequence[float]) -> list[float]:
        """draw: normal numbers of the white noise."""
        kept = self._motion.scale.tolist(), self._bias, self._motion.white.tolist()
        wrong = zip((*truth[0], *truth[1]), *kept, draw, strict=True)
        return [v * scale + bias + sd * d for v, scale, bias, sd, d in wrong]


class Units(Compiled):
    """The units of many worlds."""

    reads: ClassVar = {"engine": EngineState}
    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[ErrorImu]) -> None:
        n = len(parts)
        super().__init__(n, {"inertial": row_of(Inertial, n)})
        self._memory = np.zeros((n, SIZE))
        self._units = [UnitStep(part, row) for part, row in zip(parts, self._memory, strict=True)]
        self._dt = round(parts[0].setup.period * NS)
        self.walks = all(part.params.vibration is None for part in parts)
        self._normals = AllNormals(self._memory[:, DRAW:READING])
        self._table = self.sent["inertial"].memory.view(np.float64).reshape(n, -1)
        self._table[:, 6:] = [part.white_sd for part in parts]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """At rest, level."""
        self._normals.reset(streams)
        for world, (unit, stream) in enumerate(zip(self._units, streams, strict=True)):
            self._table[world, :6] = unit.reset(stream)
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """Normal numbers, the states into the memories, the samples."""
        from swath.sensing.imu.imu_step_kernel import lay_states, sample_each

        trail, memory = self.heard["state"], shared(self._memory)
        states = [*map(shared, (trail.head, trail.stamps, trail.memory["pose"])), memory, shared(self.needs)]
        noise = self._normals.launch(self.clock[1:2], self.needs)
        made = [memory, shared(self._table)]
        if not self.walks:
            return [noise]
        return [
            noise,
            repeatable(lay_states, states, threads=self.worlds),
            repeatable(sample_each, made, threads=self.worlds),
        ]

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Samples at t + dt."""
        if abs(dt - self._dt) > 1:  # ns, by which the steps of a rate differ
            self._dt = dt
            for unit in self._units:
                unit.spread(dt)
        if self.walks:
            return super().step(t, dt, inputs)
        self._memory[:, 0] = 0.0
        found = super().step(t, dt, inputs)
        self._in_python(dt, inputs["state"], inputs.get("engine"))
        return found

    def supply(self, stage: int) -> None:
        """Numbers that numpy draws; samples that need more than the states."""
        if stage == 0:
            self._normals.finish(int(self.clock[1]))
        else:
            trail = self.heard["state"]
            self._in_python(int(self.clock[2]), [trail.at(k) for k in range(trail.count)], None)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        found: State = self._units[world].save()
        return found

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._units[world].load(state)

    def _in_python(self, dt: int, states: Sequence[Any], engines: Any) -> None:
        """Write the samples of worlds whose states the compiled step did not take."""
        for world in np.flatnonzero(self._memory[:, 0] == 0.0).tolist():
            own = [in_world(state, world) for state in states]
            self._table[world, :6] = self._units[world].step(dt, own, in_world(engines, world))


def _six(gyro: float, accel: float) -> list[float]:
    return [gyro] * 3 + [accel] * 3


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
