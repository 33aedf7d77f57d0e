"""Scan filter level `peer_body`: without echoes of the machine that this one works with, by its messages.

The messages say where it is and how large its body, its header and its box are. All echoes go that lie over
their outlines on the ground, whatever their height, widened by a margin for the errors of both machines'
positions. The wall of a cart is no crop edge.
"""

from dataclasses import dataclass
from math import cos, isfinite, sin
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.cooperate.peer_track import PeerTrack
from swath.control.scan_filter.filter import SCAN, Mask, ScanFilter
from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import F64, Odometry, PeerState
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """margin_m: around the outlines, for tyres beside a box and errors of the positions
    hold_s: silence through which the place of the other machine is carried on by dead reckoning
    """

    margin_m: Annotated[float, Ge(0), Le(3)] = 0.5
    hold_s: Annotated[float, Gt(0), Le(60)] = 5.0


class PeerBody(ScanFilter):
    """Rectangles of the other machine, kept up by dead reckoning between its messages."""

    kept: ClassVar[tuple[str, ...]] = ("_seen", "_track", "_peer")
    inputs = (SCAN, Port("peer", PeerState), Port("odometry", Odometry))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(setup)
        self._p, self._track = params, PeerTrack()
        self._peer: PeerState | None = None

    def reset(self, stream: Stream) -> Outputs:
        """Nothing heard."""
        self._track.reset()
        self._peer = None
        return super().reset(stream)

    def follow(self, now: int, dt: int, inputs: Inputs) -> None:
        """Where the other machine is now."""
        self._peer = inputs["peer"]
        if self._peer is not None:
            self._track.update(now, dt, self._peer, inputs["odometry"])

    def unwanted(self, points: F64) -> Mask:
        """Those over an outline of the other machine."""
        is_out = np.zeros(len(points), dtype=bool)
        if self._peer is None or self._track.age > self._p.hold_s:
            return is_out
        margin = self._p.margin_m
        for middle_x, middle_y, turn, length, width in outlines(self._peer):
            x, y = self._track.to_own(middle_x, middle_y)
            c, s = cos(self._track.heading + turn), sin(self._track.heading + turn)
            along = c * (points[:, 0] - x) + s * (points[:, 1] - y)
            across = c * (points[:, 1] - y) - s * (points[:, 0] - x)
            is_out |= (np.abs(along) <= 0.5 * length + margin) & (np.abs(across) <= 0.5 * width + margin)
        return is_out


def outlines(peer: PeerState) -> list[tuple[float, float, float, float, float]]:
    """Body, header and box as far as told, in the other one's frame: middle x, y [m], heading [rad], length,
    width [m].
    """
    found = []
    if isfinite(peer.body_width):
        length = peer.body_front - peer.body_rear
        found.append((0.5 * (peer.body_front + peer.body_rear), 0.0, 0.0, length, peer.body_width))
    if isfinite(peer.header_width):
        rear = min(peer.body_front, peer.header_front)
        middle = 0.5 * (peer.header_front + rear)
        found.append((middle, peer.header_left, 0.0, peer.header_front - rear, peer.header_width))
    if isfinite(peer.box_width):
        found.append((peer.box_x, peer.box_y, peer.box_heading, peer.box_length, peer.box_width))
    return found


LEVEL = Level(
    PeerBody,
    Params,
    summary="without echoes of the machine beside, by its messages",
    cost="0.1 ms per scan",
    tolerance="every echo on a machine whose messages are right to its margin goes",
)
