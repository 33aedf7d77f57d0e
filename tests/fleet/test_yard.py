"""Waiting places: each can be left and come to when all others are taken."""

from swath.fleet.bodies import body_of
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import machines_of
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Finder
from swath.fleet.yard import WIDE, Waits, at_gate, run_of, waiting_places
from tests.fleet.drawn import drawn_job


def test_seven_machines_wait_so_that_each_can_leave_and_come_back_with_all_others_there():
    job = drawn_job(101, (0.5, 1.0))
    machines = machines_of(job)
    ground = Ground(job, body_of(machines.truck))
    finder = Finder(ground.grid)
    waits = [Waits(c.name, c.body, c.drive, None) for c in machines.combines]
    waits += [Waits(k.name, k.body, k.drive, ground.dock.ahead(-k.box_x)) for k in machines.carts]
    places = [home.place for home in waiting_places(ground, finder, waits)]
    taken = [run_of(w.body, place, 0.0, WIDE) for w, place in zip(waits, places, strict=True)]
    for i, (w, place) in enumerate(zip(waits, places, strict=True)):
        others = taken[:i] + taken[i + 1 :]
        assert not shapely_here().intersects(run_of(w.body, place, 0.0), others).any()

        def way(start, goal, w=w, others=others):
            return finder.find(w.body, w.drive, start, goal, stand=others, in_line=WAYS.line_deg)

        for goals in (at_gate(ground), [w.dock] if w.dock is not None else []):
            assert not goals or any(way(place, g) is not None for g in goals)
            assert not goals or any(way(g, place) is not None for g in goals)
