"""Box level `gnss_link`: where the other machine says that its box is, by radio and satellites. No grain."""

from dataclasses import dataclass
from math import atan2, cos, isfinite, pi, sin
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Le

from swath.control.cooperate.peer_track import PeerTrack
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import BoxSeen, Odometry, PeerState, box_unseen
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """position_sd_m, heading_sd_deg, height_sd_m: of calibration, antennas and ground, as given on
    hold_s: so long without a message the place is carried on by dead reckoning
    """

    position_sd_m: Annotated[float, Ge(0), Le(5)] = 0.1
    heading_sd_deg: Annotated[float, Ge(0), Le(45)] = 1.0
    height_sd_m: Annotated[float, Ge(0), Le(2)] = 0.1
    hold_s: Annotated[float, Ge(0), Le(60)] = 1.0


class LinkBox(KeepsState):
    """Brings the newest message forward to now."""

    kept: ClassVar[tuple[str, ...]] = ("_track",)
    inputs = (Port("peer", PeerState), Port("odometry", Odometry))
    outputs = (Port("box", BoxSeen),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._track = PeerTrack()

    def reset(self, stream: Stream) -> Outputs:
        """Nothing heard."""
        self._track.reset()
        return {"box": box_unseen(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The box at t + dt."""
        p, peer = self._p, inputs["peer"]
        self._track.update(t + dt, dt, peer, inputs["odometry"])
        if self._track.age > p.hold_s or not isfinite(peer.box_x):
            return {"box": box_unseen(t + dt)}
        x, y = self._track.to_own(peer.box_x, peer.box_y)
        turn = self._track.heading + peer.box_heading
        none = np.full(1, np.nan)
        sure = p.position_sd_m, p.position_sd_m, p.heading_sd_deg * pi / 180.0, p.height_sd_m
        seen = BoxSeen(
            t + dt, True, x, y, atan2(sin(turn), cos(turn)), peer.rim_height, *sure, 1.0, none, none, none
        )
        return {"box": seen}


LEVEL = Level(
    LinkBox,
    Params,
    summary="the place that the other machine tells of its box, brought forward to now",
    cost="0.1 ms per step",
    tolerance="within 3 cm of truth with a link without error, on level ground",
)
