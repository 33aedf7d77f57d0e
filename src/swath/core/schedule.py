"""Integer-time multi-rate schedule.

Every slot has a period and an offset [ns]. A slot is due at offset + k * period (k >= 1 when the offset is
0); being due at time T it steps over (T - period, T], so its outputs are valid at T. At one T the slots run
in declared order and see what earlier slots just produced (Gauss-Seidel); a latched slot sees only what was
there before T (Jacobi). The pattern is computed round by round: once where all rounds are alike, as those of
a hyperperiod are. Wall clock never enters.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import lcm

from swath.core.errors import InputError

NS = 1_000_000_000
TICK = 100_000
MOST = 50_000  # steps of a round: a longer hyperperiod is cut into rounds that differ


@dataclass(frozen=True)
class Slot:
    """When a component runs. period, offset [ns]; latch: read only samples from before the tick."""

    name: str
    period: int
    offset: int = 0
    latch: bool = False


@dataclass(frozen=True)
class Plan:
    """A round of a plan. begin: of the round; span: how long each round is [ns].

    ticks: (time within the round [ns], indices of the slots due, in declared order)
    is_every: all rounds are like this one: it is a hyperperiod
    """

    slots: tuple[Slot, ...]
    begin: int
    span: int
    ticks: tuple[tuple[int, tuple[int, ...]], ...]
    is_every: bool

    def at(self, t: int) -> "Plan":
        """The round in which a time lies; this one where all are alike."""
        begin = t // self.span * self.span
        if self.is_every or begin == self.begin:
            return self
        return replace(self, begin=begin, ticks=_ticks(self.slots, begin, self.span))

    def walk(self, start: int, stop: int) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Every (time [ns], due slots) with start < time <= stop, in order."""
        base, plan = start // self.span * self.span, self.at(start)
        first = bisect_right(plan.ticks, start - base, key=lambda tick: tick[0])
        while base <= stop:
            for at, due, begun in plan._begun[first:] if first else plan._begun:
                t = base + at
                if t > stop:
                    return
                running = due if t > begun else tuple(i for i in due if t > self.slots[i].offset)
                if running:
                    yield t, running
            base, first = base + self.span, 0
            plan = plan.at(base)

    @cached_property
    def _begun(self) -> tuple[tuple[int, tuple[int, ...], int], ...]:
        """The ticks, each with the largest offset [ns] of its slots: later, all of them have begun."""
        return tuple((at, due, max(self.slots[i].offset for i in due)) for at, due in self.ticks)


def make_plan(slots: Sequence[Slot], *, most: int = MOST) -> Plan:
    """The first round of a plan, of at most about `most` steps.

    Raises InputError on a period <= 0, an offset outside [0, period), or two slots of one name.
    """
    names = [s.name for s in slots]
    for slot in slots:
        if slot.period <= 0:
            raise InputError(f"{slot.name}.period", slot.period, "expected > 0 ns")
        if not 0 <= slot.offset < slot.period:
            raise InputError(f"{slot.name}.offset", slot.offset, f"expected 0 <= offset < {slot.period} ns")
        if names.count(slot.name) > 1:
            raise InputError(slot.name, None, "declared twice")
    span = hyper = lcm(*(s.period for s in slots)) if slots else NS
    if (count := sum(hyper // s.period for s in slots)) > most:
        span = max(min(s.period for s in slots), hyper * most // count)
    return Plan(tuple(slots), 0, span, _ticks(slots, 0, span), span == hyper)


def _ticks(slots: Sequence[Slot], begin: int, span: int) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """The ticks of the round that begins then."""
    due: dict[int, list[int]] = {}
    for index, slot in enumerate(slots):
        passed = max(0, -((slot.offset - begin) // slot.period))  # periods until it is due in the round
        for at in range(slot.offset - begin + passed * slot.period, span, slot.period):
            due.setdefault(at, []).append(index)
    return tuple((at, tuple(due[at])) for at in sorted(due))


def from_hz(rate_hz: float) -> int:
    """Period [ns] of a rate, rounded to 0.1 ms so that rates share a short rhythm (15 Hz: 66.7 ms)."""
    return max(1, round(NS / rate_hz / TICK)) * TICK
