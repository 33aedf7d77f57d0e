import itertools

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import MOST, NS, Slot, from_hz, make_plan

MS = 1_000_000


def brute_force(slots, stop):
    return [
        (t, tuple(i for i, s in enumerate(slots) if t > s.offset and (t - s.offset) % s.period == 0))
        for t in range(MS, stop + MS, MS)
        if any(t > s.offset and (t - s.offset) % s.period == 0 for s in slots)
    ]


@pytest.mark.parametrize(
    "slots",
    [
        [Slot("a", 5 * MS), Slot("b", 20 * MS), Slot("c", 20 * MS, offset=3 * MS)],
        [Slot("a", 7 * MS, offset=6 * MS), Slot("b", 3 * MS)],
        [Slot("one", 10 * MS)],
    ],
)
def test_plan_equals_brute_force(slots):
    assert list(make_plan(slots).walk(0, 200 * MS)) == brute_force(slots, 200 * MS)


def test_walk_in_pieces_equals_walk_at_once():
    plan = make_plan([Slot("a", 5 * MS), Slot("b", 8 * MS, offset=2 * MS)])
    cuts = [0, 13 * MS, 40 * MS, 41 * MS, 333 * MS]
    pieces = [tick for a, b in itertools.pairwise(cuts) for tick in plan.walk(a, b)]
    assert pieces == list(plan.walk(0, 333 * MS))


def test_declared_order_is_kept_at_one_time():
    plan = make_plan([Slot("late", 10 * MS), Slot("early", 5 * MS)])
    assert dict(plan.ticks)[0] == (0, 1)


@pytest.mark.parametrize(
    ("slot", "key"),
    [(Slot("a", 0), "a.period"), (Slot("a", -5), "a.period"), (Slot("a", 10, offset=10), "a.offset")],
)
def test_bad_slots_are_refused_by_name(slot, key):
    with pytest.raises(InputError, match=key):
        make_plan([slot])


def test_two_slots_of_one_name():
    with pytest.raises(InputError, match="declared twice"):
        make_plan([Slot("a", 10), Slot("a", 10)])


@pytest.mark.parametrize("seed", range(6))
def test_a_rhythm_of_any_length_goes_in_rounds(seed):
    """Cut into rounds that differ, the walk is what it is at once, from wherever it begins."""
    rng = np.random.default_rng(seed)
    periods = rng.choice([1, 5, 7, 13, 29, 533, 667, 1000], 4, replace=False).tolist()
    slots = [Slot(str(p), p * MS, offset=int(rng.integers(p)) * MS) for p in periods]
    stop, plan = 1500 * MS, make_plan(slots, most=int(rng.integers(3, 300)))
    whole = brute_force(slots, stop)
    assert not plan.is_every
    assert list(plan.walk(0, stop)) == whole
    start = int(rng.integers(stop))
    assert list(plan.at(start).walk(start, stop)) == [tick for tick in whole if tick[0] > start]


def test_periods_without_a_common_rhythm_have_a_plan():
    plan = make_plan([Slot("a", 9_999_991), Slot("b", 9_999_973)])
    assert len(plan.ticks) <= MOST
    assert [t for t, _ in plan.walk(0, 20_000_000)] == [9_999_973, 9_999_991, 19_999_946, 19_999_982]


def test_rates_are_rounded_to_a_tenth_of_a_millisecond():
    assert from_hz(25) == 40 * MS
    assert from_hz(15) == 66_700_000
    assert from_hz(1e9) == 100_000
    assert NS % from_hz(50) == 0
