"""Process level `constant`: a constant share of the grain is lost, what comes in leaves at once or delayed.

Grain goes to the tank, straw to a swath on the ground behind the machine. What a full tank does not hold is
lost. Without delays nothing is held inside. `delay_line` is the same with those of a combine: pure delay and
first order reproduce what a yield sensor shows (Sensors 2008, 8(2):952).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.core.component import Component, Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.schedule import NS
from swath.core.together import InWorlds, KeepsRows, Samples, plain
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import tank_of
from swath.machine.process.straw_outlet import Outlet, Outlets, StrawOutlet
from swath.machine.transport import Conveyor, Mixer
from swath.signals import CropFlow, MachineLoad, MachineState

LOADS = (
    *("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw", "grain_flow", "straw_flow"),
    *("header_flow", "feeder_flow", "drum_flow", "rotor_flow", "shoe_flow", "separation_loss", "loss_share"),
)  # as pass_on.cpp has them
INPUTS = (Port("flow", CropFlow, history=True), Port("state", MachineState))
OUTPUTS = (Port("load", MachineLoad),)
TOTALS = ("tank", "lost", "straw")
JOINED = 0.02  # [s]
Delay = Annotated[float, Ge(0), Le(120)]
DELAYS = ("feed_delay_s", "grain_delay_s", "grain_lag_s", "straw_delay_s", "straw_lag_s")


@dataclass(frozen=True)
class Params:
    """Losses, delays and straw without a model of threshing. Lost grain leaves with the straw.

    feed_delay_s: from the knife to the drum
    grain_delay_s: from the knife to the tank
    grain_lag_s: time constant of the way of the grain
    straw_delay_s: from the knife to the ground
    straw_lag_s: time constant of the way of the straw
    loss_percent: share of the grain that is lost; 1.0-1.5 % in all is acceptable (John Deere manual
        OMCQ76042)
    swath_width_m: width of the straw swath
    swath_step_m: travel after which the straw dropped on it is laid down
    """

    feed_delay_s: Delay = 0.0
    grain_delay_s: Delay = 0.0
    grain_lag_s: Delay = 0.0
    straw_delay_s: Delay = 0.0
    straw_lag_s: Delay = 0.0
    loss_percent: Annotated[float, Ge(0), Le(100)] = 1.0
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25


@dataclass(frozen=True)
class CombineParams(Params):
    """A combine in the field; uncited estimates.

    feed_delay_s: from the knife to the drum, 2-4 s
    grain_delay_s: from the knife to the tank, 10-15 s
    grain_lag_s: time constant of the way of the grain, 2-5 s
    straw_delay_s: from the knife to the ground, the drum and 2-5 s more
    straw_lag_s: time constant of the way of the straw
    """

    feed_delay_s: Delay = 2.75
    grain_delay_s: Delay = 11.0
    grain_lag_s: Delay = 3.0
    straw_delay_s: Delay = 6.0
    straw_lag_s: Delay = 1.0


def outlet_of(params: Params, setup: SiteSetup) -> Outlet:
    """What lays the straw, behind the machine."""
    return Outlet(setup.field, setup.machine.body[0], params.swath_width_m, params.swath_step_m, True)


def process_of(params: Params, setup: SiteSetup) -> Component:
    """The process, an op of many worlds where nothing is delayed."""
    is_delayed = any(getattr(params, name) > 0.0 for name in DELAYS)
    return (DelayedProcess if is_delayed else ConstantProcess)(params, setup)


class ConstantProcess(InWorlds):
    """No delay, a constant loss. tank: what it holds; outlet: of the straw."""

    steps_any_length = True

    inputs, outputs = INPUTS, OUTPUTS

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.field, self.loss = setup.field, params.loss_percent * PERCENT
        self.tank, self.outlet = tank_of(setup.machine), outlet_of(params, setup)

    @classmethod
    def together(cls, parts: Sequence["ConstantProcess"]) -> "Processes":
        """Make one object that steps these parts of many worlds together."""
        return Processes(parts)


class Processes(KeepsRows, Compiled):
    """The parts of many worlds, stepped together."""

    kept = ("_sums", "_outlets")
    reads: ClassVar = {"state": MachineState}
    hears: ClassVar = {"flow": CropFlow}

    def __init__(self, parts: Sequence[ConstantProcess]) -> None:
        n = len(parts)
        super().__init__(n, {"load": row_of(MachineLoad, n, LOADS)})
        self._shares = np.array([(part.loss, part.tank.capacity) for part in parts])
        self._sums, self._outlets = np.zeros((n, 6)), Outlets([part.outlet for part in parts])

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty tanks; swaths start where the first state finds the machine."""
        self._outlets.clear()
        self._sums[:] = 0.0
        self.sent["load"].memory[:] = 0
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """Pass on what the headers took in since the last step, and lay the straw."""
        trail, load = self.heard["flow"], self.sent["load"].memory.view(np.float64)
        given = {"active": self.active, "clock": self.clock, "head": trail.head, "shares": self._shares}
        given |= {"grain": trail.memory["grain"], "cut_straw": trail.memory["straw"], "sums": self._sums}
        given |= {"loads": load.reshape(self.worlds, -1), "poses": self.given["state"].arrays["pose"]}
        return self._outlets.launches(self.needs, "pass_on", **given)

    def supply(self, stage: int) -> None:
        """Lay the straw where it is not in memory."""
        self.errors.update(self._outlets.lay_rest())


class DelayedProcess(KeepsState):
    """Feeder, then a line for the grain and a line for straw with the lost grain."""

    kept = ("_feeder", "_grain", "_straw", "_grain_mixer", "_straw_mixer", "_totals", "_outlet")
    steps_any_length = True

    inputs, outputs = INPUTS, OUTPUTS

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p = self._p = params
        for name in ("grain_delay_s", "straw_delay_s"):
            if getattr(p, name) < p.feed_delay_s:
                expected = f"expected >= feed_delay_s = {p.feed_delay_s:g}"
                raise InputError(name, getattr(p, name), expected)
        self._loss = p.loss_percent * PERCENT
        self._bulk, self._outlet = tank_of(setup.machine), StrawOutlet(*outlet_of(params, setup))

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
        self._outlet.drop(dropped, plain(inputs["state"].pose))
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
    process_of,
    Params,
    summary="everything leaves at once or after a delay, a constant share of the grain is lost",
    cost="about 100 us per step, straw included; delayed 35 us, 70 us more when straw is laid",
    tolerance="no transport delay (10-15 s from knife to tank in the field), no load-dependent loss",
    given=("mean_loss_percent", "peak_loss_percent"),
)
PRESETS = {
    "delay_line": Level(
        DelayedProcess,
        CombineParams,
        summary="dead time and first order for grain and straw, a constant share of the grain is lost",
        cost="about 35 us per step, 70 us more when straw is laid",
        tolerance="mean delays exact, spread by less than a step; they do not depend on the load",
        given=LEVEL.given,
    )
}
