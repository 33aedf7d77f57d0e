"""Keeping a station beside the machine that unloads: what all fill strategies share.

The middle of the own box is to lie `spot` behind the point where the stream of the other one lands, as
the link reports, and the own path runs parallel to the other one's. The tractor drives outside of the path
of its trailer by what that tracks off in a bend; what is left at the box is taken out slowly.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import atan2, copysign, cos, hypot, inf, sin, sqrt
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.cooperate.freeboard import FreeboardTrack
from swath.control.cooperate.peer_track import PeerTrack
from swath.control.cooperate.seen_box import SeenBox
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import wrapped
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import BoxSeen, HeapState, Odometry, PeerState, UnloadState
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup

SLOW_INTEGRAL = 20.0  # time constant of what takes out the rest of the box's lateral error [s]
MOST_INTEGRAL = 0.3  # of it [m]
NEAR = 0.12  # it works while the box is nearer to its path than this [m]
STEADY = 0.004  # and the trailer swings slower than this against the machine [rad/s]
SMOOTHED, MOST_DRIFT = 3.0, 0.03  # of how the stream moves across: time constant [s], fastest [m/s]
MOST_LEAN = 0.12  # grain is poured so far to the side that is lower, at most [m]
ONWARD = 0.1  # how fast it moves on from front to rear [m/s]
LEARNS_LEAN = 10.0  # time constant of what takes out the rest of it [s]
LONGEST_WAIT = 6.0  # for the auger to stop before a full cart leaves [s]
LEAVING = 16.0  # time in which a machine that leaves comes to rest [s]


@dataclass(frozen=True)
class Shared:
    """How a cart keeps its station beside the machine that unloads.

    margin_m: height of the rim above the grain at the walls with which the box counts as full
    lead_s: time for which grain goes on coming after the auger is commanded to stop
    compensate: whether the age of messages is made up for
    hold_s: silence through which the station is kept by dead reckoning
    clear_m: how far aside the cart goes when it is full, or when it hears nothing
    profile: profile of the grain: that of the cart's own slot `heap`, or `seen` by slot `box` of the other
        machine; then the box takes no grain before it is seen
    blind_s: with `seen`, the box takes no grain either when it was seen longer ago than this
    """

    margin_m: Annotated[float, Ge(0), Le(1)] = 0.02
    lead_s: Annotated[float, Ge(0), Le(10)] = 1.5
    compensate: bool = True
    hold_s: Annotated[float, Ge(0), Le(60)] = 2.5
    clear_m: Annotated[float, Gt(0), Le(50)] = 3.0
    profile: Literal["heap", "seen"] = "heap"
    blind_s: Annotated[float, Gt(0), Le(60)] = 2.0


@dataclass(frozen=True)
class BoxView:
    """What a fill strategy knows. half, width: half the length, and the width of the box [m].

    places [m ahead of the middle], heights [m above the floor]: profile of the grain
    freeboard: rim above the grain at the walls beside each place, less the margin [m]
    """

    half: float
    width: float
    places: tuple[float, ...]
    heights: tuple[float, ...]
    freeboard: tuple[float, ...]

    def has_room(self, place: float) -> bool:
        """Whether grain poured there stays in the box."""
        return self.room(place) > 0.0

    def room(self, place: float) -> float:
        """Least freeboard, less the margin, at the walls beside a place [m]."""
        at_end = abs(place) > self.half - 0.5 * self.width - 0.3
        beside = [
            free for free, at in zip(self.freeboard, self.places, strict=True) if abs(at - place) <= 0.3
        ]
        if at_end:
            beside.append(self.freeboard[-1 if place > 0.0 else 0])
        return min(beside)

    @property
    def reach(self) -> float:
        """Farthest place from the middle where it is worth to pour: half a width from an end, and a
        quarter of a metre [m].
        """
        return max(self.half - 0.5 * self.width, 0.0) + 0.25

    def open_places(self) -> list[tuple[float, float]]:
        """Height of the grain and place, of those places within reach that have room [m]."""
        pairs = zip(self.heights, self.places, strict=True)
        return [(high, place) for high, place in pairs if abs(place) <= self.reach and self.has_room(place)]


class StationKeeper(KeepsState, ABC):
    """A fill strategy gives `aim`; everything else is here."""

    kept = (
        "_track", "_hitch_angle", "_swing", "_integral", "_spot", "_is_full", "_waits", "_full_at", "_aside",
        "_memory", "_seen", "_box_seen", "_free",
    )  # fmt: skip
    inputs = (
        Port("peer", PeerState),
        Port("odometry", Odometry),
        Port("heap", HeapState),
        Port("unload", UnloadState, optional=True),
        Port("seen", BoxSeen, optional=True),
    )
    outputs = (Port("station", Wanted),)

    def __init__(self, keep: Shared, setup: ControlSetup) -> None:
        if setup.machine.box is None:
            raise InputError("level", type(self).__name__, "expected a machine whose data sheet has a `box`")
        self._keep, self._box, self._hitch = keep, setup.machine.box, setup.machine.hitch
        self._track = PeerTrack(compensated=keep.compensate)
        self._box_seen = SeenBox()
        self._free = FreeboardTrack()

    @abstractmethod
    def aim(self, t: float, view: BoxView) -> tuple[float, bool]:
        """Where grain is to come down, ahead of the middle of the box [m], and whether the box is full."""

    def from_front(self, t: float, view: BoxView, shift: float = ONWARD) -> tuple[float, bool]:
        """The first place from the front with room; one that was left is not gone back to: an `aim`.

        shift: how fast it moves on [m/s]
        """
        inner = view.reach
        place, since = self._memory.setdefault("from_front", inner), t - self._memory.get("then", t)
        self._memory["then"] = t
        if not view.has_room(place):
            place = self._memory["from_front"] = max(place - shift * since, -inner)
        return place, place <= -inner + 1e-6 and not view.has_room(place)

    def tops_up(self, view: BoxView, freeboard: float) -> bool:
        """Whether grain has come that near to the rim somewhere [m], until the box is emptied."""
        near = min(view.freeboard) < freeboard
        if near:
            self._memory["tops_up"] = 1.0
        return near or "tops_up" in self._memory

    def reset(self, stream: Stream) -> Outputs:
        """Nothing to keep yet."""
        self._track.reset()
        self._box_seen.clear()
        self._free.clear()
        self._hitch_angle = self._swing = self._integral = self._spot = self._aside = 0.0
        self._is_full = self._waits = False
        self._full_at, self._seen = -1.0, 0.0
        self._memory: dict[str, float] = {}
        return {"station": self._idle(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The station at t + dt."""
        now, h = t + dt, dt / NS
        peer: PeerState = inputs["peer"]
        own: Odometry = inputs["odometry"]
        self._fold(own, h)
        self._track.update(now, dt, peer, own)
        if self._track.age == inf or not peer.has_stream:
            return {"station": self._idle(now)}
        before = self._spot
        self._box_seen.update(inputs.get("seen"), *self._track.to_peer(*self._middle()))
        heap, is_blind = inputs["heap"], False
        if self._keep.profile == "seen":
            is_blind = self._box_seen.age(now) > self._keep.blind_s
            heights, freeboard = self._box_seen.grain(self._box.depth)
            heap = replace(heap, profile=heights, freeboard=freeboard, lean=self._box_seen.lean)
        if not np.isfinite(heap.profile).any() or not np.isfinite(heap.freeboard).any():
            self._waits = True
            return {"station": self._idle(now)}
        full = np.where(np.isfinite(heap.profile), heap.profile, self._box.depth)  # what nobody measured
        heap = replace(heap, profile=full, freeboard=np.nan_to_num(heap.freeboard))
        self._free.update(heap.freeboard, h)
        view = self._view(heap)
        spot, is_full = self.aim(now / NS, view)
        shift = (spot - before) / h if abs(spot - before) < 0.5 * h and not self._is_full else 0.0
        there = self._spot + shift * self._keep.lead_s
        has_room = view.has_room(self._spot) and view.has_room(there)
        self._waits = self._is_full or is_blind or not has_room
        if not self._is_full:
            self._spot, self._is_full = spot, is_full
            self._full_at = now / NS
        return {"station": self._station(now, h, peer, shift, float(heap.lean))}

    def _fold(self, own: Odometry, h: float) -> None:
        """Angle of the trailer against the machine, by rolling without slip."""
        if self._hitch is not None:
            c, s, v, r = cos(self._hitch_angle), sin(self._hitch_angle), own.speed, own.yaw_rate
            self._swing = (-v * s + self._hitch.x * r * c) / self._hitch.drawbar - r
            self._hitch_angle += h * self._swing

    def _middle(self) -> tuple[float, float]:
        """Middle of the own box in the own frame [m]."""
        if self._hitch is None:
            return self._box.x, 0.0
        back = self._box.x - self._hitch.drawbar
        return self._hitch.x + back * cos(self._hitch_angle), back * sin(self._hitch_angle)

    def _off_tracking(self, curvature: float) -> float:
        """How far the trailer runs inside of the machine's path of a curvature, > 0 left [m]."""
        if self._hitch is None or abs(curvature) < 1e-6:
            return 0.0
        radius = 1.0 / abs(curvature)
        inner = sqrt(max(radius**2 + self._hitch.x**2 - self._hitch.drawbar**2, 0.0))
        return copysign(radius - inner, curvature)

    def _station(self, now: int, h: float, peer: PeerState, shift: float, lean: float) -> Wanted:
        """shift: speed of the spot along the box [m/s]; lean: how the grain's surface tilts across."""
        track = self._track
        k = track.curvature
        y, drift = self._stream(h, peer.impact_y)
        y += self._towards_lower_side(h, peer, lean)
        scale = max(1.0 - k * y, 0.2)
        bend = k / scale
        away = self._leave(now / NS, h, peer, y)
        aside, _, along = on_arc(k, *self._corrected(*self._middle()))
        lateral, tangent, _ = on_arc(k, *self._corrected(0.0, 0.0))
        if away == 0.0 and abs(y - aside) < NEAR and abs(self._swing) < STEADY:
            gain = h / SLOW_INTEGRAL
            self._integral = min(max(self._integral + gain * (y - aside), -MOST_INTEGRAL), MOST_INTEGRAL)
        late = drift / max(track.speed, 0.5)
        y_path = y + late * (0.0 if self._hitch is None else self._hitch.drawbar)
        left = y_path - self._off_tracking(bend) - lateral + self._integral + copysign(self._aside, y)
        heading = wrapped(track.heading + tangent) + late
        # within a step of the link the impact's own way is part of the other one's speed
        ahead, speed = scale * (peer.impact_x - self._spot - along), track.speed * scale - shift
        rate = track.acceleration * scale if track.age < 1.0 else 0.0
        if away > 0.0:
            ahead, rate, speed = 0.0, 0.0, max(self._seen * (1.0 - away / LEAVING), 0.0)
        else:
            self._seen = speed
        return Wanted(now, True, ahead, left, heading, bend, speed, rate, self._spot, self._waits)

    def _corrected(self, x: float, y: float) -> tuple[float, float]:
        """A point of the own frame in the other one's, less the error of the messages as far as seen [m]."""
        px, py = self._track.to_peer(x, y)
        return px + self._box_seen.dx, py + self._box_seen.dy

    def _stream(self, h: float, y: float) -> tuple[float, float]:
        """Where the stream comes down to the left [m], and how fast that moves as the grain rises [m/s]."""
        smooth = self._memory.setdefault("smooth", y)
        drift = min(max((y - smooth) / SMOOTHED, -MOST_DRIFT), MOST_DRIFT)
        self._memory["smooth"] = smooth + (y - smooth) * h / SMOOTHED
        return smooth + drift * SMOOTHED, drift

    def _towards_lower_side(self, h: float, peer: PeerState, lean: float) -> float:
        """How far aside of the middle grain is to come down, so that both walls fill alike [m].

        lean: grain at the left wall above that at the right one, which is about as far as it came down aside
        """
        if peer.is_pouring:
            far = self._memory.get("lower", 0.0) + 2.0 * lean * h / LEARNS_LEAN
            self._memory["lower"] = min(max(far, -MOST_LEAN), MOST_LEAN)
        return min(max(2.0 * lean, -MOST_LEAN), MOST_LEAN) + self._memory.get("lower", 0.0)

    def _leave(self, now: float, h: float, peer: PeerState, y: float) -> float:
        """Time [s] since it began to leave, full and no longer poured on, or in silence; 0 while it stays."""
        since = 0.0
        if self._is_full and self._track.age < self._keep.hold_s:
            if peer.is_pouring and now - self._full_at < LONGEST_WAIT and "left" not in self._memory:
                return 0.0
            self._memory.setdefault("left", now)
            since = now - self._memory["left"] + 1e-3
        elif self._track.age > self._keep.hold_s:
            since = self._track.age - self._keep.hold_s
        if since > 0.0:
            self._aside = min(self._aside + 0.5 * h * max(self._seen, 0.5), self._keep.clear_m)
        elif self._aside > 0.0:
            self._aside = max(self._aside - 0.5 * h, 0.0)
        return since

    def _view(self, heap: HeapState) -> BoxView:
        box, count = self._box, len(heap.profile)
        places = tuple(((i + 0.5) / count - 0.5) * box.length for i in range(count))
        free = tuple((self._free.after(self._keep.lead_s) - self._keep.margin_m).tolist())
        return BoxView(0.5 * box.length, box.width, places, tuple(heap.profile.tolist()), free)

    def _idle(self, t: int) -> Wanted:
        return Wanted(t, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self._spot, self._waits)


def on_arc(curvature: float, x: float, y: float) -> tuple[float, float, float]:
    """A point against the path of a machine at (0, 0) that drives an arc: distance to its left [m],
    direction of the path there [rad], way along it [m].
    """
    direction = atan2(curvature * x, 1.0 - curvature * y)
    across = (2.0 * y - curvature * (x * x + y * y)) / (1.0 + hypot(curvature * x, 1.0 - curvature * y))
    return across, direction, direction / curvature if abs(curvature) > 1e-6 else x
