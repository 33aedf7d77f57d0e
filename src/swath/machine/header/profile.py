"""Header level `profile`: the knife cuts the field as profiles along the edge, for LiDAR `profile`.

Each end of the knife notes where it passed every 5 cm along the edge; what lies between both is cut, with the
masses that stand on a square metre there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import Port, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, Samples, of_columns
from swath.field.profile import BIN, refused
from swath.field.site_setup import SiteSetup
from swath.kernels import Rows, filled, of_worlds, repeatable, shared
from swath.machine import SPEED
from swath.machine.header import PROFILE_STEMS
from swath.machine.header.fill_gauge import OVER_M
from swath.signals import CropFlow, MachineState

ROOM = 64  # states between two steps
FLOWS = "grain", "straw", "area", "stem_count", "header_fill", "dt", "left_grain"  # as the kernel gives them


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
        """All of them."""
        return Headers(parts)


class Headers:
    """The headers of many worlds."""

    def __init__(self, parts: Sequence[ProfileHeader]) -> None:
        from swath.field.profile_kernel import Profile
        from swath.machine.header import profile_kernel as kernel

        self.errors: dict[int, SwathError] = {}
        n = len(parts)
        self._profiles = [part.profile.struct() for part in parts]
        self._taken = [_taken(kernel.Taken, part) for part in parts]
        self._cuttings = Rows(kernel.Cutting, n)
        self._poses, self._flows = np.zeros((n, ROOM, 12)), np.zeros((n, 7))
        self._counts = np.zeros(n, np.int32)
        self._sent = of_columns(CropFlow, n, FLOWS, stem_count=np.int64)
        self._inputs = [
            of_worlds(Profile, self._profiles),
            of_worlds(kernel.Taken, self._taken),
            Rows(kernel.Knife, n, [part.knife for part in parts]).array,
            self._cuttings.array,
            *(shared(array) for array in (self._poses, self._counts, self._flows)),
        ]
        self._launch = repeatable(kernel.cut_along, self._inputs, threads=n)

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """Nothing cut; the knife's place is taken from the first state that comes."""
        self._cuttings.clear()
        self._flows[:] = 0.0
        return self._samples(0, 0.0)

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """Cut what the knives passed over since the last step."""
        states = inputs["state"][-ROOM:]
        for k, state in enumerate(states):
            self._poses[:, k] = state.arrays["pose"]
        self._counts[:] = len(states)
        self._launch.launch()
        for world in np.flatnonzero(self._cuttings.of["is_refused"]).tolist():
            self.errors[world] = refused("second pass, or a drive against the edge's direction")
        return self._samples(t + dt, dt / NS)

    def save(self, world: int) -> State:
        """Where a knife was; the cut itself is the field's."""
        return {"cutting": self._cuttings.save(world)}

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        self._cuttings.load(world, state["cutting"])

    def _samples(self, t: int, seconds: float) -> dict[str, Samples]:
        self._flows[:, 5] = seconds
        for k, name in enumerate(FLOWS):
            self._sent.arrays[name][:] = self._flows[:, k]
        self._sent.t = t
        return {"flow": self._sent}


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
