"""GNSS without error: the true place and velocity of the antenna."""

from dataclasses import dataclass, field

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.sensing import CHECKED
from swath.sensing.gnss.antenna import Antenna, Place, TwoAntennas, fix_of, no_fix
from swath.signals import FIX_QUALITIES, Fix, MachineState


@dataclass(frozen=True)
class Params:
    """A receiver without errors.

    antenna: where the antenna sits on the machine
    second_antenna: place of another antenna, for the heading, and for roll or pitch
    """

    antenna: Place = field(default_factory=Place)
    second_antenna: Place | None = None


class IdealGnss(KeepsState):
    """Passes the truth on, without delay."""

    kept = ("_antenna", "_pair")

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("fix", Fix),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._setup = setup
        self._antenna = Antenna(params.antenna)
        self.mounting = self._antenna.mounting
        second = params.second_antenna
        self._pair = None if second is None else TwoAntennas(params.antenna, second, 0.0, 0)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing received yet."""
        self._antenna.reset()
        if self._pair is not None:
            self._pair.reset()
        return {"fix": no_fix(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One sample at t + dt."""
        self._antenna.take(inputs["state"])
        position, velocity = self._antenna.at(t + dt)
        quality = FIX_QUALITIES.index("fix")
        more = {}
        if self._pair is not None:
            self._pair.take(inputs["state"])
            more = self._pair.seen(t + dt)
        return {"fix": fix_of(t + dt, self._setup, position, velocity, (0.0, 0.0, 0.0), quality, **more)}


LEVEL = Level(
    IdealGnss,
    Params,
    "true place and velocity of the antenna",
    cost="0.15 ms per sample",
    tolerance="exact",
    checked=CHECKED,
)
