"""Job level `harvest`: pass after pass with its turns; stands with a full tank, calls a cart."""

from dataclasses import dataclass
from math import hypot, inf, isfinite, nan, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from swath.control.cooperate.peer_track import OTHER_PORTS
from swath.control.job.abreast import Abreast, own_passes
from swath.control.job.calls import FORESIGHT
from swath.control.job.carts_in_way import CartsInWay
from swath.control.job.crossings import NONE, Crossing, Crossings
from swath.control.job.heard import SILENT, AllHeard
from swath.control.job.passes import RUN_OUT, Pass, Route, route_of
from swath.control.job.right_of_way import SWEPT
from swath.control.job.tank import EMPTY, TankForecast
from swath.control.job.turn_speed import BRAKE, speed_between
from swath.control.turns.dubins import Place
from swath.control.turns.limits import limits_of
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, KMH, PERCENT
from swath.signals import (
    GuidancePath,
    HeaderCommand,
    JobState,
    MachineLoad,
    Odometry,
    PeerState,
    Phase,
    PoseEstimate,
    UnloadState,
)
from swath.signals.setup import ControlSetup

RUNS_OUT = 1.5  # s without grain from the pipe: what comes late from the threshing has run out, too
AT_END = -0.3  # m to go, at which the header is out of the crop
LOOKS = 9.0  # m to go, from where on it looks whether carts block its turn: at rest it has not begun that
AT_HOLD = 0.1  # m before where it has to wait for another combine
STILL, TOO_LONG = 1.0, 3600.0  # m, s: no farther along its way than that for so long, it gives the job up
GENTLE = 0.25  # m/s2, to rest at the end of a pass: machines follow late, and one was 1 m in its turn
CRAWL = 0.2  # m/s, slowest towards the end of a pass
HALF = 0.5  # of the tank, from where on it is emptied at the end of a pass where carts are few
TAKEN = 0.02  # of the tank, that a cart took before a machine with a full one goes on
LOW = 0.02  # of the tank: driving it needs its cart no more
CALLS_AHEAD = 150.0  # s before it has to stand for a cart, in which that comes
BESIDE = 16.0  # m, nearer than which a cart stands beside it
LETS_OFF = 40.0  # s without grain, for which it waits there for a cart that drives off
PASSES = 0.4  # m from a cart beside it, that it drives on past behind its last pass


@dataclass(frozen=True)
class Params:
    """passes: of all combines, in the order of working; number: of this one
    turn_speed_kmh: between them; transport_speed_kmh: on the straights of a way of more than 80 m;
    turn_radius_m: of turns not given
    turn_rate_deg_s: of the steering angle in them, less than the steering can, to come back to the path
    lower_m, raise_m: way before the crop on which the header goes down, behind it on which it goes up
    edge_from_m, edge_to_m: way in the pass from which, and before its end up to which, the crop edge may lead
    call_percent: of the tank, from which a cart is called, in the last pass at once
    full_percent: of the tank, at which the machine stands
    unload_to_m: before the end of a pass, where a load is broken off that would take longer than finish_s
    standing there; in the last pass it is not
    give_up_s: the run ends when it has been standing so long for a cart that is silent, or an hour for any
    reason
    run_out_m: it drives on behind the last pass, at most
    crossings: where ways of several combines meet, and who goes first there; lag_m: in echelon, behind the
    one that cuts the pass before, the same way
    """

    passes: Annotated[tuple[Pass, ...], MinLen(1)]
    turn_speed_kmh: Annotated[float, Gt(0), Le(20)] = 7.0
    transport_speed_kmh: Annotated[float, Gt(0), Le(40)] = 12.0
    turn_radius_m: Annotated[float, Gt(3), Le(50)] = 7.0
    turn_rate_deg_s: Annotated[float, Gt(0), Le(90)] = 9.0
    lower_m: Annotated[float, Ge(0), Le(20)] = 3.0
    raise_m: Annotated[float, Ge(0), Le(20)] = 0.5
    edge_from_m: Annotated[float, Ge(0), Le(1000)] = 5.0
    edge_to_m: Annotated[float, Ge(0), Le(1000)] = 12.0
    call_percent: Annotated[float, Ge(0), Le(100)] = 60.0
    full_percent: Annotated[float, Gt(0), Le(100)] = 97.0
    unload_to_m: Annotated[float, Ge(0), Le(200)] = 25.0
    finish_s: Annotated[float, Ge(0), Le(600)] = 30.0
    give_up_s: Annotated[float, Gt(0), Le(36_000)] = 600.0
    run_out_m: Annotated[float, Ge(5), Le(200)] = RUN_OUT
    number: Annotated[int, Ge(0), Le(3)] = 0
    lag_m: Annotated[float, Ge(5), Le(500)] | None = None
    crossings: tuple[Crossing, ...] = ()


class Harvest(KeepsState):
    """Knows its passes, and by its own pose how far it has come."""

    kept = (
        "_index", "_way", "_phase", "_calls", "_finishes", "_stands", "_unloads", "_tank", "_ended",
        "_heard", "_silent_for", "_dry_for", "_to_come", "_stands_in", "_pours_on", "_will_stand",
        "_crossings", "_lets_first", "_stood_for", "_stood_at",
    )  # fmt: skip
    inputs = (
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
        Port("load", MachineLoad),
        Port("unload", UnloadState, optional=True),
        Port("peer", PeerState, optional=True),
        *OTHER_PORTS,
    )
    outputs = (Port("job", JobState), Port("path", GuidancePath), Port("header", HeaderCommand))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        if not setup.machine.has_header:
            raise InputError("level", "harvest", "expected a machine with a header")
        self._p, self._knife, self._aside = params, setup.machine.knife_x, setup.machine.header_y
        self._own = own_passes(params.passes, params.number)
        if not self._own:
            raise InputError("number", params.number, "expected the number of a combine that has passes")
        self._passes = [params.passes[i] for i in self._own]
        speed, rate = params.turn_speed_kmh * KMH, params.turn_rate_deg_s * DEG
        self._crossings = Crossings(params.passes, params.number, params.crossings, speed)
        self._abreast = Abreast(params.passes, params.number, params.lag_m, self._crossings)
        self._team: list[PeerState] = []
        self._limits = limits_of(setup.machine.wheelbase, params.turn_radius_m, rate, speed)
        self._routes: dict[int, tuple[Route, GuidancePath, GuidancePath]] = {}
        self._in_way = CartsInWay(setup.machine, self._own)
        self._heard = AllHeard()
        self._tank = TankForecast(self._passes, params.full_percent * PERCENT)
        self._forget()

    def _forget(self) -> None:
        self._index, self._way, self._phase = 0, 0.0, Phase.WAITS
        self._calls = self._finishes = self._stands = self._unloads = self._pours_on = False
        self._will_stand = False
        self._tank.reset()
        self._ended, self._silent_for, self._dry_for, self._to_come, self._stands_in = "", 0.0, inf, nan, nan
        self._stood_for, self._stood_at = 0.0, 0.0
        self._heard.reset()
        self._crossings.reset()
        self._lets_first = NONE

    def reset(self, stream: Stream) -> Outputs:
        """Before the first pass."""
        self._forget()
        return self._out(0, 0.0, -self._p.lower_m - 1.0)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What is to be done at t + dt."""
        pose: PoseEstimate | None = inputs["pose"]
        if pose is None or not isfinite(pose.x):
            return self._out(t + dt, 0.0, self._way)
        self._advance(pose)
        heard = self._heard.update(t + dt, dt, inputs).values()
        carts = [said for said in heard if not isfinite(said.header_width)]
        self._team = [said for said in heard if isfinite(said.header_width)]
        here = Place(pose.x, pose.y, pose.heading)
        unload: UnloadState | None = inputs.get("unload")
        pours = unload is not None and unload.flow > 0.0
        self._dry_for = 0.0 if pours else self._dry_for + dt / NS
        own = self._progress(t, inputs["odometry"].speed)
        self._lets_first = self._crossings.update(t + dt, own, self._team)
        speed = self._speed(inputs, here, carts)
        self._note_standing(carts, dt / NS)
        return self._out(t + dt, speed, self._way)

    def _note_standing(self, carts: list[PeerState], h: float) -> None:
        """How long it has been standing, by its way, as measured speeds have noise; and without a message."""
        is_silent = self._phase == Phase.STANDS and any(cart.age > SILENT for cart in carts)
        self._silent_for = self._silent_for + h if is_silent else 0.0
        if abs(self._way - self._stood_at) > STILL or self._phase == Phase.DONE:
            self._stood_for, self._stood_at = 0.0, self._way
        self._stood_for += h
        task = self._own[self._index]
        if self._silent_for > self._p.give_up_s:
            self._ended = f"stands in pass {task} and hears nothing of the cart"
        elif self._stood_for > TOO_LONG:
            self._ended = f"has been standing in pass {task} or its turn for an hour"

    def _progress(self, t: int, speed: float) -> PeerState:
        """What it tells of itself to those that it works with, as they hear it."""
        task, way = self._own[self._index], self._way
        return PeerState(t, True, 0.0, 0.0, 0.0, 0.0, speed, 0.0, phase=self._phase, task=task, come=way)

    @property
    def _is_last(self) -> bool:
        return self._index + 1 == len(self._passes)

    def _route(self) -> Route:
        return self._made()[0]

    def _made(self) -> tuple[Route, GuidancePath, GuidancePath]:
        """Its route, that as a path, and straight on behind the pass."""
        if self._index not in self._routes:
            how = self._index, self._knife, self._limits, self._aside, self._p.run_out_m
            route, straight = (route_of(of, *how) for of in (self._passes, self._passes[: self._index + 1]))
            number, count = self._own[self._index], len(self._p.passes)
            (x, y), (on_x, on_y) = np.array(route.points).T, np.array(straight.points).T
            paths = GuidancePath(0, x, y, number), GuidancePath(0, on_x, on_y, count + number)
            self._routes = {self._index: (route, *paths)}
        return self._routes[self._index]

    def _advance(self, pose: PoseEstimate) -> None:
        """How far it has come; behind the turn the next pass is the own one."""
        route = self._route()
        near = self._way if self._phase != Phase.WAITS else None
        self._way = route.line.project(pose.x, pose.y, near).way
        if not self._is_last and self._way > route.length + route.turn:
            self._way -= route.length + route.turn
            self._index += 1
            self._finishes = self._pours_on = False

    def _speed(self, inputs: Inputs, here: Place, carts: list[PeerState]) -> float:
        """Wanted speed [m/s], and with it what the machine does."""
        p, work, load = self._p, self._passes[self._index], inputs["load"]
        left, level, speed = self._route().length - self._way, load.tank_level, inputs["odometry"].speed
        unload: UnloadState | None = inputs.get("unload")
        flow = unload.flow if unload is not None else 0.0
        is_last, has_cart = self._is_last, bool(carts) and unload is not None
        is_over = is_last and left <= AT_END
        to_last = is_last or (self._phase == Phase.TURNS and self._index + 2 == len(self._passes))
        if left > AT_END:
            self._tank.update(load, self._index, self._way)
        self._to_come = self._tank.to_come(load, self._index, left)
        self._stands_in = self._tank.stands_in(load, self._index, left, p.turn_speed_kmh * KMH)
        self._unloads = has_cart and self._is_too_full(load, left)
        goes_on = (self._calls and self._is_served(carts)) or to_last
        least = EMPTY if to_last or self._phase == Phase.STANDS else LOW
        wants = level >= p.call_percent * PERCENT or (goes_on and level > least)
        wants |= self._unloads or self._tank.wants_cart(load, self._index, left)
        then = self._passes[self._index + 1 :][:FORESIGHT]
        if work.cart_standing and then and not any(w.cart_beside for w in then):
            wants &= self._stands or self._tank.is_full_before_cart(load, self._index, left)
        wants |= level > EMPTY and self._stands_in < CALLS_AHEAD
        self._calls = has_cart and wants
        leaves = self._phase == Phase.TURNS or (not self._calls and self._dry_for > RUNS_OUT)
        if self._phase == Phase.DONE or (is_over and leaves):
            return self._leaves(left, here, carts)
        if flow > 0.0 and 0.0 < left < p.unload_to_m and not self._finishes:
            is_soon_over = load.tank_grain / flow <= p.finish_s + left / max(speed, 0.3)
            are_few = len(carts) < 1 + len(self._team)  # than combines: the cart will be elsewhere then
            empties = are_few and (level >= HALF or self._tank.is_full_in_next(load, self._index, left))
            route = self._route()
            in_peace = is_soon_over or empties
            in_peace = in_peace and self._in_way.leaves_in_peace(route, route.length - AT_END, carts)
            self._finishes = is_soon_over and in_peace
            too_full = self._tank.is_too_full(load, self._index, left) or (empties and in_peace)
            self._pours_on |= has_cart and not is_last and too_full
        is_near_end = has_cart and not is_last and AT_END < left < p.unload_to_m
        self._will_stand = is_near_end and work.has_cart and self._tank.is_too_full(load, self._index, left)
        if left > AT_END:
            holds = self._is_full(work, level, pours=flow > 0.0)
        else:
            holds = is_over or self._is_held(here, carts)
        if holds:
            self._phase = Phase.STANDS
            return 0.0
        if left <= AT_END and self._phase != Phase.TURNS:
            self._tank.begin(load)
        self._phase = Phase.CUTS if left > AT_END else Phase.TURNS
        wanted, turning = work.speed_kmh * KMH, p.turn_speed_kmh * KMH
        free = self._free()
        if self._phase == Phase.TURNS:
            fast = speed_between(self._route(), self._way, turning, p.transport_speed_kmh * KMH)
            stops = self._in_way.stops_turn(self._route(), self._way, here, carts, speed)
            return 0.0 if stops else min(fast, free)
        if self._in_way.stops_cutting(self._route(), self._way, here, carts):
            return 0.0
        goes_on = not (self._finishes or self._pours_on or self._will_stand or is_last)
        goes_on = goes_on and not (left < LOOKS and self._is_blocked(here, carts))
        slower, brake = (min(turning, wanted), BRAKE) if goes_on else (0.0, GENTLE)
        return min(wanted, free, max(sqrt(slower**2 + 2.0 * brake * (left - AT_END)), CRAWL))

    def _is_served(self, carts: list[PeerState]) -> bool:
        """Whether a cart is at one of its passes, or on its way there; one that has no job may be."""
        return any(cart.phase < 0 or cart.task in self._own for cart in carts)

    def _free(self) -> float:
        """Speed [m/s] from which it comes to rest where it has to wait for another combine."""
        route = self._route()
        free = self._abreast.free(self._index, self._way, route.length + route.turn, self._team)
        return sqrt(2.0 * BRAKE * free) if free > AT_HOLD else 0.0

    def _leaves(self, left: float, here: Place, carts: list[PeerState]) -> float:
        """Behind the last pass: on past a cart that stands beside it, whose trailer need not come by the
        header then, and out of the way of a combine that still works: it lets the cart drive off first. left:
        to the end of the pass [m], < 0 behind it
        """
        rest = self._p.run_out_m - 1.0 + left
        in_way = any(said.phase != Phase.DONE for said in self._team)
        near = in_way or any(cart.is_heard and hypot(cart.x, cart.y) < BESIDE for cart in carts)
        is_over = self._phase == Phase.DONE or rest <= 0.0 or not near
        blocked = not is_over and self._is_blocked(here, carts, PASSES)
        if is_over or (blocked and not (in_way and self._dry_for < LETS_OFF)):
            self._phase = Phase.DONE
            return 0.0
        self._phase = Phase.TURNS
        if blocked:
            return 0.0
        return min(self._p.turn_speed_kmh * KMH, self._free(), max(sqrt(2.0 * BRAKE * rest), CRAWL))

    def _is_full(self, work: Pass, level: float, *, pours: bool) -> bool:
        """In the pass it stands with a full tank, until a cart takes grain on the go, or has taken some."""
        full = self._p.full_percent * PERCENT
        if level >= full and not (pours and work.cart_beside):
            self._stands = True
            if not work.has_cart:
                self._ended = (
                    f"the tank is full in pass {self._own[self._index]}, beside which no cart can drive"
                )
        elif level < full - TAKEN and (work.cart_beside or not pours):
            self._stands = False
        return self._stands

    def _is_held(self, here: Place, carts: list[PeerState]) -> bool:
        """At the end of a pass: until a load is finished, and the carts are out of the way of the turn."""
        if self._phase == Phase.TURNS:
            return False
        finishes = self._finishes and self._dry_for <= RUNS_OUT
        return finishes or self._unloads or self._is_blocked(here, carts)

    def _is_blocked(self, here: Place, carts: list[PeerState], clear: float = SWEPT) -> bool:
        route, is_last = self._route(), self._is_last
        return self._in_way.is_blocked(route, self._way, here, carts, is_last=is_last, clear=clear)

    def _is_too_full(self, load: MachineLoad, left: float) -> bool:
        """At the end of a pass beside which a cart can stand: whether it unloads there before it goes on."""
        if self._phase == Phase.TURNS or left > AT_END or self._is_last:
            return False
        pours_on = (self._unloads or self._pours_on) and self._dry_for <= RUNS_OUT
        is_too_full = pours_on or self._tank.is_too_full(load, self._index)
        return self._passes[self._index].has_cart and is_too_full

    def _out(self, t: int, speed: float, way: float) -> Outputs:
        p, (route, path, straight), work = self._p, self._made(), self._passes[self._index]
        left = route.length - way
        next_in = left + route.turn
        is_last = self._is_last
        is_down = left > -p.raise_m or (not is_last and next_in < p.lower_m)
        is_down &= way > -p.lower_m and self._phase != Phase.DONE
        in_pass = left > AT_END
        edge = in_pass and way >= p.edge_from_m and left >= p.edge_to_m
        stands = self._phase == Phase.STANDS
        goes_on = left > p.unload_to_m or self._finishes or self._pours_on or is_last or self._will_stand
        driving = work.cart_beside and in_pass and way > 2.0 and goes_on
        may = (work.has_cart and (stands or self._will_stand)) or driving
        job = JobState(
            t, int(self._phase), self._own[self._index], speed, left if in_pass or stands else nan,
            by_edge=edge, may_unload=may, calls=self._calls, come=way, to_come=self._to_come,
            stands_in=self._stands_in, lets_first=self._lets_first,
        )  # fmt: skip
        ends = self._finishes or self._pours_on or self._will_stand or self._unloads
        if ends and self._phase != Phase.TURNS:  # else the header swings to the cart before it stands
            path = straight
        sent = GuidancePath(t, path.x, path.y, path.number)
        return {"job": job, "path": sent, "header": HeaderCommand(t, is_down)}

    def end_reason(self, t: int) -> str:
        """Why the run ends before the field is empty."""
        return self._ended


LEVEL = Level(
    Harvest,
    Params,
    summary="passes and turns in their order, tank limits, a cart called and waited for",
    cost="0.1 ms per step",
    tolerance="header up and down within 0.2 m of where they should be",
)
