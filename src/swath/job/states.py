"""What a job remembers of each machine while it goes on."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swath.job.machines import Cart, Combine
from swath.job.path import Pose
from swath.job.plan import PlannedPass
from swath.job.timeline import Timeline

Array = NDArray[np.float64]
BESIDE = 20.0  # m to a combine's header
DONE = 1e-6  # m, s or kg: nothing left


@dataclass
class CombineState:
    """phase: way (to a pass), hold (until the one ahead is far enough), cut, stand, haul, back, done.

    left: of the way or the pass [m]; pace: wanted speed now [m/s]; tank, cut, poured [kg]; index: of the
    pass; before: of the one before it; taken: of the next one, while it stands at the end of this one; -1 =
    none
    timer: until pouring may begin [s]; since: when it came to stand [s]; hauling: there, pour or back,
    without carts, from way_back with `rest` of its pass left [m]; called: a cart is on its way or wanted
    turn: its way to the pass, points (n, 2) [m]; None in a corner
    """

    spec: Combine
    number: int
    place: Pose
    tank: float
    phase: str = "way"
    state: str = "turn"
    left: float = 0.0
    pace: float = 0.0
    speed: float = 0.0
    index: int = -1
    before: int = -1
    taken: int = -1
    task: PlannedPass | None = None
    per_metre: float = 0.0
    cart: "CartState | None" = None
    called: bool = False
    is_pouring: bool = False
    timer: float = 0.0
    since: float = 0.0
    is_last: bool = False
    cut: float = 0.0
    area: float = 0.0
    poured: float = 0.0
    way: float = 0.0
    fuel: float = 0.0
    hauling: str = ""
    way_back: Pose = field(default_factory=lambda: Pose(0.0, 0.0, 0.0))
    rest: float = 0.0
    turn: Array | None = None
    timeline: Timeline = field(default_factory=Timeline)
    loads: list[tuple[float, float, str]] = field(default_factory=list)
    """Begin, grain [kg] and kind (`on the go`, `standing`) of each load poured."""


@dataclass
class CartState:
    """phase: idle, to_combine, beside, to_truck, queue, emptying. left [m]; timer [s]; grain [kg]; queued: it
    has waited for another one at the truck
    """

    spec: Cart
    place: Pose
    phase: str = "idle"
    left: float = 0.0
    speed: float = 0.0
    timer: float = 0.0
    grain: float = 0.0
    queued: bool = False
    delivered: float = 0.0
    way: float = 0.0
    fuel: float = 0.0
    combine: CombineState | None = None
    timeline: Timeline = field(default_factory=Timeline)


def cart_state(k: CartState) -> str:
    """What a cart does, in a word of its timeline."""
    if k.phase in ("to_combine", "to_truck"):
        return "transport"
    if k.phase == "emptying":
        return "unload"
    return "load" if k.phase == "beside" and k.combine is not None and k.combine.is_pouring else "wait"


def at(c: CombineState) -> Pose:
    """Where a combine's header is."""
    if c.task is None or c.phase not in ("cut", "stand") or c.hauling:
        return c.place
    return c.task.at(c.task.length - c.left)


def same_way(a: CombineState, b: CombineState) -> bool:
    """True where two combines have passes in the same direction."""
    assert a.task is not None
    assert b.task is not None
    return math.cos(a.task.start.heading - b.task.start.heading) > 0.9


def is_beside(here: Pose, headers: Iterable[Pose]) -> bool:
    """Whether a cart's place is beside one of some combines, in its direction."""
    return any(way_between(here, o) <= BESIDE and math.cos(o.heading - here.heading) > 0.9 for o in headers)


def way_between(a: Pose, b: Pose) -> float:
    """Way between two places along headland and passes [m]: the sum of both directions."""
    return abs(a.x - b.x) + abs(a.y - b.y)


def ahead_of_start(leader: CombineState, combine: CombineState) -> float:
    """How far a leader is ahead of where the one behind it begins its pass, along that pass [m]."""
    if leader.phase in ("way", "hold") or combine.task is None:
        return -math.inf
    start, place = combine.task.start, at(leader)
    return (place.x - start.x) * math.cos(start.heading) + (place.y - start.y) * math.sin(start.heading)
