"""Process level `constant`: what comes in leaves at once; a constant share of the grain is lost.

Grain goes to the tank, straw to a swath on the ground behind the machine. Nothing is held inside.
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.process.straw_outlet import StrawOutlet
from swath.signals import CropFlow, MachineLoad, MachineState

TOTALS = ("tank", "lost", "straw")


@dataclass(frozen=True)
class Params:
    """loss_percent: share of the grain lost; 1.0-1.5 % in all is acceptable (John Deere manual OMCQ76042).

    swath_width_m: of the straw swath; swath_step_m: travel after which the straw dropped on it is laid down
    """

    loss_percent: Annotated[float, Ge(0), Le(100)] = 1.0
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25


class ConstantProcess(KeepsState):
    """No delay, a constant loss."""

    kept = ("_totals", "_outlet")
    steps_any_length = True

    inputs = (Port("flow", CropFlow, history=True), Port("state", MachineState))
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._loss = params.loss_percent * PERCENT
        rear = setup.machine.body[0]
        self._outlet = StrawOutlet(setup.field, rear, params.swath_width_m, params.swath_step_m, ridge=True)

    def reset(self, stream: Stream) -> Outputs:
        """Empty tank; the swath starts where the first state finds the machine."""
        self._totals = {name: Total() for name in TOTALS}
        self._outlet.reset()
        return {"load": self._load(0, 0.0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Pass on what the header took in since the last step."""
        grain = straw = lost = 0.0
        for flow in inputs["flow"]:
            gone = flow.grain * self._loss
            self._totals["lost"].add(gone)
            self._totals["tank"].add(flow.grain - gone)
            self._totals["straw"].add(flow.straw)
            grain, straw, lost = grain + flow.grain - gone, straw + flow.straw, lost + gone
        self._outlet.drop(straw, inputs["state"])
        rate = NS / dt
        return {"load": self._load(t + dt, grain * rate, straw * rate, lost * rate)}

    def _load(self, t: int, grain: float, straw: float, lost: float) -> MachineLoad:
        tank_total, lost_total, straw_total = (self._totals[name].value for name in TOTALS)
        feed = grain + lost + straw
        return MachineLoad(
            t,
            tank_total,
            lost_total,
            straw_total,
            0.0,
            0.0,
            grain,
            straw,
            header_flow=feed,
            feeder_flow=feed,
            drum_flow=feed,
            rotor_flow=straw,
            shoe_flow=grain,
            separation_loss=lost,
            loss_share=self._loss if feed > 0.0 else 0.0,
        )


LEVEL = Level(
    ConstantProcess,
    Params,
    summary="everything leaves at once, a constant share of the grain is lost",
    cost="about 100 us per step, straw included",
    tolerance="no transport delay (10-15 s from knife to tank in the field), no load-dependent loss",
)
