"""Header level `fixed_height`: the knife takes all standing crop it passes over, at one height.

The swept area between two poses is a polygon over the knife's ends; the field cuts each of its cells once.
Between poses the ends go straight: with a step of 0.1 m the outer end of a 6 m turn is 0.2 mm off its arc.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.core.component import Port, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.schedule import NS
from swath.core.together import InWorlds, Samples
from swath.field.cutting.cut_result import Cut
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated
from swath.machine import SPEED
from swath.machine.header import FLOWS
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


class FixedHeightHeader(InWorlds):
    """A knife of the header's width at a fixed height above ground. knife: x, left and right y of its ends.

    path: where the knife was; gauge: how much of it cuts
    """

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("flow", CropFlow),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params, self.field = params, setup.field
        left, right = setup.machine.header_end("left"), setup.machine.header_end("right")
        self.knife = (left[0], left[1], right[1])
        self.path, self.gauge = LinePath(params.sweep_step_m), FillGauge(setup.machine.header_width)

    @classmethod
    def together(cls, parts: Sequence["FixedHeightHeader"]) -> "Headers":
        """Make one object that steps these parts of many worlds together."""
        return Headers(parts)


class Headers(Compiled):
    """The headers of many worlds, each of which cuts as soon as it is due."""

    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[FixedHeightHeader]) -> None:
        super().__init__(len(parts), {"flow": row_of(CropFlow, len(parts), FLOWS)})
        self._parts = parts

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Nothing cut; the knife's place is taken from the first state that comes."""
        for part in self._parts:
            part.path.clear()
            part.gauge.clear()
        self.sent["flow"].memory[:] = 0
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """None: `supply` is all."""
        return [self.asking()]

    def supply(self, stage: int) -> None:
        """Cut what the knives of worlds that run passed over since the last step."""
        trail, memory = self.heard["state"], self.sent["flow"].memory
        for world in np.flatnonzero(self.active).tolist():
            part, poses = self._parts[world], trail.memory["pose"][: trail.count, world].tolist()
            taken, swept_area = Cut(), 0.0
            try:
                for before, now in part.path.over(line_ends(pose, *part.knife) for pose in poses):
                    for polygon in swept(before, now):
                        taken += part.field.cut(polygon, part.params.cutting_height_m)
                        swept_area += signed_area(polygon)
            except SwathError as error:
                self.errors[world] = error
            fill = part.gauge.read(taken.area, swept_area)
            sums = taken.grain, taken.straw, taken.area, taken.stem_count
            memory[world] = *sums, fill, self.clock[2] / NS, taken.grain_left

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        return {"path": self._parts[world].path.save(), "gauge": self._parts[world].gauge.save()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._parts[world].path.load(state["path"])
        self._parts[world].gauge.load(state["gauge"])


LEVEL = Level(
    FixedHeightHeader,
    Params,
    summary="takes all standing crop under the knife at one height",
    cost="0.12 ms per step (12 m header, 50 Hz)",
    tolerance="ears below the knife are left; nothing is shed or lifted, the header follows no ground",
    checked=(SPEED,),
)
