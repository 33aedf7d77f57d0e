"""Process level `constant`: what comes in leaves at once; a constant share of the grain is lost.

Grain goes to the tank, straw to a swath on the ground behind the machine. Nothing is held inside. What a full
tank does not hold is lost.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.core.component import Port, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.together import InWorlds, Samples
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, Rows, repeatable, shared
from swath.machine.drivetrain_sheet import tank_of
from swath.machine.process.straw_outlet import StrawOutlet
from swath.signals import CropFlow, MachineLoad, MachineState

LOADS = (
    *("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw", "grain_flow", "straw_flow"),
    *("header_flow", "feeder_flow", "drum_flow", "rotor_flow", "shoe_flow", "separation_loss", "loss_share"),
)  # as `pass_on` has them


@dataclass(frozen=True)
class Params:
    """Losses and straw without a model of threshing.

    loss_percent: share of the grain that is lost; 1.0-1.5 % in all is acceptable (John Deere manual
        OMCQ76042)
    swath_width_m: width of the straw swath
    swath_step_m: travel after which the straw dropped on it is laid down
    """

    loss_percent: Annotated[float, Ge(0), Le(100)] = 1.0
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25


class ConstantProcess(InWorlds):
    """No delay, a constant loss. tank: what it holds; outlet: lays straw on the field."""

    steps_any_length = True

    inputs = (Port("flow", CropFlow, history=True), Port("state", MachineState))
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.field, self.loss = setup.field, params.loss_percent * PERCENT
        self.tank = tank_of(setup.machine)
        rear = setup.machine.body[0]
        self.outlet = StrawOutlet(setup.field, rear, params.swath_width_m, params.swath_step_m, ridge=True)

    @classmethod
    def together(cls, parts: Sequence["ConstantProcess"]) -> "Processes | None":
        """All of them, on fields where straw is counted and not seen: worlds that have ended lay on."""
        are_counted = len(parts) == 1 or all(part.field.profile is not None for part in parts)
        return Processes(parts) if are_counted else None


class Processes(Compiled):
    """Those of many worlds."""

    reads: ClassVar = {"state": MachineState}
    hears: ClassVar = {"flow": CropFlow}

    def __init__(self, parts: Sequence[ConstantProcess]) -> None:
        from swath.machine.process import constant_kernel as kernel

        n = len(parts)
        super().__init__(n, {"load": row_of(MachineLoad, n, LOADS)})
        shares = [(part.loss, part.tank.capacity) for part in parts]
        self._parts, self._shares = parts, Rows(kernel.Shares, n, shares)
        self._sums = Rows(kernel.Sums, n)

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty tanks; swaths start where the first state finds the machine."""
        for part in self._parts:
            part.outlet.reset()
        self._sums.clear()
        self.sent["load"].memory[:] = 0
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """Pass on what the headers took in since the last step."""
        from swath.machine.process.constant_kernel import pass_on

        trail, load = self.heard["flow"], self.sent["load"]
        more = self.clock, self.needs, trail.head, trail.memory["grain"], trail.memory["straw"]
        given = [self._shares.array, self._sums.array, *map(shared, (*more, *load.arrays.values()))]
        return [repeatable(pass_on, given, threads=self.worlds)]

    def supply(self, stage: int) -> None:
        """Lay the straw."""
        state: Any = self.given["state"]
        for world, (part, laid) in enumerate(zip(self._parts, self._sums.of["laid"].tolist(), strict=True)):
            try:
                part.outlet.drop(laid, state.of(world))
            except SwathError as error:
                self.errors[world] = error

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        return {"sums": self._sums.save(world), "outlet": self._parts[world].outlet.save()}

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        self._sums.load(world, state["sums"])
        self._parts[world].outlet.load(state["outlet"])


LEVEL = Level(
    ConstantProcess,
    Params,
    summary="everything leaves at once, a constant share of the grain is lost",
    cost="about 100 us per step, straw included",
    tolerance="no transport delay (10-15 s from knife to tank in the field), no load-dependent loss",
    given=("mean_loss_percent", "peak_loss_percent"),
)
