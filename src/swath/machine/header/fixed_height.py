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
from swath.core.component import Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import InWorlds, KeepsRows, Samples
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated
from swath.machine import SPEED
from swath.machine.header.knives import Knives
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
    """A knife of the header's width at one height above ground. knife: x, left and right y of its ends."""

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("flow", CropFlow),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params, self.field, self.width = params, setup.field, setup.machine.header_width
        left, right = setup.machine.header_end("left"), setup.machine.header_end("right")
        self.knife = (left[0], left[1], right[1])

    @classmethod
    def together(cls, parts: Sequence["FixedHeightHeader"]) -> "Headers":
        """Make one object that steps these parts of many worlds together."""
        return Headers(parts)


class Headers(KeepsRows, Compiled):
    """The headers of many worlds, each of which cuts as soon as it is due."""

    kept = ("_knives",)

    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[FixedHeightHeader]) -> None:
        steps, widths = [part.params.sweep_step_m for part in parts], [part.width for part in parts]
        self._knives = Knives([part.field for part in parts], 2, steps, widths)
        super().__init__(len(parts), {"flow": self._knives.flow})
        self._ends = np.array([part.knife for part in parts])
        self._knives.sweeps.runs[:, 0, 2] = [round(100.0 * part.params.cutting_height_m) for part in parts]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Nothing cut."""
        self._knives.clear()
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """Cut what the knives passed over since the last step."""
        trail = self.heard["state"]
        poses = {"head": trail.head, "poses": trail.memory["pose"], "knives": self._ends}
        return self._knives.launches(len(trail.times), self.needs, self.active, self.clock, **poses)

    def supply(self, stage: int) -> None:
        """Cut what is not in memory."""
        self.errors.update(self._knives.cut_rest())


LEVEL = Level(
    FixedHeightHeader,
    Params,
    summary="takes all standing crop under the knife at one height",
    cost="0.12 ms per step (12 m header, 50 Hz)",
    tolerance="ears below the knife are left; nothing is shed or lifted, the header follows no ground",
    checked=(SPEED,),
)
