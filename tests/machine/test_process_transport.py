import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.machine.transport import Conveyor, Mixer, flow_delay


def leaving(conveyor, masses, way):
    return [conveyor.advance([m], way)[0] for m in masses]


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 1.234, 2.75])
def test_plug_flow_delays_by_exactly_its_length(delay):
    """The mean time of what leaves is the mean time of what entered plus the delay, whatever the step."""
    for h in (0.01, 0.1, 0.37):
        count = round(8.0 / h)
        out = leaving(Conveyor(delay, 1), [2.0 if i < 5 else 0.0 for i in range(count)], h)
        times = (np.arange(count) + 0.5) * h
        assert sum(out) == pytest.approx(10.0, rel=1e-12)
        assert np.dot(times, out) / 10.0 - 2.5 * h == pytest.approx(delay, abs=1e-9)


def test_a_step_comes_out_as_a_step():
    out = leaving(Conveyor(1.05, 1), [3.0] * 30, 0.1)
    assert out[:10] == [0.0] * 10
    assert out[10] == pytest.approx(1.5)
    assert out[11:] == pytest.approx([3.0] * 19)


def test_a_stopped_conveyor_keeps_everything_and_goes_on():
    conveyor = Conveyor(1.0, 1)
    leaving(conveyor, [1.0] * 4, 0.1)
    assert leaving(conveyor, [0.5, 0.5, 0.5], 0.0) == [0.0] * 3
    out = leaving(conveyor, [0.0] * 20, 0.1)
    assert sum(out) == pytest.approx(5.5)
    assert max(out) == pytest.approx(1.0 + 1.5)  # what piled up leaves in one lump
    assert conveyor.held() == [0.0]


def test_joined_packets_cost_less_and_shift_little():
    fine, coarse = Conveyor(1.0, 1), Conveyor(1.0, 1, joined=0.02)
    masses = [1.0 + math.sin(0.05 * i) for i in range(3000)]
    a, b = leaving(fine, masses, 0.001), leaving(coarse, masses, 0.001)
    assert len(coarse.save()["packets"]) < 60 < len(fine.save()["packets"])
    assert sum(a) + fine.held()[0] == pytest.approx(sum(b) + coarse.held()[0], rel=1e-12)
    assert np.cumsum(b) == pytest.approx(np.cumsum(a), abs=0.01 * sum(a) / 3)


flows = st.lists(st.tuples(st.floats(0, 50), st.floats(0, 40), st.floats(0, 2)), min_size=1, max_size=120)


@given(flows, st.floats(0, 5), st.floats(0, 0.1))
@settings(max_examples=80)
def test_nothing_is_lost_on_the_way(steps, length, joined):
    conveyor, fed, left = Conveyor(length, 2, joined=joined), np.zeros(2), np.zeros(2)
    for grain, straw, way in steps:
        fed += (grain, straw)
        left += conveyor.advance([grain, straw], way)
        packets = sum((np.array(masses) for *_, masses in conveyor.save()["packets"]), np.zeros(2))
        assert conveyor.held() == pytest.approx(packets, rel=1e-12, abs=1e-9)
    assert left + packets == pytest.approx(fed, rel=1e-12, abs=1e-12)
    assert np.all(left >= 0.0)


def test_mixing_is_the_first_order_response():
    for h in (0.01, 0.1, 0.5):
        mixer = Mixer(1)
        out = [mixer.advance([2.0 * h], h, 1.5)[0] for _ in range(round(4.0 / h))]
        total = 2.0 * (4.0 - 1.5 * (1.0 - math.exp(-4.0 / 1.5)))
        assert sum(out) == pytest.approx(total, rel=1e-12)
        assert mixer.held()[0] == pytest.approx(8.0 - total, rel=1e-12)
    assert Mixer(1).advance([3.0], 0.1, 0.0) == [3.0]


def test_delay_falls_with_the_flow_as_measured():
    """8 s at 1.3-2.1 kg/s, 6 s at 4-13, 5 s at 17-21 (University of Kentucky yield-monitor test facility)."""

    def settled(flow):
        delay = 6.0
        for _ in range(200):
            delay = flow_delay(flow * delay, 6.0, 8.5, 0.19)
        return delay

    assert settled(8.5) == pytest.approx(6.0)
    assert settled(1.7) == pytest.approx(8.0, rel=0.03)
    assert settled(19.0) == pytest.approx(5.0, rel=0.04)
    assert settled(19.0) == pytest.approx(6.0 * (19.0 / 8.5) ** -0.19)
    assert flow_delay(0.0, 6.0, 8.5, 0.19) == pytest.approx(9.6)


def test_saved_transports_go_on_exactly():
    one, two = Conveyor(1.3, 2, joined=0.02), Conveyor(1.3, 2, joined=0.02)
    a, b = Mixer(2), Mixer(2)
    for i in range(40):
        a.advance(one.advance([0.1 * i, 1.0], 0.07), 0.1, 0.4)
    two.load(one.save())
    b.load(a.save())
    for i in range(40):
        left = one.advance([0.1 * i, 1.0], 0.05)
        assert two.advance([0.1 * i, 1.0], 0.05) == left
        assert b.advance(left, 0.1, 0.4) == a.advance(left, 0.1, 0.4)
