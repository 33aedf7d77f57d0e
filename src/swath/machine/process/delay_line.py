"""Process level `delay_line`: a dead time and a first order for grain and for straw, a constant loss.

Pure delay and first order reproduce what a yield sensor shows (Sensors 2008, 8(2):952).
"""

from dataclasses import dataclass
from math import fsum
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import tank_of
from swath.machine.process.straw_outlet import StrawOutlet
from swath.machine.process.transport import Conveyor, Mixer
from swath.signals import CropFlow, MachineLoad, MachineState

TOTALS = ("tank", "lost", "straw")
JOINED = 0.02  # [s]
Delay = Annotated[float, Ge(0), Le(120)]


@dataclass(frozen=True)
class Params:
    """feed_delay_s: knife to drum, 2-4 s (uncited estimate); grain_delay_s, grain_lag_s: knife to tank, dead
    time 10-15 s and time constant 2-5 s in the field (uncited); straw_delay_s, straw_lag_s: knife to
    ground, the drum and 2-5 s more (uncited estimate). Lost grain leaves with the straw.

    loss_percent: share of the grain lost; swath_width_m: of the straw swath; swath_step_m: travel after which
    the straw dropped on it is laid down
    """

    feed_delay_s: Delay = 2.75
    grain_delay_s: Delay = 11.0
    grain_lag_s: Delay = 3.0
    straw_delay_s: Delay = 6.0
    straw_lag_s: Delay = 1.0
    loss_percent: Annotated[float, Ge(0), Le(100)] = 1.0
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25


class DelayLineProcess(KeepsState):
    """Feeder, then a line for the grain and a line for straw with the lost grain."""

    kept = ("_feeder", "_grain", "_straw", "_grain_mixer", "_straw_mixer", "_totals", "_outlet")
    steps_any_length = True

    inputs = (Port("flow", CropFlow, history=True), Port("state", MachineState))
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p = self._p = params
        for name in ("grain_delay_s", "straw_delay_s"):
            if getattr(p, name) < p.feed_delay_s:
                expected = f"expected >= feed_delay_s = {p.feed_delay_s:g}"
                raise InputError(name, getattr(p, name), expected)
        self._loss = p.loss_percent * PERCENT
        self._bulk = tank_of(setup.machine)
        rear = setup.machine.body[0]
        self._outlet = StrawOutlet(setup.field, rear, p.swath_width_m, p.swath_step_m, ridge=True)

    def reset(self, stream: Stream) -> Outputs:
        """Empty."""
        p = self._p
        self._feeder = Conveyor(p.feed_delay_s, 2, joined=JOINED)
        self._grain = Conveyor(p.grain_delay_s - p.feed_delay_s, 1, joined=JOINED)
        self._straw = Conveyor(p.straw_delay_s - p.feed_delay_s, 2, joined=JOINED)
        self._grain_mixer, self._straw_mixer = Mixer(1), Mixer(2)
        self._totals = {name: Total() for name in TOTALS}
        self._outlet.reset()
        return {"load": self._load(0, 1.0, [0.0, 0.0], [0.0, 0.0], 0.0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Move everything on by dt."""
        p, h = self._p, dt / NS
        cut = [fsum(f.grain for f in inputs["flow"]), fsum(f.straw for f in inputs["flow"])]
        grain, straw = fed = self._feeder.advance(cut, h)
        lost = grain * self._loss
        (tank,) = self._grain_mixer.advance(self._grain.advance([grain - lost], h), h, p.grain_lag_s)
        dropped, gone = self._straw_mixer.advance(self._straw.advance([straw, lost], h), h, p.straw_lag_s)
        over = float(self._bulk.over_rim(self._totals["tank"].value, tank))
        self._totals["tank"].add(tank - over)
        self._totals["lost"].add(gone + over)
        self._totals["straw"].add(dropped)
        self._outlet.drop(dropped, inputs["state"])
        return {"load": self._load(t + dt, h, cut, fed, tank, dropped, gone)}

    def _load(
        self, t: int, h: float, cut: list[float], fed: list[float], tank: float, straw: float, lost: float
    ) -> MachineLoad:
        (feeder_grain, feeder_straw), (line_straw, line_lost) = self._feeder.held(), self._straw.held()
        mixed_straw, mixed_lost = self._straw_mixer.held()
        held_grain = feeder_grain + self._grain.held()[0] + self._grain_mixer.held()[0]
        return MachineLoad(
            t,
            self._totals["tank"].value,
            self._totals["lost"].value,
            self._totals["straw"].value,
            held_grain + line_lost + mixed_lost,
            feeder_straw + line_straw + mixed_straw,
            tank / h,
            straw / h,
            header_flow=fsum(cut) / h,
            feeder_flow=fsum(fed) / h,
            drum_flow=fsum(fed) / h,
            rotor_flow=fed[1] / h,
            shoe_flow=fed[0] / h,
            separation_loss=lost / h,
            loss_share=self._loss if lost > 0.0 else 0.0,
        )


LEVEL = Level(
    DelayLineProcess,
    Params,
    summary="dead time and first order for grain and straw, a constant share of the grain is lost",
    cost="about 35 us per step, 70 us more when straw is laid",
    tolerance="mean delays exact, spread by less than a step; they and the loss do not depend on the load",
    given=("mean_loss_percent", "peak_loss_percent"),
)
