"""Settings level `fixed`: as the scenario says, or as a manual has it for the crop."""

from dataclasses import dataclass
from math import nan
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG, MM, RPM
from swath.signals import OrganSettings
from swath.signals.setup import ControlSetup

Speed = Annotated[float, Ge(1), Le(5000)]
Opening = Annotated[float, Ge(0.1), Le(100)]


@dataclass(frozen=True)
class Params:
    """Settings; none = the machine's own for its crop.

    drum_rpm: of drum or rotor
    concave_mm: clearance between drum and concave
    fan_rpm: fan of the shoe
    upper_sieve_mm: opening of the upper sieve
    lower_sieve_mm: opening of the lower sieve
    vane_deg: rotor vanes, steeper ones carry the straw out sooner
    """

    drum_rpm: Speed | None = None
    concave_mm: Opening | None = None
    fan_rpm: Annotated[float, Ge(0), Le(5000)] | None = None
    upper_sieve_mm: Opening | None = None
    lower_sieve_mm: Opening | None = None
    vane_deg: Annotated[float, Ge(1), Le(80)] | None = None


UNITS = {"drum_rpm": RPM, "concave_mm": MM, "fan_rpm": RPM,
         "upper_sieve_mm": MM, "lower_sieve_mm": MM, "vane_deg": DEG}  # fmt: skip


class Fixed(KeepsState):
    """The same all the time."""

    inputs: tuple[Port, ...] = ()
    outputs = (Port("settings", OrganSettings),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        values = [getattr(params, name) for name in UNITS]
        units = UNITS.values()
        self._values = [nan if v is None else v * unit for v, unit in zip(values, units, strict=True)]

    def reset(self, stream: Stream) -> Outputs:
        """Settings at the start."""
        return {"settings": OrganSettings(0, *self._values)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The same settings."""
        return {"settings": OrganSettings(t + dt, *self._values)}


LEVEL = Level(
    Fixed,
    Params,
    summary="as the scenario says; what it leaves out is the machine's own for its crop",
    cost="5 us per step",
    tolerance="exact",
)
PRESETS = {"table": LEVEL.preset("as a manual has them for the crop", "5 us", **dict.fromkeys(UNITS))}
