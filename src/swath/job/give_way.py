"""Who makes room where two driven machines stand in each other's way.

Whoever has nothing to do does; else the one of lower precedence, and where it cannot the other one. Where
neither can, both stay where they are and the standoff is noted.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swath.job.driver import Driver, Manoeuvre
from swath.job.footprint import overlap
from swath.job.leave import waits_for_cart
from swath.job.path import Path, Pose
from swath.job.standoff import CLEAR, COST_BACK, EVERY, PATIENCE, Standoff, manoeuvre
from swath.job.states import DONE, CartState, CombineState
from swath.job.traffic import MOVES, RESTS, Mover, aside_of

Array = NDArray[np.float64]
State = CombineState | CartState
SOON, SOON_S = 25.0, 8.0  # m, and s of driving of a combine, before one who stands, that it makes room
AGAIN = 6.0  # s until a standoff that nobody could solve is looked at again
SOON_AGAIN, MORE = 90.0, 10.0  # s, m: two who stand again so soon take a manoeuvre that is so much longer
SAME = 600.0  # s, within which a standoff that nobody can solve is noted once
FAR = 80.0  # m of the other one's way that one who has nothing to do leaves
BEHIND = 10.0  # m behind the end of a pass, or its place beside a combine
MEET = 4.0  # times as far looked ahead of two who meet head-on
POURS = 30.0  # s that is waited for one that pours
RUN = 8.0 * COST_BACK  # cost of the way back from where a header comes aside of another one's
NOWHERE: Array = np.zeros((0, 6))  # ground that is clear wherever one stands


@dataclass
class GiveWay:
    """standoffs: all of a job, in order."""

    standoffs: list[Standoff] = field(default_factory=list)
    _since: dict[str, float] = field(default_factory=dict)
    _costs: dict[str, tuple[float, float]] = field(default_factory=dict)
    _tried: dict[str, float] = field(default_factory=dict)
    _still: dict[str, float] = field(default_factory=dict)

    def look(
        self, time: float, movers: list[Mover], states: Mapping[str, State], fixed: Mapping[str, Array],
        way_from: Callable[[str, Pose], Path | None],
    ) -> None:  # fmt: skip
        """Let one of two who stand in each other's way make room. movers: in order of precedence; way_from:
        the way of a machine from a place
        """
        by_name = {m.name: m for m in movers}
        for i, m in enumerate(movers):
            if m.ignores:
                continue
            if self._stands(m, states[m.name], time) and time >= self._tried.get(m.name, 0.0):
                coming = next(
                    (o for k, o in enumerate(movers) if (k < i or o.waits) and _comes(o, m, states)), None
                )
                if coming is not None:
                    self._solve(time, m, coming, movers, states, fixed, way_from)
                    continue
            if not m.blocked or m.speed > RESTS or m.driver.manoeuvre is not None:
                self._since.pop(m.name, None)
                continue
            stood = time - self._since.setdefault(m.name, time)
            other = by_name.get(m.blocked)
            if stood < PATIENCE or time < self._tried.get(m.name, 0.0):
                continue
            if other is not None and not _is_stuck(other, m, states, stood):
                continue
            self._solve(time, m, other, movers, states, fixed, way_from)

    def _stands(self, m: Mover, state: State, time: float) -> bool:
        """True for one that will not drive by itself: it has nothing to do, or has stood for PATIENCE."""
        if m.speed > RESTS or m.driver.manoeuvre is not None:
            self._still.pop(m.name, None)
            return False
        stood = time - self._still.setdefault(m.name, time)
        return is_free_of_work(state) or (stood >= PATIENCE and (m.wanted <= 0.0 or bool(m.blocked)))

    def _solve(
        self, time: float, m: Mover, other: Mover | None, movers: list[Mover], states: Mapping[str, State],
        fixed: Mapping[str, Array], way_from: Callable[[str, Pose], Path | None],
    ) -> None:  # fmt: skip
        self._tried[m.name] = time + AGAIN
        m.blocked = m.blocked or (other.name if other is not None else "")
        pairs = (
            [(m, other)]
            if other is None or other.speed > RESTS or stays(states[other.name])
            else [(m, other), (other, m)]
        )
        pairs.sort(
            key=lambda p: (
                not is_free_of_work(states[p[0].name]), self._was_soon(p, m, time),
                states[p[0].name].phase == "cut", -movers.index(p[0]),
            )
        )  # fmt: skip
        for who, whom in pairs:
            pair = _names(who, whom, m)
            last, cost = self._costs.get(pair, (-math.inf, 0.0))
            least = cost + MORE if time - last < SOON_AGAIN else 0.0
            made = self._manoeuvre(who, whom, m.blocked, movers, states, fixed, way_from, least)
            if made is not None:
                self._costs[pair] = time, made[0][3]
                who.reserved = made[0][2]
                who.driver.held = np.vstack([who.driver.held, made[0][2]])
                who.driver.manoeuvre = Manoeuvre(
                    *made[0][:2],
                    m.blocked if whom is None else whom.name,
                    time,
                    made[0][2],
                    made[1],
                    apart=EVERY,
                )
                self._note(time, m, who.name)
                return
        self._note(time, m, "")

    def _was_soon(self, pair: tuple[Mover, Mover | None], m: Mover, time: float) -> bool:
        """Whether the first of two has made room a moment ago for the second, which a third one stops: now it
        is the second's turn.
        """
        who, whom = pair
        if whom is None or whom.blocked in ("", who.name):
            return False
        return time - self._costs.get(_names(who, whom, m), (-math.inf, 0.0))[0] < SOON_AGAIN

    def stood(self, name: str, time: float) -> float:
        """For how long one is stopped by another one [s]."""
        return time - self._since.get(name, time)

    def _note(self, time: float, m: Mover, by: str) -> None:
        pair = {m.name, m.blocked}
        if not by and any({s.first, s.second} == pair and time - s.time < SAME for s in self.standoffs):
            return
        x, y, _ = m.driver.machine.pose
        self.standoffs.append(Standoff(time, m.name, m.blocked, x, y, by))

    def _manoeuvre(
        self, who: Mover, whom: Mover | None, name: str, movers: list[Mover], states: Mapping[str, State],
        fixed: Mapping[str, Array], way_from: Callable[[str, Pose], Path | None],
        least: float,
    ) -> tuple[tuple[float, Path | None, Array, float], bool] | None:  # fmt: skip
        """Way back and path, and whether it waits behind them until the other one is past."""
        state = states[who.name]
        if not _may(state) or who.reserved is not None or who.ignores:
            return None
        only_back = isinstance(state, CombineState) and state.phase == "cut"
        others = [o.driver.held for o in movers if o is not who] + list(fixed.values())
        radius = state.spec.limits.radius if isinstance(state, CombineState) else 8.0
        far = FAR if is_free_of_work(state) else CLEAR
        ahead = None if whom is None else way_of(whom, states[whom.name], far)
        if ahead is not None:
            made = manoeuvre(
                who.driver, others, ahead, None, ahead, radius=radius, only_back=only_back, least=least
            )
            if made is not None:
                return made, True
        there = fixed[name] if whom is None else whom.now
        if only_back and whom is not None and aside_of(who, whom) != 0.0:
            made = manoeuvre(
                who.driver, others, NOWHERE, None, there, radius=radius, only_back=True, least=max(least, RUN)
            )
            return None if made is None else (made, False)
        if only_back or is_free_of_work(state):
            return None
        made = manoeuvre(
            who.driver,
            others,
            None,
            lambda pose: _known(way_from(who.name, pose)),
            there,
            radius=radius,
            least=least,
        )
        return None if made is None else (made, False)


def _names(who: Mover, whom: Mover | None, m: Mover) -> str:
    return f"{who.name} {m.blocked if whom is None else whom.name}"


def stands_alone(state: State) -> bool:
    """True for a combine that stands with no cart beside it: it goes only when one has been there."""
    if not isinstance(state, CombineState) or state.phase != "stand" or state.is_pouring:
        return False
    return state.cart is None or state.cart.phase != "beside"


def _comes(o: Mover, m: Mover, states: Mapping[str, State]) -> bool:
    """True where one of higher precedence drives soon over where a machine stands that can make room."""
    state = states[m.name]
    if (
        (o.speed < MOVES and not o.waits)
        or o is m
        or not _may(state)
        or state.phase == "cut"
        or (state.phase == "beside" and o.name != m.after)
        or m.reserved is not None
    ):
        return False
    p, q = o.driver.machine, m.driver.machine
    soon = SOON + (0.0 if o.driver.footprint.towed else SOON_S * o.speed)
    if math.hypot(p.x - q.x, p.y - q.y) > soon + 20.0:
        return False
    way = way_of(o, states[o.name], soon)
    return way is not None and overlap(way, m.now)


def _known(path: Path | None) -> Path:
    assert path is not None
    return path


def way_of(m: Mover, state: State, most: float = CLEAR) -> Array | None:
    """Ground that a machine goes over next; None where it is not going anywhere."""
    if m.waits and m.wished is not None:
        return m.wished
    if m.driver.follower is None or stays(state) or is_free_of_work(state):
        return None
    left = m.driver.left
    if state.phase in ("cut", "to_combine"):  # its path goes on behind that
        left = min(left, state.left + BEHIND)
    count = math.ceil(min(most, left) / EVERY)
    return np.vstack(
        [m.now, m.driver.footprint.sweep(m.driver.ahead([EVERY * (i + 1) for i in range(count)]))]
    )


def is_free_of_work(state: State) -> bool:
    """True for a machine that has nothing to do."""
    return state.phase in ("idle", "done")


def stays(state: State) -> bool:
    """True for a machine that stands for a reason, and does not make room."""
    if isinstance(state, CombineState):
        return state.phase in ("stand", "hold") and not waits_for_cart(state)
    return state.phase in ("queue", "emptying") or is_at_work(state)


def is_at_work(k: CartState) -> bool:
    """True for a cart that takes grain, or gets in line beside a combine that stands with some."""
    c = k.combine
    return k.phase == "beside" and c is not None and (c.is_pouring or (c.phase == "stand" and c.tank > DONE))


def _may(state: State) -> bool:
    """True for a machine that can make room now."""
    if isinstance(state, CombineState):
        pours = state.is_pouring and state.tank > DONE
        return waits_for_cart(state) or (state.phase in ("way", "done", "cut") and not pours)
    return state.phase in ("idle", "to_combine", "to_truck") or (
        state.phase == "beside" and not is_at_work(state)
    )


def _is_stuck(other: Mover, m: Mover, states: Mapping[str, State], stood: float) -> bool:
    """True where one who stands in the way will not go by itself soon."""
    if other.speed > RESTS or other.driver.manoeuvre is not None:
        return False
    state = states[other.name]
    if stays(state):
        return max(stood, _stands_for(state)) > POURS or stands_alone(state)
    if other.blocked not in ("", m.name):
        return stood > 3.0 * PATIENCE
    return True


def _stands_for(state: State) -> float:
    """How long a combine with a cart beside it, or that cart, still stands until the tank is empty [s]."""
    c = state if isinstance(state, CombineState) else state.combine
    if c is None or c.phase != "stand" or c.cart is None or c.cart.phase != "beside":
        return 0.0
    return c.timer + c.tank / c.spec.auger


def room_for(driver: Driver, way: Path | None, other: Driver) -> bool:
    """True where a machine's way, a new one or its own, is clear of another one's for some metres; where they
    meet head-on, for more.
    """
    far = MEET if _meet(driver, way, other) else 1.0
    lengths = [2.0 * i * far for i in range(1, 9)]
    ahead = driver.ahead(lengths) if way is None else [(p, p.heading) for p in map(way.at, lengths)]
    mine = driver.footprint.sweep([driver.place, *ahead])
    theirs = other.footprint.sweep([other.place, *other.ahead([2.0 * i * far for i in range(1, 11)])])
    return not overlap(mine, theirs, 0.3)


def _meet(driver: Driver, way: Path | None, other: Driver) -> bool:
    """True where a way leads against the direction of another one's."""
    if way is None or other.follower is None:
        return False
    mine, theirs = way.at(8.0 * MEET).heading, other.ahead([10.0 * MEET])[0][1]
    return math.cos(mine - theirs) < -0.7
