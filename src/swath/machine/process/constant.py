"""Process level `constant`: what comes in leaves at once; a constant share of the grain is lost.

Grain goes to the tank, straw to a swath on the ground behind the machine. Nothing is held inside. What a full
tank does not hold is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Given, OneByOne, Samples, field_of
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import tank_of
from swath.machine.process.straw_outlet import StrawOutlet
from swath.signals import F64, CropFlow, MachineLoad, MachineState

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
        self._field = setup.field
        self._loss = params.loss_percent * PERCENT
        self._tank = tank_of(setup.machine)
        rear = setup.machine.body[0]
        self._outlet = StrawOutlet(setup.field, rear, params.swath_width_m, params.swath_step_m, ridge=True)

    @classmethod
    def together(cls, parts: Sequence["ConstantProcess"]) -> "Processes | None":
        """All of them, on fields where straw is counted and not seen, with the same tank."""
        are_alike = all(p._field.profile is not None and p._tank == parts[0]._tank for p in parts)
        return Processes(parts) if are_alike else None

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
            over = float(self._tank.over_rim(self._totals["tank"].value, flow.grain - gone))
            self._totals["lost"].add(gone + over)
            self._totals["tank"].add(flow.grain - gone - over)
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


class Processes(OneByOne):
    """Those of many worlds."""

    def __init__(self, parts: Sequence[ConstantProcess]) -> None:
        super().__init__(parts)
        self._loss = np.array([part._loss for part in parts])
        self._tank = parts[0]._tank
        self._totals, self._rests = np.zeros((2, len(TOTALS), len(parts)))

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """Empty tanks."""
        for part, stream in zip(self.parts, streams, strict=True):
            part.reset(stream)
        self._totals[:], self._rests[:] = 0.0, 0.0
        return self._loads(0, *np.zeros((3, len(self.parts))))

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """Pass on what the headers took in since the last step."""
        grain, straw, lost = np.zeros((3, len(self.parts)))
        for flow in inputs["flow"]:
            cut, stems = field_of(flow, "grain"), field_of(flow, "straw")
            gone = cut * self._loss
            over = self._tank.over_rim(self._totals[0] + self._rests[0], cut - gone)
            for k, part in enumerate((cut - gone - over, gone + over, stems)):
                self._add(k, part)
            grain, straw, lost = grain + cut - gone, straw + stems, lost + gone
        for part, laid in zip(self.parts, straw.tolist(), strict=True):
            part._field.profile.straw_kg += laid
        rate = NS / dt
        return self._loads(t + dt, grain * rate, straw * rate, lost * rate)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        totals, rests = self._totals[:, world].tolist(), self._rests[:, world].tolist()
        kept = zip(TOTALS, totals, rests, strict=True)
        self.parts[world]._totals = {name: Total(total, rest) for name, total, rest in kept}
        return super().save(world)

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        super().load(world, state)
        for k, name in enumerate(TOTALS):
            saved = self.parts[world]._totals[name].save()
            self._totals[k, world], self._rests[k, world] = saved["total"], saved["rest"]

    def _add(self, k: int, value: F64) -> None:
        """As `Total.add`."""
        old = self._totals[k]
        new = old + value
        self._rests[k] += np.where(np.abs(old) >= np.abs(value), (old - new) + value, (value - new) + old)
        self._totals[k] = new

    def _loads(self, t: int, grain: F64, straw: F64, lost: F64) -> dict[str, Samples]:
        tank, gone, laid = self._totals + self._rests
        feed = grain + lost + straw
        arrays = {
            "tank_grain": tank,
            "lost_grain": gone,
            "dropped_straw": laid,
            "grain_flow": grain,
            "straw_flow": straw,
            **dict.fromkeys(("header_flow", "feeder_flow", "drum_flow"), feed),
            "rotor_flow": straw,
            "shoe_flow": grain,
            "separation_loss": lost,
            "loss_share": np.where(feed > 0.0, self._loss, 0.0),
        }
        return {"load": Samples(MachineLoad, t, arrays, {"held_grain": 0.0, "held_straw": 0.0})}


LEVEL = Level(
    ConstantProcess,
    Params,
    summary="everything leaves at once, a constant share of the grain is lost",
    cost="about 100 us per step, straw included",
    tolerance="no transport delay (10-15 s from knife to tank in the field), no load-dependent loss",
    given=("mean_loss_percent", "peak_loss_percent"),
)
