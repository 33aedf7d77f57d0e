"""Granted ground: first times, the order at shared places under any delay, messages that are lost."""

import math

import numpy as np
import pytest

from swath.fleet.driven import Grants
from swath.fleet.machines import Drive, Place, body_of
from swath.fleet.table import Table, order_of, segments, standing
from swath.fleet.ways import straight, times_along
from swath.machine.machine_sheet import load_machine
from tests.fleet.drawn import scheduled

BODY = body_of(load_machine("grain-truck"))
DRIVE = Drive(8.0, 2.0, 3.0, 1.0, 0.5, 2.0)


def path(x, y, heading, length):
    track = straight(Place(x, y, heading, heading), length, BODY)
    return segments(track, times_along(track, DRIVE), BODY, "way")


def crossing():
    """Two machines whose ways cross in the origin; the second one has to wait."""
    table = Table()
    for name, x, y in (("a", -60.0, 0.0), ("b", 0.0, -60.0)):
        heading = 0.0 if name == "a" else math.pi / 2
        place = Place(x, y, heading, heading)
        table.stand(name, standing(place, BODY, 0.0, "home"))
    first, second = path(-60.0, 0.0, 0.0, 120.0), path(0.0, -60.0, math.pi / 2, 120.0)
    table.commit("a", first, table.earliest("a", first, 0.0))
    times = table.earliest("b", second, 0.0, early=True)
    table.commit("b", second, times)
    return table, second, times


def test_who_comes_second_waits_just_before_the_shared_place():
    table, second, times = crossing()
    waits = np.diff(times) - second.spent[:-1]
    at = int(np.argmax(waits))
    assert (np.delete(waits, at) < 1e-9).all()
    end = second.track.places[second.last[at], 1]
    assert -16.0 < end < -7.0  # the front of its body is 6.2 m ahead, half of the other 1.3 m wide
    assert list(table.order())


def test_one_that_would_stand_in_the_way_of_what_is_granted_is_not_granted():
    table, _, _ = crossing()
    place = Place(40.0, 60.0, -math.pi / 2, -math.pi / 2)
    table.stand("c", standing(place, BODY, 0.0, "home"))
    to_the_way_of_a = path(40.0, 60.0, -math.pi / 2, 60.0)
    assert table.earliest("c", to_the_way_of_a, 0.0) is not None  # behind a
    blocked = path(60.0, 60.0, -math.pi / 2, 60.0)  # where a stands in the end
    assert table.earliest("c", blocked, 0.0) is None


def test_what_is_taken_back_is_gone():
    table, _, times = crossing()
    mark, count = table.mark(), len(table.segments)
    more = path(0.0, 60.0, math.pi / 2, 30.0)
    table.commit("b", more, table.earliest("b", more, times[-1] + 60.0))
    table.back(mark)
    assert len(table.segments) == count
    assert table.segments[table.last["b"]].out == math.inf


def test_who_is_called_back_no_longer_stands_where_it_would_have_come_to():
    table, _, _ = crossing()
    table.stand("c", standing(Place(60.0, 60.0, math.pi, math.pi), BODY, 0.0, "home"))
    past_the_end_of_b = path(60.0, 60.0, math.pi, 120.0)
    first = next(s.number for s in table.segments if s.machine == "b" and s.index == 1)
    mark = table.mark()
    table.take_off(first)
    assert table.earliest("c", past_the_end_of_b, 300.0) is not None
    table.back(mark)
    assert table.earliest("c", past_the_end_of_b, 300.0) is None
    table.take_off(first)
    new = table.clear()
    assert [s.number for s in table.segments] == [n for n in new if n >= 0]
    assert table.last["b"] == new[first]
    assert np.isfinite(order_of(table).times(np.ones((len(table.segments), 1)))).all()


def test_a_circle_is_refused():
    table, _, _ = crossing()
    (a, b), *_ = table.order()
    table.calls.append((b, a))
    with pytest.raises(ValueError, match="circle"):
        order_of(table)


def test_ten_thousand_draws_of_delays_bring_nobody_together():
    """Every pair of segments that share ground, in the planned order, under delays of up to 600 s."""
    table = scheduled(130).table
    order = order_of(table)
    rng = np.random.default_rng(1)
    pairs = shared(table)
    after = np.array([s.next for s in table.segments])
    assert len(pairs) > 50
    for _ in range(10):
        spent = order.spent[:, None] + rng.exponential(5.0, (len(order.spent), 1000))
        spent += 600.0 * (rng.random(spent.shape) < 0.01)
        into = order.times(spent)
        out = np.where(after[:, None] >= 0, into[after], np.inf)
        assert np.isfinite(into).all()
        assert (out[pairs[:, 0]] <= into[pairs[:, 1]] + 1e-6).all()


def shared(table):
    """Pairs of segments of two machines that sweep the same ground, who is first by the plan first."""
    import shapely

    flat = [(s, p) for s in table.segments for p in s.path.swept[s.index]]
    tree = shapely.STRtree([p for _, p in flat])
    found = set()
    for i, j in tree.query([p for _, p in flat], predicate="intersects").T:
        a, b = flat[i][0], flat[j][0]
        if a.machine != b.machine and a.out <= b.into + 1e-9:
            found.add((a.number, b.number))
    return np.array(sorted(found))


def test_planned_times_are_those_of_the_order():
    schedule = scheduled(130)
    into = order_of(schedule.table).times(order_of(schedule.table).spent[:, None])[:, 0]
    planned = np.array([s.into for s in schedule.table.segments])
    assert (into <= planned + 1e-6).all()  # a cart may be early where its combine was not asked to wait


@pytest.mark.parametrize("lost", [0.0, 0.4])
def test_machines_that_drive_as_granted_all_arrive_though_messages_are_lost(lost):
    """Each second each machine says where it is and what it wants; some of that is lost or comes later."""
    table, rng = scheduled(130).table, np.random.default_rng(2)
    grants, held, at = Grants(order_of(table)), {}, {}
    pairs = shared(table)
    before = {b: [a for a, c in pairs if c == b] for b in {b for _, b in pairs.tolist()}}
    for name in table.last:
        held[name] = [s.number for s in table.segments if s.machine == name]
        at[name] = -1
        grants.set(name, 1, held[name])
    late, steps = [], 0
    while any(at[n] < len(held[n]) - 1 for n in held):
        steps += 1
        assert steps < 40 * len(table.segments)
        for name, numbers in held.items():
            allowed = grants.granted(name)
            if allowed is not None and at[name] < numbers.index(allowed):
                at[name] += 1
                gone = {m for n in held for m in held[n][: max(at[n], 0)]}
                assert all(a in gone for a in before.get(numbers[at[name]], ()))
            here = numbers[at[name]] if at[name] >= 0 else None
            if rng.random() >= lost:
                late.append((name, here, numbers[min(at[name] + 3, len(numbers) - 1)]))
        due, late = late, []
        for name, here, wanted in due:
            if here is not None:
                grants.reached(name, 1, here)
            grants.ready(name, 1, wanted)
            grants.ready(name, 0, held[name][-1])  # of an older reservation
    assert all(grants.granted(n) == held[n][-1] for n in held)
