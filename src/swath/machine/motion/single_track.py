"""Motion level `single_track`: side slip, tyre lag and side slopes.

One tyre per axle; lateral speed of the centre of gravity and yaw rate as in the textbooks; forward speed from
the drive's closed loop. Equations, signs and validation: docs/explanation/machine.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, Samples
from swath.core.units import DEG_PER_G, KMH, MS
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, Rows, filled, shared
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import loop_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of
from swath.machine.motion import ON_SOIL
from swath.machine.motion.on_ground import OnGround
from swath.machine.on_soil import OnSoil, OnTyres, met_by, soil_of
from swath.machine.soil import Grip
from swath.machine.towing import DRIVEN, ports_of, towed_by
from swath.machine.traction import Traction, check_wheel_slip, pull, traction_of
from swath.machine.tyre import GRAVITY, axle_stiffness
from swath.signals import (
    F64,
    HeapState,
    MachineLoad,
    MachineState,
    WheelState,
)


@dataclass(frozen=True)
class Params(OnTyres):
    """A single-track model; what is left out comes from the machine's sheet.

    start_speed_kmh: speed at t = 0
    wheel_slip: whether pull and slip of the driven wheels are reported for odometry; the machine drives the
        same either way
    substep_ms: longest integration step
    """

    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0
    wheel_slip: bool = False
    substep_ms: Annotated[float, Ge(0.01), Le(20)] = 20.0


class SingleTrack(InWorlds):
    """Single-track model on terrain, steered behind or ahead of the fixed axle; it does not feel its trailer.

    Steering angle and slopes are held over a step. Lengths behind the fixed axle are below 0 where the
    steered axle is ahead of it; the equations are the same.
    """

    inputs = (*DRIVEN, Port("load", MachineLoad, optional=True), Port("cargo", HeapState, optional=True))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        d = dynamics_of(setup.machine)
        if params.wheel_slip:
            check_wheel_slip(setup.machine)
        self.params, self.machine = params, setup.machine
        start = setup.start
        self.start = float(start.position[0]), float(start.position[1]), start.euler()[2]
        self.start_speed = params.start_speed_kmh * KMH
        self.sense = -1.0 if setup.machine.steers_ahead else 1.0
        given = params.understeer_deg_per_g
        self._stiffness = axle_stiffness(
            _either(params.stiffness_per_rad, d.stiffness),
            d.understeer if given is None else given * DEG_PER_G,
            steers_ahead=setup.machine.steers_ahead,
        )
        self._friction = _either(params.friction, d.friction)
        self.rolling = _either(params.rolling_resistance, d.rolling_resistance)
        self.follower = TerrainFollower(setup.field, setup.machine)
        self.soil = soil_of(setup.field, setup.machine, params)
        self.towed = towed_by(setup)
        wheels = (Port("wheels", WheelState),) if params.wheel_slip else ()
        self.outputs = (*ports_of(self.towed), *wheels)

    @classmethod
    def together(cls, parts: Sequence["SingleTrack"]) -> "Cars":
        """Make one object that steps these parts of many worlds together."""
        return Cars(parts)

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """The soil under it."""
        return met_by(self.soil, state)

    @property
    def axle_loads(self) -> tuple[float, float]:
        """Loads of the fixed and the steered axle in the last step [N]."""
        cars: Any = self.alone
        loads: tuple[float, float] = cars.axle_loads(0)
        return loads

    def soft(self, front: Grip, rear: Grip) -> tuple[float, float]:
        """Cornering stiffnesses of the axles over load, for the soil's grips of them."""
        own = dynamics_of(self.machine).stiffness
        return self._stiffness[0] * front.side / own, self._stiffness[1] * rear.side / own

    def numbers(self) -> tuple[Traction, list[float], list[float]]:
        """Of the driven wheels, of a `Car`, both with an empty tank, and what weigh.cpp knows of that."""
        d, machine, tank = dynamics_of(self.machine), self.machine, (0.0,) * 5
        ahead, kind, thrust = self.sense * d.cg_behind, 0.0, inf
        if isinstance(machine, MachineSheet) and machine.masses is not None:
            t, thrust, kind = machine.masses.tank, machine.masses.thrust, 1.0 if self.soil is None else 2.0
            area, spread = t.density * t.length * t.width, t.length**2 + t.width**2
            tank = t.x, t.floor, area, spread, (d.cg_behind + t.x) ** 2
        wheels = d.front.radius, d.rear.radius, d.front.relaxation, d.rear.relaxation
        tyres = *self._stiffness, self._friction, self.rolling
        body = ahead, -machine.steered_x - ahead, d.mass, d.yaw_inertia, d.cg_height, machine.front_track
        car = [*body, *wheels, *tyres, self.sense, self.params.substep_ms * MS]
        wheelbase = 0.0 if machine.steers_ahead else machine.wheelbase
        held = d.mass, d.cg_behind, d.cg_height, d.yaw_inertia, *tank, self.sense, machine.steered_x
        return traction_of(machine, d), car, [kind, *held, wheelbase, thrust]


class Cars(OnGround):
    """The machines of many worlds."""

    reads: ClassVar = {**OnGround.reads, "load": MachineLoad}

    def __init__(self, parts: Sequence[SingleTrack]) -> None:
        from swath.machine import drive_kernel as kernel
        from swath.machine.motion.single_track_kernel import Car, Moment
        from swath.machine.motion.single_track_step_kernel import stand_cars

        super().__init__(parts)
        n = self.worlds
        self._soft = [(world, part.soil) for world, part in enumerate(parts) if part.soil is not None]
        self.walks = self.walks and not (self._soft or any(part.params.wheel_slip for part in parts))
        self._cars, self._moments = Rows(Car, n), Rows(Moment, n)
        self._loops = Rows(kernel.Loop, n, [loop_of(dynamics_of(part.machine)) for part in parts])
        self._tractions, self._firm = Rows(kernel.Traction, n), Rows(kernel.Traction, n)
        if parts[0].params.wheel_slip:
            self._slips = np.zeros((2, n))  # forces of driven wheels over their load, slips for them
            given = [shared(self._slips[0]), self._firm.array, shared(self._slips[1])]
            self._slip_under = self.launch(kernel.slip_under, *given)
        self._again, self._sought, self._empties = np.zeros(1, np.int32), np.zeros((n, 3)), np.zeros((n, 14))
        self._grain, self._before = np.zeros(n), np.zeros(n)  # carried now, and when soil gave way to it
        rows = [row.array for row in (self._cars, self.tracks, self.stands)]
        self.stand = self.launch(stand_cars, self.grounds, *rows, self.table)

    def launches(self) -> Sequence[Repeated]:
        """Look what is in the tank, drive on."""
        from swath.machine.motion import single_track_step_kernel as kernel

        needs = shared(self.needs)
        bodies = [self.grounds, self._cars.array, self._loops.array, self._tractions.array]
        flags = [shared(self.clock), needs, shared(self._again), shared(self._sought)]
        rows = [row.array for row in (self._moments, self.tracks, self.stands)]
        given = [*bodies, *self.asked(), *flags, *rows, shared(self.table)]
        self._drive = self.launch(kernel.drive, *given)
        if "load" not in self.given:
            return [self._drive]
        return [self._weigh(self.column("load", "tank_grain")), self._drive]

    def _weigh(self, tank_grain: Any) -> Repeated:
        """The launch that lets machines follow their tanks."""
        from swath.machine.motion.single_track_step_kernel import Loading, weigh

        rows = {"cars": self._cars, "tractions": self._tractions, "firm": self._firm, "tracks": self.tracks}
        own = {"carried": self._grain, "needs": self.needs, "empties": self._empties}
        arrays = {name: row.array for name, row in rows.items()}
        return self.launch(weigh, filled(Loading, tank_grain=tank_grain, **own, **arrays))

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Stand (or roll straight) at the start pose, tyres without slip, the tank empty."""
        self._moments.clear()
        self._sought[:] = [part.start for part in self.parts]
        for world in range(self.worlds):
            self._fill(world, 0.0)
        return super().reset(streams)

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Integrate over dt in equal substeps."""
        before = self.stands.of["speed"].copy()
        for world, soil in self._soft:
            self._give_way(world, soil)
        found = super().step(t, dt, inputs)
        for world, soil in self._soft:
            soil.roll(*self.place(world), self._loads(world, soil))
        return (
            found if self.walks else self._with_wheels(found, (self.stands.of["speed"] - before) / (dt / NS))
        )

    def supply(self, stage: int) -> None:
        """Soil under a tank that is another weight; ground that is not in memory."""
        if stage == 0 and "load" in self.given:
            for world, soil in self._soft:
                if self._grain[world] != self._before[world]:
                    self._give_way(world, soil)
            self._before[:], self.needs[0] = self._grain, 0
        else:
            super().supply(stage)

    def stand_again(self) -> None:
        """Drive those that had no ground."""
        self._again[0] = 1
        self._drive.launch()
        self._again[0] = 0

    def lacking(self, world: int) -> tuple[float, float, float]:
        """Farther on than where it is."""
        x, y, yaw = self._sought[world].tolist()
        return x, y, yaw

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        soil = self.parts[world].soil
        return {
            **super().save(world),
            **({} if soil is None else {"soil": soil.save()}),
            "grain": float(self._grain[world]),
            "moment": self._moments.save(world),
        }

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._fill(world, state["grain"])
        self._moments.load(world, state["moment"])
        if (soil := self.parts[world].soil) is not None:
            soil.load(state["soil"])
        super().load(world, state)

    def axle_loads(self, world: int) -> tuple[float, float]:
        """Of the fixed and the steered axle in the last step [N]."""
        of = self._moments.of
        return float(of["front_load"][world]), float(of["rear_load"][world])

    def with_trailers(self, t: int) -> Mapping[str, Samples]:
        """With the wheels at rest, at the start."""
        found = super().with_trailers(t)
        return found if self.walks or t > 0 else self._with_wheels(found, np.zeros(self.worlds))

    def _fill(self, world: int, grain: float) -> None:
        """Grain [kg] in the tank."""
        traction, numbers, self._empties[world] = self.parts[world].numbers()
        for row in (self._tractions, self._firm):
            for column, number in zip(row.of.values(), (*traction, 0.0), strict=True):
                column[world] = number
        for column, number in zip(self._cars.of.values(), numbers, strict=True):
            column[world] = number
        self._before[:], self._grain[world] = self._grain, -inf
        self._before[world] = grain
        self._weigh(self._before).launch()
        self.needs[0] = 0
        if (soil := self.parts[world].soil) is not None:
            self._give_way(world, soil)

    def _loads(self, world: int, soil: OnSoil) -> tuple[float, float]:
        """Of the axles [N]; before the first step those at rest."""
        loads = self.axle_loads(world)
        return loads if loads[0] > 0.0 else soil.loads_at_rest(float(self._grain[world]))

    def _give_way(self, world: int, soil: OnSoil) -> None:
        """Tyres on the soil that is under them now."""
        part, of = self.parts[world], self._cars.of
        loads, slip = self._loads(world, soil), float(self.stands.of["slip"][world])
        front, rear, drag = soil.given(*self.place(world), loads, slip)
        of["front_stiffness"][world], of["rear_stiffness"][world] = part.soft(front, rear)
        of["friction"][world] = 0.5 * (front.side_top + rear.side_top)
        along = self._tractions.of
        along["stiffness"][world], along["friction"][world] = front.along, front.along_top
        of["rolling"][world] = along["drag"][world] = drag

    def _with_wheels(self, found: Mapping[str, Samples], accel: F64) -> Mapping[str, Samples]:
        """What the driven wheels pull, and how they slip. accel: mean of the step [m/s2]."""
        if not self.parts[0].params.wheel_slip:
            return found
        wheels: list[WheelState] = []
        states: list[Any] = self.sent["state"].each()
        for world, (part, state) in enumerate(zip(self.parts, states, strict=True)):
            rolling = part.rolling if part.soil is None else float(self._tractions.of["drag"][world])
            d = replace(dynamics_of(part.machine), rolling_resistance=rolling)
            force, t = pull(state, float(accel[world]), float(self._grain[world]), d), state.t
            behind = float(self._cars.of["behind"][world])
            at_rest = GRAVITY * d.mass * behind / -part.machine.steered_x
            load = self.axle_loads(world)[0] if t > 0 else at_rest
            self._slips[0, world] = force / max(load, 1.0)
            wheels.append(WheelState(t, state.speed, 0.0, force, load))
        self._slip_under.launch()
        each = zip(wheels, self._slips[1].tolist(), strict=True)
        wheels = [replace(wheel, speed=wheel.speed * (1.0 + slip), slip=slip) for wheel, slip in each]
        return {**found, "wheels": Samples.joined(wheels)}


def _either(given: float | None, sheet: float) -> float:
    return sheet if given is None else given


LEVEL = Level(
    SingleTrack,
    Params,
    summary="side slip, tyre relaxation, rolling resistance, side slopes, on the terrain",
    cost="about 18 us per step",
    tolerance="against multibody up to 2.5 m/s: yaw gain within 0.2 %, offset after 30 deg within 2.8 %",
    checked=ON_SOIL,
)
