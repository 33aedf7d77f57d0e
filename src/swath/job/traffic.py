"""Right of way of driven machines: nobody drives onto ground that another one needs to come to rest.

Every LOOKS steps, in order of precedence, each machine asks for the ground that its bodies sweep if it drives
on until the next look and brakes from then on. It gets it where that is clear of what all others hold; else
it brakes, on ground that it holds already. So nobody has to trust that another one gives way. And a machine
stops before ground that one of higher precedence drives over in the next AHEAD s, unless it is on it already,
or that one is stopped by it.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swath.job.drive import SLANT, SLANT_ON_WAY, Follower
from swath.job.driver import Driver
from swath.job.footprint import overlap

Array = NDArray[np.float64]
LOOKS = 3  # steps between two looks
GAP, NEARLY = 0.1, 0.03  # m between bodies; of those that are nearer than that already
AHEAD = 6.0  # s that those of higher precedence are looked ahead
TURN, BEHIND = 60.0, 15.0  # m of a turn and behind it, likewise
SPACING = 2.0  # m between the places of the own way that are held against theirs
ROOM = 3.0  # m that it stops before them
MOVES = 0.2  # m/s, from which a machine is driving
ASIDE, LITTLE = 0.8, 0.06  # m, that a machine drives farther out to let another one pass; more than GAP
TRAILS = 0.2  # m, likewise, that a trailer may be off the way of its tractor
MEET, PAST = 50.0, 14.0  # m ahead and behind, where the other one is then
CART_ASIDE, WAY_ASIDE = 8.0, 13.0  # m, most that a cart, and a combine, drive farther out on their ways
WAY_MEET = 120.0  # m ahead, where the other one is then
TURN_IN = 2.0  # m farther out, where a cart waits for a combine that turns onto its pass
OFF = 40.0  # m from what is fixed, within which nobody drives beside its way
STRAIGHT = 20.0  # m of a way between passes, where it may drive beside it
RESTS = 0.02  # m/s, below which it stands
TOUCHES = -1e6  # m, a gap at which nothing overlaps


@dataclass
class Mover:
    """A machine in traffic. wanted: speed [m/s]; beside: name of the one that it keeps beside, which it is
    not held against; reserved: more ground that it holds, wished: and that it will need, boxes

    turns: it claims all of its turn; waits: until the ground that it wishes is clear; gives_way: to those of
    higher precedence; ignores: whose ground does not count for it; waits_for: who has to act before it can;
    left: way to where it goes [m]; to: name of the combine there; after: of the one that goes before that;
    blocked: by whom it is stopped; now, claim: ground where it is, and that it drives over
    next, boxes
    """

    name: str
    driver: Driver
    wanted: float
    beside: str = ""
    reserved: Array | None = None
    wished: Array | None = None
    gives_way: bool = True
    turns: bool = False
    waits: bool = False
    ignores: tuple[str, ...] = ()
    waits_for: str = ""
    left: float = math.inf
    to: str = ""
    after: str = ""
    blocked: str = ""
    now: Array = field(default_factory=lambda: np.zeros((0, 6)))
    claim: Array | None = None

    @property
    def speed(self) -> float:
        """Its speed [m/s]."""
        return self.driver.machine.speed


def look(movers: list[Mover], fixed: dict[str, Array]) -> None:
    """Let each machine drive on or make it brake. movers: in order of precedence; fixed: what stands"""
    for m in movers:
        m.now = m.driver.footprint.sweep([m.driver.place])
    for i, m in enumerate(movers):
        near = [o for o in movers if o is not m and not _are_together(m, o) and _are_near(m, o)]
        near = [o for o in near if o.name not in m.ignores]
        stands = {n: b for n, b in fixed.items() if n not in m.ignores and _is_near(m, b)}
        if not near and not stands:
            m.driver.let(math.inf)
            m.driver.held = m.now
            continue
        if m.wanted <= 0.0 and m.speed < RESTS:
            m.driver.let(0.0)  # it asks before it starts
            m.driver.held = m.now if m.reserved is None else np.vstack([m.now, m.reserved])
            continue
        go = m.driver.footprint.sweep(m.driver.until_rest(m.wanted, LOOKS))
        held = {o.name: (o.now, o.driver.held) for o in near} | {n: (b, b) for n, b in stands.items()}
        m.blocked = _blocked(m.now, go, held)
        if not m.blocked and m.gives_way:
            ours = {m.name, m.beside, m.to, *(o.name for o in movers if o.beside == m.name)} - {""}
            m.blocked = _in_the_way(m, [o for o in near if o in movers[:i] and o.blocked not in ours])
        m.driver.let(0.0 if m.blocked else max(m.wanted, 0.0), m.blocked)
        if m.blocked:
            go = m.driver.footprint.sweep(m.driver.until_rest(0.0, 0))
        m.driver.held = go if m.reserved is None else np.vstack([go, m.reserved])


def is_free(boxes: Array, others: list[Array]) -> bool:
    """Whether ground is clear of what others hold."""
    return not any(overlap(boxes, o, GAP) for o in others)


def _blocked(now: Array, go: Array, held: dict[str, tuple[Array, Array]]) -> str:
    """Who holds ground that is asked for; nobody: "". One that is nearer than GAP already must not come
    nearer than bodies are wide.
    """
    for name, (there, ground) in held.items():
        if overlap(go, ground, gap_to(now, there)):
            return name
    return ""


def gap_to(now: Array, there: Array, most: float = GAP) -> float:
    """Gap that a machine keeps to another one's bodies [m]: less to one that is nearer than that already, and
    none to one that it touches, so that both can part.
    """
    return next((gap for gap in (most, NEARLY, 0.0) if not overlap(now, there, gap)), TOUCHES)


def _in_the_way(m: Mover, others: list[Mover]) -> str:
    """Who drives soon over what lies ahead within the way to stop."""
    others = [
        o
        for o in others
        if (o.speed > MOVES and o.driver.follower is not None) or o.wished is not None or o.turns
    ]
    if not others or m.driver.follower is None:
        return ""
    way = m.driver.braking_way(m.speed) + m.speed * 0.8 + ROOM
    ahead = m.driver.footprint.sweep(
        m.driver.ahead([SPACING * (i + 1) for i in range(math.ceil(way / SPACING))])
    )
    for o in others:
        if o.claim is None:
            far = min(o.driver.left + BEHIND, TURN) if o.turns else AHEAD * o.speed
            count = math.ceil(far / SPACING)
            lengths = [far * (i + 1) / count for i in range(count)]
            o.claim = np.vstack([o.now, o.driver.footprint.sweep(o.driver.ahead(lengths))])
            if o.wished is not None:
                o.claim = np.vstack([o.claim, o.wished])
        if not overlap(m.now, o.claim) and overlap(ahead, o.claim, GAP):
            return o.name
    return ""


def _are_together(a: Mover, b: Mover) -> bool:
    return a.beside == b.name or b.beside == a.name


def _are_near(a: Mover, b: Mover) -> bool:
    p, q = a.driver.machine, b.driver.machine
    if a.turns or b.turns or a.wished is not None or b.wished is not None:
        return math.hypot(p.x - q.x, p.y - q.y) < 80.0
    return math.hypot(p.x - q.x, p.y - q.y) < _reach(a) + _reach(b) + 2.0 * ROOM


def _is_near(a: Mover, boxes: Array) -> bool:
    p = a.driver.machine
    return math.hypot(p.x - boxes[0, 0], p.y - boxes[0, 1]) < _reach(a) + 10.0 + 2.0 * ROOM


def _reach(a: Mover) -> float:
    return a.driver.footprint.reach + a.driver.braking_way(a.speed) + AHEAD * a.speed


def steer_aside(movers: list[Mover], fixed: dict[str, Array]) -> None:
    """Of two that meet, or pass each other, with sides that overlap by less than ASIDE, by less than
    CART_ASIDE of a cart on its way and WAY_ASIDE of a combine on a straight way between passes, one drives
    that much farther out, with a cart beside it, until they are past: who is
    on its way between passes, else who has the lower precedence; of a combine that stands the other one.
    A cart drives farther out where its combine turns onto the pass. Nobody does near what is fixed.
    """
    for i, m in enumerate(movers):
        follower = m.driver.follower
        if follower is None:
            continue
        if any(
            math.hypot(m.driver.machine.x - b[0, 0], m.driver.machine.y - b[0, 1]) < OFF
            for b in fixed.values()
        ):
            follower.aside = 0.0
            continue
        follower.slant = SLANT_ON_WAY if m.turns or (m.to and not m.beside) else SLANT
        beside = next((o for o in movers if o.name == m.beside), None)
        if beside is not None and beside.driver.follower is not None:
            follower.aside = beside.driver.follower.aside
            continue
        if any(o.turns and o.name == m.to for o in movers):
            follower.aside = TURN_IN
            continue
        others = [o for o in movers if o is not m and not o.turns] if m.turns else movers[:i]
        others += [o for o in movers[:i] if m.turns and o.turns]
        if not m.turns:
            others += [o for o in movers[i + 1 :] if o.speed < RESTS and not o.driver.footprint.towed]
        follower.aside = next((left for o in others if (left := aside_of(m, o)) != 0.0), 0.0)


def _bends(follower: Follower) -> bool:
    """Whether a path bends soon."""
    here, there = (follower.path.at(follower.at + s).heading for s in (0.0, STRAIGHT))
    return abs(math.remainder(there - here, math.tau)) > 0.05


def aside_of(m: Mover, o: Mover) -> float:
    """How far to the left one has to drive to come past another one [m]; 0: not at all."""
    follower = m.driver.follower
    if follower is None or o.driver.follower is None:
        return 0.0
    own = follower.path.at(follower.at)
    other = o.driver.follower.path.end if o.turns and not m.turns else o.driver.machine.pose
    if m.turns and (_bends(follower) or (o.turns and _bends(o.driver.follower))):
        return 0.0
    c, s = math.cos(own.heading), math.sin(own.heading)
    same = math.cos(other.heading - own.heading)
    if abs(same) < 0.98 or (same > 0.0 and (o.speed > 0.7 * m.wanted or (m.turns and o.turns))):
        return 0.0
    dx, dy = other.x - own.x, other.y - own.y
    along, across = dx * c + dy * s, dy * c - dx * s
    body, past = m.driver.footprint, PAST
    deep = body.wide + o.driver.footprint.wide + GAP + LITTLE - abs(across)
    if body.towed:  # a trailer comes later, and nearer
        deep, past = deep + TRAILS, PAST + body.reach
    most, soon, back = ASIDE, MEET, past + STRAIGHT + deep / SLANT_ON_WAY
    if body.towed and o.name != m.to:
        most, soon = CART_ASIDE, min(WAY_MEET, m.left - back)
    elif m.turns and (same < 0.0 or o.speed < RESTS):
        most, soon = WAY_ASIDE, min(WAY_MEET, m.driver.left - back)
    if not -past < along < soon or not 0.0 < deep <= most:
        return 0.0
    return -math.copysign(deep, across)
