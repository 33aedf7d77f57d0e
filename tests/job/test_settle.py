"""Standoffs that nobody can solve: the higher machine drives on after a while, and that is told."""

import math

import pytest

from swath.job.contact import ContactWatch
from swath.job.path import Pose
from swath.job.settle import LONGEST, Settle
from swath.job.states import CartState, CombineState
from swath.job.traffic import LOOKS, look
from tests.job.test_give_way import CART, COMBINE, STEP, driving

HERE = Pose(0.0, 0.0, 0.0)


def combine(phase="way"):
    return CombineState(None, 0, HERE, 0.0, phase=phase)


def drive(movers, states, time):
    """All for a time [s]: the standoffs that were settled, contact [s], and by when each one first moved."""
    settle, watch, told, moved = Settle(), ContactWatch(), [], {}
    by_name = dict(zip((m.name for m in movers), states, strict=True))
    for m in movers:
        watch.add(m.name, m.driver.footprint)
    for i in range(round(time / STEP)):
        if i % LOOKS == 0:
            for m in movers:
                m.blocked, m.claim, m.ignores = "", None, settle.ignores.get(m.name, ())
            look(movers, {})
            told += settle.look(i * STEP, movers, by_name, {})
        for m in movers:
            if m.wanted > 0.0:
                m.driver.step(m.wanted)
                if m.driver.machine.distance > 15.0:
                    moved.setdefault(m.name, i * STEP)
        watch.look(i * STEP, STEP, {m.name: m.driver.place for m in movers})
    return told, watch.pairs[0].touched, moved, settle


def test_nose_to_nose_the_higher_one_drives_on_and_then_both_are_past():
    higher = driving(COMBINE, HERE, 2.0, "higher")
    lower = driving(CART, Pose(40.0, 0.0, math.pi), 2.0, "lower")
    told, touched, _, settle = drive([higher, lower], [combine(), CartState(None, HERE, "to_truck")], 300.0)
    (found,) = told
    assert (found.first, found.second, found.solved_by) == ("higher", "lower", "")
    assert found.driven_on == "higher"
    assert LONGEST <= found.time < LONGEST + 20.0
    assert 3.0 < touched < 30.0
    assert higher.driver.machine.x > 60.0
    assert lower.driver.machine.x < -20.0
    assert settle.ignores == {}


def test_who_is_done_and_in_the_way_is_driven_over_by_the_lower_one():
    done = driving(COMBINE, Pose(30.0, 2.0, 0.0), 0.0, "done")
    cart = driving(CART, HERE, 2.0, "cart")
    told, touched, _, settle = drive(
        [done, cart], [combine("done"), CartState(None, HERE, "to_truck")], 260.0
    )
    assert [(s.first, s.driven_on) for s in told] == [("cart", "cart")]
    assert touched > 3.0
    assert cart.driver.machine.x > 70.0
    assert settle.ignores == {}


@pytest.mark.parametrize(
    "ahead",
    [
        CartState(None, HERE, "queue"),
        CartState(None, HERE, "beside", combine=CombineState(None, 0, HERE, 0.0, is_pouring=True)),
    ],
    ids=["at the truck", "under the pipe"],
)
def test_who_works_for_a_while_is_waited_for(ahead):
    there = driving(CART, Pose(30.0, 0.0, 0.0), 0.0, "there")
    cart = driving(CART, HERE, 2.0, "cart")
    told, touched, moved, _ = drive([there, cart], [ahead, CartState(None, HERE, "to_truck")], 2.0 * LONGEST)
    assert (told, touched) == ([], 0.0)
    assert moved["cart"] < 30.0


def test_behind_one_who_drives_slowly_nobody_is_held_up():
    slow = driving(COMBINE, Pose(20.0, 0.0, 0.0), 0.3, "slow")
    cart = driving(CART, HERE, 2.0, "cart")
    told, touched, _, _ = drive([slow, cart], [combine(), CartState(None, HERE, "to_truck")], 2.0 * LONGEST)
    assert (told, touched) == ([], 0.0)
