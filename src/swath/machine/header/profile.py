"""Header level `profile`: the knife cuts the field as profiles along the edge, for LiDAR `profile`.

Each end of the knife notes where it passed every 5 cm along the edge; what lies between both is cut, with the
masses that stand on a square metre there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Gt, Le

from swath.compiled import Compiled
from swath.core.component import Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.together import InWorlds, KeepsRows, Samples
from swath.field.edges.profile import BIN, refused
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, Rows, filled, of_worlds
from swath.machine import SPEED
from swath.machine.header import FLOWS, OVER_M, PROFILE_STEMS
from swath.signals import CropFlow, MachineState


@dataclass(frozen=True)
class Params:
    """cutting_height_m: stubble left behind."""

    cutting_height_m: Annotated[float, Gt(0), Le(1.5)] = 0.15


class ProfileHeader(InWorlds):
    """A knife of the header's width at a fixed height above ground, one pass along the edge."""

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("flow", CropFlow),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.edge is None:
            raise refused("field without an edge")
        self.profile = setup.field.profiled(setup.edge)
        self.profile.set_height(round(100.0 * params.cutting_height_m))
        left, right = setup.machine.header_end("left"), setup.machine.header_end("right")
        self.knife = (left[0], left[1], right[1], OVER_M, BIN, float(self.profile.is_left))

    @classmethod
    def together(cls, parts: Sequence["ProfileHeader"]) -> "Headers":
        """Make one object that steps these parts of many worlds together."""
        return Headers(parts)


class Headers(KeepsRows, Compiled):
    """The headers of many worlds. Kept is where a knife was; the cut itself is the field's."""

    kept = ("_cuttings",)

    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[ProfileHeader]) -> None:
        from swath.field.edges.profile_kernel import Profile
        from swath.machine.header import profile_kernel as kernel

        n = len(parts)
        super().__init__(n, {"flow": row_of(CropFlow, n, FLOWS)})
        self._held = [part.profile.struct() for part in parts], [_taken(kernel.Taken, part) for part in parts]
        self._cuttings = Rows(kernel.Cutting, n)
        self._given = [
            of_worlds(Profile, self._held[0]),
            of_worlds(kernel.Taken, self._held[1]),
            Rows(kernel.Knife, n, [part.knife for part in parts]).array,
            self._cuttings.array,
        ]

    def launches(self) -> Sequence[Repeated]:
        """Cut what the knives passed over since the last step."""
        from swath.machine.header.profile_kernel import cut_along

        trail, flow = self.heard["state"], self.sent["flow"]
        numbers = [flow.memory.view(kind).reshape(self.worlds, -1) for kind in (np.float64, np.int64)]
        more = trail.head, trail.memory["pose"], self.clock, self.needs, *numbers
        return [self.launch(cut_along, *self._given, *more)]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Nothing cut; the knife's place is taken from the first state that comes."""
        self._cuttings.clear()
        self.sent["flow"].memory[:] = 0
        return self.sent_at(0)

    def supply(self, stage: int) -> None:
        """A knife that goes where it cannot ends its world."""
        for world in np.flatnonzero(self._cuttings.of["is_refused"]).tolist():
            self.errors[world] = refused("second pass, or a drive against the edge's direction")


def _taken(struct: Any, part: ProfileHeader) -> Any:
    grain, straw, stems, left, _ = part.profile.per_m2(part.knife[1] - part.knife[2])
    return filled(struct, grain=grain, straw=straw, stems=stems, left=left)


LEVEL = Level(
    ProfileHeader,
    Params,
    summary="cuts profiles along the edge: 5 cm along it, masses of a square metre",
    cost="0.1 ms per step (12 m header, 50 Hz), 8 us in a batch of worlds",
    tolerance="area and masses against fixed_height within 2 %, one pass along one edge",
    checked=(SPEED, PROFILE_STEMS),
)
