"""Job level `shuttle`: a cart drives to a combine that calls, keeps beside it, and brings grain to the truck.

It knows the passes of the field, so where crop still stands, and drives where none does. Beside a pass it
comes up from behind on the ground that is cut, parallel to it, and then keeps its station (`cooperate`). It
breaks off before the end of a pass and stays back, so that the combine can turn.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, isfinite, nan, pi, sin, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from swath.control.job.clothoid import bends_of
from swath.control.job.dubins import Place
from swath.control.job.ground import Ground, beside
from swath.control.job.passes import Coordinate, Pass, way_along
from swath.control.job.ways import Search, moved
from swath.control.steer.guidance_line import GuidanceLine, along_bends
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, KMH
from swath.signals import F64, GuidancePath, HeapState, JobState, Odometry, PeerState, Phase, PoseEstimate
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup

BRAKE = 0.4  # m/s2
SIDEWAYS = 0.8  # m/s2, most in a bend
HALF, NARROW = 2.0, 1.2  # m, of the machine to either side, and of that about start and goal
HEADER = 4.0  # m, of a combine's knife ahead of its axle
COME_UP = 25.0  # m behind the combine, where it comes onto the line beside the pass
STRAIGHT = 14.0  # m before that on the same line: the trailer is straight behind
CATCH_UP = 0.3  # 1/s
IN_LINE, TURNED, NEAR = 1.0, 12.0 * DEG, 15.0  # m, rad, m: from there on it keeps the station
GIVE_WAY = 18.0  # m, a combine so near ahead has the right of way
FULL_FOR = 4.0  # s, that the station says full, or that nothing is poured any more, before it leaves
PULL_AHEAD = 10.0  # m straight on before it turns away from a combine beside it
BEGIN = -4.0  # m from the begin of a pass, where the line beside it begins
AHEAD = STRAIGHT - BEGIN + 20.0  # m along that line, where it waits for the combine to come up
FORESIGHT = 2  # passes after the present one, for which it sets out
APART = 45.0  # m from the combine, from where on it sets out for a pass to come
LEAST = 15.0  # m of a pass beside the combine, for which it sets out
RETRY = 5.0  # s between two looks for a way
ARRIVED = 0.4  # m


@dataclass(frozen=True)
class Params:
    """passes, boundary_m: of the field; header_m: width of the combine's; beside_m: its pipe to the left
    truck_m: place beside the truck; dock_s: to stand right there and to be gone again
    speed_kmh: on the field; radius_m: of its tightest turn; leave_percent: of the largest heap, from which it
    drives to the truck; break_off_m: before the end of a pass, where it stops keeping the station; but in the
    last one
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
    break_off_m: Annotated[float, Ge(0), Le(200)] = 25.0


class Shuttle(KeepsState):
    """Waits, drives, keeps beside, empties. Its phases are those of `JobState`."""

    kept = (
        "_phase", "_goal", "_task", "_points", "_number", "_way", "_lane", "_since", "_until", "_retry_at",
        "_is_free", "_peer_at", "_ended", "_poured_at",
    )  # fmt: skip
    inputs = (
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
        Port("peer", PeerState),
        Port("heap", HeapState),
        Port("station", Wanted),
    )
    outputs = (Port("job", JobState), Port("path", GuidancePath))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        if setup.machine.box is None:
            raise InputError("level", "shuttle", "expected a machine whose data sheet has a `box`")
        self._p = params
        self._line: GuidanceLine | None = None
        self._forget()

    def _forget(self) -> None:
        self._phase, self._goal, self._task, self._number = Phase.WAITS, "", -1, 0
        self._points = np.zeros((0, 2))
        self._way = self._lane = 0.0
        self._peer_at = 0.0, 0.0
        self._since, self._until, self._retry_at, self._poured_at = inf, -inf, -inf, -inf
        self._is_free, self._ended = True, ""

    def reset(self, stream: Stream) -> Outputs:
        """Waits where it stands."""
        self._forget()
        self._line = None
        return self._out(0, 0.0)

    def load(self, state: dict[str, object]) -> None:
        """Back to a saved moment."""
        super().load(state)
        self._line = None

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What is to be done at t + dt."""
        pose, peer, now = inputs["pose"], inputs["peer"], (t + dt) / NS
        if pose is None or not isfinite(pose.x) or not peer.is_heard:
            return self._out(t + dt, 0.0)
        heap, station = inputs["heap"], inputs["station"]
        if self._phase == Phase.WAITS:
            speed = self._waits(now, pose, peer, heap)
        elif self._phase == Phase.DRIVES:
            speed = self._drives(now, pose, inputs, max(inputs["odometry"].speed, 0.0))
        elif self._phase == Phase.BESIDE:
            speed = self._keeps(now, pose, peer, station)
        else:
            speed = 0.0
            self._empties(now, heap)
        return self._out(t + dt, speed)

    # what it decides

    def _waits(self, now: float, pose: PoseEstimate, peer: PeerState, heap: HeapState) -> float:
        is_over = peer.phase == Phase.DONE
        if self._has_load(heap) or not self._is_free or (is_over and heap.grain > 0.0):
            self._set_out(now, pose, peer, "truck")
        elif is_over:
            self._phase, self._ended = Phase.DONE, "the field is empty, and its grain at the truck"
        elif peer.calls and self._next_task(peer) >= 0:
            self._set_out(now, pose, peer, "combine")
        return 0.0

    def _next_task(self, peer: PeerState) -> int:
        """The combine's pass, where enough is left of it or it stands; else the next one where a cart can
        drive beside; -1 = none.
        """
        p = self._p
        least = self._break_off(peer.task) + LEAST
        if p.passes[peer.task].cart_beside and (peer.phase == Phase.STANDS or peer.remaining > least):
            return peer.task
        if hypot(peer.x, peer.y) < APART:
            return -1
        for i in range(peer.task + 1, min(peer.task + 1 + FORESIGHT, len(p.passes))):
            if p.passes[i].cart_beside:
                return i
        return -1

    def _set_out(self, now: float, pose: PoseEstimate, peer: PeerState, goal: str) -> None:
        if now < self._retry_at:
            return
        self._retry_at = now + RETRY
        found = self._to_truck(pose, peer) if goal == "truck" else self._to_combine(pose, peer)
        if found is None:
            return
        self._points, self._number, self._way = found, self._number + 1, 0.0
        self._line = None
        self._phase, self._goal, self._task = Phase.DRIVES, goal, self._next_task(peer)
        self._lane = inf if goal == "truck" else self._made().length - self._lane
        self._retry_at = -inf

    def _drives(self, now: float, pose: PoseEstimate, inputs: Inputs, speed: float) -> float:
        """Along the way that was found; on the line beside the pass it catches up."""
        peer, station, heap = inputs["peer"], inputs["station"], inputs["heap"]
        line = self._made()
        self._way = line.project(pose.x, pose.y, self._way).way
        left = line.length - self._way
        if self._goal == "truck":
            if left <= ARRIVED:
                empties = self._has_load(heap) or (peer.phase == Phase.DONE and heap.grain > 0.0)
                self._phase, self._since = Phase.EMPTIES if empties else Phase.WAITS, now
                self._is_free = True
                return 0.0
        elif self._is_lost(peer) or self._is_in_way(pose, peer):
            self._phase, self._is_free = Phase.WAITS, True
            return 0.0
        elif self._is_in_line(peer, station):
            self._phase, self._since = Phase.BESIDE, inf
            return 0.0
        braking = sqrt(2.0 * BRAKE * max(left, 0.0))
        wanted = min(self._p.speed_kmh * KMH, self._slow(line, speed), braking)
        if self._way >= self._lane and peer.task < self._task:
            hold = max(self._lane + AHEAD - self._way, 0.0)
            return float(min(wanted, sqrt(2.0 * BRAKE * hold)))
        if self._way >= self._lane:
            behind = station.ahead if station.is_active else 0.0
            return float(min(wanted, max(peer.speed + CATCH_UP * behind, 0.0)))
        return 0.0 if self._gives_way(peer) else max(wanted, 0.3)

    def _is_lost(self, peer: PeerState) -> bool:
        """The combine has left the pass that the cart drives to, or soon will."""
        if peer.task < self._task:
            return False
        break_off = self._break_off(peer.task)
        has_left = peer.task > self._task or (not peer.may_unload and peer.remaining < break_off)
        return has_left or (peer.phase != Phase.STANDS and peer.remaining < break_off)

    def _break_off(self, task: int) -> float:
        """Before the end of a pass [m]; behind the last one the combine stands and does not turn."""
        return -inf if task + 1 == len(self._p.passes) else self._p.break_off_m

    def _is_in_line(self, peer: PeerState, station: Wanted) -> bool:
        is_there = peer.task == self._task and peer.may_unload and station.is_active
        return (
            is_there and self._way >= self._lane and abs(station.left) < IN_LINE
            and abs(station.heading) < TURNED and abs(station.ahead) < NEAR
        )  # fmt: skip

    def _is_in_way(self, pose: PoseEstimate, peer: PeerState) -> bool:
        """The combine stands near, elsewhere than when the way was found."""
        x, y = beside(pose.x, pose.y, pose.heading, peer.x, peer.y)
        moved_on = hypot(x - self._peer_at[0], y - self._peer_at[1]) > 5.0
        near = hypot(peer.x, peer.y) < GIVE_WAY and peer.speed <= 0.3
        return self._way < self._lane and near and moved_on

    def _gives_way(self, peer: PeerState) -> bool:
        """A combine that moves near, ahead or beside."""
        return peer.speed > 0.3 and hypot(peer.x, peer.y) < GIVE_WAY and peer.x > -6.0

    def _slow(self, line: GuidanceLine, speed: float) -> float:
        """Speed [m/s] for the bends of the next metres."""
        ahead = [self._way + i for i in range(0, int(2.0 + 2.5 * speed) + 2, 2)]
        bend = max(abs(line.curvature(way, 1.0)) for way in ahead)
        return sqrt(SIDEWAYS / max(bend, 1e-3))

    def _keeps(self, now: float, pose: PoseEstimate, peer: PeerState, station: Wanted) -> float:
        is_over = peer.phase == Phase.DONE or (peer.phase == Phase.STANDS and not peer.calls)
        if peer.is_pouring:
            self._poured_at = now
        ends = self._is_lost(peer) or (is_over and now - self._poured_at > FULL_FOR)
        if station.is_full and not peer.is_pouring:
            self._since = min(self._since, now)
        else:
            self._since = inf
        is_full = now - self._since > FULL_FOR
        if ends or is_full:
            # where the combine stands the cart is in the way of its turn, and drives off
            self._is_free = peer.phase != Phase.STANDS and not is_full
            self._phase = Phase.WAITS
            self._hold(pose)
            if not self._is_free:
                self._set_out(now, pose, peer, "truck")
        return 0.0

    def _hold(self, pose: PoseEstimate) -> None:
        """Straight on to a stop."""
        c, s = cos(pose.heading), sin(pose.heading)
        self._points = np.array([[pose.x, pose.y], [pose.x + 30.0 * c, pose.y + 30.0 * s]])
        self._number, self._way, self._line = self._number + 1, 0.0, None

    def _has_load(self, heap: HeapState) -> bool:
        return heap.level * 100.0 >= self._p.leave_percent

    def _empties(self, now: float, heap: HeapState) -> None:
        """Beside the truck, until it is empty and gone again."""
        half = 0.5 * self._p.dock_s
        if heap.grain > 0.0 or now - self._since <= half:
            self._until = now + half
        if self._phase == Phase.EMPTIES and now >= self._until:
            self._phase = Phase.WAITS

    # ways

    def _to_truck(self, pose: PoseEstimate, peer: PeerState) -> F64 | None:
        x, y = self._p.truck_m
        goals = [Place(x, y, 2.0 * pi * i / 12) for i in range(12)]
        near = hypot(peer.x, peer.y) < GIVE_WAY
        return self._found(pose, peer, goals, [], ahead=PULL_AHEAD if near else 0.0)

    def _to_combine(self, pose: PoseEstimate, peer: PeerState) -> F64 | None:
        """Onto the line beside the pass behind the combine, and along it."""
        task = self._next_task(peer)
        line = _shifted(self._p.passes[task], self._p.beside_m)
        length = way_along(line)
        (ax, ay), (bx, by) = line[0], line[-1]
        course = atan2(by - ay, bx - ax)
        ux, uy = cos(course), sin(course)
        x, y = beside(pose.x, pose.y, pose.heading, peer.x, peer.y)
        at = (x - ax) * ux + (y - ay) * uy
        begin = min(max(at - COME_UP - STRAIGHT, BEGIN - STRAIGHT), length)
        if task > peer.task:
            begin = BEGIN - STRAIGHT
        goal = Place(ax + ux * begin, ay + uy * begin, course)
        beyond = bx + 30.0 * ux, by + 30.0 * uy
        self._lane = hypot(beyond[0] - goal.x, beyond[1] - goal.y)
        return self._found(pose, peer, [goal], [beyond])

    def _found(
        self,
        pose: PoseEstimate,
        peer: PeerState,
        goals: list[Place],
        rest: list[tuple[float, float]],
        *,
        ahead: float = 0.0,
    ) -> F64 | None:
        """Points of a way straight on, to the goal, and through the rest; None where there is none now."""
        p, here = self._p, Place(pose.x, pose.y, pose.heading)
        ground = self._ground(pose, peer)
        x, y = self._peer_at = beside(*here, peer.x, peer.y)
        course = here.heading + peer.heading
        half = 0.5 * p.header_m
        across = [half * (i / 4.0 - 1.0) for i in range(9)]
        discs = [(*beside(x, y, course, HEADER, left), 0.3) for left in across]
        discs += [(*beside(x, y, course, ahead, 0.0), 1.7) for ahead in (-5.0, -3.0, -1.0, 1.0)]
        search = Search(ground, ground.clear_of(HALF, discs), ground.clear_of(NARROW, discs), p.radius_m)
        straight = moved(here, "S", ahead, p.radius_m)
        way = search.way(straight, goals)
        if way is None:
            return None
        first = [here[:2]] if ahead > 0.0 else []
        return np.array([*first, *along_bends(*straight, bends_of(way, p.radius_m)), *rest])

    def _ground(self, pose: PoseEstimate, peer: PeerState) -> Ground:
        """Crop as it stands now, by the passes that are done and the way in the present one."""
        p, ground = self._p, Ground(self._p.boundary_m)
        for i, done in enumerate(p.passes[: peer.task + 1]):
            size = None
            if i == peer.task and isfinite(peer.remaining):
                size = max(way_along(done.line_m) - peer.remaining - 4.0, 0.0)
            if i < peer.task or size is not None or peer.phase != Phase.CUTS:
                ground.cut(done.line_m, p.header_m, size)
        return ground

    def _made(self) -> GuidanceLine:
        if self._line is None:
            self._line = GuidanceLine(self._points.tolist(), "path")
        return self._line

    def _out(self, t: int, speed: float) -> Outputs:
        job = JobState(
            t, int(self._phase), self._task, speed, nan, by_station=self._phase == Phase.BESIDE,
            empties=self._phase == Phase.EMPTIES and t / NS - self._since >= 0.5 * self._p.dock_s,
        )  # fmt: skip
        x, y = self._points.T
        return {"job": job, "path": GuidancePath(t, x, y, self._number)}

    def end_reason(self, t: int) -> str:
        """Why the run ends: all is done."""
        return self._ended


def _shifted(of: Pass, left: float) -> list[tuple[float, float]]:
    """A pass's line, so far to its left at begin and end [m]."""
    (ax, ay), (bx, by) = of.line_m[0], of.line_m[-1]
    course = atan2(by - ay, bx - ax)
    return [beside(x, y, course, 0.0, left) for x, y in ((ax, ay), (bx, by))]


LEVEL = Level(
    Shuttle,
    Params,
    summary="between a combine and the truck, on ground that is cut",
    cost="0.1 ms per step, some 0.3 s for every way it looks for",
    tolerance="ways no tighter than its radius, 1.5 m clear of crop",
)
