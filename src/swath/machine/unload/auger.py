"""Unload level `auger`: a pipe that swings, a flow that runs up and out, a stream that spreads in the air.

Grain in the air flies ballistically.
"""

from dataclasses import dataclass
from math import cos, fsum, sin, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream as RandomStream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import Landing, SiteSetup
from swath.machine import SPEED
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.tyre import GRAVITY
from swath.signals import F64, MachineLoad, MachineState, UnloadCommand, UnloadState

DRAG = 0.2  # how fast a dense stream takes on the speed of the air [1/s], an estimate
SHARE = 1.0 / 6.0  # of each of four points at sqrt(3) sd; with the middle they have the spread's variance


@dataclass(frozen=True)
class Parcel:
    """Grain that left the mouth together. t: then [s]; mass [kg]; place, speed: then, world (3,)."""

    t: float
    mass: float
    place: F64
    speed: F64


class Stream(KeepsState):
    """Parcels in flight. spread: of where a parcel comes down, 1 sigma [m]; wind: world (3,) [m/s]."""

    kept = ("_parcels",)

    def __init__(self, landing: Landing, spread: float, wind: F64) -> None:
        self._landing, self._spread, self._wind = landing, spread, wind
        self._parcels: list[Parcel] = []

    def clear(self) -> None:
        """Nothing in the air."""
        self._parcels = []

    def add(self, parcel: Parcel) -> None:
        """It leaves the mouth."""
        self._parcels.append(parcel)

    @property
    def mass(self) -> float:
        """Grain in the air [kg]."""
        return fsum(p.mass for p in self._parcels)

    def fly(self, t: float) -> tuple[float, float]:
        """Up to a time [s]: masses that came down and stayed in a box, and that came down elsewhere [kg]."""
        caught = missed = 0.0
        flying = []
        for parcel in self._parcels:
            place = self._down(parcel, t)
            if place is None:
                flying.append(parcel)
                continue
            kept = fsum(self._landing.land(m, p) for m, p in self._points(parcel.mass, place))
            caught, missed = caught + kept, missed + parcel.mass - kept
        self._parcels = flying
        return caught, missed

    def _down(self, parcel: Parcel, t: float) -> F64 | None:
        """Where it has come down by a time, None while it flies."""
        age = t - parcel.t
        place = self._at(parcel, age)
        under = self._under(place)
        if place[2] > under:
            return None
        drop = parcel.place[2] - under
        return self._at(parcel, min(age, fall_time(float(drop), float(-parcel.speed[2]))))

    def _at(self, parcel: Parcel, age: float) -> F64:
        pull = DRAG * (self._wind - parcel.speed)
        pull[2] = -GRAVITY
        place: F64 = parcel.place + parcel.speed * age + 0.5 * pull * age**2
        return place

    def _under(self, place: F64) -> float:
        """Height of the grain or the ground below a point [m]."""
        found = self._landing.bodies.box_under(place)
        if found is None:
            return float(self._landing.field.ground_height(place[0], place[1]))
        name, x, y = found
        bodies = self._landing.bodies
        return float(bodies.pose_of(name).position[2]) + bodies.boxes[name].surface_at(x, y)

    def _points(self, mass: float, place: F64) -> list[tuple[float, F64]]:
        if self._spread <= 0.0:
            return [(mass, place)]
        far = sqrt(3.0) * self._spread
        around = [(far, 0.0), (-far, 0.0), (0.0, far), (0.0, -far)]
        aside = [(SHARE * mass, place + np.array([x, y, 0.0])) for x, y in around]
        return [(mass - 4.0 * (SHARE * mass), place), *aside]


def fall_time(drop: float, down: float) -> float:
    """Time [s] to fall so far [m], the speed downward at the start given [m/s]."""
    return (sqrt(max(down * down + 2.0 * GRAVITY * drop, 0.0)) - down) / GRAVITY


LEAST_SWING = 0.97  # of the whole swing: the auger does not turn before the pipe is out so far
AIM_HEIGHT = 3.2  # of what grain comes down on while there is no box below [m]
LEAST_FLOW = 0.2  # of the full flow, while a nearly empty tank runs out


@dataclass(frozen=True)
class Params:
    """An unloading auger.

    run_up_s: time from the start of the auger to full flow
    run_out_s: time from the stop of the auger to no flow
    taper_percent: level of the tank below which the flow falls, down to a fifth
    spread_m: standard deviation of the stream's width where it comes down; a pipe of 0.4 m has 0.1 m
    wind_east_m_s: east component of the wind
    wind_north_m_s: north component of the wind
    """

    run_up_s: Annotated[float, Ge(0), Le(20)] = 2.0
    run_out_s: Annotated[float, Ge(0), Le(20)] = 1.5
    taper_percent: Annotated[float, Ge(0), Le(100)] = 4.0
    spread_m: Annotated[float, Ge(0), Le(2)] = 0.1
    wind_east_m_s: Annotated[float, Ge(-30), Le(30)] = 0.0
    wind_north_m_s: Annotated[float, Ge(-30), Le(30)] = 0.0


class Auger(KeepsState):
    """Takes grain out of the tank and pours it out at the mouth of its pipe."""

    kept = ("_angle", "_share", "_drawn", "_caught", "_missed", "_stream")
    swings_at_once = False
    inputs = (Port("command", UnloadCommand), Port("load", MachineLoad), Port("state", MachineState))
    outputs = (Port("unload", UnloadState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.machine.pipe is None:
            raise InputError(
                "level", type(self).__name__.lower(), "expected a machine whose data sheet has a `pipe`"
            )
        self._p, self._pipe, self._setup = params, setup.machine.pipe, setup
        self._drivetrain = drivetrain_of(setup.machine)
        self._landing = Landing(setup.field, setup.bodies)
        wind = np.array([params.wind_east_m_s, params.wind_north_m_s, 0.0])
        self._stream = Stream(self._landing, params.spread_m, wind)

    def reset(self, stream: RandomStream) -> Outputs:
        """Folded back, nothing flows."""
        self._angle = self._share = 0.0
        self._drawn, self._caught, self._missed = Total(), Total(), Total()
        self._stream.clear()
        return {"unload": self._state(0, 0.0, None)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Swing, draw from the tank, pour, and let what is in the air fall."""
        command, h = inputs["command"], dt / NS
        self._swing(command.angle, h)
        before = self._share
        self._run(command.is_running and self._angle >= LEAST_SWING * self._pipe.swing, h)
        mass = self._draw(inputs["load"], 0.5 * (before + self._share) * h)
        state = inputs["state"]
        if mass > 0.0:
            self._pour(mass, (t + dt) / NS, state)
        caught, missed = self._stream.fly((t + dt) / NS)
        self._caught.add(caught)
        self._missed.add(missed)
        return {"unload": self._state(t + dt, mass / h, state)}

    def _swing(self, wanted: float, h: float) -> None:
        wanted = min(max(wanted, 0.0), self._pipe.swing)
        most = np.inf if self.swings_at_once else self._pipe.rate * h
        self._angle += min(max(wanted - self._angle, -most), most)

    def _run(self, is_running: bool, h: float) -> None:
        if is_running:
            self._share = min(1.0, self._share + h / self._p.run_up_s) if self._p.run_up_s > 0.0 else 1.0
        else:
            self._share = max(0.0, self._share - h / self._p.run_out_s) if self._p.run_out_s > 0.0 else 0.0

    def _draw(self, load: MachineLoad, seconds: float) -> float:
        """Grain [kg] out of the tank in so many seconds of full flow; the process books it later."""
        content = load.tank_grain + load.unloaded_grain - self._drawn.value
        taper = self._p.taper_percent * PERCENT * self._drivetrain.tank
        share = max(LEAST_FLOW, content / taper) if 0.0 < content < taper else 1.0
        mass = min(self._drivetrain.unloading * share * seconds, max(content, 0.0))
        self._drawn.add(mass)
        return mass

    def _pour(self, mass: float, t: float, state: MachineState) -> None:
        mouth, speed = self._mouth(self._angle)
        own = np.array([state.speed, state.lateral_speed, 0.0])
        turning = state.yaw_rate * np.array([-mouth[1], mouth[0], 0.0])
        place, gone = state.pose.apply(mouth), state.pose.turn(own + turning + speed)
        self._stream.add(Parcel(t, mass, place, gone))

    def _mouth(self, angle: float) -> tuple[F64, F64]:
        """Mouth of the pipe at an angle and velocity of the grain there, machine frame [m], [m/s]."""
        p = self._pipe
        along = np.array([-cos(angle), sin(angle), 0.0])
        mouth: F64 = np.array([p.x, p.y, p.z]) + p.length * along
        speed: F64 = p.exit_speed * (cos(p.fall) * along + np.array([0.0, 0.0, -sin(p.fall)]))
        return mouth, speed

    def _impact(self, state: MachineState | None) -> F64:
        """Where the stream comes down, machine frame [m]: on what lies there, found in two steps.

        Of a pipe that is not out yet: where it will come down. In still air: wind is not known.
        """
        is_out = self._angle >= LEAST_SWING * self._pipe.swing
        mouth, speed = self._mouth(self._angle if is_out else self._pipe.swing)
        height, bodies = AIM_HEIGHT, self._setup.bodies
        driven = np.array([0.0 if state is None else state.speed, 0.0, 0.0])
        place = mouth
        for _ in range(2 if state is not None and bodies.boxes else 1):
            age = fall_time(max(float(mouth[2]) - height, 0.0), float(-speed[2]))
            place = mouth + speed * age - 0.5 * DRAG * (speed + driven) * age**2
            found = None if state is None else bodies.box_under(state.pose.apply(place))
            if found is not None:
                height = bodies.boxes[found[0]].surface_at(found[1], found[2])
        return place

    def _state(self, t: int, flow: float, state: MachineState | None) -> UnloadState:
        x, y, _ = self._impact(state).tolist()
        sums = self._drawn.value, self._stream.mass, self._caught.value, self._missed.value
        return UnloadState(t, self._angle, flow, *sums, x, y)


class IdealUnload(Auger):
    """Its pipe is out at once."""

    swings_at_once = True


LEVEL = Level(
    Auger,
    Params,
    summary="pipe with swing rate and limits, flow with run-up, run-out and tank level, ballistic stream",
    cost="0.3 ms per step while it pours",
    tolerance="equal to ideal without ramps; no stream was measured",
    checked=(SPEED,),
)
PRESETS = {
    "ideal": LEVEL.preset(
        "full flow at once, no spread of the stream",
        "0.1 ms per step while it pours",
        IdealUnload,
        **dict.fromkeys(Params.__dataclass_fields__, 0.0),
    )
}
