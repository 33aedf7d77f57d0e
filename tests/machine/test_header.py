import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.frames import Pose
from swath.machine.header.fixed_height import FixedHeightHeader, Params
from swath.machine.sweep import signed_area, swept
from swath.signals import MachineState
from tests.machine.machine_fakes import STREAM, Ground, site


def state(x, y, yaw, t=0):
    return MachineState(t, Pose.from_euler((x, y, 0.0), yaw=yaw), 2.0, 0.0, 0.0, 0.0, 0.0)


def make(**params):
    ground = Ground()
    header = FixedHeightHeader(Params(**params), site(ground))
    header.reset(STREAM)
    return header, ground


def circle(radius, turn, count):
    angles = np.linspace(0.0, turn, count + 1)
    return [state(radius * math.sin(a), radius * (1 - math.cos(a)), a) for a in angles]


def total(header, states, per_step):
    flows = [
        header.step(i, per_step, {"state": tuple(states[i : i + per_step])})["flow"]
        for i in range(0, len(states), per_step)
    ]
    return sum(f.area for f in flows), flows


def test_straight_sweep():
    header, _ = make()
    area, flows = total(header, [state(0.01 * i, 1.0, 0.0) for i in range(1001)], 8)
    assert area == pytest.approx(12.0 * 10.0, rel=1e-12)
    assert flows[-1].header_fill == pytest.approx(1.0)
    assert sum(f.grain for f in flows) == pytest.approx(0.8 * 120.0)


def test_sweep_in_an_arc():
    """Speed across the knife is (R - y) * turn rate wherever it lies ahead: the sweep is width * R * turn."""
    radius, turn = 20.0, 1.2
    header, ground = make()
    area, _ = total(header, circle(radius, turn, 2000), 8)
    assert area == pytest.approx(12.0 * radius * turn, rel=1e-5)
    assert all(len(p) == 4 for p in ground.cuts)


def test_turn_about_a_point_of_the_knife_sweeps_two_fans():
    """R = 4.3 m: the left end of a 12 m header lies beyond the turning point and backs up."""
    radius, turn = 4.3, 0.5
    header, _ = make(sweep_step_m=0.0)
    area, _ = total(header, circle(radius, turn, 2000), 4)
    # parts of the knife at a distance s abeam of the turning point sweep |s| ds * turn
    expected = 0.5 * turn * ((radius + 6.0) ** 2 + (6.0 - radius) ** 2)
    # every part counts, also where the two fans lie over each other
    assert area == pytest.approx(expected, rel=1e-3)


def test_no_gaps_between_neighbouring_polygons():
    header, ground = make()
    total(header, circle(6.5, 2.0, 500), 7)
    for before, after in zip(ground.cuts, ground.cuts[1:], strict=False):
        shared = {tuple(p) for p in before} & {tuple(p) for p in after}
        assert len(shared) == 2


def test_standing_still_cuts_nothing():
    header, ground = make()
    area, flows = total(header, [state(1.0, 2.0, 0.3)] * 50, 5)
    assert (area, flows[-1].header_fill, ground.cuts) == (0.0, 0.0, [])


def test_first_pose_only_starts_the_sweep():
    header, ground = make()
    header.step(0, 1, {"state": (state(0, 0, 0),)})
    assert ground.cuts == []
    header.step(1, 1, {"state": ()})
    header.step(2, 1, {"state": (state(0.5, 0, 0),)})
    assert sum(signed_area(p) for p in ground.cuts) == pytest.approx(6.0)


def test_saved_header_goes_on_where_it_was():
    states = circle(15.0, 0.5, 100)
    whole, one = make()
    total(whole, states, 10)
    first, _ = make()
    total(first, states[:60], 10)
    second, two = make()
    second.load(first.save())
    total(second, states[60:], 10)
    assert np.concatenate(two.cuts).tobytes() == np.concatenate(one.cuts[-len(two.cuts) :]).tobytes()


coordinate = st.floats(-0.5, 0.5)


@settings(max_examples=200)
@given(coordinate, coordinate, st.floats(-0.3, 0.3))
def test_every_part_is_convex_and_anticlockwise(dx, dy, turn):
    before = np.array([[0.0, 6.0], [0.0, -6.0]])
    c, s = math.cos(turn), math.sin(turn)
    after = before @ np.array([[c, s], [-s, c]]) + (dx, dy)
    for part in swept(before.tolist(), after.tolist()):
        part = np.array(part)
        rolled, further = np.roll(part, -1, axis=0), np.roll(part, -2, axis=0)
        a, b = rolled - part, further - rolled
        assert np.all(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] >= -1e-9)
        assert signed_area(part) > 0
