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

from swath.control.cooperate.peer_track import OTHER_PORTS, OTHERS, PeerTrack, heard
from swath.control.scan_filter.filter import SCAN, Mask, ScanFilter
from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import F64, Odometry, PeerState
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """margin_m: around the outlines, for tyres beside a box and errors of the positions.

    hold_s: silence through which the place of the other machine is carried on by dead reckoning
    """

    margin_m: Annotated[float, Ge(0), Le(3)] = 0.5
    hold_s: Annotated[float, Gt(0), Le(60)] = 5.0


class PeerBody(ScanFilter):
    """Rectangles of the other machines, kept up by dead reckoning between its messages."""

    kept: ClassVar[tuple[str, ...]] = ("_seen", "_tracks", "_said")
    inputs = (
        SCAN,
        Port("peer", PeerState),
        Port("odometry", Odometry),
        *OTHER_PORTS,
    )

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(setup)
        self._p, self._tracks = params, {name: PeerTrack() for name in ("peer", *OTHERS)}
        self._said: dict[str, PeerState] = {}

    def reset(self, stream: Stream) -> Outputs:
        """Nothing heard."""
        for track in self._tracks.values():
            track.reset()
        self._said = {}
        return super().reset(stream)

    def follow(self, now: int, dt: int, inputs: Inputs) -> None:
        """Where the other machines are now."""
        self._said = heard(self._tracks, now, dt, inputs)

    def unwanted(self, points: F64) -> Mask:
        """Echoes over an outline of another machine."""
        is_out = np.zeros(len(points), dtype=bool)
        for name, said in self._said.items():
            if self._tracks[name].age <= self._p.hold_s:
                is_out |= self._over(points, said, self._tracks[name])
        return is_out

    def _over(self, points: F64, said: PeerState, track: PeerTrack) -> Mask:
        """Points over the outlines of one machine."""
        is_over, margin = np.zeros(len(points), dtype=bool), self._p.margin_m
        for middle_x, middle_y, turn, length, width in outlines(said):
            x, y = track.to_own(middle_x, middle_y)
            c, s = cos(track.heading + turn), sin(track.heading + turn)
            along = c * (points[:, 0] - x) + s * (points[:, 1] - y)
            across = c * (points[:, 1] - y) - s * (points[:, 0] - x)
            is_over |= (np.abs(along) <= 0.5 * length + margin) & (np.abs(across) <= 0.5 * width + margin)
        return is_over


def outlines(peer: PeerState) -> list[tuple[float, float, float, float, float]]:
    """Body, header and box as far as reported, in the other one's frame: middle x, y [m], heading [rad],
    length, width [m].
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
