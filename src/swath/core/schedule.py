"""Exact times of many rates.

Sample n of a slot is due at offset + n periods, rounded to a nanosecond, a half up; n is 1 or more: `reset`
gives what holds at t = 0. A step ends when its sample is due and begins when the one before was, so that its
length is the period to a nanosecond, and no error adds up. At one time T the slots run in declared order and
see what earlier slots just produced (Gauss-Seidel); a latched slot sees only what was there before T
(Jacobi). What is due next is a queue: rates need nothing in common. Wall clock never enters.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from heapq import merge
from itertools import groupby
from operator import itemgetter

from swath.core.errors import InputError

NS = 1_000_000_000
NEVER = 1 << 61  # ns, 73 years: the longest period, and when nothing is due


@dataclass(frozen=True)
class Slot:
    """When a component runs. period, offset [ns]; latch: read only samples from before the tick."""

    name: str
    period: int | Fraction
    offset: int = 0
    latch: bool = False

    def due(self, number: int) -> int:
        """When a sample is due [ns]; the first step begins when that of number 0 would be."""
        top, bottom = self.period.as_integer_ratio()
        return self.offset + (2 * number * top + bottom) // (2 * bottom)

    def count(self, t: int) -> int:
        """How many samples are due up to a time [ns]."""
        top, bottom = self.period.as_integer_ratio()
        return max(0, ((2 * (t - self.offset) + 1) * bottom - 1) // (2 * top))

    def after(self, t: int) -> int:
        """The first time after one at which a sample is due [ns]."""
        return self.due(self.count(t) + 1)

    def length(self, t: int) -> int:
        """Length of the step that ends at a time at which a sample is due [ns]."""
        return self.period if isinstance(self.period, int) else t - self.due(self.count(t) - 1)

    def clockwork(self, t: int) -> tuple[int, ...]:
        """How it goes on after a time in whole numbers: begin and end of the next step [ns], whole ns to the
        one after, and what is left over: so far, each time, of how much to a nanosecond.
        """
        top, bottom = self.period.as_integer_ratio()
        number, of = self.count(t), 2 * bottom
        rest = (2 * (number + 1) * top + bottom) % of
        return self.due(number), self.due(number + 1), top // bottom, rest, 2 * top % of, of


@dataclass(frozen=True)
class Plan:
    """Slots in the order in which they run within a tick.

    Raises InputError on a period <= 0, an offset outside [0, period), or two slots of one name.
    """

    slots: tuple[Slot, ...]

    def __post_init__(self) -> None:
        names = [slot.name for slot in self.slots]
        for slot in self.slots:
            if slot.period <= 0:
                raise InputError(f"{slot.name}.period", slot.period, "expected > 0 ns")
            if not 0 <= slot.offset < slot.period:
                expected = f"expected 0 <= offset < {float(slot.period):.12g} ns"
                raise InputError(f"{slot.name}.offset", slot.offset, expected)
            if names.count(slot.name) > 1:
                raise InputError(slot.name, None, "declared twice")

    def walk(self, start: int, stop: int) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Every (time [ns], due slots) with start < time <= stop, in order."""
        for t, due in groupby(due_after(start, dict(enumerate(self.slots))), itemgetter(0)):
            if t > stop:
                return
            yield t, tuple(place for _, place in due)


def due_after(t: int, slots: Mapping[int, Slot]) -> Iterator[tuple[int, int]]:
    """Times [ns] after one at which slots are due, each with the place of the slot, in order; without end."""
    return merge(*(_due(place, slot.clockwork(t)) for place, slot in slots.items()))


def _due(place: int, clockwork: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    _, at, whole, rest, more, of = clockwork
    while True:
        yield at, place
        rest += more
        at, rest = at + whole + rest // of, rest % of


def from_hz(rate_hz: float) -> int | Fraction:
    """Period [ns] of a rate, exactly that of its decimal number."""
    period = min(NS / Fraction(repr(float(rate_hz))), Fraction(NEVER))
    return period.numerator if period.denominator == 1 else period
