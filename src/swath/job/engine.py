"""The decisions of a job: who cuts, calls, follows, pours and drives to the truck, and when.

Machines are moved by a `Motion`: the cheap one jumps from event to event, the other drives every machine in
steps of a tenth of a second. Decisions are the same for both, and so is the grain: what is cut per metre of
a pass is its ground times the yield over its length.
"""

import math

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import SwathError
from swath.job import pouring
from swath.job.cart_ways import beside
from swath.job.combine_ways import behind_first
from swath.job.fleet import FleetFile
from swath.job.foresight import is_needed_soon
from swath.job.grain import leaves, move_grain
from swath.job.machines import Fleet
from swath.job.meetings import Held, Meetings
from swath.job.motion import Motion
from swath.job.path import Pose
from swath.job.plan import FieldPlan, Shared
from swath.job.shared_ways import SharedWays
from swath.job.states import (
    DONE,
    CartState,
    CombineState,
    at,
    cart_state,
    same_way,
    way_between,
)
from swath.job.team import Passes
from swath.job.truck_ways import place_at_truck

Array = NDArray[np.float64]
LONGEST = 400.0 * 3600.0  # s
MOST_MOVES = 20_000_000
DRIVES_UP = 35.0  # s, that a cart which waited for another one at the truck drives up. Estimate: with sensors


class Job:
    """A field being worked off. time [s]; room: in the trucks that wait [kg]; ways: of combines between
    passes, points (n, 2) [m] each. plan: shared out among combines before, or whoever is done takes the next
    pass
    """

    def __init__(
        self,
        file: FleetFile,
        plan: FieldPlan | Shared,
        fleet: Fleet,
        motion: Motion,
    ) -> None:
        of = plan if isinstance(plan, Shared) else Shared(plan, [], {})
        plan, by, self.turns = of.plan, of.by or None, of.turns
        self.file, self.plan, self.fleet, self.motion = file, plan, fleet, motion
        self.grain_per_m2 = file.field.yield_t_ha / 10.0
        self.truck = Pose(file.truck.x_m, file.truck.y_m, 0.0)
        first = plan.passes[0].start
        self.combines = [CombineState(c, i, first, c.start) for i, c in enumerate(fleet.combines)]
        self.passes = Passes(plan, self.combines, file.team.together, by)
        self.drives_up = DRIVES_UP if of.told else 0.0
        self.meetings = Meetings(of.told, of.crossings, self.combines) if of.crossings else None
        self.places = [place_at_truck(self.truck, plan.boundary, i) for i in range(len(fleet.carts))]
        searches = of.told and of.turns and file.team.together != "echelon"
        lead = fleet.combines[0]
        self.shared_ways = SharedWays(of.told, plan.boundary, lead, self.places) if searches else None
        self.carts = [CartState(c, p) for c, p in zip(fleet.carts, self.places, strict=True)]
        self.time, self.moves = 0.0, 0
        volume = file.truck.volume_m3
        self.capacity = math.inf if volume is None else volume * fleet.density
        self.room, self.away = self.capacity, 0.0
        self.at_truck = 0.0
        self.started = math.fsum(c.tank for c in self.combines)
        self.cut_now: dict[int, float] = {}
        self.ways: list[Array] = []
        self.pass_times: dict[int, tuple[float, float]] = {}

    def run(self, until: float = math.inf) -> None:
        """Until all is cut and brought, or a time [s]; again: onward. SwathError where it does not end."""
        if self.moves == 0:
            for combine in self.combines:
                self._next_pass(combine)
        while self.time < until:
            self._decide()
            if self.is_over:
                return
            self._move()

    def _move(self) -> None:
        before, self.cut_now = self.time, {}
        if self.meetings is not None:
            self.meetings.update(self.time, self.combines)
        dt = self.motion.move(self)
        self.moves += 1
        if not dt > 0.0 or self.time > LONGEST or self.moves > MOST_MOVES:
            machines: list[CombineState | CartState] = [*self.combines, *self.carts]
            stuck = ", ".join(f"{m.spec.name} {m.phase}" for m in machines)
            raise SwathError(f"the job does not end: after {self.time / 3600.0:.2f} h {stuck}")
        self.time += dt
        move_grain(self, dt)
        self._note(before)

    @property
    def is_over(self) -> bool:
        """True when all is cut and all grain at the truck."""
        return all(c.phase == "done" for c in self.combines) and all(
            k.phase == "idle" and k.grain <= DONE for k in self.carts
        )

    def start_behind(self, combine: CombineState) -> float:
        """How far before its first pass a combine begins the job [m]: in echelon one behind another."""
        return behind_first(self.combines[0], combine) if self.file.team.together == "echelon" else 0.0

    def place_at_truck(self, cart: CartState) -> Pose:
        """Where a cart stands to be emptied."""
        return self.places[self.carts.index(cart)]

    def leader_of(self, combine: CombineState) -> CombineState | None:
        """The combine on the pass before in the same direction, in echelon; None where nobody is there."""
        if self.file.team.together != "echelon" or combine.task is None:
            return None
        for other in self.combines:
            ahead = other.task is not None and other.phase in ("cut", "stand", "way", "hold")
            if ahead and other.index == combine.index - 1 and same_way(other, combine):
                return other
        return None

    def held(self, combine: CombineState) -> Held:
        """Where a combine has to wait for another one."""
        return Held() if self.meetings is None else self.meetings.held(combine)

    def gap(self, leader: CombineState, combine: CombineState) -> float:
        """How far a leader is ahead of the one behind it, along the follower's pass [m]."""
        assert leader.task is not None
        assert combine.task is not None
        if leader.phase in ("way", "hold"):
            return -math.inf
        course = combine.task.start.heading
        ahead = at(leader), at(combine)
        return (ahead[0].x - ahead[1].x) * math.cos(course) + (ahead[0].y - ahead[1].y) * math.sin(course)

    # what machines decide

    def _decide(self) -> None:
        """Let machines react until nothing changes any more."""
        for _ in range(1000):
            changed = [self._combine(c) for c in self.combines] + [self._cart(k) for k in self.carts]
            if not any(changed) and not self._calls():
                return
        raise SwathError("the job's machines react to each other without end")

    def _combine(self, c: CombineState) -> bool:
        if pouring.pours(self, c):
            return True
        return any(rule(c) for rule in (self._arrives, self._cuts, self._stands, self._hauls))

    def _arrives(self, c: CombineState) -> bool:
        if c.phase not in ("way", "hold") or (c.phase == "way" and c.left > DONE):
            return False
        leader = self.leader_of(c)
        assert c.task is not None
        c.place = c.task.start
        if leader is not None and self.gap(leader, c) < self.file.team.lag_m - DONE:
            was, c.phase, c.state, c.pace = c.phase, "hold", "wait", 0.0
            return was != "hold"
        c.phase, c.state, c.left = "cut", "cut", c.task.length
        c.per_metre = c.task.area * self.grain_per_m2 / c.task.length
        c.pace = c.spec.speed_in(c.per_metre)
        if c.cart is not None and c.cart.phase == "beside":
            c.timer = pouring.ready_after(self, c)
        self.pass_times[c.index] = (self.time, math.nan)
        self.motion.begin_cut(self, c)
        return True

    def _cuts(self, c: CombineState) -> bool:
        if c.phase != "cut":
            return False
        if c.left <= DONE:
            return self._ends_pass(c)
        if (c.tank >= c.spec.tank - DONE or self._pours_while_blocked(c)) and not c.is_pouring:
            self._stand(c, "wait")
            if c.cart is not None and c.cart.phase == "beside":
                c.timer = max(c.timer, pouring.ready_after(self, c))
            return True
        return False

    def _pours_while_blocked(self, c: CombineState) -> bool:
        """In echelon behind one that stands: true where a cart is beside it and it only pours standing."""
        if self.file.unload.mode == "on_the_go" or c.cart is None or c.cart.phase != "beside":
            return False
        leader = self.leader_of(c)
        if leader is None or leader.phase != "stand" or c.tank <= DONE:
            return False
        return self.gap(leader, c) <= self.file.team.lag_m + 1.0

    def _ends_pass(self, c: CombineState) -> bool:
        assert c.task is not None
        started = self.pass_times.get(c.index, (self.time, math.nan))[0]
        if math.isnan(self.pass_times.get(c.index, (0.0, 0.0))[1]):
            self.pass_times[c.index] = (started, self.time)
            c.area += c.task.area
            self.passes.done(c.index)
        c.place = c.task.end
        if c.is_pouring and c.tank > DONE:
            rest, unload = c.tank / c.spec.auger, self.file.unload
            if unload.at_row_end == "finish" and (rest <= unload.finish_s or not self.goes_on_pouring(c)):
                self._stand(c, "unload")
                return True
            c.is_pouring = False
            pouring.note_load(c)
        elif pouring.waits_at_end(self, c):
            self._stand(c, "wait")
            return True
        self._next_pass(c)
        return True

    def goes_on_pouring(self, c: CombineState) -> bool:
        """Whether a cart may drive beside its next pass, which it takes now."""
        index = self.passes.take(c)
        c.taken = -1 if index is None else index
        return index is not None and self.passes[index].cart_beside

    def _next_pass(self, c: CombineState) -> None:
        index = c.taken if c.taken >= 0 else self.passes.take(c)
        c.taken = -1
        if index is None:
            c.is_last, c.task, c.index, c.left = True, None, -1, 0.0
            self._stand(c, "wait")
            self._bring_cart(c)
            return
        c.before, c.index, c.task, c.phase = c.index, index, self.passes[index], "way"
        c.state, known = "turn", len(self.ways)
        self.motion.combine_way(self, c)
        c.turn = self.ways[-1] if len(self.ways) > known else None
        self._bring_cart(c)

    def _bring_cart(self, c: CombineState) -> None:
        """The cart of a combine that turns drives to its next pass; beside its last one it stays."""
        cart = c.cart
        if cart is None or (c.is_last and cart.phase == "beside"):
            return
        if cart.phase == "beside":
            cart.place = beside(c.place, c.spec, cart.spec)
        cart.phase = "to_combine"
        self.motion.cart_to_combine(self, cart)

    def _stand(self, c: CombineState, why: str) -> None:
        c.phase, c.state, c.pace, c.since = "stand", why, 0.0, self.time

    def _stands(self, c: CombineState) -> bool:
        if c.phase != "stand" or c.hauling:
            return False
        if c.is_pouring:
            state = "unload"
            if c.left > DONE and pouring.may_pour_driving(self, c):
                self._go_on(c)
                return True
            changed, c.state = c.state != state, state
            return changed
        if c.tank > DONE and (c.is_last or c.tank >= 0.5 * c.spec.tank or self._pours_while_blocked(c)):
            return False
        if c.is_last:
            c.phase, c.state = "done", "wait"
            return True
        self._go_on(c)
        return True

    def _go_on(self, c: CombineState) -> None:
        """From standing: along the pass, or to the next one where it is at its end.

        A combine that came to its end while it braked ends the pass from there.
        """
        if c.left > DONE or math.isnan(self.pass_times[c.index][1]):
            c.phase, c.state = "cut", "cut"
            c.pace = c.spec.speed_in(c.per_metre)
        else:
            self._next_pass(c)

    def _calls(self) -> bool:
        """One of the free carts goes to one of the combines that call: where that is needed soonest."""
        pairs = [(k, c) for c in self.combines if self._wants(c) for k in self.carts if self._may_go(k, c)]
        if pairs:
            self.hand_over(*min(pairs, key=self._need))
        return bool(pairs)

    def _may_go(self, k: CartState, c: CombineState) -> bool:
        """Whether a cart may drive to a combine: it is free, or its own one waits for another one while that
        combine stands.
        """
        own = k.combine
        may_leave = c.phase == "stand" and own is not None and not own.is_pouring and self.held(own).is_held
        return (may_leave or k.phase == "idle") and not leaves(self, k)

    def hand_over(self, cart: CartState, c: CombineState) -> None:
        """A cart that takes no grain drives to a combine; one that it was to drive to may call anew."""
        was = cart.combine
        if was is not None:
            if cart.phase == "beside":
                begins = was.phase in ("way", "hold")
                there = was.task.start if was.task is not None and begins else at(was)
                cart.place = beside(there, was.spec, cart.spec)
            was.cart, was.called = None, False
        c.called, c.cart, cart.combine, cart.phase = True, cart, c, "to_combine"
        self.motion.cart_to_combine(self, cart)

    def _wants(self, c: CombineState) -> bool:
        ends = c.phase == "stand" or (c.phase in ("way", "cut") and self.passes.left() == 0)
        may = not c.called and c.phase != "done"
        return may and (c.tank >= c.spec.call or (ends and c.tank > DONE) or is_needed_soon(self, c))

    def _need(self, pair: tuple[CartState, CombineState]) -> tuple[float, int, str]:
        """Time that a cart needs to a combine and that this has until its tank is full, < 0 where it stands
        full already, together [s]: by a moment more or less nobody is sent across the field.
        """
        k, c = pair
        grain = c.per_metre * c.spec.speed_in(c.per_metre) if c.per_metre > 0.0 else math.inf
        stands = c.phase == "stand" and (not c.is_last or self._holds_up(c))
        until = c.since - self.time if stands else (c.spec.tank - c.tank) / grain
        return until + way_between(k.place, at(c)) / k.spec.speed, c.number, k.spec.name

    def _holds_up(self, c: CombineState) -> bool:
        """Whether another combine has to wait for it here."""
        return any(held.is_held and held.by == c.number for held in map(self.held, self.combines))

    def _hauls(self, c: CombineState) -> bool:
        """Without carts: to the truck and back."""
        if self.carts:
            return False
        if c.phase == "stand" and not c.hauling and c.tank > DONE:
            c.hauling, c.phase, c.state = "there", "haul", "transport"
            c.called = c.left > DONE
            c.way_back, c.rest = at(c), c.left
            self.motion.combine_to(self, c, self.truck)
            return True
        if c.phase == "haul" and c.left <= DONE:
            c.place = self.truck
            self._stand(c, "unload")
            c.timer = self.file.truck.dock_s + c.spec.swing
            c.hauling = "pour"
            return True
        if c.hauling == "pour" and c.timer <= DONE and c.tank <= DONE:
            c.hauling, c.phase, c.state = "back", "back", "transport"
            self.motion.combine_to(self, c, c.way_back)
            return True
        if c.phase == "back" and c.left <= DONE:
            c.place, c.left, c.hauling, c.called = c.way_back, c.rest, "", False
            self._stand(c, "wait")
            return True
        return False

    def _cart(self, k: CartState) -> bool:
        if k.phase == "to_combine" and k.left <= DONE:
            assert k.combine is not None
            k.phase = "beside"
            k.combine.timer = pouring.ready_after(self, k.combine)
            return True
        if k.phase == "idle" and k.grain > DONE and (leaves(self, k) or self._no_more()):
            k.phase = "to_truck"
            self.motion.cart_to_truck(self, k)
            return True
        if k.phase == "to_truck" and k.left <= DONE:
            k.phase, k.place = "queue", self.place_at_truck(k)._replace(heading=k.place.heading)
            return True
        if k.phase == "queue" and self.away <= DONE and not any(o.phase == "emptying" for o in self.carts):
            k.phase, k.timer = "emptying", self.file.truck.dock_s + (self.drives_up if k.queued else 0.0)
            k.queued = False
            return True
        k.queued |= k.phase == "queue"
        if k.phase == "emptying" and k.timer <= DONE and k.grain <= DONE:
            k.phase = "idle"
            return True
        if self.room <= DONE and self.away <= DONE:
            self.away, self.room = max(60.0 * self.file.truck.away_min, 1.0), self.capacity
            return True
        return False

    def _no_more(self) -> bool:
        """True when no combine will pour again."""
        return all(c.phase == "done" for c in self.combines)

    # times

    def pours_at_truck(self, k: CartState) -> bool:
        """True while a cart's auger runs at the truck."""
        return k.phase == "emptying" and k.timer <= DONE and self.away <= DONE and self.room > DONE

    def _note(self, before: float) -> None:
        """Add what each machine did to its timeline."""
        for c in self.combines:
            if c.phase != "done":
                state = "wait" if self.held(c).is_held else c.state
                c.timeline.add(state, before, self.time, c.index if state == "cut" else -1)
        for k in self.carts:
            k.timeline.add(cart_state(k), before, self.time)
