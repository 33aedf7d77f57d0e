"""Process level `constant`: what comes in leaves at once; a constant share of the grain is lost.

Grain goes to the tank, straw to a swath on the ground behind the machine. Nothing is held inside.
"""

from dataclasses import dataclass
from math import atan2
from typing import Annotated, Any, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.frames import Array
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.signals import CropFlow, MachineLoad, MachineState
from swath.core.units import PERCENT
from swath.field.site import SiteSetup
from swath.machine.sums import Total
from swath.machine.sweep import line_ends, signed_area, swept

TOTALS = ("tank", "lost", "straw")


@dataclass(frozen=True)
class Params:
    """loss_percent: share of the grain lost; 1.0-1.5 % in all is acceptable (John Deere manual OMCQ76042).

    swath_width_m: of the straw swath; swath_step_m: way after which the straw dropped on it is laid down
    """

    loss_percent: Annotated[float, Ge(0), Le(100)] = 1.0
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25


class StrawGround(Protocol):
    """The part of a field that takes straw."""

    def deposit_straw(self, polygon: Array, mass: float, /, *, heading: float | None = None) -> Any:
        """Lay straw [kg] over a convex polygon (n, 2) [m], as a ridge along a heading [rad]."""
        ...


class ConstantProcess:
    """No delay, a constant loss."""

    inputs = (Port("flow", CropFlow, history=True), Port("state", MachineState))
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._params = params
        self._field: StrawGround = setup.field
        half = 0.5 * params.swath_width_m
        self._outlet = (setup.machine.body[0], half, -half)

    def reset(self, stream: Stream) -> Outputs:
        """Empty tank; the swath starts where the first state finds the machine."""
        self._totals = {name: Total() for name in TOTALS}
        self._ends: Array | None = None
        self._loose = 0.0
        return {"load": self._load(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Pass on what the header took in since the last step."""
        loss = self._params.loss_percent * PERCENT
        grain = straw = 0.0
        for flow in inputs["flow"]:
            lost = flow.grain * loss
            self._totals["lost"].add(lost)
            self._totals["tank"].add(flow.grain - lost)
            self._totals["straw"].add(flow.straw)
            grain, straw = grain + flow.grain - lost, straw + flow.straw
        self._loose += straw
        self._lay_swath(inputs["state"])
        return {"load": self._load(t + dt, grain * NS / dt, straw * NS / dt)}

    def save(self) -> State:
        """Totals and the open end of the swath."""
        totals = {name: total.save() for name, total in self._totals.items()}
        ends = None if self._ends is None else self._ends.copy()
        return {"totals": totals, "ends": ends, "loose": self._loose}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._totals = {name: Total(*state["totals"][name]) for name in TOTALS}
        self._ends = None if state["ends"] is None else np.array(state["ends"])
        self._loose = state["loose"]

    def _lay_swath(self, state: MachineState) -> None:
        ends = line_ends(state.pose, *self._outlet)
        if self._ends is None:
            self._ends = ends
        if float(np.hypot(*(ends - self._ends).T).max()) < self._params.swath_step_m:
            return
        polygons = swept(self._ends, ends)
        area = sum(signed_area(p) for p in polygons)
        if area <= 0.0:
            return
        if self._loose > 0.0:
            dx, dy = (ends - self._ends).sum(axis=0).tolist()
            for polygon in polygons:
                mass = self._loose * signed_area(polygon) / area
                self._field.deposit_straw(polygon, mass, heading=atan2(dy, dx))
            self._loose = 0.0
        self._ends = ends

    def _load(self, t: int, grain_flow: float, straw_flow: float) -> MachineLoad:
        tank, lost, straw = (self._totals[name].value for name in TOTALS)
        return MachineLoad(t, tank, lost, straw, 0.0, 0.0, grain_flow, straw_flow)


LEVEL = Level(
    ConstantProcess,
    Params,
    summary="everything leaves at once, a constant share of the grain is lost",
    cost="about 40 us per step",
    tolerance="no transport delay (10-15 s from knife to tank in the field), no load-dependent loss",
)
