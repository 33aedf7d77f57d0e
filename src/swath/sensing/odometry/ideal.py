"""Odometry without error: the true speed, yaw rate and steer angle."""

from dataclasses import dataclass

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing import CHECKED
from swath.signals import MachineState, Odometry, SteerState


@dataclass(frozen=True)
class Params:
    """No parameters."""


class IdealOdometry(KeepsState):
    """Passes the truth on."""

    inputs = (Port("state", MachineState), Port("steering", SteerState))
    outputs = (Port("odometry", Odometry),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        pass

    def errors(self, sample: Odometry) -> dict[str, tuple[float, float]]:
        """None."""
        return dict.fromkeys(("speed", "yaw_rate", "steer_angle"), (0.0, 0.0))

    def reset(self, stream: Stream) -> Outputs:
        """At rest."""
        return {"odometry": Odometry(0, 0.0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One sample at t + dt."""
        state: MachineState = inputs["state"]
        steering: SteerState = inputs["steering"]
        return {"odometry": Odometry(t + dt, state.speed, state.yaw_rate, steering.angle)}


LEVEL = Level(
    IdealOdometry,
    Params,
    "true speed, yaw rate and steer angle",
    cost="3 us per sample",
    tolerance="exact",
    checked=CHECKED,
)
