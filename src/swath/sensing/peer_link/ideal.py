"""Peer link level `ideal`: what the other machine knows of itself, at once and without error."""

from dataclasses import dataclass
from math import atan2, cos, nan, sin
from typing import Any, ClassVar

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.signals import (
    HeapState,
    MachineLoad,
    MachineState,
    PeerState,
    Station,
    TrailerState,
    UnloadState,
)
from swath.signals.setup import MachineGeometry, OpenBox

POURS = 0.01  # a flow below this is none [kg/s]


@dataclass(frozen=True)
class Params:
    """No parameters."""


class IdealLink(KeepsState):
    """Puts a message together from the states of the other machine, relative to this one."""

    kept: ClassVar[tuple[str, ...]] = ("_last",)
    inputs = (
        Port("state", MachineState),
        Port("peer_state", MachineState),
        Port("peer_trailer", TrailerState, optional=True),
        Port("peer_load", MachineLoad, optional=True),
        Port("peer_heap", HeapState, optional=True),
        Port("peer_unload", UnloadState, optional=True),
        Port("peer_station", Station, optional=True),
    )
    outputs = (Port("peer", PeerState),)

    def __init__(self, params: Any, setup: SiteSetup) -> None:
        if setup.peer is None:
            raise InputError("peer", None, "expected the key `peer` of the machine: the one that it hears")
        self._peer, self._body = setup.peer, _body(setup.peer)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing heard yet."""
        self._last: tuple[int, float, float] | None = None  # time, speed, acceleration of the other one
        return {"peer": silence(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The message of now."""
        return {"peer": self.message(t + dt, inputs)}

    def message(self, t: int, inputs: Inputs) -> PeerState:
        """What the other machine says at t [ns], relative to this one."""
        own, peer = inputs["state"], inputs["peer_state"]
        age = (own.t - peer.t) / NS  # the other one may have moved later or earlier in this tick
        x, y, _ = (
            own.pose.inverse()
            .apply(peer.pose.apply([peer.speed * age, peer.lateral_speed * age, 0.0]))
            .tolist()
        )
        heading = peer.pose.euler()[2] + peer.yaw_rate * age - own.pose.euler()[2]
        parts: dict[str, Any] = self._body | self._box(inputs) | _grain(inputs)
        return PeerState(
            t, True, (t - own.t) / NS, x, y, atan2(sin(heading), cos(heading)), peer.speed, peer.yaw_rate,
            self._acceleration(peer), **parts,
        )  # fmt: skip

    def _acceleration(self, peer: MachineState) -> float:
        if self._last is None:
            self._last = peer.t, peer.speed, 0.0
        then, before, rate = self._last
        if peer.t > then:
            rate = (peer.speed - before) * NS / (peer.t - then)
        self._last = peer.t, peer.speed, rate
        return rate

    def _box(self, inputs: Inputs) -> dict[str, Any]:
        if self._peer.box is None:
            return {}
        box, hitch, trailer = self._peer.box, self._peer.hitch, inputs.get("peer_trailer")
        x, y, angle = box.x, 0.0, 0.0
        if isinstance(trailer, TrailerState) and hitch is not None:
            angle = trailer.hitch_angle
            x = hitch.x + (box.x - hitch.drawbar) * cos(angle)
            y = (box.x - hitch.drawbar) * sin(angle)
        return _measures(box) | {"box_x": x, "box_y": y, "box_heading": angle}


def silence(t: int) -> PeerState:
    """Nothing was ever heard."""
    return PeerState(t, False, nan, nan, nan, nan, nan, nan)


def _body(of: MachineGeometry) -> dict[str, float]:
    """Its outline, as on its data sheet."""
    rear, front, half, _, _ = of.body
    said = {"body_front": front, "body_rear": rear, "body_width": 2.0 * half}
    if of.has_header:
        said |= {"header_front": of.knife_x, "header_left": of.header_y, "header_width": of.header_width}
    return said


def _measures(box: OpenBox) -> dict[str, float]:
    return {"box_length": box.length, "box_width": box.width, "rim_height": box.rim}


def _grain(inputs: Inputs) -> dict[str, Any]:
    """Pipe, tank and whether the box is full."""
    said: dict[str, Any] = {}
    unload, load, station = (inputs.get(f"peer_{n}") for n in ("unload", "load", "station"))
    if unload is not None:
        said |= {"impact_x": unload.impact_x, "impact_y": unload.impact_y}
        said["is_pouring"] = unload.flow > POURS or unload.held > POURS
    if load is not None:
        said |= {"tank_level": load.tank_level, "tank_grain": load.tank_grain}
    if station is not None:
        said["is_full"] = station.is_full
    return said


LEVEL = Level(
    IdealLink,
    Params,
    summary="every message at once, positions exact",
    cost="0.1 ms per message",
    tolerance="exact",
)
