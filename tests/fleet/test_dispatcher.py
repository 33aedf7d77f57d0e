"""Dispatchers: what the horizon estimates, and that it holds on drawn states and jobs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.fleet.dispatcher import Ahead, Greedy, Horizon, Option, State
from swath.fleet.files import read_job
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import by_events
from tests.fleet.check import looked_at
from tests.fleet.drawn import drawn_job, scheduled

TANK, BOX = 9000.0, 24000.0
WAY, AT_TRUCK = 150.0, 100.0  # s, from the truck, and there
TRIP = 2.0 * WAY + AT_TRUCK


def drawn_state(seed: int) -> State:
    """Up to four combines, up to three carts, up to six options."""
    rng = np.random.default_rng(seed)
    carts = {
        f"cart_{i}": (float(rng.uniform(0.0, 600.0)), float(rng.uniform(1000.0, BOX)))
        for i in range(rng.integers(0, 4))
    }
    others = {
        f"other_{i}": Ahead(rng.uniform(0.0, 400.0), rng.uniform(0.0, TANK), TANK, 20.0 * rng.integers(2))
        for i in range(rng.integers(0, 4))
    }
    options = tuple(drawn_option(rng, list(carts)) for _ in range(rng.integers(1, 7)))
    comes = {name: free + float(rng.uniform(0.0, WAY)) for name, (free, _) in carts.items()}
    return State(
        0.0, "own", 5000.0, TANK, 3000.0, carts, 9, options, 20.0, others, comes, dict.fromkeys(carts, WAY),
        dict.fromkeys(carts, AT_TRUCK), dict.fromkeys(carts, (BOX, 0.6 * BOX)),
        may_wait=bool(others) and bool(rng.integers(2)),
    )  # fmt: skip


def drawn_option(rng: np.random.Generator, carts: list[str]) -> Option:
    """Of any kind, times in whole seconds, so that some are alike."""
    begins, load = float(rng.integers(0, 300)), float(rng.uniform(500.0, TANK))
    pours = load / 90.0
    if not carts or rng.random() < 0.3:
        return Option("cut", "", begins, begins + 300.0, 0.0, 8000.0, 0.0, 0.0, 270.0)
    cart, ends = str(rng.choice(carts)), begins + pours
    cuts = float(rng.choice([0.0, 280.0]))
    kind, cart_next, room = (
        "beside" if cuts else "stand",
        ends + TRIP * rng.integers(2),
        rng.uniform(0.0, BOX),
    )
    return Option(
        kind, cart, begins, ends + cuts, load, TANK - load, ends + 300.0, pours, cuts, cart_next, room
    )


def estimate(state: State, option: Option) -> float:
    return option.lost + Horizon.waits(state, option)


@pytest.mark.parametrize("seed", range(40))
def test_by_its_own_estimate_the_horizon_is_never_worse_than_greedy(seed):
    state = replace(drawn_state(seed), may_wait=False)
    chosen, greedy = Horizon().decide(state), Greedy().decide(state)
    assert chosen in state.options
    assert estimate(state, chosen) <= estimate(state, greedy) + 0.1
    assert estimate(state, chosen) <= min(estimate(state, o) for o in state.options) + 0.1


@pytest.mark.parametrize("seed", range(40))
def test_a_decision_depends_on_neither_the_order_of_options_nor_that_of_machines(seed):
    state = drawn_state(seed)
    turned = replace(
        state, options=state.options[::-1], carts=dict(reversed(state.carts.items())),
        others=dict(reversed(state.others.items())),
    )  # fmt: skip
    for dispatcher in (Horizon(), Greedy()):
        assert dispatcher.decide(turned) == dispatcher.decide(state)


@pytest.mark.parametrize("seed", range(40))
def test_moved_in_time_the_estimate_is_the_same(seed):
    state = drawn_state(seed)
    later = replace(
        state, time=1000.0, carts={n: (t + 1000.0, room) for n, (t, room) in state.carts.items()},
        others={n: replace(o, time=o.time + 1000.0) for n, o in state.others.items()},
        comes={n: t + 1000.0 for n, t in state.comes.items()},
    )  # fmt: skip
    for o in state.options:
        moved = replace(
            o, begins=o.begins + 1000.0, ends=o.ends + 1000.0, cart_free=o.cart_free + 1000.0,
            cart_next=o.cart_next + 1000.0,
        )  # fmt: skip
        assert Horizon.waits(later, moved) == pytest.approx(Horizon.waits(state, o), abs=1e-6)


@pytest.mark.parametrize("apart", [0.0, 100.0, 250.0])
def test_two_tanks_that_are_full_at_once_wait_for_one_cart_and_later_ones_less(apart):
    """Both are full at 450 s and so much later; the cart, there before, takes one load, then empties."""
    state = State(
        0.0, "own", 0.0, TANK, 3000.0, {"cart": (0.0, TANK)}, 9, (), 20.0,
        {"other": Ahead(apart, 0.0, TANK, 20.0)}, {"cart": WAY}, {"cart": WAY}, {"cart": AT_TRUCK},
        {"cart": (TANK, TANK)},
    )  # fmt: skip
    cut = Option("cut", "", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    calls, waits, there = [TANK / 20.0, TANK / 20.0 + apart], 0.0, WAY
    for _ in range(4):
        time, later = sorted(calls)
        come = max(time, there)
        waits, there, calls = waits + come - time, come + TRIP, [later, come + TANK / 20.0]
    assert Horizon.waits(state, cut) == pytest.approx(waits)
    assert waits > 0.0


def test_it_lets_another_one_go_first_where_it_stands_in_the_way_and_only_then():
    late = Option("stand", "cart", 500.0, 560.0, 5000.0, 0.0, 900.0, 60.0)
    state = State(
        0.0, "own", 5000.0, TANK, 3000.0, {"cart": (0.0, BOX)}, 9, (late,), 20.0,
        {"other": Ahead(30.0, 0.0, TANK, 20.0)}, {"cart": 0.0}, {"cart": WAY}, {"cart": AT_TRUCK},
        {"cart": (BOX, BOX)},
        soonest={"stand": 50.0}, may_wait=True,
    )  # fmt: skip
    assert Horizon().decide(state) is None
    assert Horizon().decide(replace(state, may_wait=False)) == late
    assert Horizon().decide(replace(state, soonest={"stand": 480.0})) == late  # nobody is in the way
    busy = {"other": Ahead(490.0, 0.0, TANK, 20.0)}
    assert Horizon().decide(replace(state, others=busy)) == late  # it goes on too late


def test_who_always_lets_others_go_first_is_asked_once_and_the_job_ends():
    class Polite:
        def decide(self, state: State) -> Option | None:
            return None if state.may_wait else Greedy().decide(state)

    schedule = schedule_of(read_job("small-two-combines")[0], dispatcher=Polite())
    assert schedule.delivered == pytest.approx(schedule.harvested)
    assert looked_at(schedule).contact == {}


def test_two_combines_on_a_small_field_do_not_wait_for_each_other():
    """They set out on ground as it is cut: half of the time that both have is that of cutting."""
    worked = by_events(schedule_of(read_job("small-two-combines")[0]))
    assert worked.efficiency > 0.5


def test_a_drawn_job_ends_with_each_built_in_dispatcher():
    job = drawn_job(130, (0.5, 1.0))
    assert job.fleet.dispatcher == "horizon"
    assert schedule_of(job).ends == scheduled(130).ends  # the same each time
    greedy = schedule_of(replace(job, fleet=replace(job.fleet, dispatcher="greedy")))
    for made in (scheduled(130), greedy):
        assert math.isclose(made.delivered, made.harvested, rel_tol=1e-9)
