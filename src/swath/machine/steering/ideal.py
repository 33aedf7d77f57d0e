"""Steering level `ideal`: the axle stands at the wanted angle at once, within its limit."""

from dataclasses import dataclass
from math import atan

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.signals import SteerCommand, SteerState
from swath.signals.setup import MachineGeometry


@dataclass(frozen=True)
class Params:
    """Nothing to set."""


def wanted_angle(command: SteerCommand, machine: MachineGeometry, held: float) -> float:
    """Equivalent wheel angle [rad] for a wanted curvature: atan(L kappa), within the machine's limit.

    When steering is not engaged, or the curvature is no number, the angle `held` stays.
    """
    angle = atan(machine.wheelbase * command.curvature)
    if not command.is_engaged or angle != angle:
        return held
    return min(max(angle, -machine.max_steer), machine.max_steer)


class IdealSteering(KeepsState):
    """No dead time, no rate limit, no lag."""

    kept = ("_angle",)

    inputs = (Port("command", SteerCommand),)
    outputs = (Port("steering", SteerState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._machine = setup.machine

    def reset(self, stream: Stream) -> Outputs:
        """Wheels straight."""
        self._angle = 0.0
        return {"steering": SteerState(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take the wanted angle; the rate is the mean over the step."""
        before = self._angle
        self._angle = wanted_angle(inputs["command"], self._machine, before)
        return {"steering": SteerState(t + dt, self._angle, (self._angle - before) * NS / dt)}


LEVEL = Level(
    IdealSteering,
    Params,
    summary="wanted angle at once, within the limit",
    cost="about 2 us per step",
    tolerance="no dead time, rate limit, lag or dead band: compare with actuator",
)
