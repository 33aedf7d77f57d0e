"""Unload level `ideal`: full flow at once and to the last grain, a stream without spread."""

from dataclasses import dataclass

from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.machine import SPEED
from swath.machine.unload import auger


@dataclass(frozen=True)
class Params:
    """Nothing to set."""


class IdealUnload(auger.Auger):
    """The auger without swing time, ramps, taper and spread."""

    swings_at_once = True

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        none = auger.Params(run_up_s=0.0, run_out_s=0.0, taper_percent=0.0, spread_m=0.0)
        super().__init__(none, setup)


LEVEL = Level(
    IdealUnload,
    Params,
    summary="full flow at once, no spread of the stream",
    cost="0.1 ms per step while it pours",
    tolerance="tank volume over flow exact",
    checked=(SPEED,),
)
