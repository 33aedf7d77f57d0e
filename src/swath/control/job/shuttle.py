"""Job level `shuttle`: a cart drives to a combine that calls, keeps beside it, and brings grain to the truck.

It knows the passes of the field, so where crop still stands, and drives where none does. Beside a pass it
comes up from behind on the ground that is cut, parallel to it, and then keeps its station (`cooperate`). It
breaks off before the end of a pass and stays back, so that the combine can turn, and follows it through the
turn to the next pass. Where a combine will be next it drives only behind it.
"""

from dataclasses import dataclass
from math import cos, dist, hypot, inf, isfinite, nan, sin, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from swath.control.cooperate.peer_track import OTHER_PORTS
from swath.control.job.bend_speed import bend_speed
from swath.control.job.calls import CLEAR, Calls, combines_of, nearest, stands_for_cart, waits_behind
from swath.control.job.cart_ways import MOVES, CartWays, Way
from swath.control.job.carts import LATER, OtherCart, discs_of, free_of, is_in_line, others_of
from swath.control.job.free_ahead import free_ahead
from swath.control.job.heard import SILENT, AllHeard
from swath.control.job.passes import Coordinate, Pass
from swath.control.job.right_of_way import SHORT, Clearance, own_outline
from swath.control.job.to_truck import ToTruck
from swath.control.job.wait_ahead import AHEAD, Found, WaitAhead
from swath.control.steer.guidance_line import GuidanceLine
from swath.control.turns.dubins import Place
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import KMH, PERCENT
from swath.signals import GuidancePath, HeapState, JobState, Odometry, PeerState, Phase, PoseEstimate
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup

BRAKE, CATCH_UP = 0.4, 0.3  # m/s2; 1/s
OFF, SLOWLY = 0.3, 1.0  # m off its way it drives no faster than that, m/s
FULL_FOR = 4.0  # s, that the station says full, or that nothing is poured any more, before it leaves
HELD_FOR = 8.0  # s without grain beside a combine that stands: it cannot turn while the cart is there
MISSED_FOR = 30.0  # s likewise, while that calls, or cuts on later: it comes up anew, or serves another one
RETRY = 5.0  # s between two looks for a way
ARRIVED, AT_PLACE = 0.4, 6.0  # m from the end of its way; from its place
AROUND, SHORTER = 150.0, 75.0  # m longer than straight there: it looks for a way that is so much shorter
BLOCKED_FOR = 4.0  # s behind a machine that stands in its way, before it looks for another one


@dataclass(frozen=True)
class Params:
    """passes: of all combines; boundary_m: of the field; header_m: width of the combine's; beside_m: its pipe
    to the left
    truck_m: place beside the truck; dock_s: to stand right there and to be gone again
    speed_kmh: on the field; radius_m: of its tightest turn; leave_percent: of the largest heap, from which it
    drives to the truck, but not alone with room for all of the last two passes; fill_percent: that it takes
    for sure (one spot fills 77); break_off_m: before the end of a pass but the last, where its station ends
    of several carts - number: in their order; wait_m: where it waits; none = at the truck
    """

    passes: Annotated[tuple[Pass, ...], MinLen(1)]
    boundary_m: Annotated[tuple[tuple[Coordinate, Coordinate], ...], MinLen(3)]
    header_m: Annotated[float, Gt(0.5), Le(30)] = 12.2
    beside_m: Annotated[float, Gt(1), Le(20)] = 8.2
    truck_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    dock_s: Annotated[float, Ge(0), Le(600)] = 45.0
    speed_kmh: Annotated[float, Gt(0), Le(40)] = 15.0
    radius_m: Annotated[float, Gt(3), Le(50)] = 9.0
    leave_percent: Annotated[float, Gt(0), Le(100)] = 60.0
    fill_percent: Annotated[float, Gt(0), Le(100)] = 75.0
    break_off_m: Annotated[float, Ge(0), Le(200)] = 25.0
    number: Annotated[int, Ge(0), Le(3)] = 0
    wait_m: tuple[Coordinate, Coordinate] | None = None


class Shuttle(KeepsState):
    """Waits, drives, keeps beside, empties. Its phases are those of `JobState`."""

    kept = (
        "_phase", "_goal", "_task", "_points", "_number", "_way", "_lane", "_since", "_until", "_retry_at",
        "_is_free", "_is_clear", "_drives_to", "_looks_at", "_blocked_at", "_ended", "_poured_at", "_heard",
        "_calls", "_served", "_spot",
    )  # fmt: skip
    inputs = (
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
        Port("peer", PeerState),
        Port("heap", HeapState),
        Port("station", Wanted),
        *OTHER_PORTS,
        *(Port(f"way_{i}", GuidancePath, optional=True) for i in (1, 2, 3)),
    )
    outputs = (Port("job", JobState), Port("path", GuidancePath))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        if setup.machine.box is None:
            raise InputError("level", "shuttle", "expected a machine whose data sheet has a `box`")
        p = self._p = params
        places = [p.truck_m] if p.wait_m is None else [p.truck_m, p.wait_m]
        self._ways = CartWays(p.passes, p.boundary_m, p.header_m, p.beside_m, p.radius_m, places)
        self._clearance, self._wheelbase = Clearance(p.passes), setup.machine.wheelbase
        self._outline = own_outline(setup.machine)
        self._line: GuidanceLine | None = None
        self._heard, self._others, self._combines = AllHeard(), list[OtherCart](), dict[int, PeerState]()
        self._calls = Calls(p.passes, p.break_off_m, p.fill_percent * PERCENT)
        leave = p.leave_percent * PERCENT
        self._truck = ToTruck(p.truck_m, p.number, leave, self._calls, is_alone=p.wait_m is None)
        self._ahead = WaitAhead(p.passes, self._outline, self._clearance, self._calls)
        self._forget()

    def _forget(self) -> None:
        self._phase, self._goal, self._task, self._number = Phase.WAITS, "", -1, 0
        self._points = np.zeros((0, 2))
        self._way, self._lane, self._line = 0.0, 0.0, None
        self._since, self._until, self._retry_at, self._poured_at = inf, -inf, -inf, -inf
        self._is_clear, self._drives_to, self._looks_at = True, inf, -inf
        self._is_free, self._ended, self._blocked_at, self._served, self._spot = True, "", inf, 0, nan
        self._heard.reset()
        self._calls.reset()

    def reset(self, stream: Stream) -> Outputs:
        """Waits where it stands."""
        self._forget()
        return self._out(0, 0.0)

    def load(self, state: dict[str, object]) -> None:
        """Back to a saved moment."""
        super().load(state)
        self._line = None

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What is to be done at t + dt."""
        pose, now = inputs["pose"], (t + dt) / NS
        heard = self._heard.update(t + dt, dt, inputs)
        self._combines = combines_of(heard)
        if pose is None or not isfinite(pose.x) or len(self._combines) < self._calls.combines:
            return self._out(t + dt, 0.0)
        here, heap = Place(pose.x, pose.y, pose.heading), inputs["heap"]
        carts = {name: said for name, said in heard.items() if not isfinite(said.header_width)}
        self._others = others_of(here, carts, inputs, self._p.number)
        peer, speed = self._combines[self._served], 0.0
        if self._phase == Phase.WAITS:
            self._waits(now, here, heap)
        elif self._phase == Phase.DRIVES:
            speed = self._drives(now, here, peer, inputs)
        elif self._phase == Phase.BESIDE:
            self._keeps(now, here, peer, inputs["station"])
        else:
            self._empties(now, heap)
        if self._phase == Phase.DONE and all(cart.said.phase == Phase.DONE for cart in self._others):
            self._ended = "the field is empty, and its grain at the truck"
        return self._out(t + dt, speed)

    def _waits(self, now: float, here: Place, heap: HeapState) -> None:
        combines = self._combines.values()
        if any(said.age > SILENT for said in combines):
            return
        is_over = all(said.phase == Phase.DONE for said in combines)
        caller, since = self._calls.neediest(now, self._combines, self._others)
        is_loaded = self._truck.leaves(heap, self._combines, self._others)
        takes = since >= LATER * self._p.number and not is_loaded and self._is_free
        self._served = caller if takes else nearest(self._combines)
        place, peer = self._p.wait_m, self._combines[self._served]
        if is_loaded and self._truck.is_first(here, self._others):
            self._set_out(now, here, peer, "truck")
        elif is_loaded or not self._is_free or (place is not None and is_over):
            self._gets_out(now, here, peer, is_over=is_over and not is_loaded)
        elif is_over:
            self._phase = Phase.DONE
        elif takes:
            self._set_out(now, here, peer, "combine")
        elif self._task < 0:
            self._gets_out(now, here, peer, is_over=False)
        if self._phase == Phase.WAITS and self._is_free and now >= self._looks_at:
            self._looks_at, self._is_free = now + RETRY, not self._is_soon_in_way(here)

    def _is_soon_in_way(self, here: Place) -> bool:
        """Whether it stands on the field in the way of a combine."""
        x, y = self._p.wait_m or self._p.truck_m
        return hypot(here.x - x, here.y - y) > AT_PLACE and any(
            self._clearance.is_soon_in_way(here, self._outline, said) for said in self._combines.values()
        )

    def _gets_out(self, now: float, here: Place, peer: PeerState, *, is_over: bool) -> None:
        """To the place where it waits; a single cart waits at the truck, where it is cleared off to."""
        place = self._p.wait_m
        if place is None and not self._is_free:
            self._set_out(now, here, peer, "truck")
        elif place is not None and dist(here[:2], place) > AT_PLACE:
            self._set_out(now, here, peer, "place")
        elif place is not None and is_over:
            self._phase = Phase.DONE

    def _set_out(self, now: float, here: Place, peer: PeerState, goal: str, most: float = inf) -> None:
        """On a way to a combine, the truck or its place, if there is one. most: its length [m], to that pass
        only; else it drives on
        """
        drives = peer.phase in (Phase.CUTS, Phase.TURNS) and peer.speed > MOVES
        drives &= hypot(peer.x, peer.y) < CLEAR
        if now < self._retry_at or (drives and goal != "combine"):
            return  # a combine that drives away from it is not driven past
        self._retry_at = now + RETRY
        task = self._calls.next_task(peer) if goal == "combine" else -1
        discs, rest = discs_of(self._others), [c for c in self._combines.values() if c is not peer]
        if goal == "combine":
            found = self._ahead.found(self._ways, here, task, peer, discs, rest)
        else:
            place = (self._p.wait_m if goal == "place" else None) or self._p.truck_m
            past = discs_of(self._others, place, dist(here[:2], place))
            way = self._ways.to_place(here, place, peer, discs, rest, past)
            found = None if way is None else Found(way, is_clear=True, until=inf)
        if found is None and most == inf:
            self._calls.no_way(self._served, now)
        if found is None or found.way.length > most or (most < inf and task != self._task):
            return
        way, self._is_clear, self._drives_to = found
        self._phase, self._goal, self._task = Phase.DRIVES, goal, task
        self._takes(way)
        self._retry_at, self._blocked_at = -inf, inf

    def _takes(self, way: Way) -> None:
        self._points, self._number, self._way, self._line = way.points, self._number + 1, 0.0, None
        self._lane = self._made().length - way.beside if self._goal == "combine" else inf

    def _drives(self, now: float, here: Place, peer: PeerState, inputs: Inputs) -> float:
        """Along the way that was found; on the line beside the pass it catches up."""
        station, heap, speed = inputs["station"], inputs["heap"], max(float(inputs["odometry"].speed), 0.0)
        nearest = (line := self._made()).project(here.x, here.y, self._way)
        self._way, left = nearest.way, line.length - nearest.way
        if left <= ARRIVED and self._goal != "combine":
            brings = self._truck.brings(heap, self._combines, self._others) or peer.phase == Phase.DONE
            empties = brings and heap.grain > 0.0 and self._goal == "truck"
            self._phase = Phase.EMPTIES if empties else Phase.WAITS
            self._since, self._is_free = now, True
            return 0.0
        to_combine = self._goal == "combine"
        withdrawn = to_combine and self._calls.withdraws(peer, here, self._p.number, self._others)
        if withdrawn or (self._goal == "truck" and self._truck.is_taken(left, self._others)):
            self._phase, self._task = Phase.WAITS, -1
            return 0.0
        waits, is_early = speed <= MOVES, peer.task < self._task
        is_held = waits and peer.speed <= MOVES and not peer.may_unload  # by one that stands, perhaps
        elsewhere = (is_early or is_held) and self._calls.turns_to_standing(
            now, self._served, self._combines, self._others, waits=waits
        )
        if to_combine and (self._calls.is_lost(peer, self._task, is_beside=False) or elsewhere):
            self._phase, self._is_free = Phase.WAITS, True
            self._task = self._task if self._way >= self._lane else -1
            return 0.0
        met = free_of(self._others, here, line, self._way, speed, self._p.number)
        is_there = peer.task == self._task and peer.may_unload and self._way >= self._lane
        if to_combine and met == inf and is_there and is_in_line(station):
            self._phase, self._since, self._poured_at = Phase.BESIDE, inf, now
            return 0.0
        in_lane, to_next = self._way >= self._lane, is_early and not self._is_clear
        if in_lane and not is_early and (way := self._ways.onto_line(here, self._points, self._task, peer)):
            self._takes(way)
            line = self._made()
        rest = [said for said in self._combines.values() if said is not peer]
        free = min(met, free_ahead(
            self._clearance, here, line, self._way, self._lane, speed, peer, rest,
            is_early=is_early, to_next=to_next,
        ))  # fmt: skip
        if peer.age > SILENT and (in_lane or not self._clearance.is_in_way(here, peer)):
            return 0.0
        is_passed = in_lane and not is_early and speed < MOVES and waits_behind(peer)
        holds_up = self._clearance.holds_up(here, self._outline, rest)
        is_stopped = waits and self._clearance.is_close(here, line, self._way, filter(stands_for_cart, rest))
        stays = in_lane and (to_next or not is_early) and not (holds_up or is_stopped)
        if is_passed or self._is_blocked(now, 0.0 if holds_up else free, speed, stays=stays):
            self._phase, self._is_free = Phase.WAITS, stays or not self._is_soon_in_way(here)
            return 0.0
        if is_early or not in_lane:
            most = min(self._lane + AHEAD, self._drives_to) if is_early else self._drives_to
            free = min(free, max(most - self._way, 0.0))
            if now >= self._looks_at and self._looks_on(now, here, line, peer, inputs):
                return speed if self._phase == Phase.DRIVES else 0.0
        slow = bend_speed(line, self._way, speed, self._wheelbase)
        slow = min(slow, SLOWLY) if abs(nearest.left) > OFF and not in_lane else slow
        wanted = min(self._p.speed_kmh * KMH, slow, sqrt(2.0 * BRAKE * max(min(left, free), 0.0)))
        if in_lane and not is_early:
            behind = station.ahead if station.is_active else 0.0
            return float(min(wanted, max(peer.speed + CATCH_UP * behind, 0.0)))
        return wanted if in_lane or free <= 0.5 else max(wanted, 0.3)

    def _takes_call(self, now: float, here: Place, heap: HeapState) -> bool:
        """On its way to where it waits, not to bring grain: whether it sets out to a combine that calls."""
        if self._goal == "combine" or self._truck.brings(heap, self._combines, self._others):
            return False
        served, (caller, since) = self._served, self._calls.neediest(now, self._combines, self._others)
        if since >= LATER * self._p.number:
            self._served = caller
            self._set_out(now, here, self._combines[caller], "combine")
            self._served = caller if self._goal == "combine" else served
        return self._goal == "combine"

    def _looks_on(self, now: float, here: Place, line: GuidanceLine, peer: PeerState, inputs: Inputs) -> bool:
        """Looks for calls, far ways of combines, and where it waits; True: its way is another one now."""
        self._looks_at, number, is_early = now + RETRY, self._number, peer.task < self._task
        if self._takes_call(now, here, inputs["heap"]):
            return True
        to_place, end = self._goal == "place", min(self._lane, line.length)
        leaves = to_place and self._truck.leaves(inputs["heap"], self._combines, self._others)
        if leaves and self._truck.is_first(here, self._others):
            self._set_out(now, here, peer, "truck")
        elif end - self._way > dist(here[:2], line.point(end)) + AROUND:  # machines may have left since
            self._set_out(now, here, peer, self._goal, end - self._way - SHORTER)
            self._retry_at = -inf
        if self._number != number:
            return True
        until = self._ahead.on_far_ways(here, line, self._way, self._lane, self._combines)
        if until < inf:
            self._set_out(now, here, peer, self._goal)
            until = self._ahead.on_far_ways(here, self._made(), self._way, self._lane, self._combines)
            if until < self._way + SHORT:  # it is on it: on its way elsewhere it gets out
                until = inf
                if self._goal == "combine":
                    self._phase, self._task, self._is_free = Phase.WAITS, -1, False
        self._drives_to = min(self._drives_to, until) if is_early else until
        is_over = self._number != number or self._phase != Phase.DRIVES
        if is_over or inputs["odometry"].speed >= MOVES or not is_early:
            return is_over
        rest = [said for said in self._combines.values() if said is not peer]
        if self._drives_to < self._lane and peer.phase == Phase.CUTS:
            further = self._ahead.further(here, line, self._way, self._lane, self._task, peer, rest)
            self._drives_to = max(self._drives_to, further)
        if any(self._clearance.is_soon_in_way(here, self._outline, said, in_pass=True) for said in rest):
            self._phase, self._is_free = Phase.WAITS, False
        return False

    def _is_blocked(self, now: float, free: float, speed: float, *, stays: bool) -> bool:
        """A machine has been standing in its way for a while: it looks for another one, unless it stays."""
        self._blocked_at = inf if stays or free > 1.0 or speed > MOVES else min(self._blocked_at, now)
        return now - self._blocked_at > BLOCKED_FOR

    def _keeps(self, now: float, here: Place, peer: PeerState, station: Wanted) -> None:
        """Beside the combine: until the load or the pass is over, or another machine comes."""
        if peer.is_pouring or peer.speed >= MOVES:
            self._poured_at = now
        if peer.age > SILENT:
            return  # the station brings it aside
        pours_on = peer.is_pouring and peer.task == self._task and peer.phase != Phase.TURNS
        dry, rest = now - self._poured_at, [said for said in self._combines.values() if said is not peer]
        idle = dry > (HELD_FOR if peer.phase == Phase.STANDS else FULL_FOR)
        is_over = idle and (peer.phase == Phase.DONE or (peer.phase == Phase.STANDS and not peer.calls))
        self._way = self._made().project(here.x, here.y, self._way).way
        met = free_of(self._others, here, self._made(), self._way, peer.speed, self._p.number)
        is_long = dry > MISSED_FOR
        stops = dry > HELD_FOR and self._clearance.holds_up(here, self._outline, rest, before_turn=is_long)
        stops |= is_long and self._calls.gives_up_waiting(now, self._served, self._combines, self._others)
        is_lost = self._calls.is_lost(peer, self._task, is_beside=True)
        caller, _ = self._calls.neediest(now, self._combines, self._others)
        is_over |= peer.phase == Phase.CUTS and not peer.calls and caller >= 0
        ends = is_over or stops or met < inf or (is_lost and not pours_on)
        ends |= self._clearance.is_close(here, self._made(), self._way, filter(stands_for_cart, rest))
        moves_on = peer.is_pouring or station.spot != self._spot  # to a place with room
        self._since = min(self._since, now) if station.is_full and not moves_on else inf
        self._spot = station.spot
        if (is_full := now - self._since > FULL_FOR) or ends:
            drives_off = peer.phase == Phase.STANDS or is_full  # else it is in the way of its turn
            self._phase, self._is_free = Phase.WAITS, not (drives_off or stops)
            c, s = 30.0 * cos(here.heading), 30.0 * sin(here.heading)  # straight on to a stop
            self._points = np.array([[here.x, here.y], [here.x + c, here.y + s]])
            self._number, self._way, self._line = self._number + 1, 0.0, None
            if drives_off:
                self._set_out(now, here, peer, "truck")

    def _empties(self, now: float, heap: HeapState) -> None:
        """Beside the truck, until it is empty and gone again."""
        half = 0.5 * self._p.dock_s
        if heap.grain > 0.0 or now - self._since <= half:
            self._until = now + half
        if self._phase == Phase.EMPTIES and now >= self._until:
            self._phase = Phase.WAITS

    def _made(self) -> GuidanceLine:
        if self._line is None:
            self._line = GuidanceLine(self._points.tolist(), "path")
        return self._line

    def _out(self, t: int, speed: float) -> Outputs:
        job = JobState(
            t, int(self._phase), self._task, speed, nan, by_station=self._phase == Phase.BESIDE,
            empties=self._phase == Phase.EMPTIES and t / NS - self._since >= 0.5 * self._p.dock_s,
            serves=self._served,
        )  # fmt: skip
        return {"job": job, "path": GuidancePath(t, self._points[:, 0], self._points[:, 1], self._number)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: all is done."""
        return self._ended


LEVEL = Level(
    Shuttle,
    Params,
    summary="between a combine and the truck, on ground that is cut",
    cost="0.1 ms per step, some 0.3 s for every way it looks for",
    tolerance="ways no tighter than its radius, 1.5 m clear of crop",
)
