"""Contacts of machines with things and with each other: events, counts, clearance, the end of the run."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.field.site_setup import Bodies
from swath.field.solid.solids import machine_body, post, stone
from swath.judge.evaluator import EvaluatorSetup
from swath.judge.evaluators.contact import LEVEL
from swath.record.message_factory import RecordedMachine
from swath.signals import MachineState
from tests.field.test_solids import MACHINE

POST = post([20.0, 0.0, 0.0], 2.0, 0.2)


def watches(bodies, *names, **options):
    machines = {n: RecordedMachine(n, MACHINE, "left") for n in names}
    made = [EvaluatorSetup(None, machines, n, bodies=bodies, **options) for n in names]
    return [LEVEL.component(setup) for setup in made]


def drive(bodies, watch, name, until, *, begin=0.0, y=0.0, speed=2.0, hz=100):
    """Straight along x; clearance at every step, which is the same when it is asked for at the end."""
    (column,), times, seen = watch.columns(), [], []
    for i in range(round((until - begin) / speed * hz) + 1):
        x = begin + speed * i / hz
        pose = Pose.from_euler((x, y, 0.0))
        bodies.place(name, pose)
        t = round(i * NS / hz)
        watch.see(f"{name}.motion", t, {"state": MachineState(t, pose, speed, 0.0, 0.0, 0.0, x - begin)})
        times.append(t / NS)
        seen += column.later({"t_s": np.array([t / NS])}).tolist()
    at_end = column.later({"t_s": np.array(times)})
    np.testing.assert_array_equal(at_end, seen)
    return at_end


def test_driving_through_a_post_is_one_contact_from_begin_to_end():
    bodies = Bodies({"post 1": POST})
    bodies.add("combine", machine_body(MACHINE), Pose.identity())
    (watch,) = watches(bodies, "combine")
    assert watch.metrics()["contact_count"] == 0.0
    clearance = drive(bodies, watch, "combine", 30.0)
    (event,) = watch.events()
    knife = 20.0 - 0.1 - MACHINE.knife_x  # way of the fixed axle when the knife is there
    assert (event.kind, event.machine, event.other) == ("contact", "combine", "post 1")
    assert event.distance == pytest.approx(knife, abs=0.11)
    assert event.t / NS == pytest.approx(event.distance / 2.0)
    assert (event.x, event.y) == (pytest.approx(20.0, abs=0.25), pytest.approx(0.0, abs=0.2))
    assert event.end_distance == pytest.approx(25.1, abs=0.12)
    assert watch.metrics() == {"contact_count": 1.0, "least_clearance_m": 0.0}
    assert watch.end_reason(0) == f"touched post 1 at {event.t / NS:.1f} s"
    way = np.arange(len(clearance)) * 0.02
    near = (way > knife - 4.9) & (way < knife)
    assert np.abs(clearance - (knife - way))[near].max() < 0.12  # looked at 20 times per second
    assert watches(bodies, "combine", contact_ends_run=False)[0].end_reason(0) == ""


def test_a_post_outside_the_header_and_a_low_stone_are_not_touched():
    low, high = stone([10.0, 0.0, 0.0], [0.5, 0.4, 0.18]), stone([10.0, 0.0, 0.0], [0.5, 0.4, 0.3])
    for obstacle, count in ((post([20.0, 5.2, 0.0], 2.0, 0.2), 0), (low, 0), (high, 1)):
        bodies = Bodies({"it": obstacle})
        bodies.add("combine", machine_body(MACHINE), Pose.identity())
        (watch,) = watches(bodies, "combine")
        drive(bodies, watch, "combine", 40.0)
        assert len(watch.events()) == watch.metrics()["contact_count"] == count
        assert bool(watch.end_reason(0)) == bool(count)


def test_two_machines_that_touch_each_count_it_and_one_event_tells_of_it():
    bodies = Bodies()
    bodies.add("combine", machine_body(MACHINE), Pose.identity())
    bodies.add("cart", machine_body(MACHINE), Pose.from_euler((40.0, 0.0, 0.0)))
    combine, cart = watches(bodies, "combine", "cart")
    drive(bodies, combine, "combine", 32.0)
    drive(bodies, cart, "cart", 40.2, begin=40.0)
    assert combine.metrics() == cart.metrics() == {"contact_count": 1.0, "least_clearance_m": 0.0}
    assert [(e.machine, e.other, e.end_t) for e in cart.events()] == [("cart", "combine", None)]
    assert combine.events() == []
    bodies.hitch("combine", "cart")
    assert bodies.contacts() == []
    assert bodies.clearance("combine") == (np.inf, "")


def test_what_is_far_away_is_no_clearance():
    bodies = Bodies({"post 1": POST})
    bodies.add("combine", machine_body(MACHINE), Pose.identity())
    (watch,) = watches(bodies, "combine")
    assert np.isnan(drive(bodies, watch, "combine", -80.0, begin=-82.0)).all()
    assert LEVEL.component.LIMITS == {"contact_count": {"max": 0.0}}
