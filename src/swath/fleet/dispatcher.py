"""Who serves whom, when: the one place where that is decided, at every level.

Whenever a combine is done with what it was given, the schedule works out what it could do next: cut on, with
or without a cart that comes beside, or have its tank emptied standing; each with the times that follow from
granted ground. A dispatcher takes one of them. Your own is a class in a Python file, named in the job as
`fleet: {dispatcher: my.py:Class}`, with this one method `decide`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from swath.core.errors import InputError
from swath.core.foreign_code import load_python


@dataclass(frozen=True)
class Option:
    """What a combine could do next. kind: `cut`, `beside` (cut, a cart beside), `stand` (a cart comes to
    where it stands) or `truck` (it drives there itself); cart: name, "" without; begins: of pouring; ends:
    when the combine is done [s]; load: that is taken out of its tank [kg]; tank: level behind [kg];
    cart_free: when the cart is at its place again [s]; pours, cuts: how long [s]
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


@dataclass(frozen=True)
class State:
    """What is known when it is decided. time [s]; combine: name; level, tank: of it [kg]; call: level from
    which a cart may come [kg]; carts: name -> (free from [s], room in its box [kg]); passes_left: of all;
    options: what it can do, in no order
    """

    time: float
    combine: str
    level: float
    tank: float
    call: float
    carts: dict[str, tuple[float, float]]
    passes_left: int
    options: tuple[Option, ...]


class Dispatcher(Protocol):
    """What a dispatcher does."""

    def decide(self, state: State) -> Option:
        """One of the options."""


class Greedy:
    """The option that costs the least time now: when the combine is done, less its time of cutting and what
    the load that is taken would cost to be taken standing; of those alike the one whose cart is free first.
    """

    def decide(self, state: State) -> Option:
        """One of the options."""
        return min(state.options, key=lambda o: (round(o.ends - o.cuts - o.pours, 1), o.cart_free, o.cart))


def dispatcher_of(name: str, base: Path | None) -> Dispatcher:
    """`greedy`, or a class of the user's as `file.py:Class`. InputError for one without `decide`."""
    if name == "greedy":
        return Greedy()
    made: Any = _own(name, base)
    if not callable(getattr(made, "decide", None)):
        raise InputError("fleet.dispatcher", name, "expected a class with a method `decide`")
    return made  # type: ignore[no-any-return]


def _own(name: str, base: Path | None) -> Any:
    file, colon, kind = name.partition(":")
    if not colon or not file.endswith(".py"):
        raise InputError("fleet.dispatcher", name, "expected `greedy` or `file.py:Class`")
    module = load_python("fleet.dispatcher", name, base)
    if not hasattr(module, kind):
        raise InputError("fleet.dispatcher", name, f"expected a class {kind} in {file}")
    return getattr(module, kind)()
