"""Motion level `kinematic`: wheels roll where they point. Exact circular arcs.

With the fixed axle as reference and the steered axle a distance L behind it: yaw rate = v tan(steer) / L
(steer > 0 turns left; the rear wheel itself then points right). Turning costs no side slip: see
docs/explanation/machine.md for what that hides. On a slope the wheels slip as in the other levels, along and
across, behind by the relaxation lengths: both axles drift alike, so it crabs downhill and keeps its heading.
"""

from dataclasses import dataclass
from math import cos, hypot, sin, tan
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.field.site_setup import SiteSetup
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import SpeedLoop, within_drive
from swath.machine.machine_sheet import dynamics_of
from swath.machine.towing import ports_of, tow, towed_by, with_trailer
from swath.machine.traction import DrivenWheels, across_of, traction_of
from swath.signals import EngineState, HeapState, MachineState, SpeedCommand, SteerState


@dataclass(frozen=True)
class Params:
    """start_speed_kmh: speed at t = 0."""

    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0


class Kinematic(KeepsState):
    """A vehicle, its trailer behind it. The steering angle is held over a step."""

    kept = ("_x", "_y", "_yaw", "_wheels", "_drift", "_distance", "_towed")

    inputs = (
        Port("steering", SteerState),
        Port("speed", SpeedCommand),
        Port("drive", EngineState, optional=True),
        Port("cargo", HeapState, optional=True),
    )

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._params, self._start = params, setup.start
        self._wheelbase = setup.machine.wheelbase
        self._follower = TerrainFollower(setup.field, setup.machine)
        self._wheels = DrivenWheels(SpeedLoop(dynamics_of(setup.machine)))
        self._traction, self._across = traction_of(setup.machine), across_of(setup.machine)
        self._rear_share = dynamics_of(setup.machine).cg_behind / abs(self._wheelbase)
        self._towed = towed_by(setup)
        self.outputs = ports_of(self._towed)

    def reset(self, stream: Stream) -> Outputs:
        """Stand at the start pose."""
        self._x, self._y = float(self._start.position[0]), float(self._start.position[1])
        self._yaw = self._start.euler()[2]
        self._wheels.reset(self._params.start_speed_kmh * KMH)
        self._distance = self._drift = 0.0
        if self._towed is not None:
            self._towed.place(self._x, self._y, self._yaw)
        return self._output(0, 0.0)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Drive one arc."""
        steer: float = inputs["steering"].angle
        wanted = within_drive(inputs["speed"].speed, inputs.get("drive"))
        stance, before = self._follower.stance, self._drift
        _, travel = self._wheels.advance(wanted, dt / NS, stance.pitch, self._traction)
        slope = stance.front_slope + self._rear_share * (stance.rear_slope - stance.front_slope)
        self._drift = self._across.slip_after(before, -slope, abs(travel))
        turn = travel * tan(steer) / self._wheelbase
        half = 0.5 * turn
        chord = travel * (sin(half) / half if abs(half) > 1e-8 else 1.0)
        ahead, aside = chord, 0.5 * chord * (before + self._drift)
        c, s = cos(self._yaw + half), sin(self._yaw + half)
        self._x += ahead * c - aside * s
        self._y += ahead * s + aside * c
        self._yaw += turn
        self._distance += hypot(travel, aside)
        tow(self._towed, inputs, self._x, self._y, self._yaw)
        return self._output(t + dt, steer)

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        super().load(state)
        self._follower.at(self._x, self._y, self._yaw)

    def _output(self, t: int, steer: float) -> Outputs:
        self._follower.at(self._x, self._y, self._yaw)
        pose = self._follower.pose()
        speed = self._wheels.speed
        yaw_rate = speed * tan(steer) / self._wheelbase
        state = MachineState(t, pose, speed, speed * self._drift, yaw_rate, steer, self._distance)
        return with_trailer(self._towed, state, self._yaw)


LEVEL = Level(
    Kinematic,
    Params,
    summary="rolls where the wheels point, slips on slopes, on the terrain",
    cost="about 12 us per step",
    tolerance="against multibody up to 2.5 m/s: yaw gain 2 to 4 % high, offset after 30 deg -3 to +18 %",
)
