"""Returns level `model`: what the shoe sends back is at the drum some time later."""

from collections.abc import Sequence

from swath.core.component import Inputs, Outputs
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.organ import (
    ENGINE,
    JOINED,
    SHARED,
    Organ,
    crop,
    given,
    in_transport,
    masses,
    moisture,
    ratio_of,
    sent,
)
from swath.machine.transport import Conveyor


class Returns(Organ):
    """Plug flow; faster with the engine."""

    kept = ("_elevator",)
    inputs = (crop("fed"), ENGINE)
    outputs = given("back")

    def __init__(self, params: None, setup: SiteSetup) -> None:
        self._elevator = Conveyor(self._length(setup), len(SHARED), joined=JOINED)

    def _length(self, setup: SiteSetup) -> float:
        return drivetrain_of(setup.machine).transport.returns

    def start(self) -> None:
        """Empty it."""
        self._elevator.clear()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Move everything on by dt."""
        h, came = dt / NS, inputs["fed"]
        moved = self._elevator.advance(masses(came), h * ratio_of(inputs))
        back = sent(t + dt, h, moved, moisture(came))
        return {"back": back, "work": self.work(t + dt, h, back.grain, back.mog)}

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and other material in it [kg]."""
        return [in_transport(self._elevator)]


class IdealReturns(Returns):
    """Within a step."""

    def _length(self, setup: SiteSetup) -> float:
        return 0.0


LEVEL = Level(
    Returns,
    None,
    summary="the returns elevator: plug flow back to the drum",
    cost="about 10 us per step",
    tolerance="delay exact to rounding",
    numbers=("transport",),
)
PRESETS = {"ideal": Level(IdealReturns, None, "what the shoe sends back is at the drum in the next step",
                          cost="10 us", tolerance="exact")}  # fmt: skip
