"""Powertrain level `ideal`: the engine always turns at rated speed, whatever is asked of it."""

from dataclasses import dataclass

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import dynamics_of
from swath.machine.powertrain.power_balance import (
    Powers,
    engine_state,
    fuel_rate,
    powers,
    propulsion_power,
    pull,
)
from swath.signals import EngineState, MachineLoad, MachineState


@dataclass(frozen=True)
class Params:
    """There is nothing to choose: everything is on the machine's sheet."""


class IdealPowertrain:
    """Adds up what is taken; the load may exceed 1."""

    inputs = (Port("state", MachineState), Port("load", MachineLoad))
    outputs = (Port("engine", EngineState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._drivetrain, self._dynamics = drivetrain_of(setup.machine), dynamics_of(setup.machine)
        self._width = setup.machine.header_width

    def reset(self, stream: Stream) -> Outputs:
        """At rated speed, nothing threshed."""
        self._fuel = Total()
        self._before: float | None = None
        nothing = MachineLoad(0, *[0.0] * 7)
        return {"engine": self._sample(0, powers(nothing, 0.0, self._width, self._drivetrain))}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Powers at t + dt."""
        state: MachineState = inputs["state"]
        load: MachineLoad = inputs["load"]
        accel = 0.0 if self._before is None else (state.speed - self._before) * NS / dt
        self._before = state.speed
        force = pull(state, accel, load.tank_content, self._dynamics)
        driving = propulsion_power(force, state.speed, self._drivetrain.hydrostat.efficiency)
        taken = powers(load, driving, self._width, self._drivetrain)
        self._fuel.add(
            fuel_rate(taken.total, self._drivetrain.engine.rated_speed, self._drivetrain.engine) * dt / NS
        )
        return {"engine": self._sample(t + dt, taken)}

    def save(self) -> State:
        """Fuel and the last speed."""
        return {"fuel": self._fuel.save(), "before": self._before}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._fuel, self._before = Total(*state["fuel"]), state["before"]

    def _sample(self, t: int, taken: Powers) -> EngineState:
        e = self._drivetrain.engine
        load, limit = taken.total / e.rated_power, self._dynamics.max_speed
        return engine_state(
            t, taken, e.rated_speed, taken.total, load, self._fuel.value, limit, self._drivetrain
        )


LEVEL = Level(
    IdealPowertrain,
    Params,
    summary="rated speed at all times, power and fuel added up",
    cost="about 10 us per step",
    tolerance="equal to hydrostat within the governor's droop while the load stays below 1",
)
