"""Times of drawn rates, against exact fractions made here."""

from fractions import Fraction
from itertools import groupby, pairwise
from operator import itemgetter

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS, Plan, Slot, from_hz

MS = 1_000_000
RATES = [15, 29.97, 7, 0.3333333, 1 / 3, 1024, 300, 33.333333333333336, 60, 25, 50, 200, 10_000, 999.9]


def due(slot, rate, stop):
    """The definition: sample n at offset + n / rate, half a nanosecond up."""
    found, n = [], 1
    while (t := slot.offset + int(Fraction(n * NS) / Fraction(str(rate)) + Fraction(1, 2))) <= stop:
        found.append(t)
        n += 1
    return found


def drawn(seed, count=5):
    """Slots of drawn rates and offsets, and when they are due, by time, then place."""
    draw = np.random.default_rng(seed)
    rates = [float(rate) for rate in draw.choice([*RATES, *draw.uniform(0.5, 400, 6).round(3)], count)]
    slots = [Slot(str(k), from_hz(rate)) for k, rate in enumerate(rates)]
    slots = [Slot(s.name, s.period, int(draw.integers(2) * draw.uniform() * float(s.period))) for s in slots]
    stop = int(draw.integers(1, 100) * NS / max(rates))
    each = sorted((t, k) for k, slot in enumerate(slots) for t in due(slot, rates[k], stop))
    return slots, stop, [(t, tuple(k for _, k in of)) for t, of in groupby(each, itemgetter(0))], draw


@pytest.mark.parametrize("seed", range(12))
def test_ticks_are_those_of_the_definition(seed):
    slots, stop, whole, draw = drawn(seed)
    plan = Plan(tuple(slots))
    assert list(plan.walk(0, stop)) == whole
    cuts = [0, *sorted(draw.integers(0, stop + 1, 7).tolist()), stop]
    assert [tick for a, b in pairwise(cuts) for tick in plan.walk(a, b)] == whole


@pytest.mark.parametrize("seed", range(12))
def test_steps_follow_each_other_whatever_time_they_are_asked_at(seed):
    slots, stop, whole, draw = drawn(seed)
    for k, slot in enumerate(slots):
        times = [slot.offset, *(t for t, places in whole if k in places)]
        begun = int(draw.integers(0, stop + 1))
        since, end, ns, rest, more, of = slot.clockwork(begun)
        for a, b in pairwise(times):
            assert slot.length(b) == b - a
            assert abs(slot.length(b) - slot.period) < 1
            assert slot.after(a) == slot.after(b - 1) == b
            if b > begun:
                assert (since, end) == (a, b)
                rest += more
                since, end, rest = end, end + ns + rest // of, rest % of


def test_declared_order_is_kept_at_one_time():
    plan = Plan((Slot("late", 10 * MS), Slot("early", 5 * MS)))
    assert dict(plan.walk(0, 10 * MS))[10 * MS] == (0, 1)


@pytest.mark.parametrize(
    ("slot", "key"),
    [(Slot("a", 0), "a.period"), (Slot("a", -5), "a.period"), (Slot("a", 10, offset=10), "a.offset"),
     (Slot("a", from_hz(15), offset=66_666_667), "a.offset.*66666666.6667 ns")],
)  # fmt: skip
def test_bad_slots_are_refused_by_name(slot, key):
    with pytest.raises(InputError, match=key):
        Plan((slot,))


def test_two_slots_of_one_name():
    with pytest.raises(InputError, match="declared twice"):
        Plan((Slot("a", 10), Slot("a", 10)))


def test_a_rate_is_the_decimal_number_that_was_written():
    assert [from_hz(rate) for rate in (25, 15, 29.97)] == [
        40 * MS,
        Fraction(NS, 15),
        Fraction(100 * NS, 2997),
    ]
    assert isinstance(from_hz(25.0), int)
    assert Slot("a", from_hz(1024)).due(1) == 976_563  # of 976 562.5


@pytest.mark.parametrize("rate", [1e-300, 5e-324, 1e-12, 1e-5, 9999.999999999998, 1234.5678901234567])
def test_any_rate_fits_the_compiled_walk(rate):
    """A slot that is slower than once in a lifetime is never due."""
    slot = Slot("a", from_hz(rate))
    np.array(slot.clockwork(10**15), np.int64)
    assert slot.after(10**15) + int(slot.period) < 2**63
