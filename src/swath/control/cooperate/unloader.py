"""Cooperate level `unloader`: the machine with the tank swings its pipe out, pours while a box is below."""

from dataclasses import dataclass
from math import cos, hypot, inf, sin
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.cooperate.peer_track import OTHER_PORTS, OTHERS, PeerTrack, heard
from swath.control.cooperate.seen_box import SeenBox
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.signals import (
    BoxSeen,
    MachineLoad,
    Odometry,
    PeerState,
    UnloadCommand,
    UnloadState,
)
from swath.signals.setup import ControlSetup

FOLD_AFTER = 4.0  # the pipe swings back so long after the last grain [s]


@dataclass(frozen=True)
class Params:
    """When a machine unloads.

    start_percent: level of the tank from which on it wants to unload
    stop_percent: level of the tank at which it has unloaded
    call_m: distance of the cart at which the pipe swings out
    margin_m: distance from the stream to the rim, along and across, that unloading needs; to begin it needs
        twice that
    steady_s: time for which the stream must lie well inside before unloading begins
    silence_s: time without a message after which the auger stops
    over_crop: whether the pipe may swing out over standing crop
    """

    start_percent: Annotated[float, Gt(0), Le(100)] = 30.0
    stop_percent: Annotated[float, Ge(0), Le(100)] = 0.1
    call_m: Annotated[float, Gt(0), Le(500)] = 30.0
    margin_m: Annotated[float, Ge(0), Le(2)] = 0.35
    steady_s: Annotated[float, Ge(0), Le(60)] = 1.0
    silence_s: Annotated[float, Gt(0), Le(60)] = 1.0
    over_crop: bool = False


class Unloader(KeepsState):
    """Watches the box from the messages of the machine beside, and where the own stream comes down."""

    kept = (
        "_tracks", "_served", "_wants", "_pours", "_good_since", "_poured_at", "_relative", "_box_seen",
    )  # fmt: skip
    inputs = (
        Port("peer", PeerState),
        Port("odometry", Odometry),
        Port("load", MachineLoad),
        Port("unload", UnloadState),
        Port("box", BoxSeen, optional=True),
        *OTHER_PORTS,
    )
    outputs = (Port("command", UnloadCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        if setup.machine.pipe is None:
            raise InputError("level", "unloader", "expected a machine whose data sheet has a `pipe`")
        self._p, self._pipe = params, setup.machine.pipe
        self._may_swing = params.over_crop or not setup.machine.has_header or setup.edge_side == "left"
        self._tracks, self._box_seen = {name: PeerTrack() for name in ("peer", *OTHERS)}, SeenBox()
        self._served = "peer"

    def reset(self, stream: Stream) -> Outputs:
        """Folded back."""
        for track in self._tracks.values():
            track.reset()
        self._served = "peer"
        self._box_seen.clear()
        self._wants = self._pours = False
        self._good_since, self._poured_at = inf, -inf
        self._relative: tuple[float, float] | None = None
        return {"command": UnloadCommand(0, 0.0, False)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command at t + dt."""
        now, p = t + dt, self._p
        peer, load, unload = self._follow(now, dt, inputs), inputs["load"], inputs["unload"]
        level = load.tank_level
        if level >= p.start_percent * PERCENT:
            self._wants = True
        elif level <= p.stop_percent * PERCENT:
            self._wants = False
        is_heard = self._track.age <= p.silence_s
        may_pour = is_heard and not peer.is_full and peer.has_box
        if may_pour:
            self._box_seen.update(inputs.get("box"), *self._track.to_own(peer.box_x, peer.box_y))
        room = self._room(peer, unload, dt / NS) if may_pour else -inf
        self._pours = self._decide(now / NS, room) and self._wants and self._may_swing
        near = hypot(self._track.x, self._track.y) <= p.call_m and is_heard
        if unload.flow > 0.0:
            self._poured_at = now / NS
        is_out = self._pours or (self._wants and near) or now / NS - self._poured_at < FOLD_AFTER
        angle = self._pipe.swing if is_out and self._may_swing else 0.0
        return {"command": UnloadCommand(now, angle, self._pours)}

    @property
    def _track(self) -> PeerTrack:
        return self._tracks[self._served]

    def _follow(self, now: int, dt: int, inputs: Inputs) -> PeerState:
        """What the machine says that is served: the nearest with a box."""
        said = heard(self._tracks, now, dt, inputs)
        if len(said) > 1:
            served = min(said, key=lambda name: self._rank(name, said[name]))
            if served != self._served:
                self._served, self._relative, self._good_since = served, None, inf
                self._box_seen.clear()
        return said[self._served]

    def _rank(self, name: str, said: PeerState) -> tuple[bool, float]:
        """Carts before machines without a box."""
        track = self._tracks[name]
        return not said.has_box, hypot(track.x, track.y) if track.age < inf else inf

    def _decide(self, now: float, room: float) -> bool:
        """Pour while the stream keeps its margin; begin when it has kept twice that for a while."""
        if self._pours:
            return room >= self._p.margin_m
        if room < 2.0 * self._p.margin_m:
            self._good_since = inf
            return False
        self._good_since = min(self._good_since, now)
        return now - self._good_since >= self._p.steady_s

    def _room(self, peer: PeerState, unload: UnloadState, h: float) -> float:
        """Least distance of the stream from the rim, also when the auger has run out [m]; < 0 outside."""
        x, y = self._track.to_own(peer.box_x, peer.box_y)
        turn = self._track.heading + peer.box_heading
        dx = unload.impact_x - x - self._box_seen.dx
        dy = unload.impact_y - y - self._box_seen.dy
        along, across = cos(turn) * dx + sin(turn) * dy, cos(turn) * dy - sin(turn) * dx
        before = self._relative or (along, across)
        self._relative = along, across
        reach = 1.0 / h  # a second of run-out at the present relative speed
        later = [
            now + min(max((now - then) * reach, -0.5), 0.5)
            for now, then in zip(self._relative, before, strict=True)
        ]
        half = 0.5 * peer.box_length, 0.5 * peer.box_width
        return min(size - max(abs(a), abs(b)) for size, a, b in zip(half, self._relative, later, strict=True))


LEVEL = Level(
    Unloader,
    Params,
    summary="pipe and auger of the machine with the tank, by what the other one sends",
    cost="0.1 ms per step",
    tolerance="stops within a step of its margin, its silence or a full box",
)
