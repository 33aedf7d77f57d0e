"""Powertrain level `ideal`: the engine always turns at rated speed, whatever is asked of it."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine import DRIVEN, SLOPES
from swath.machine.powertrain.power_balance import Powers, Powertrain, fuel_rate, steady


@dataclass(frozen=True)
class Params:
    """rated_power_kw: of another engine in the same machine, else that of the data sheet."""

    rated_power_kw: Annotated[float, Ge(1), Le(2000)] | None = None


class IdealPowertrain(Powertrain):
    """Adds up what is taken; the load may exceed 1."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params.rated_power_kw, setup)

    def reset(self, stream: Stream) -> Outputs:
        """At rated speed, nothing threshed."""
        return self._sample(0, self._at_rest())

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Powers at t + dt."""
        e, state = self._drivetrain.engine, inputs["state"]
        taken, _ = self._taken(inputs, self._gained(state.speed) * NS / dt)
        self._fuel.add(fuel_rate(taken.total, e.rated_speed, e) * dt / NS)
        return self._sample(t + dt, taken)

    def _sample(self, t: int, taken: Powers) -> Outputs:
        e, limit = self._drivetrain.engine, self._dynamics.max_speed
        load = taken.total / e.rated_power
        return self._state(t, taken, speed=e.rated_speed, power=taken.total, load=load, limit=limit)


LEVEL = Level(
    IdealPowertrain,
    Params,
    summary="rated speed at all times, power and fuel added up",
    cost="about 20 us per step",
    tolerance="equal to hydrostat within the governor's droop while the load stays below 1",
    numbers=("engine", "power"),
    steady=steady,
    checked=(DRIVEN, SLOPES[1]),
)
