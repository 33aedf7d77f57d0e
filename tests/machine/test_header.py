import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.frames import Pose
from swath.field.cutting.cut_result import Cut
from swath.field.edges.edge import StraightEdge
from swath.field.memory_layout import REVISION
from swath.machine.header.fixed_height import FixedHeightHeader, Params
from swath.machine.sweep import Sweeps, numbered
from swath.signals import MachineState
from tests.field.made_field import made_field
from tests.machine.machine_fakes import STREAM, Ground, signed_area, site


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
    for corners, area, _ in Sweeps(2, [-1.0]).between(before.tolist(), after.tolist()):
        part = np.array(corners)
        rolled, further = np.roll(part, -1, axis=0), np.roll(part, -2, axis=0)
        a, b = rolled - part, further - rolled
        assert np.all(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] >= -1e-9)
        assert 0.0 < area == pytest.approx(signed_area(part))


def line_ends(pose, x, *abeam):
    """World xy of the ends of a line across the machine [m]."""
    return [[pose[k] * x + pose[k + 1] * y + pose[(k - 3) // 3] for k in (3, 6)] for y in abeam]


def drawn_way(rng, steps):
    """Poses of a machine, 0 to 6 a step: ahead, back, about a point of the knife, at rest."""
    x, y, yaw = rng.uniform(-20.0, 20.0), rng.uniform(-20.0, 20.0), rng.uniform(-3.0, 3.0)
    for _ in range(steps):
        ahead, turn = rng.choice([0.03, 0.03, -0.03, 0.0, 2.0]), rng.choice([0.0, 0.0, 0.02, -0.1])
        states = []
        for _ in range(rng.integers(0, 7)):
            x, y, yaw = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw), yaw + turn
            states.append(state(x, y, yaw))
        yield tuple(states)


@pytest.mark.parametrize("seed", range(4))
def test_a_step_takes_what_the_field_cuts_of_each_polygon(seed, monkeypatch):
    """To the bit, and both fields hold the same after it: pages in the order in which they were used, too."""
    rng = np.random.Generator(np.random.Philox(seed))
    own, other = (made_field(page_limit=12, edge=StraightEdge(x_m=-200.0, y_m=-250.0)) for _ in range(2))
    header, way = FixedHeightHeader(Params(), site(own)), Sweeps(2, [Params().sweep_step_m])
    header.reset(STREAM)
    way.widen(6)
    asked, cut, polygons = [], own.cut, 0
    monkeypatch.setattr(own, "cut", lambda *given: asked.append(given) or cut(*given))
    for number, states in enumerate(drawn_way(rng, 60)):
        poses = [[*s.pose.position, *s.pose.rotation.ravel()] for s in states]
        way.counts[0] = len(poses)
        way.lines[0, : len(poses)] = [line_ends(pose, *header.knife) for pose in poses] or 0.0
        way.launch.launch()
        taken = Cut()
        for polygon, *_ in numbered(way.polygons[0, : way.found[0]]):
            taken += other.cut(polygon, Params().cutting_height_m)
            polygons += 1
        flow = header.step(number, 20_000_000, {"state": states})["flow"]
        assert (flow.grain, flow.straw, flow.area) == (taken.grain, taken.straw, taken.area)
        assert (flow.stem_count, flow.left_grain) == (taken.stem_count, taken.grain_left)
        if number % 20 == 19:
            own.ensure(*(far := rng.uniform(-90.0, 90.0, 2)), 10.0)
            other.ensure(*far, 10.0)
    assert own.recount().area > 100.0
    assert 0 < len(asked) < 0.3 * polygons  # the others are cut by compiled code
    assert own.recount() == other.recount()
    assert own.pages.counters[REVISION] == other.pages.counters[REVISION]
    assert own.store.recut == other.store.recut
    assert list(own.store.keys) == list(other.store.keys)
