"""Unload level `auger`: a pipe that swings, a flow that runs up and out, a stream that spreads in the air."""

from dataclasses import dataclass
from math import cos, sin
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
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.unload.stream import DRAG, Parcel, Stream, fall_time
from swath.signals import F64, MachineLoad, MachineState, UnloadCommand, UnloadState

LEAST_SWING = 0.97  # of the whole swing: the auger does not turn before the pipe is out so far
AIM_HEIGHT = 3.2  # of what grain comes down on while there is no box below [m]
LEAST_FLOW = 0.2  # of the full flow, while a nearly empty tank runs out


@dataclass(frozen=True)
class Params:
    """run_up_s, run_out_s: from start and stop of the auger to full flow and none
    taper_percent: level of the tank below which the flow falls, down to a fifth; spread_m: of the stream
    where it comes down, 1 sigma, a pipe of 0.4 m has 0.1 m; wind_east_m_s, wind_north_m_s: where the wind
    blows to
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
        share = 1.0 if content >= taper else max(LEAST_FLOW, content / taper)
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


LEVEL = Level(
    Auger,
    Params,
    summary="pipe with swing rate and limits, flow with run-up, run-out and tank level, ballistic stream",
    cost="0.3 ms per step while it pours",
    tolerance="equal to ideal without ramps; no stream was measured",
)
