"""What came of a job: what each machine did when, and why it waited; and the mover `events`.

A mover carries out a schedule by the order at shared places and says what each machine did. `events` takes
the least time of each segment, `driven` (driven.py) drives bodies.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swath.core.number_text import num
from swath.fleet.machines import Cart, Combine
from swath.fleet.schedule import Poured, Schedule
from swath.fleet.table import Order, Segment, Table, order_of
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.fuel import DIESEL, combine_fuel, tractor_fuel

Array = NDArray[np.float64]
CUT, WAY, POUR, LOAD, BESIDE, TRUCK, WAIT, IDLE = (
    "cut", "way", "pour", "load", "beside", "at truck", "wait", "idle",
)  # fmt: skip
STATES = (CUT, WAY, POUR, BESIDE, LOAD, TRUCK, WAIT, IDLE)
STATE_OF = {  # of a segment's kind; all others are ways
    "cut": CUT, "pours standing": POUR, "waits for cart": POUR, "home": IDLE, "beside": BESIDE,
    "beside, pouring": LOAD, "at truck": TRUCK,
}  # fmt: skip
NEXT_TRUCK, GROUND_OF = "the next truck", "ground of "
WAITS = ("waits for partner", "waits for ground", "waits for truck")
SHOWN = (*STATES[:-2], *WAITS, IDLE)  # states, with what is waited for
WENT = {  # what hours go for, of states
    "cutting": (CUT,), "ways": (WAY, BESIDE), "pouring": (POUR, LOAD, TRUCK), "waiting": (WAIT,),
    "idle": (IDLE,),
}  # fmt: skip
SHORT = 1e-3  # s, least time that grain takes to flow
FAR = 2.0  # times the bound, beyond which a note says so
AT_ONCE = 4000  # times that bodies are looked at together


@dataclass(frozen=True)
class Span:
    """What a machine did from when to when [s]. reason: of waiting, for what or whom."""

    state: str
    begin: float
    end: float
    reason: str = ""

    @property
    def shown(self) -> str:
        """One of `SHOWN`."""
        if self.state != WAIT:
            return self.state
        return WAITS[1 if self.reason.startswith(GROUND_OF) else 2 if self.reason == NEXT_TRUCK else 0]


@dataclass
class Worked:
    """A job that was carried out.

    level: `events` or `driven`
    schedule: who had which ground when
    spans: what each machine did when
    poured: grain handed over
    cut: time at which the last pass is cut [s]
    ends: time at which all grain is at the truck [s]
    into: times of entry into each segment [s]
    clock: times of the bodies' places, each 0.1 s, at `driven` alone, (n,) [s]
    places: the bodies' places, (n, 4)
    stray: largest distance of a body from its path [m]
    draws: `ends` of the draws of a spread [s]
    """

    level: str
    schedule: Schedule
    spans: dict[str, list[Span]]
    poured: list[Poured]
    cut: float
    ends: float
    into: Array
    clock: Array = field(default_factory=lambda: np.zeros(0))
    places: dict[str, Array] = field(default_factory=dict)
    stray: float = 0.0
    draws: tuple[float, ...] = ()

    def minutes(self, name: str, state: str) -> float:
        """That a machine spent so until the job ends, in a state or one of `SHOWN`. It is idle where it has
        nothing to do any more; what it does once the job has ended (the way home) does not count.
        """
        over, of = max(self.ends, self.cut), self.spans[name]
        times = [max(min(s.end, over) - s.begin, 0.0) for s in of]
        spent = math.fsum(t for t, s in zip(times, of, strict=True) if state in (s.state, s.shown))
        return (spent + (max(over - math.fsum(times), 0.0) if state == IDLE else 0.0)) / 60.0

    def went(self, name: str) -> dict[str, float]:
        """Hours of a machine by what they went for."""
        return {what: math.fsum(self.minutes(name, s) for s in of) / 60.0 for what, of in WENT.items()}

    def waited(self, name: str) -> dict[str, float]:
        """Minutes that a machine waited, by reason."""
        found: dict[str, float] = {}
        for s in self.spans[name]:
            if s.state == WAIT:
                found[s.reason] = found.get(s.reason, 0.0) + (s.end - s.begin) / 60.0
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    @cached_property
    def contact(self) -> dict[tuple[str, str], float]:
        """How long driven bodies are over each other [s], of each two machines that ever are."""
        machines, found = self.schedule.machines.by_name, {}
        for (a, at_a), (b, at_b) in combinations(self.places.items(), 2):
            one, two = machines[a].body, machines[b].body
            near = np.flatnonzero(np.hypot(*(at_a[:, :2] - at_b[:, :2]).T) < one.reach + two.reach)
            parts = (near[i : i + AT_ONCE] for i in range(0, len(near), AT_ONCE))
            count = math.fsum(_over(one.outlines(at_a[n]), two.outlines(at_b[n])).sum() for n in parts)
            if count > 0.0:
                found[a, b] = count * float(self.clock[1] - self.clock[0])
        return found

    @property
    def mass_error(self) -> float:
        """Grain cut that is not at the truck, as a share."""
        at_truck = math.fsum(p.amount for p in self.poured if p.target == "truck")
        return abs(self.schedule.harvested - at_truck) / max(self.schedule.harvested, 1.0)

    @property
    def efficiency(self) -> float:
        """Field efficiency: area over what all headers could cut meanwhile at the speed the crop allows."""
        schedule = self.schedule
        area = math.fsum(area for *_, area in schedule.cut)
        grain = math.fsum(mass for _, mass, _ in schedule.cut) / max(area, 1e-9)  # tanks may begin with some
        rate = math.fsum(c.width * c.speed_in(grain * c.width) for c in schedule.machines.combines)
        return schedule.plan.area / (rate * self.cut) if self.cut > 0.0 else math.nan


@dataclass(frozen=True)
class Used:
    """way: driven [m]; litres: of diesel."""

    way: float
    litres: float


def stays(w: Worked) -> Iterator[tuple[Segment, float, float]]:
    """Each segment with the times of its entry and of leaving it; the last of a machine ends with the job
    [s].
    """
    over = max(w.ends, w.cut, *w.into.tolist()) if len(w.into) else 0.0
    for s in w.schedule.table.segments:
        yield s, float(w.into[s.number]), float(w.into[s.next]) if s.next >= 0 else over


def grain(w: Worked) -> dict[str, tuple[Array, Array]]:
    """Of each machine, and of `truck`: times [s] and what it holds then [kg], straight between."""
    flows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in (*w.spans, "truck")}
    for s, into, _ in stays(w):
        if s.number in w.schedule.grain:
            flows[s.machine].append((into, into + s.spent, w.schedule.grain[s.number]))
    for p in w.poured:
        flows[p.source].append((p.begins, p.ends, -p.amount))
        flows[p.target].append((p.begins, p.ends, p.amount))
    starts = {c.name: c.start for c in w.schedule.machines.combines}
    return {name: _summed(starts.get(name, 0.0), rows) for name, rows in flows.items()}


def _summed(start: float, flows: list[tuple[float, float, float]]) -> tuple[Array, Array]:
    """Times and levels of even flows (begin, end [s], amount [kg])."""
    if not flows:
        return np.zeros(1), np.array([start])
    begin, end, amount = np.array(flows).T
    end = np.maximum(end, begin + SHORT)
    rate = amount / (end - begin)
    times, place = np.unique(np.concatenate([[0.0], begin, end]), return_inverse=True)
    change = np.zeros(len(times))
    np.add.at(change, place[1:], np.concatenate([rate, -rate]))
    gained = np.cumsum(np.cumsum(change)[:-1] * np.diff(times))
    return times, start + np.concatenate([[0.0], gained])


def used(w: Worked) -> dict[str, Used]:
    """Of each machine. Engines run while a machine waits, and stop where it has nothing to do for good."""
    held = grain(w)
    machines = w.schedule.machines.by_name
    pours = {n: p for p in w.poured if p.target != "truck" for n in range(p.during[0], p.during[1] + 1)}
    way = dict.fromkeys(w.spans, 0.0)
    burnt = dict.fromkeys(w.spans, 0.0)
    for s, into, out in stays(w):
        m = machines[s.machine]
        length = float(
            s.path.track.distance[s.path.last[s.index]] - s.path.track.distance[s.path.first[s.index]]
        )
        way[s.machine] += length
        if s.next < 0 and state_of(s) == IDLE:
            continue
        moves = min(s.spent, out - into) if length > 0.0 else 0.0
        load = float(np.interp(0.5 * (into + out), *held[s.machine]))
        speed = length / moves if moves > 0.0 else 0.0
        p = pours.get(s.number)
        is_pouring = p is not None and p.source == s.machine and p.begins < out and p.ends > into
        come = w.schedule.grain.get(s.number, 0.0)
        for time, v in ((moves, speed), (out - into - moves, 0.0)):
            if time > 0.0:
                cuts = state_of(s) == CUT and v > 0.0
                burnt[s.machine] += time * _rate(m, load, v, come / time if cuts else 0.0, cuts, is_pouring)
    return {name: Used(way[name], burnt[name] / DIESEL) for name in w.spans}


def _rate(m: Combine | Cart, load: float, speed: float, come: float, cuts: bool, is_pouring: bool) -> float:
    """Fuel of a machine [kg/s]."""
    if isinstance(m, Cart):
        return tractor_fuel(m.sheet, load, speed)
    out = m.auger if is_pouring else 0.0
    return combine_fuel(
        m.sheet, drivetrain_of(m.sheet), tank=load, speed=speed, grain=come, cuts=cuts, out=out
    )


def _over(one: Array, two: Array) -> NDArray[np.bool_]:
    """Whether any convex outlines (n, r, 4, 2), anticlockwise, overlap those of another body, (n,): no side
    of either has all of the other one outside.
    """
    apart = np.zeros((len(one), one.shape[1], two.shape[1]), bool)
    for a, b, pairs in ((one, two, apart), (two, one, apart.swapaxes(1, 2))):
        side = np.roll(a, -1, axis=2) - a
        normal = np.stack([side[..., 1], -side[..., 0]], axis=-1)
        at = (normal * a).sum(axis=-1)
        far = np.einsum("nrsk,nqck->nrqsc", normal, b).min(axis=-1)
        pairs |= (far >= at[:, :, None]).any(axis=-1)
    return np.asarray(~apart.all(axis=(1, 2)))


def litres_per_ha(w: Worked) -> float:
    """Diesel of all machines over what is cut."""
    area = math.fsum(area for _, _, area in w.schedule.cut)
    return math.fsum(u.litres for u in used(w).values()) / max(area / 1e4, 1e-9)


def by_events(schedule: Schedule) -> Worked:
    """The schedule by its order alone, each segment in its least time."""
    order, segments = order_of(schedule.table), schedule.table.segments
    into = order.times(order.spent[:, None])[:, 0]
    spans = {name: _spans(schedule, order, into, name) for name in schedule.machines.by_name}
    planned = [s.into for s in segments]
    poured = [
        replace(p, begins=p.begins + into[a] - planned[a], ends=p.ends + into[b] - planned[b])
        for p in schedule.poured
        for a, b in (p.during,)
    ]
    cut = max((into[s.number] + s.spent for s in segments if s.kind == "cut"), default=0.0)
    ends = max((p.ends for p in poured if p.target == "truck"), default=0.0)
    return Worked("events", schedule, spans, poured, float(cut), float(ends), into)


def state_of(segment: Segment) -> str:
    """What a machine does in a segment."""
    return STATE_OF.get(segment.kind, WAY)


def spans_in(segment: Segment, begin: float, poured: Sequence[Poured], dock: float) -> list[Span]:
    """What a machine does in the least time of a segment from its entry on [s].

    poured: into trucks there, by the plan's times
    dock: until it stands beside the truck and is gone again [s]
    """
    end = begin + segment.spent
    here = [p for p in poured if p.during[0] == segment.number and p.target == "truck"]
    if not here:
        return [Span(state_of(segment), begin, end)]
    spans, at = [], begin
    for p in here:
        start = p.begins - segment.into + begin
        wait = start - at - (0.5 * dock if at == begin else 0.0)
        spans.append(Span(WAIT, at, at + max(wait, 0.0), NEXT_TRUCK))
        spans.append(Span(TRUCK, at + max(wait, 0.0), start + p.ends - p.begins))
        at = start + p.ends - p.begins
    return [*spans, Span(TRUCK, at, end)]


def waiting(table: Table, segment: Segment, begin: float, end: float, until: tuple[int, int]) -> Span:
    """The span of a machine that stands at the end of a segment.

    until: the segment that it or its partner enters next, and what has to be entered before; one that stands
        at its place waits for nothing
    """
    if segment.kind in ("home", "to its place", "in the field") or segment.next < 0:
        return Span(IDLE, begin, end)
    member, other = (table.segments[n].machine for n in until)
    if member != segment.machine:
        return Span(WAIT, begin, end, member)
    if other == member:
        return Span(state_of(segment), begin, end)
    return Span(WAIT, begin, end, GROUND_OF + other)


def _spans(schedule: Schedule, order: Order, into: Array, name: str) -> list[Span]:
    table, dock = schedule.table, schedule.dock
    group = {n: g for g in order.groups for n in g}
    spans: list[Span] = []
    for s in (s for s in table.segments if s.machine == name):
        begin = float(into[s.number])
        spans += spans_in(s, begin, schedule.poured, dock)
        if s.next >= 0 and into[s.next] > begin + s.spent + 1e-6:
            late = [(m, o) for m in group[s.next] for o, _ in order.before[m] if o != s.number]
            until = max(late, key=lambda mo: into[mo[1]], default=(s.next, s.number))
            spans.append(waiting(table, s, begin + s.spent, float(into[s.next]), until))
    return merged(spans)


def merged(spans: Iterable[Span]) -> list[Span]:
    """Spans that follow each other alike as one; none of no time."""
    out: list[Span] = []
    for s in spans:
        if s.end <= s.begin:
            continue
        last = out[-1] if out else None
        if (
            last is not None
            and (last.state, last.reason) == (s.state, s.reason)
            and s.begin <= last.end + 1e-6
        ):
            out[-1] = replace(last, end=s.end)
        else:
            out.append(s)
    return out


def checked(worked: Worked) -> list[str]:
    """What a reader of a result has to know, beside the schedule's notes."""
    notes = [*_far_over(worked), *worked.schedule.notes, *worked.schedule.plan.notes]
    if worked.schedule.plan.left > 0.0:
        share = 100.0 * worked.schedule.plan.left / worked.schedule.plan.area
        notes.append(f"{num(worked.schedule.plan.left)} m2 ({num(share)} %) are in no pass")
    served = {p.target for p in worked.poured}
    idle = [k.name for k in worked.schedule.machines.carts if k.name not in served]
    return [*notes, *(f"{name} takes no load: the job needs fewer carts" for name in idle)]


def _far_over(worked: Worked) -> list[str]:
    """That a job takes more than `FAR` of what no plan can take less than, and the longest wait in it."""
    if not 0.0 < worked.schedule.bound * FAR < worked.ends:
        return []
    times = worked.ends / worked.schedule.bound
    over = f"the job takes {num(times)} times as long as the least that any plan could take"
    waits = [(minutes, name, why) for name in worked.spans for why, minutes in worked.waited(name).items()]
    if not waits:
        return [over]
    minutes, name, why = max(waits, key=lambda wait: wait[0])
    if minutes < 0.5:
        return [over]
    return [f"{over}; the longest wait: {name}, {num(minutes)} min for {why}"]
