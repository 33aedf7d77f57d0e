"""Waiting places: each can be left and come to when others are taken."""

import pytest

from swath.core.errors import InputError
from swath.fleet.ground import Ground, run_of, shapely_here
from swath.fleet.machines import body_of, machines_of
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Finder
from swath.fleet.yard import WIDE, Waits, at_gate, waiting_places
from tests.fleet.drawn import drawn_job


def test_seven_machines_wait_so_that_each_can_leave_and_come_back():
    job = drawn_job(101, (0.5, 1.0))
    machines = machines_of(job)
    ground = Ground(job, body_of(machines.truck))
    finder = Finder(ground.grid)
    waits = [Waits(c.name, c.body, c.drive, None) for c in machines.combines]
    waits += [Waits(k.name, k.body, k.drive, ground.dock.ahead(-k.box_x)) for k in machines.carts]
    kept = waiting_places(ground, finder, waits)
    taken = {w.name: run_of(w.body, kept[w.name].place, 0.0, WIDE) for w in waits}
    order = list(kept)
    for w in waits:
        place, before = kept[w.name].place, order[: order.index(w.name)]
        # combines leave theirs last one first
        others = [taken[name] for name in (order if w.body.has_trailer else before) if name != w.name]
        assert not shapely_here().intersects(taken[w.name], [taken[n] for n in order if n != w.name]).any()

        def way(start, goal, w=w, others=others):
            return finder.find(w.body, w.drive, start, goal, stand=others, in_line=WAYS.line_deg)

        for goals in (at_gate(ground), [w.dock] if w.dock is not None else []):
            assert not goals or any(way(place, g) is not None for g in goals)
            assert not goals or any(way(g, place) is not None for g in goals)


def test_a_cart_without_room_is_left_out_and_none_at_all_is_refused():
    job = drawn_job(101, (0.5, 1.0))
    machines = machines_of(job)
    ground = Ground(job, body_of(machines.truck))
    finder = Finder(ground.grid)
    ground.open = ground.open.intersection(shapely_here().Point(ground.gate).buffer(26.0))
    cart = machines.carts[0]
    waits = [Waits(f"cart {i}", cart.body, cart.drive, None) for i in range(6)]
    assert 0 < len(waiting_places(ground, finder, waits)) < 6
    ground.open = ground.open.intersection(shapely_here().Point(ground.gate).buffer(9.0))
    with pytest.raises(InputError, match="expected room for 6 machines"):
        waiting_places(ground, finder, waits)
