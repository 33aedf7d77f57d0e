"""What came of a job: what each machine did when, and why it waited; and the mover `events`.

A mover carries out a schedule by the order at shared places and says what each machine did. `events` takes
the least time of each segment, `driven` (driven.py) drives bodies.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swath.fleet.schedule import Poured, Schedule
from swath.fleet.table import Order, Segment, Table, order_of

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


@dataclass(frozen=True)
class Span:
    """What a machine did from when to when [s]. reason: of waiting, for what or whom"""

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
    """level; schedule; spans: of each machine; poured: grain handed over; cut: when the last pass is cut,
    ends: when all grain is at the truck, into: of entry into each segment [s]; clock, places: of bodies each
    0.1 s, (n,), (n, 4), at `driven` alone; stray: most that a body was off its path [m]; draws: `ends`
    of a spread [s]
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
        """That a machine spent so, in a state or in one of `SHOWN`."""
        return math.fsum(s.end - s.begin for s in self.spans[name] if state in (s.state, s.shown)) / 60.0

    def waited(self, name: str) -> dict[str, float]:
        """Minutes that a machine waited, by reason."""
        found: dict[str, float] = {}
        for s in self.spans[name]:
            if s.state == WAIT:
                found[s.reason] = found.get(s.reason, 0.0) + (s.end - s.begin) / 60.0
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    @property
    def mass_error(self) -> float:
        """Grain cut that is not at the truck, as a share."""
        at_truck = math.fsum(p.amount for p in self.poured if p.target == "truck")
        return abs(self.schedule.harvested - at_truck) / max(self.schedule.harvested, 1.0)

    @property
    def efficiency(self) -> float:
        """Field efficiency: area over what all headers could cut meanwhile at the speed the crop allows."""
        schedule = self.schedule
        grain = schedule.harvested / max(math.fsum(area for _, _, area in schedule.cut), 1e-9)
        rate = math.fsum(c.width * c.speed_in(grain * c.width) for c in schedule.machines.combines)
        return schedule.plan.area / (rate * self.cut) if self.cut > 0.0 else math.nan


def by_events(schedule: Schedule) -> Worked:
    """The schedule by its order alone, each segment in its least time."""
    order = order_of(schedule.table)
    into = order.times(order.spent[:, None])[:, 0]
    spans = {name: _spans(schedule, order, into, name) for name in schedule.table.last}
    return _worked("events", schedule, into, spans)


def _worked(level: str, schedule: Schedule, into: Array, spans: dict[str, list[Span]]) -> Worked:
    planned = [s.into for s in schedule.table.segments]
    poured = [
        replace(p, begins=p.begins + into[p.during[0]] - planned[p.during[0]],
                ends=p.ends + into[p.during[1]] - planned[p.during[1]])
        for p in schedule.poured
    ]  # fmt: skip
    segments = schedule.table.segments
    cut = max((into[s.number] + s.spent for s in segments if s.kind == "cut"), default=0.0)
    ends = max((p.ends for p in poured if p.target == "truck"), default=0.0)
    return Worked(level, schedule, spans, poured, float(cut), float(ends), into)


def state_of(segment: Segment) -> str:
    """What a machine does in a segment."""
    return STATE_OF.get(segment.kind, WAY)


def spans_in(segment: Segment, begin: float, poured: Sequence[Poured], dock: float) -> list[Span]:
    """What a machine does in the least time of a segment from its entry on [s]. poured: into trucks there, by
    the plan's times; dock: until it stands beside the truck and is gone again [s]
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
    """The span of a machine that stands at the end of a segment. until: the segment that it or its partner
    enters next, and what has to be entered before; one that stands at its place waits for nothing
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
    notes = [*worked.schedule.notes, *worked.schedule.plan.notes]
    if worked.schedule.plan.left > 0.0:
        share = 100.0 * worked.schedule.plan.left / worked.schedule.plan.area
        notes.append(f"{worked.schedule.plan.left:.0f} m2 ({share:.2f} %) are in no pass")
    served = {p.target for p in worked.poured}
    idle = [k.name for k in worked.schedule.machines.carts if k.name not in served]
    return [*notes, *(f"{name} takes no load: the job needs fewer carts" for name in idle)]
