"""Who serves whom, when: the one place where that is decided, at every level.

Whenever a combine is done with what it was given, the schedule works out what it could do next: cut on, with
or without a cart that comes beside, or have its tank emptied standing; each with the times that follow from
granted ground. A dispatcher takes one of them, or lets another combine go first. `horizon` looks ahead over
the next loads of all, `greedy` does not. Your own is a class in a Python file, named in the job as
`fleet: {dispatcher: my.py:Class}`, with this one method `decide`.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from swath.core.errors import InputError
from swath.core.foreign_code import load_python
from swath.core.random import Stream


@dataclass(frozen=True)
class Params:
    """Settings of the look ahead; estimates.

    loads: loads of each combine that the horizon looks ahead, as many as a cart's box holds of tanks
    saves_s: time below which a gain is no reason to let another one go first, more than turns take
    off_s: most that drawn estimates are off
    """

    loads: int = 2
    saves_s: float = 60.0
    off_s: float = 60.0


PARAMS = Params()


@dataclass(frozen=True)
class Option:
    """What a combine could do next.

    kind: `cut`; `beside` = cut with a cart beside; `stand` = a cart comes to where it stands; `truck` = it
        drives to the truck itself
    cart: name of the cart, "" without
    begins: when unloading begins [s]
    ends: when the combine is done [s]
    load: grain that is taken out of its tank [kg]
    tank: grain in its tank afterwards [kg]
    cart_free: when the cart is at its place again [s]
    pours: duration of unloading [s]
    cuts: duration of cutting [s]
    cart_next: when the cart can set out to another load [s]
    room: room in the cart's box then [kg]
    """

    kind: str
    cart: str
    begins: float
    ends: float
    load: float
    tank: float
    cart_free: float
    pours: float
    cuts: float = 0.0
    cart_next: float = 0.0
    room: float = 0.0

    @property
    def lost(self) -> float:
        """Time that the option loses [s].

        It is the time until the combine is done, less the time in which it cuts and the time that unloading
        the same grain while standing would take.
        """
        return self.ends - self.cuts - self.pours


@dataclass(frozen=True)
class Ahead:
    """A combine as it will be when it is done with what it was given.

    time: when that is [s]
    level: grain in its tank then [kg]
    tank: capacity of its tank [kg]
    fills: grain that it cuts [kg/s], 0 for one that has nothing left to cut
    """

    time: float
    level: float
    tank: float
    fills: float

    @property
    def full(self) -> float:
        """When its tank is full, if it cuts on [s]."""
        return self.time + (self.tank - self.level) / self.fills if self.fills > 0.0 else math.inf


@dataclass(frozen=True)
class State:
    """What a dispatcher knows when it decides.

    time: now [s]
    combine: name of the combine that asks
    level: grain in its tank [kg]
    tank: capacity of its tank [kg]
    call: level from which a cart may come [kg]
    carts: by name (time from which it is free [s], room in its box [kg])
    passes_left: passes of the whole field that nobody has been given
    options: what the combine can do, in no order
    fills: grain that it cuts [kg/s]
    others: the other combines, by name
    comes: by cart when it could be there [s]
    ways: by cart about how long it takes from the truck to there [s]
    at_truck: by cart how long it stays at the truck [s]
    boxes: by cart (grain in its box, load from which it drives to the truck) [kg]
    places: by machine x, y in the field's frame where it is done or free [m]
    soonest: by kind of an option the least time until the combine could do that, if no other machine had the
        ground [s]
    may_wait: whether another combine may go first, once
    """

    time: float
    combine: str
    level: float
    tank: float
    call: float
    carts: dict[str, tuple[float, float]]
    passes_left: int
    options: tuple[Option, ...]
    fills: float = 0.0
    others: dict[str, Ahead] = field(default_factory=dict)
    comes: dict[str, float] = field(default_factory=dict)
    ways: dict[str, float] = field(default_factory=dict)
    at_truck: dict[str, float] = field(default_factory=dict)
    boxes: dict[str, tuple[float, float]] = field(default_factory=dict)
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    soonest: dict[str, float] = field(default_factory=dict)
    may_wait: bool = False


class Dispatcher(Protocol):
    """What a dispatcher does."""

    def decide(self, state: State) -> Option | None:
        """One of the options, None to be asked again when another combine was given something."""


class Greedy:
    """The option that costs the least time now; of those alike the one whose cart is free first."""

    def decide(self, state: State) -> Option:
        """Choose one of the options."""
        return min(state.options, key=lambda o: (round(o.lost, 1), o.cart_free, *_alike(o)))


class Horizon:
    """The option that costs the least time of all combines, now and in the next loads of each; or none, where
    who is in the way goes on before. draw: number by which its estimates are off at random, 0: they are not.
    """

    def __init__(self, draw: int = 0) -> None:
        self._random = Stream(draw, "horizon").at() if draw else None

    def decide(self, state: State) -> Option | None:
        """Choose one of the options, or None."""
        off = np.zeros(len(state.options))
        if self._random is not None:
            off = self._random.uniform(0.0, PARAMS.off_s, len(off))
        costs = {
            o: (round(o.lost + more + self.waits(state, o), 1), round(o.lost, 1), o.cart_free, *_alike(o))
            for o, more in zip(state.options, off.tolist(), strict=True)
        }
        best = min(state.options, key=costs.__getitem__)
        if state.may_wait:
            lost = best.lost - state.time - state.soonest.get(best.kind, 0.0)
            goes_on = min(o.time for o in state.others.values()) - state.time
            if lost - PARAMS.saves_s > max(goes_on, 0.0):
                return None
        return best

    @staticmethod
    def waits(state: State, option: Option) -> float:
        """About how long combines wait for carts in their next loads behind an option [s]: each is emptied
        when its tank is full, by the cart that is there first; a cart with its load drives to the truck.
        """
        carts = {name: (state.comes[name], room) for name, (_, room) in state.carts.items()}
        if option.cart:
            is_empty = option.room >= state.boxes[option.cart][0]
            way = state.ways[option.cart] if is_empty else 0.0
            carts[option.cart] = option.cart_next + way, option.room
        if not carts:
            return 0.0
        own = Ahead(option.ends, option.tank, state.tank, state.fills)
        calls = [(c.full, c) for c in (*state.others.values(), own) if c.fills > 0.0]
        waits = 0.0
        for _ in range(PARAMS.loads * len(calls)):
            calls.sort(key=lambda call: call[0])
            time, c = calls[0]
            name = min(carts, key=lambda k: (max(time, carts[k][0]), *carts[k], *state.boxes[k]))
            come, room = max(time, carts[name][0]), carts[name][1]
            waits += come - time
            load = min(c.tank, room)
            full, leaves = state.boxes[name]
            if full - room + load >= leaves:
                carts[name] = come + 2.0 * state.ways[name] + state.at_truck[name], full
            else:
                carts[name] = come, room - load
            calls[0] = come + load / c.fills, c
        return waits


def _alike(option: Option) -> tuple[Any, ...]:
    """By what options that cost alike are told apart: never by name, nor by their order."""
    return option.kind, option.ends, option.begins, option.load, option.cart_next, option.room


BUILT_IN = "horizon", "greedy"


def dispatcher_of(name: str, base: Path | None, draw: int = 0) -> Dispatcher:
    """One of `BUILT_IN`, or a class of the user's as `file.py:Class`. InputError for one without `decide`."""
    if name in BUILT_IN:
        return Horizon(draw) if name == "horizon" else Greedy()
    made: Any = _own(name, base)
    if not callable(getattr(made, "decide", None)):
        raise InputError("fleet.dispatcher", name, "expected a class with a method `decide`")
    return made  # type: ignore[no-any-return]


def _own(name: str, base: Path | None) -> Any:
    file, colon, kind = name.partition(":")
    if not colon or not file.endswith(".py"):
        raise InputError("fleet.dispatcher", name, "expected `horizon`, `greedy` or `file.py:Class`")
    module = load_python("fleet.dispatcher", name, base)
    if not hasattr(module, kind):
        raise InputError("fleet.dispatcher", name, f"expected a class {kind} in {file}")
    return getattr(module, kind)()
