"""IMU without error: mean angular rate and specific force since the sample before."""

from dataclasses import dataclass, field

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing import CHECKED
from swath.sensing.imu.strapdown import Place, Strapdown, sample_of
from swath.signals import Inertial, MachineState


@dataclass(frozen=True)
class Params:
    """mount: where the unit sits on the machine."""

    mount: Place = field(default_factory=Place)


class IdealImu(KeepsState):
    """Passes the truth on."""

    kept = ("_motion",)

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("inertial", Inertial),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.mounting = params.mount.pose()
        self._start = setup.start
        self._motion = Strapdown(self.mounting)

    def errors(self, sample: Inertial) -> dict[str, tuple[float, float]]:
        """None."""
        return dict.fromkeys(("rate", "force"), (0.0, 0.0))

    def reset(self, stream: Stream) -> Outputs:
        """At rest, level."""
        return {"inertial": sample_of(0, *self._motion.reset(self._start))}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One sample at t + dt."""
        return {"inertial": sample_of(t + dt, *self._motion.take(inputs["state"]))}


LEVEL = Level(
    IdealImu,
    Params,
    "true mean rate and specific force",
    cost="13 us per sample",
    tolerance="exact",
    checked=CHECKED,
)
