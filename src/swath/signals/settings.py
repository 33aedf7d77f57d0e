"""Settings of a combine's organs, and what manuals say of them crop by crop."""

from dataclasses import dataclass, fields
from math import isnan, nan
from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import Quantity, Signal
from swath.core.units import DEG, MM, RPM

OWN = "as the machine has it for its crop"
SIEVE_AIR = (
    2.0  # of the fan's air lost per mm that the upper sieve is wider: an estimate within 1 to 4 [%/mm]
)
SPEED, GAP, STEEP = (1.0 * RPM, 5000.0 * RPM), (0.1 * MM, 100.0 * MM), (1.0 * DEG, 80.0 * DEG)


@frozen
class OrganSettings(Signal):
    """How the organs are to be set."""

    drum: Annotated[float, Quantity("rad/s", "drum or rotor", nan=OWN, span=SPEED)] = nan
    concave: Annotated[float, Quantity("m", "clearance between drum and concave", nan=OWN, span=GAP)] = nan
    fan: Annotated[float, Quantity("rad/s", "fan of the shoe", nan=OWN, span=(0.0, SPEED[1]))] = nan
    upper: Annotated[float, Quantity("m", "opening of the upper sieve", nan=OWN, span=GAP)] = nan
    lower: Annotated[float, Quantity("m", "opening of the lower sieve", nan=OWN, span=GAP)] = nan
    vane: Annotated[
        float, Quantity("rad", "rotor vanes, > 0 steeper: straw leaves sooner", nan=OWN, span=STEEP)
    ] = nan


NAMES = tuple(f.name for f in fields(OrganSettings) if f.name != "t")


@dataclass(frozen=True)
class Works:
    """What a machine is set to for wheat. Speeds [rad/s], openings [m], vanes [rad].

    Without a sheet's own: rotor of 559 mm, New Holland CR, operator's manual, section 6; vanes estimated.
    radius: of drum or rotor [m]
    """

    radius: float = 0.2795
    drum: float = 1150.0 * RPM
    concave: float = 13.0 * MM
    fan: float = 850.0 * RPM
    upper: float = 10.0 * MM
    lower: float = 4.0 * MM
    vane: float = 30.0 * DEG


@dataclass(frozen=True)
class CropWork:
    """A crop in the machine: settings over those for wheat (the manual above), and what laws need of it.

    broken: share of the grain at these settings and `moisture`, of a tangential drum, estimates
    air, width: speed of the air that the shoe is best at, and that changes its losses e-fold [m/s], estimates
    load: of the shoe at the flow that straw or grain limits, over that of wheat, derived from straw over
        grain of 0.75, 1.05, 1.2, 1.6, 1.0, 0.22, in the order of `CROPS`
    rotors, walkers: factors on the rates of rotors and walkers; of barley so that a machine takes at a loss
        of 3 % so much of the straw and chaff of wheat as measured ones: 0.7 and 0.49 (PAMI); else not known
    """

    drum: float = 1.0
    concave: float = 1.0
    fan: float = 1.0
    upper: float = 1.0
    lower: float = 1.0
    vane: float = 1.0
    broken: float = 0.01
    moisture: float = 0.14
    air: float = 6.0
    width: float = 0.6
    load: float = 1.0
    rotors: float = 1.0
    walkers: float = 1.0


def _row(drum: float, concave: float, fan: float, upper: float, lower: float, **more: float) -> CropWork:
    return CropWork(drum / 1150.0, concave / 13.0, fan / 850.0, upper / 10.0, lower / 4.0, **more)


CROPS = {
    "wheat": CropWork(),
    "barley": _row(1100.0, 14.0, 800.0, 13.0, 5.0, load=0.93, rotors=0.555, walkers=0.274),
    "oats": _row(930.0, 14.0, 600.0, 11.0, 6.0, load=0.81),
    "rye": _row(1180.0, 14.0, 750.0, 11.0, 6.0, load=0.77),
    "rape": _row(630.0, 23.0, 500.0, 9.0, 4.0, broken=0.003, air=4.5, width=0.4, load=0.69),
    "soy": _row(600.0, 23.0, 700.0, 11.0, 8.0, broken=0.03, load=0.83),
    "maize": _row(500.0, 23.0, 1000.0, 13.0, 12.0, broken=0.04, air=9.0, width=1.0, load=0.55),
}
"""rpm, mm, rpm, mm, mm of the manual by crop. A crop that is not here is taken as wheat."""


def own_settings(works: Works, crop: str, wanted: OrganSettings | None = None) -> dict[str, float]:
    """Every setting in SI: as wanted, or where that is nan as the machine has it for the crop."""
    table, given = CROPS.get(crop, CROPS["wheat"]), {}
    for name in NAMES:
        value = nan if wanted is None else getattr(wanted, name)
        given[name] = getattr(works, name) * getattr(table, name) if isnan(value) else value
    return given
