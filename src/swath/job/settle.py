"""Standoffs that nobody solved in time, settled by rank: the higher machine drives on.

A machine is held up while whom it waits for, from one to the next, leads back to it or to one that will not
go by itself. Held up for long near one place it, or the highest of a ring, drives on: ground of those in its
way does not count for it until they are apart. Bodies may overlap then, which is counted as contact.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import SwathError
from swath.job.engine import Job
from swath.job.footprint import overlap
from swath.job.give_way import is_free_of_work, stays, way_of
from swath.job.standoff import Standoff
from swath.job.states import DONE, CartState, CombineState
from swath.job.traffic import GAP, MOVES, Mover

Array = NDArray[np.float64]
State = CombineState | CartState
LONGEST = 180.0  # s held up: three waits of 60 s behind a manoeuvre, each with the time to drive it
PLACE = 80.0  # m around where it was held up first: farther than any manoeuvre leads back
STUCK = 3600.0  # s without grain that comes farther, after which a job is given up
FREE = 60.0  # s without being held up, after which it counts anew


@dataclass
class HeldUp:
    """Where a machine was held up first [m], for how long since [s], and not since [s]."""

    x: float
    y: float
    time: float = 0.0
    free: float = 0.0


@dataclass
class Settle:
    """held: machines that are held up; ignores: whose ground does not count for whom."""

    held: dict[str, HeldUp] = field(default_factory=dict)
    ignores: dict[str, tuple[str, ...]] = field(default_factory=dict)
    _last: float = 0.0
    _done: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _since: float = 0.0

    def look(
        self, time: float, movers: list[Mover], states: Mapping[str, State], fixed: Mapping[str, Array]
    ) -> list[Standoff]:
        """The standoffs that are settled now. movers: in order of precedence; fixed: what stands"""
        dt, self._last = time - self._last, time
        self._part(movers, states, fixed)
        found = []
        for m in movers:
            chain = _held_up_by(m, movers, states)
            if self._count(m, dt, bool(chain)) < LONGEST or not chain:
                continue
            who = min(chain, key=lambda o: (o.name in self.ignores, movers.index(o)))
            ignored = {*self.ignores.get(who.name, ()), *_in_its_way(who, states[who.name], movers, fixed)}
            self.ignores[who.name] = who.ignores = tuple(sorted(ignored))
            for o in chain:
                self.held.pop(o.name, None)
            if who.driver.manoeuvre is not None:
                who.driver.manoeuvre.give_up()
            x, y, _ = who.driver.machine.pose
            found.append(Standoff(time, who.name, who.blocked or who.waits_for, x, y, "", who.name))
        return found

    def check(self, job: Job, standoffs: list[Standoff]) -> None:
        """SwathError where no grain has come farther for long."""
        cut, poured = (math.fsum(x) for x in zip(*((c.cut, c.poured) for c in job.combines), strict=True))
        done = cut, poured, job.at_truck
        if done != self._done or job.away > DONE:
            self._done, self._since = done, job.time
        elif job.time - self._since > STUCK:
            told = [f"{s.first} and {s.second} at ({s.x:.0f}, {s.y:.0f}) m" for s in standoffs[-1:]]
            last = "".join(told) or "none"
            raise SwathError(
                f"the job does not end: nothing goes on since {self._since:.0f} s; last standoff: {last}"
            )

    def _count(self, m: Mover, dt: float, is_held_up: bool) -> float:
        """For how long a machine is held up [s]."""
        p, made = m.driver.machine, self.held.get(m.name)
        if made is None:
            if is_held_up:
                self.held[m.name] = HeldUp(p.x, p.y)
            return 0.0
        made.free = 0.0 if is_held_up else made.free + dt
        if made.free > FREE or math.hypot(p.x - made.x, p.y - made.y) > PLACE:
            del self.held[m.name]
            return 0.0
        made.time += dt if is_held_up else 0.0
        return made.time

    def _part(self, movers: list[Mover], states: Mapping[str, State], fixed: Mapping[str, Array]) -> None:
        """Those who are apart hold their ground against each other again."""
        bodies = {o.name: o.now for o in movers} | dict(fixed)
        for m in movers:
            if m.name not in self.ignores:
                continue
            way = way_of(m, states[m.name])
            ground = m.now if way is None else np.vstack([m.now, way])
            drives = {o.name for o in movers if o.speed > MOVES}
            left = tuple(
                o
                for o in self.ignores[m.name]
                if o in bodies and overlap(m.now if o in drives else ground, bodies[o], GAP)
            )
            if left:
                self.ignores[m.name] = left
            else:
                del self.ignores[m.name]


def _held_up_by(m: Mover, movers: list[Mover], states: Mapping[str, State]) -> list[Mover]:
    """Those of whom one has to drive on: a ring of machines that wait for each other, or the last one who is
    stopped. Empty where one is on its way, or stands for a while only.
    """
    if not _is_stopped(m):
        return []
    by_name, seen = {o.name: o for o in movers}, [m]
    while True:
        other = by_name.get(seen[-1].blocked or seen[-1].waits_for)
        if other is None or is_free_of_work(states[other.name]):
            return [o for o in seen if _is_stopped(o)][-1:]
        if other in seen:
            return [o for o in seen[seen.index(other) :] if _is_stopped(o)]
        if _works(states[other.name]) or (other.speed > MOVES and other.driver.manoeuvre is None):
            return []
        if _is_served_soon(states[other.name], movers, states):
            return []
        seen.append(other)


def _is_stopped(m: Mover) -> bool:
    """True for one whom others do not let go where it would."""
    return bool(m.blocked) or m.waits or m.driver.manoeuvre is not None


def _is_served_soon(state: State, movers: list[Mover], states: Mapping[str, State]) -> bool:
    """True for a combine that stands without a cart while one is at work that nobody stops."""
    if not isinstance(state, CombineState) or state.phase != "stand" or state.cart is not None:
        return False
    carts = [m for m in movers if isinstance(states[m.name], CartState)]
    return any(not _is_stopped(m) and not is_free_of_work(states[m.name]) for m in carts)


def _works(state: State) -> bool:
    """True for one who stands for a while: pours, or is at the truck."""
    if isinstance(state, CombineState):
        return state.is_pouring or state.hauling == "pour"
    return stays(state)


def _in_its_way(who: Mover, state: State, movers: list[Mover], fixed: Mapping[str, Array]) -> set[str]:
    """Names of those over whom its way leads, and of the one that it waits for."""
    way = way_of(who, state)
    bodies = {o.name: o.now for o in movers if o is not who} | dict(fixed)
    found = {n for n, b in bodies.items() if way is not None and overlap(way, b, GAP)}
    return found | ({who.blocked or who.waits_for} - {""})


def waits_for(job: Job, m: State, wanted: float) -> str:
    """Name of the machine that has to act before one can go on that wants no speed [m/s]; "" for nobody."""
    if isinstance(m, CartState):
        is_led = wanted <= 0.0 and m.combine is not None and m.phase in ("to_combine", "beside")
        return m.combine.spec.name if is_led and m.combine is not None else ""
    if m.phase == "stand":
        cart = m.cart or next((k for k in job.carts if k.phase != "idle"), None)
        return "" if cart is None else cart.spec.name
    if (held := job.held(m)).is_held:
        return job.combines[held.by].spec.name
    leader = job.leader_of(m) if m.phase in ("way", "hold", "cut") and wanted < MOVES else None
    return "" if leader is None else leader.spec.name
