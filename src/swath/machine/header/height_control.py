"""Header level `height_control`: feelers, a controller and cylinders hold the knife over the ground.

The knife is straight and stiff. Where it is above the ground decides the stubble, section by section.
Equations, sources and validation: docs/explanation/machine.md.

The controller knows its own commands and the machine's turning before its feelers do: a Smith predictor (O.
J. M. Smith 1957, Chemical Engineering Progress 53): what the cylinders have done since the feelers looked,
and will do from commands under way, is added to the reading; the loop then is one without delay. To that
comes how far the machine rolls and pitches over the same time at its present rates.

Sensors, control law and cylinders are exact over a step for an input held over it.
"""

from collections import deque
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from math import exp
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import Array, Pose
from swath.core.frozen import changed
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, KMH, PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine import SPEED
from swath.machine.header.header_kinematics import HeaderKinematics
from swath.machine.header.knives import Knives
from swath.machine.sweep import OneWorld
from swath.signals import CropFlow, HeaderState, MachineState


class Delayed(KeepsState):
    """Readings, (n,), through a first-order smoothing and a delay.

    lag [s]; delay [ns]; between samples the smoothed values are taken as straight lines
    """

    kept = ("_past", "_smooth")

    def __init__(self, start: Array, lag: float, delay: int) -> None:
        self._lag, self._delay = lag, delay
        self._smooth = np.array(start, dtype=float)
        self._past: deque[tuple[int, Array]] = deque([(0, self._smooth)])

    def read(self, t: int, dt: int, values: Array) -> Array:
        """The reading at t [ns], dt after the last one, from the true values at t."""
        kept = exp(-dt / NS / self._lag) if self._lag > 0.0 else 0.0
        self._smooth = values + (self._smooth - values) * kept
        past, then = self._past, t - self._delay
        past.append((t, self._smooth))
        while len(past) > 1 and past[1][0] <= then:
            past.popleft()
        (t0, first), (t1, second) = past[0], past[min(1, len(past) - 1)]
        if then <= t0 or t1 == t0:
            return first
        return np.asarray(first + (second - first) * ((then - t0) / (t1 - t0)))


class Feelers(Delayed):
    """Heights [m], (n,), through a limited range, then as `Delayed`."""

    def __init__(self, start: Array, lag: float, delay: int, range_max: float) -> None:
        super().__init__(np.clip(start, 0.0, range_max), lag, delay)
        self._range = range_max

    def read(self, t: int, dt: int, values: Array) -> Array:
        """As `Delayed.read`."""
        return super().read(t, dt, np.clip(values, 0.0, self._range))


class Controller(KeepsState):
    """PI with a dead band: rate of a cylinder from an error.

    gain [1/s]; integral [1/s2]; the integral fades within the dead band and rests while the rate is limited
    """

    kept = ("sum",)

    def __init__(
        self, gain: float, integral: float, dead_band: float, limits: tuple[float, float], period: float
    ) -> None:
        self._gain, self._integral, self._band, self._limits = gain, integral, dead_band, limits
        self._fade = exp(-gain * period)
        self._period, self.sum = period, 0.0

    def rate(self, error: float) -> float:
        """Wanted rate, within the limits (lowest, highest)."""
        over = max(abs(error) - self._band, 0.0)
        error = over if error > 0.0 else -over
        total = self.sum + self._integral * error * self._period
        wanted = self._gain * error + total
        rate = min(max(wanted, self._limits[0]), self._limits[1])
        if over == 0.0:
            self.sum *= self._fade
        elif rate == wanted or wanted * error < 0.0:
            self.sum = total
        return rate


class Cylinder(KeepsState):
    """A cylinder behind a valve: dead time [ns], then the rate follows within a lag [s], up to a stop."""

    kept = ("place", "_rate", "_wanted", "_queue")

    def __init__(self, dead_time: int, lag: float, stroke: tuple[float, float]) -> None:
        self._dead_time, self._lag, self._stroke = dead_time, lag, stroke
        self.place = self._rate = self._wanted = 0.0
        self._queue: deque[tuple[int, float]] = deque()

    def command(self, t: int, rate: float) -> None:
        """Want a rate from t [ns] on."""
        self._queue.append((t + self._dead_time, rate))

    def advance(self, t: int, dt: int) -> float:
        """Move from t to t + dt [ns]; the place there."""
        now, end = t, t + dt
        while self._queue and self._queue[0][0] < end:
            arrival, wanted = self._queue.popleft()
            self._move(max(0, arrival - now))
            now, self._wanted = max(now, arrival), wanted
        self._move(end - now)
        return self.place

    def later(self, t: int, duration: int) -> float:
        """The place `duration` after t [ns] if nothing else is commanded."""
        twin = copy(self)
        twin._queue = self._queue.copy()
        return twin.advance(t, duration)

    def _move(self, duration: int) -> None:
        h = duration / NS
        if h <= 0.0:
            return
        kept = exp(-h / self._lag) if self._lag > 0.0 else 0.0
        place = self.place + self._wanted * h + (self._rate - self._wanted) * self._lag * (1.0 - kept)
        self._rate = self._wanted + (self._rate - self._wanted) * kept
        self.place = min(max(place, self._stroke[0]), self._stroke[1])
        if self.place != place:
            self._rate = 0.0


GYRO_LAG = 0.03  # smoothing of the rates of roll and pitch [s], estimate


class Predictor(KeepsState):
    """feeler_lag, valve_lag [s]; feeler_delay, dead_time [ns]; knife_x: ahead of the fixed axle [m]."""

    kept = ("_own", "_axes", "_rates")

    def __init__(
        self, feeler_lag: float, feeler_delay: int, valve_lag: float, dead_time: int, knife_x: float
    ) -> None:
        self._own = Delayed(np.zeros(2), feeler_lag, feeler_delay)
        self._coming = dead_time + round(valve_lag * NS)
        self._time = feeler_lag + (feeler_delay + self._coming) / NS
        self._x = knife_x
        self._axes: tuple[float, float] | None = None
        self._rates = (0.0, 0.0)

    def look(self, t: int, dt: int, lift: Cylinder, tilt: Cylinder, pose: Pose) -> tuple[float, float]:
        """By how much the knife will be higher [m], its left side more up [rad], than the feelers say."""
        seen = self._own.read(t, dt, np.array([lift.place, tilt.place]))
        rise, lean = self._turning(dt, pose)
        up = lift.later(t, self._coming) - float(seen[0]) + self._time * self._x * rise
        return up, tilt.later(t, self._coming) - float(seen[1]) + self._time * lean

    def _turning(self, dt: int, pose: Pose) -> tuple[float, float]:
        """Rates [1/s] at which the forward and the left axis rise, as an ideal gyro shows them, smoothed."""
        now = float(pose.rotation[2, 0]), float(pose.rotation[2, 1])
        before = now if self._axes is None else self._axes
        self._axes, kept = now, exp(-dt / NS / GYRO_LAG)
        new = ((a - b) * NS / dt for a, b in zip(now, before, strict=True))
        first, second = (n + (r - n) * kept for n, r in zip(new, self._rates, strict=True))
        self._rates = first, second
        return self._rates


BEST_INDEX, INDEX_WIDTH = (
    1.2,
    0.4,
)  # reel speed over ground speed that loses least; twice the loss that far off
NOMINAL_SPEED = 7.0 * KMH  # of the loss
LOSS_MAX = 0.1
HIGHEST = 2.5  # the field takes no higher cut [m]
GAIN, GAIN_WITH_PREDICTOR = 3.0, 6.0  # rate of the knife over its error [1/s]
SLIDING = 0.3  # a feeler that skids is read at its front, middle and rear [m]


@dataclass(frozen=True)
class Params:
    """A header whose height is controlled. First the knife, then feelers, controller, hydraulics and reel.

    cutting_height_m: wanted height of the knife above ground
    band_m: tolerance of that height to both sides
    sections: number of sections of the knife; each cuts at its own height
    sweep_step_m: poses of the knife that are closer together than this are joined
    least_stubble_m: least height of the knife, kept by skids where the header digs in
    feelers: number of feelers across the header
    feeler_behind_m: distance of the feelers behind the knife, < 0 = ahead of it
    feeler_range_m: greatest height that a feeler reports; what is higher reads as that
    feeler_lag_s: time constant of the feelers' smoothing
    feeler_delay_s: dead time of the feelers' signal
    gain_per_s: rate of the knife over its height error; none = 6 with `lead`, 3 without
    integral_per_s2: integral gain of the controller
    dead_band_m: height error below which the controller does nothing
    lead: whether the controller carries its own commands and the machine's roll and pitch rates over its
        delays
    lateral: whether the header is tilted after the feelers; otherwise it stays parallel to the machine
    raise_m_s: fastest rate upwards
    lower_m_s: fastest rate downwards
    tilt_deg_s: fastest rate of the tilt
    dead_time_s: dead time of both valves
    valve_lag_s: time constant of both valves
    lift_low_m: lowest place of the knife about its level stand
    lift_high_m: highest place of the knife about its level stand
    tilt_max_deg: greatest tilt to both sides
    reel_index: peripheral speed of the reel over ground speed, for a reel that follows the ground speed [1]
    reel_speed_m_s: a fixed peripheral speed of the reel instead
    loss_percent: grain shed at the header, of the grain cut, at 7 km/h and the best reel index of 1.2
    """

    cutting_height_m: Annotated[float, Gt(0), Le(1.5)] = 0.15
    band_m: Annotated[float, Gt(0), Le(1)] = 0.05
    sections: Annotated[int, Ge(1), Le(24)] = 6
    sweep_step_m: Annotated[float, Ge(0), Le(0.5)] = 0.1
    least_stubble_m: Annotated[float, Ge(0), Le(0.3)] = 0.02
    feelers: Annotated[int, Ge(2), Le(12)] = 4
    feeler_behind_m: Annotated[float, Ge(-5), Le(3)] = 0.15
    feeler_range_m: Annotated[float, Gt(0), Le(3)] = 0.4
    feeler_lag_s: Annotated[float, Ge(0), Le(2)] = 0.05
    feeler_delay_s: Annotated[float, Ge(0), Le(2)] = 0.04
    gain_per_s: Annotated[float, Ge(0), Le(20)] | None = None
    integral_per_s2: Annotated[float, Ge(0), Le(20)] = 0.0
    dead_band_m: Annotated[float, Ge(0), Le(0.2)] = 0.005
    lead: bool = True
    lateral: bool = True
    raise_m_s: Annotated[float, Gt(0), Le(3)] = 0.3
    lower_m_s: Annotated[float, Gt(0), Le(3)] = 0.25
    tilt_deg_s: Annotated[float, Gt(0), Le(30)] = 4.0
    dead_time_s: Annotated[float, Ge(0), Le(2)] = 0.08
    valve_lag_s: Annotated[float, Ge(0), Le(2)] = 0.06
    lift_low_m: Annotated[float, Ge(-2), Le(0)] = -0.4
    lift_high_m: Annotated[float, Ge(0), Le(2)] = 1.0
    tilt_max_deg: Annotated[float, Ge(0), Le(20)] = 5.0
    reel_index: Annotated[float, Ge(0), Le(5)] = 1.2
    reel_speed_m_s: Annotated[float, Ge(0), Le(10)] | None = None
    loss_percent: Annotated[float, Ge(0), Le(10)] = 0.2


class HeightControlHeader(KeepsState):
    """A stiff knife on feeder and tilt cylinders."""

    kept = (
        *("_knives", "_pose", "_speed", "_feelers", "_lift", "_tilt"),
        *("_raising", "_leaning", "_predictor"),
    )

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("flow", CropFlow), Port("height", HeaderState))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p = self._p = params
        if p.feeler_range_m <= p.cutting_height_m:
            expected = f"expected more than cutting_height_m = {p.cutting_height_m:g}"
            raise InputError("feeler_range_m", p.feeler_range_m, expected)
        self._field = setup.field
        self.kinematics = HeaderKinematics(setup.machine, p.cutting_height_m)
        half, count = self.kinematics.half, 2 * p.sections + 1
        knife = np.linspace(half, -half, count)
        self._feeler_y = half * np.linspace(0.9, -0.9, p.feelers)
        skid = np.repeat(p.feeler_behind_m + SLIDING * np.array([-0.5, 0.0, 0.5]), p.feelers)
        self._behind = np.concatenate([np.zeros(count), skid])
        self._across = np.concatenate([knife, np.tile(self._feeler_y, 3)])
        self._nodes, self._period = count, setup.period
        self._knife = Knives([setup.field], p.sections + 1, [p.sweep_step_m], [setup.machine.header_width])
        self._knives = OneWorld(self._knife)

    def reset(self, stream: Stream) -> Outputs:
        """Knife level at the wanted height; its place is taken from the first state that comes."""
        p, limit = self._p, self._p.tilt_deg_s * DEG
        start = np.full(p.feelers, p.cutting_height_m)
        delay, dead_time = round(p.feeler_delay_s * NS), round(p.dead_time_s * NS)
        self._feelers = Feelers(start, p.feeler_lag_s, delay, p.feeler_range_m)
        self._predictor = Predictor(p.feeler_lag_s, delay, p.valve_lag_s, dead_time, self.kinematics.knife_x)
        stop = p.tilt_max_deg * DEG
        self._lift = Cylinder(dead_time, p.valve_lag_s, (p.lift_low_m, p.lift_high_m))
        self._tilt = Cylinder(dead_time, p.valve_lag_s, (-stop, stop))
        gain = p.gain_per_s if p.gain_per_s is not None else GAIN_WITH_PREDICTOR if p.lead else GAIN
        gains, band = (gain, p.integral_per_s2), p.dead_band_m
        self._raising = Controller(*gains, band, (-p.lower_m_s, p.raise_m_s), self._period)
        self._leaning = Controller(*gains, band / self.kinematics.half, (-limit, limit), self._period)
        self._knife.clear()
        self._pose: Pose | None = None
        self._speed = 0.0
        heights = np.full(self._nodes, p.cutting_height_m)
        return {"flow": CropFlow(0, 0.0, 0.0, 0.0, 0, 0.0, 0.0), "height": self._state(0, heights, start)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Move the cylinders, look where the knife is over the ground, cut, and want new rates."""
        states: tuple[MachineState, ...] = inputs["state"]
        lift, tilt = self._lift.advance(t, dt) / self.kinematics.arm, self._tilt.advance(t, dt)
        points = self.kinematics.points(self._behind, self._across, lift, tilt)
        if states:
            self._pose, self._speed = states[-1].pose, states[-1].speed
        if self._pose is None:
            heights, reading = (
                np.full(self._nodes, self._p.cutting_height_m),
                np.full(self._p.feelers, np.nan),
            )
        else:
            at = self._pose.apply(points)
            over = at[:, 2] - np.asarray(self._field.ground_height(at[:, 0], at[:, 1]))
            heights = over[: self._nodes]
            seen = over[self._nodes :].reshape(3, -1).mean(axis=0)
            reading = self._feelers.read(t + dt, dt, seen)
            self._control(t + dt, dt, reading, self._pose)
        flow = self._cut(t + dt, dt, states, points[: self._nodes], heights)
        return {"flow": flow, "height": self._state(t + dt, heights, reading)}

    def _control(self, t: int, dt: int, reading: Array, pose: Pose) -> None:
        """Mean of the feelers to the lift; what they differ by from side to side to the tilt."""
        up, lean = self._predictor.look(t, dt, self._lift, self._tilt, pose) if self._p.lead else (0.0, 0.0)
        height = float(reading.mean()) + up
        self._lift.command(t, self._raising.rate(self._p.cutting_height_m - height))
        if self._p.lateral:
            rise = float((self._feeler_y * reading).sum() / (self._feeler_y * self._feeler_y).sum())
            self._tilt.command(t, self._leaning.rate(-rise - lean))

    def _cut(
        self, t: int, dt: int, states: tuple[MachineState, ...], knife: Array, heights: Array
    ) -> CropFlow:
        lines = [state.pose.apply(knife)[::2, :2] for state in states]
        taken = self._knife.cut(t, dt, lines, self._runs(heights))
        lost = taken.grain * self._loss_share()
        return changed(taken, grain=taken.grain - lost, lost_grain=lost)

    def _runs(self, heights: Array) -> list[tuple[int, int, int]]:
        """(first node, last node, height [cm]): neighbouring sections of equal height, cut as one."""
        mean = 0.25 * heights[:-2:2] + 0.5 * heights[1:-1:2] + 0.25 * heights[2::2]
        cm = np.rint(100.0 * np.clip(mean, self._p.least_stubble_m, HIGHEST)).astype(int).tolist()
        starts = [i for i in range(len(cm)) if i == 0 or cm[i] != cm[i - 1]]
        return [(a, b, cm[a]) for a, b in pairwise([*starts, len(cm)])]

    def _loss_share(self) -> float:
        """Of the grain cut: in proportion to the speed, parabolic in the reel index."""
        p, speed = self._p, max(self._speed, 0.0)
        index = p.reel_index if p.reel_speed_m_s is None else p.reel_speed_m_s / max(speed, 0.1)
        off = (index - BEST_INDEX) / INDEX_WIDTH
        return min(p.loss_percent * PERCENT * speed / NOMINAL_SPEED * (1.0 + off * off), LOSS_MAX)

    def _state(self, t: int, heights: Array, reading: Array) -> HeaderState:
        p = self._p
        return HeaderState(
            t,
            heights[::2].copy(),
            reading,
            p.cutting_height_m,
            p.band_m,
            self._lift.place / self.kinematics.arm,
            self._tilt.place,
            float(np.mean(heights <= 0.0)),
        )


LEVEL = Level(
    HeightControlHeader,
    Params,
    summary="knife over the ground by feelers, PI control and cylinders; stubble and losses follow",
    cost="0.4 ms per step on level ground, more on rough (12 m header, 50 Hz, 6 sections)",
    tolerance="stiff knife; its height is even within a section and rounded to 1 cm",
    checked=(SPEED,),
)
