"""Ground speed level `ideal`: the true forward speed of the fixed axle."""

from dataclasses import dataclass

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing import SPEED
from swath.signals import GroundSpeed, MachineState


@dataclass(frozen=True)
class Params:
    """No parameters."""


class IdealGroundSpeed(KeepsState):
    """Passes the truth on."""

    inputs = (Port("state", MachineState),)
    outputs = (Port("speed", GroundSpeed),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        pass

    def reset(self, stream: Stream) -> Outputs:
        """At rest."""
        return {"speed": GroundSpeed(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Give one sample at t + dt."""
        state: MachineState = inputs["state"]
        return {"speed": GroundSpeed(t + dt, state.speed, state.distance)}


LEVEL = Level(IdealGroundSpeed, Params, "true forward speed", cost="none", tolerance="exact",
              checked=(SPEED,))  # fmt: skip
