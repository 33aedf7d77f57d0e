"""Peer link level `radio`: messages that come late, get lost, end with the range, and carry position errors.

The rate of the slot (`rate_hz`) is that of the messages.
"""

from collections import deque
from dataclasses import dataclass
from math import cos, exp, hypot, nan, sin, sqrt
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import wrapped
from swath.core.frozen import changed
from swath.core.random import Normals, Stream
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
    """A radio between two machines.

    delay_ms: time from that for which a message is valid to its arrival
    loss_percent: share of the messages that are lost
    range_m: distance beyond which nothing arrives
    position_sd_cm: standard deviation of the relative position, each axis
    correlation_s: time over which the error of the position changes
    ahead_error_m: calibration error of antennas and box, along the machine
    left_error_m: calibration error of antennas and box, leftward
    silent_from_s: begin of a time in which nothing arrives, to try it out
    silent_for_s: duration of that time
    """

    delay_ms: Annotated[float, Ge(0), Le(5000)] = 100.0
    loss_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    range_m: Annotated[float, Gt(0), Le(1e5)] = 500.0
    position_sd_cm: Annotated[float, Ge(0), Le(1000)] = 1.5
    correlation_s: Annotated[float, Gt(0), Le(1e4)] = 60.0
    ahead_error_m: Annotated[float, Ge(-5), Le(5)] = 0.0
    left_error_m: Annotated[float, Ge(-5), Le(5)] = 0.0
    silent_from_s: Annotated[float, Ge(0)] | None = None
    silent_for_s: Annotated[float, Ge(0)] = 1e9


class RadioLink(KeepsState):
    """Puts messages together from the states of the other machine, relative to this one; a queue of them."""

    kept = ("_last", "_queue", "_newest", "_error")
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

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        if setup.peer is None:
            raise InputError("peer", None, "expected the key `peer` of the machine: the one that it hears")
        self._peer, self._body = setup.peer, _body(setup.peer)
        self._p = params
        self._share = exp(-setup.period / params.correlation_s)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing under way."""
        self._normals = Normals(stream)
        self._queue: deque[tuple[int, PeerState]] = deque()
        self._newest: PeerState | None = None
        sd = self._p.position_sd_cm * 0.01
        ex, ey = self._normals.at(0, 2).tolist()
        self._error = (sd * ex, sd * ey)
        self._last: tuple[int, float, float] | None = None  # time, speed, acceleration of the other one
        return {"peer": silence(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Send the message of now, if it gets through, and hand over the newest that has arrived."""
        now = t + dt
        ex, ey = self._normals.at(now, 2).tolist()
        message = self._with_error(self.message(now, inputs), ex, ey)
        if self._gets_through(now, message, self._normals.then_uniform()):
            self._queue.append((now + round(self._p.delay_ms * 1e6), message))
        while self._queue and self._queue[0][0] <= now:
            _, self._newest = self._queue.popleft()
        if self._newest is None:
            return {"peer": silence(now)}
        age = self._newest.age + (now - self._newest.t) / NS
        return {"peer": changed(self._newest, t=now, age=age)}

    def _gets_through(self, now: int, message: PeerState, draw: float) -> bool:
        p, lost = self._p, draw * 100.0 < self._p.loss_percent
        since = -1.0 if p.silent_from_s is None else now / NS - p.silent_from_s
        is_silent = p.silent_from_s is not None and 0.0 <= since < p.silent_for_s
        return not lost and not is_silent and hypot(message.x, message.y) <= p.range_m

    def _with_error(self, message: PeerState, dx: float, dy: float) -> PeerState:
        """First-order Gauss-Markov errors on top of those of calibration."""
        p, keep = self._p, self._share
        fresh = p.position_sd_cm * 0.01 * sqrt(1.0 - keep * keep)
        ex, ey = keep * self._error[0] + fresh * dx, keep * self._error[1] + fresh * dy
        self._error = ex, ey
        return changed(message, x=message.x + ex + p.ahead_error_m, y=message.y + ey + p.left_error_m)

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
            t, True, (t - own.t) / NS, x, y, wrapped(heading), peer.speed, peer.yaw_rate,
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
    """The outline of the machine, as on its data sheet."""
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
    RadioLink,
    Params,
    summary="rate, delay, loss and range of a radio, errors of position and calibration",
    cost="0.1 ms per message",
    tolerance="equal to ideal with every number at 0",
)
EXACT = ("delay_ms", "loss_percent", "position_sd_cm", "ahead_error_m", "left_error_m")
PRESETS = {
    "ideal": LEVEL.preset(
        "every message at once, positions exact",
        "0.1 ms per message",
        range_m=1e9,
        correlation_s=1.0,
        silent_from_s=None,
        silent_for_s=0.0,
        **dict.fromkeys(EXACT, 0.0),
    )
}
