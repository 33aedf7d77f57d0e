"""Integer-time multi-rate schedule.

Every slot has a period and an offset [ns]. A slot is due at offset + k * period (k >= 1 when the offset is
0); being due at time T it steps over (T - period, T], so its outputs are valid at T. At one T the slots run
in declared order and see what earlier slots just produced (Gauss-Seidel); a latched slot sees only what was
there before T (Jacobi). The pattern is computed once over the hyperperiod; wall clock never enters.
"""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import lcm

from swath.core.errors import InputError

NS = 1_000_000_000
TICK = 100_000


@dataclass(frozen=True)
class Slot:
    """When a component runs. period, offset [ns]; latch: read only samples from before the tick."""

    name: str
    period: int
    offset: int = 0
    latch: bool = False


@dataclass(frozen=True)
class Plan:
    """ticks: (time within the hyperperiod [ns], indices of the slots due, in declared order)."""

    slots: tuple[Slot, ...]
    hyperperiod: int
    ticks: tuple[tuple[int, tuple[int, ...]], ...]

    def walk(self, start: int, stop: int) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Every (time [ns], due slots) with start < time <= stop, in order."""
        base = start // self.hyperperiod * self.hyperperiod
        first = bisect_right(self.ticks, start - base, key=lambda tick: tick[0])
        while base <= stop:
            for at, due, begun in self._begun[first:] if first else self._begun:
                t = base + at
                if t > stop:
                    return
                running = due if t > begun else tuple(i for i in due if t > self.slots[i].offset)
                if running:
                    yield t, running
            base, first = base + self.hyperperiod, 0

    @cached_property
    def _begun(self) -> tuple[tuple[int, tuple[int, ...], int], ...]:
        """The ticks, each with the largest offset [ns] of its slots: later, all of them have begun."""
        return tuple((at, due, max(self.slots[i].offset for i in due)) for at, due in self.ticks)


def make_plan(slots: list[Slot], *, max_ticks: int = 200_000) -> Plan:
    """Plan over the hyperperiod.

    Raises InputError on a period <= 0, an offset outside [0, period), two slots of one name, or periods so
    odd that the hyperperiod holds more than `max_ticks` ticks.
    """
    names = [s.name for s in slots]
    for slot in slots:
        if slot.period <= 0:
            raise InputError(f"{slot.name}.period", slot.period, "expected > 0 ns")
        if not 0 <= slot.offset < slot.period:
            raise InputError(f"{slot.name}.offset", slot.offset, f"expected 0 <= offset < {slot.period} ns")
        if names.count(slot.name) > 1:
            raise InputError(slot.name, None, "declared twice")
    hyper = lcm(*(s.period for s in slots)) if slots else NS
    count = sum(hyper // s.period for s in slots)
    if count > max_ticks:
        periods = ", ".join(f"{s.name} {s.period} ns" for s in slots)
        raise InputError(
            "period", None, f"no common rhythm within {max_ticks} steps; the periods are {periods}"
        )
    due: dict[int, list[int]] = {}
    for index, slot in enumerate(slots):
        for at in range(slot.offset, hyper, slot.period):
            due.setdefault(at, []).append(index)
    return Plan(tuple(slots), hyper, tuple((at, tuple(due[at])) for at in sorted(due)))


def from_hz(rate_hz: float) -> int:
    """Period [ns] of a rate, rounded to 0.1 ms so that rates share a short rhythm (15 Hz: 66.7 ms)."""
    return max(1, round(NS / rate_hz / TICK)) * TICK
