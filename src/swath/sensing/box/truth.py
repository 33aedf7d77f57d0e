"""Box level `truth`: rim and grain of the box of the machine beside, exactly."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import Pose, wrap_angle
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.signals import BoxSeen, HeapState, MachineState, TrailerState, box_unseen


@dataclass(frozen=True)
class Params:
    """Nothing to set."""


class TruthBox(KeepsState):
    """Where the box is relative to this machine, and how its heap has it."""

    kept: ClassVar[tuple[str, ...]] = ()
    inputs = (
        Port("state", MachineState),
        Port("peer_state", MachineState),
        Port("peer_trailer", TrailerState, optional=True),
        Port("peer_heap", HeapState, optional=True),
    )
    outputs = (Port("box", BoxSeen),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.peer is None or setup.peer.box is None:
            expected = "expected the key `peer` of the machine: one whose data sheet has a `box`"
            raise InputError("peer", None, expected)
        self._box, self._is_towed = setup.peer.box, setup.peer.hitch is not None

    def reset(self, stream: Stream) -> Outputs:
        """Nothing before the first step."""
        return {"box": box_unseen(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The box as it is at the time of the own state."""
        own, peer, trailer = inputs["state"], inputs["peer_state"], inputs.get("peer_trailer")
        carrier, moved = peer.pose, peer
        if self._is_towed and isinstance(trailer, TrailerState):
            place = trailer.x, trailer.y, trailer.z
            carrier, moved = Pose.from_euler(place, trailer.roll, trailer.pitch, trailer.yaw), trailer
        late = (own.t - moved.t) / NS  # one of them may have moved later in this tick
        ahead = self._box.x + peer.speed * late
        x, y, z = own.pose.inverse().apply(carrier.apply([ahead, 0.0, self._box.rim])).tolist()
        heading = float(wrap_angle(carrier.euler()[2] - own.pose.euler()[2]))
        none = np.full(1, np.nan)
        grain: tuple[Any, ...] = (none, none, none, 0.0)
        heap = inputs.get("peer_heap")
        if heap is not None:
            profile = heap.profile - self._box.depth
            grain = profile, np.zeros(len(profile)), heap.freeboard, heap.lean
        return {"box": BoxSeen(own.t, True, x, y, heading, z, 0.0, 0.0, 0.0, 0.0, 1.0, *grain)}


LEVEL = Level(
    TruthBox,
    Params,
    summary="the box of the other machine and the grain in it, exactly",
    cost="0.1 ms per step",
    tolerance="exact",
    sees_truth=True,
)
