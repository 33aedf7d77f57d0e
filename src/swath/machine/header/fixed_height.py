"""Header level `fixed_height`: the knife takes all standing crop it passes over, at one height.

The swept area between two poses is a polygon over the knife's ends; the field cuts each of its cells once.
Between poses the ends go straight: with a step of 0.1 m the outer end of a 6 m turn is 0.2 mm off its arc.
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.cut_result import Cut
from swath.field.site_setup import SiteSetup
from swath.machine import SPEED
from swath.machine.header.fill_gauge import FillGauge
from swath.machine.sweep import LinePath, line_ends, signed_area, swept
from swath.signals import CropFlow, MachineState


@dataclass(frozen=True)
class Params:
    """A header at one height.

    cutting_height_m: height of the stubble left behind
    sweep_step_m: poses of the knife that are closer together than this are joined
    """

    cutting_height_m: Annotated[float, Gt(0), Le(1.5)] = 0.15
    sweep_step_m: Annotated[float, Ge(0), Le(0.5)] = 0.1


class FixedHeightHeader(KeepsState):
    """A knife of the header's width at a fixed height above ground."""

    kept = ("_path", "_gauge")

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("flow", CropFlow),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._params = params
        self._field = setup.field
        left, right = setup.machine.header_end("left"), setup.machine.header_end("right")
        self._knife = (left[0], left[1], right[1])
        self._gauge = FillGauge(setup.machine.header_width)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing cut; the knife's place is taken from the first state that comes."""
        self._path = LinePath(self._params.sweep_step_m)
        self._gauge.clear()
        return {"flow": CropFlow(0, 0.0, 0.0, 0.0, 0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Cut what the knife passed over since the last step."""
        taken, swept_area = Cut(), 0.0
        for before, now in self._path.over(inputs["state"], lambda pose: line_ends(pose, *self._knife)):
            for polygon in swept(before, now):
                taken += self._field.cut(polygon, self._params.cutting_height_m)
                swept_area += signed_area(polygon)
        fill = self._gauge.read(taken.area, swept_area)
        sums = taken.grain, taken.straw, taken.area, taken.stem_count
        return {"flow": CropFlow(t + dt, *sums, fill, dt / NS, left_grain=taken.grain_left)}


LEVEL = Level(
    FixedHeightHeader,
    Params,
    summary="takes all standing crop under the knife at one height",
    cost="0.12 ms per step (12 m header, 50 Hz)",
    tolerance="ears below the knife are left; nothing is shed or lifted, the header follows no ground",
    checked=(SPEED,),
)
