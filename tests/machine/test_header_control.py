"""Height control alone: closed forms of its answer to ground and machine, on a ground of our own."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.core.units import DEG, KMH
from swath.machine.header import fixed_height
from swath.machine.header.height_control import Controller, Cylinder, Feelers, HeightControlHeader, Params
from swath.signals import MachineState
from tests.machine.machine_fakes import STREAM, Ground, site

DT = 20_000_000
# no lag anywhere, feelers at the knife: what is left is the control law
PURE = {
    "feeler_behind_m": 0.0,
    "feeler_lag_s": 0.0,
    "feeler_delay_s": 0.0,
    "valve_lag_s": 0.0,
    "dead_time_s": 0.0,
    "dead_band_m": 0.0,
}


class Field(Ground):
    """Also notes at which height what was cut."""

    def cut(self, polygon, height_m):
        self.heights = [*getattr(self, "heights", []), height_m]
        taken = super().cut(polygon, height_m)
        return replace(taken, grain_left=0.1 * taken.area)


def make(height=None, **params):
    ground = Field() if height is None else Field(height)
    header = HeightControlHeader(Params(**params), site(ground, period=DT / NS))
    header.reset(STREAM)
    return header, ground


def state(t, x=0.0, z=0.0, roll=0.0, pitch=0.0, speed=2.0):
    return MachineState(t, Pose.from_euler((x, 0.0, z), roll, pitch), speed, 0.0, 0.0, 0.0, x)


def go(header, seconds, where, start=0):
    """Step with the states that `where(t in s)` gives as keywords; lists of flows and heights."""
    steps = range(start, start + round(seconds * NS) // DT)
    states = ((k, state((k + 1) * DT, **where((k + 1) * DT / NS))) for k in steps)
    out = [header.step(k * DT, DT, {"state": (now,)}) for k, now in states]
    return [o["flow"] for o in out], [o["height"] for o in out]


def test_on_level_ground_it_is_the_fixed_header():
    header, ground = make()
    flows, heights = go(header, 2.0, lambda t: {"x": 2.0 * t})
    plain_ground = Ground()
    plain = fixed_height.FixedHeightHeader(fixed_height.Params(), site(plain_ground))
    plain.reset(STREAM)
    for k in range(100):
        plain.step(k * DT, DT, {"state": (state(0, x=2.0 * (k + 1) * DT / NS),)})
    assert len(ground.cuts) == len(plain_ground.cuts) == 99
    np.testing.assert_allclose(np.array(ground.cuts), np.array(plain_ground.cuts), atol=1e-12)
    assert set(ground.heights) == {0.15}
    assert all(np.allclose(h.heights, 0.15, atol=1e-12) and h.lift == h.tilt == 0.0 for h in heights)
    assert flows[-1].header_fill == pytest.approx(1.0)


def test_a_step_of_the_ground_is_answered_by_a_geometric_series():
    """The rate is held over a step of 20 ms: error * (1 - gain * dt)^n."""
    header, _ = make(lambda x, y: np.full(np.shape(x), 0.05), gain_per_s=4.0, **PURE)
    _, heights = go(header, 1.0, lambda t: {})
    errors = np.array([h.heights.mean() - 0.15 for h in heights])
    np.testing.assert_allclose(errors, -0.05 * 0.92 ** np.arange(50), atol=2e-4)


@pytest.mark.parametrize(("lead", "seconds", "over"), [(True, 0.8, 1.02), (False, 1.0, 1.12)])
def test_response_time_with_everything_in_it(lead, seconds, over):
    """5 cm step: dead time of feeler (40 ms) and valve (80 ms), then 90 % within 1 s, at most 12 % over.

    With lead the loop is twice as quick and does not overshoot.
    """
    header, _ = make(lambda x, y: np.full(np.shape(x), 0.05), lead=lead)
    _, heights = go(header, 6.0, lambda t: {})
    way = np.array([h.heights.mean() for h in heights]) - 0.10
    t = 0.02 * (np.arange(len(way)) + 1)
    assert np.abs(way[t <= 0.02 + 0.12 + 1e-9]).max() < 1e-12
    assert way[t > 0.02 + 0.18][0] > 1e-5
    assert t[np.argmax(way >= 0.9 * (0.05 - 0.005))] < seconds
    assert way.max() < over * 0.05
    assert abs(way[-1] - 0.05) < 0.0055  # the dead band stays


def test_with_lead_no_gain_makes_it_swing():
    """The loop without delay: at three times the gain at which the plain loop swings for good."""
    swing = {}
    for lead in (True, False):
        header, _ = make(lambda x, y: np.full(np.shape(x), 0.05), lead=lead, gain_per_s=12.0, dead_band_m=0.0)
        _, heights = go(header, 6.0, lambda t: {})
        swing[lead] = np.ptp([h.heights.mean() for h in heights[150:]])
    assert swing[True] < 1e-3
    assert swing[False] > 0.05


def test_a_rolling_machine_is_met_half_way():
    """1 deg to and fro at 0.4 Hz: the ends of the knife go astray by a third less with lead."""
    off = {}
    for lead in (True, False):
        header, _ = make(lead=lead, gain_per_s=3.0, dead_band_m=0.0)
        _, heights = go(header, 10.0, lambda t: {"roll": DEG * math.sin(0.8 * math.pi * t)})
        off[lead] = max(np.abs(h.heights - 0.15).max() for h in heights[250:])
    assert off[True] < 0.75 * off[False]


@pytest.mark.parametrize(("ground", "rate"), [(0.25, 0.3), (-0.2, -0.25)])
def test_a_large_step_is_taken_at_the_cylinders_fastest(ground, rate):
    header, _ = make(lambda x, y: np.full(np.shape(x), ground), gain_per_s=20.0, **PURE)
    _, heights = go(header, 0.6, lambda t: {})
    way = np.array([h.heights.mean() for h in heights])
    assert np.diff(way)[:20] == pytest.approx(rate * 0.02, rel=0.02)


def test_rising_ground_leaves_the_error_of_a_proportional_law_and_none_with_an_integral():
    """Ground that rises 0.06 m/s under a level machine: error = -(dead band + rate / gain)."""
    for integral, expected in ((0.0, -(0.01 + 0.06 / 3.0)), (3.0, -0.01)):
        values = {**PURE, "dead_band_m": 0.01, "gain_per_s": 3.0, "integral_per_s2": integral}
        ground = Field()
        header = HeightControlHeader(Params(**values), site(ground, period=DT / NS))
        header.reset(STREAM)
        errors = []
        for k in range(400):
            ground.height = lambda x, y, z=0.06 * 0.02 * (k + 1): np.full(np.shape(x), z)
            out = header.step(k * DT, DT, {"state": (state((k + 1) * DT),)})
            errors.append(out["height"].heights.mean() - 0.15)
        assert errors[-1] == pytest.approx(expected, rel=0.06)


def test_a_slope_under_the_whole_machine_changes_nothing():
    slope = 0.08
    header, _ = make(lambda x, y: slope * np.asarray(x))
    tilt = -math.atan(slope)
    _, heights = go(header, 4.0, lambda t: {"x": 2.0 * t, "z": 2.0 * t * slope, "pitch": tilt})
    errors = np.array([h.heights for h in heights]) - 0.15
    assert np.abs(errors).max() < 1e-3  # the height is vertical, the knife hangs square on the machine


def test_roll_of_the_machine_is_taken_out_by_the_tilt():
    roll = 1.5 * DEG
    header, _ = make(dead_band_m=0.0)
    _, heights = go(header, 6.0, lambda t: {"roll": roll})
    assert heights[0].heights[0] - heights[0].heights[-1] == pytest.approx(12.0 * math.sin(roll), rel=1e-3)
    assert heights[-1].tilt == pytest.approx(-roll, rel=1e-3)
    assert np.abs(heights[-1].heights - 0.15).max() < 1e-3
    stiff, _ = make(lateral=False)
    _, heights = go(stiff, 6.0, lambda t: {"roll": roll})
    assert heights[-1].tilt == 0.0
    assert heights[-1].contact == pytest.approx(1 / 13, abs=1e-9)  # its right end, one of 13 places, digs in


def test_tilt_stops_at_its_stroke_and_runs_no_faster_than_its_rate():
    header, _ = make(lambda x, y: 0.2 * np.asarray(y), feeler_range_m=3.0)
    _, heights = go(header, 4.0, lambda t: {"z": 1.5})
    tilt = np.array([h.tilt for h in heights])
    assert tilt[-1] == pytest.approx(5.0 * DEG, abs=1e-12)
    assert np.diff(tilt).max() <= 4.0 * DEG * 0.02 + 1e-12


def test_sections_cut_at_their_own_height_and_share_their_ends():
    """Ground falling 2 % to the left: sections of 2 m lie 10, 6, 2, -2, ... cm off the middle."""
    header, ground = make(lambda x, y: -0.02 * np.asarray(y), lateral=False)
    header.step(0, DT, {"state": (state(DT, 0.0),)})
    header.step(DT, DT, {"state": (state(2 * DT, 0.04),)})
    assert len(ground.cuts) == 6
    np.testing.assert_allclose(ground.heights, [0.25, 0.21, 0.17, 0.13, 0.09, 0.05], atol=1e-12)
    for a, b in pairwise(ground.cuts):
        assert len({tuple(p) for p in a} & {tuple(p) for p in b}) == 2
    outline = np.concatenate(ground.cuts)
    assert np.ptp(outline[:, 1]) == pytest.approx(12.0)


def test_neighbours_of_equal_height_are_cut_as_one():
    """The left section is over ground that is 5 cm lower but for its inner end, a quarter of its weight."""
    header, ground = make(lambda x, y: np.where(np.asarray(y) > 4.1, -0.05, 0.0), lateral=False)
    header.step(0, DT, {"state": (state(DT, 0.0),)})
    header.step(DT, DT, {"state": (state(2 * DT, 0.04),)})
    assert ground.heights == pytest.approx([0.19, 0.15])


def test_a_knife_in_the_ground_is_noticed_and_its_skids_keep_it_up():
    header, ground = make(lambda x, y: np.where(np.asarray(y) > 2.1, 0.3, 0.0), gain_per_s=0.0)
    header.step(0, DT, {"state": (state(DT, 0.0),)})
    out = header.step(DT, DT, {"state": (state(2 * DT, 0.04),)})
    assert out["height"].contact == pytest.approx(4 / 13)
    assert out["height"].heights.min() == pytest.approx(-0.15)
    assert ground.heights[0] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("params", "speed", "percent"),
    [
        ({}, 7.0, 0.2),
        ({}, 3.5, 0.1),
        ({"reel_index": 1.6}, 7.0, 0.4),
        ({"reel_index": 0.8}, 7.0, 0.4),
        ({"reel_speed_m_s": 1.2 * 7.0 * KMH}, 7.0, 0.2),
        ({"reel_speed_m_s": 1.6 * 7.0 * KMH}, 7.0, 0.4),
        ({"loss_percent": 0.0}, 7.0, 0.0),
        ({"reel_speed_m_s": 10.0}, 0.5, 10.0),
    ],
)
def test_grain_is_shed_and_none_of_it_forgotten(params, speed, percent):
    header, _ = make(**params)
    flows, _ = go(header, 1.0, lambda t: {"x": speed * KMH * t, "speed": speed * KMH})
    grain, lost, area = (sum(getattr(f, n) for f in flows) for n in ("grain", "lost_grain", "area"))
    assert grain + lost == pytest.approx(0.8 * area, rel=1e-12)
    assert lost == pytest.approx(0.01 * percent * 0.8 * area, rel=1e-9)
    assert sum(f.left_grain for f in flows) == pytest.approx(0.1 * area)


def test_feelers_that_cannot_see_the_wanted_height_are_refused():
    with pytest.raises(InputError, match=r"feeler_range_m = 0\.4: expected more than cutting_height_m"):
        make(cutting_height_m=0.5)


def test_a_saved_header_goes_on_where_it_was():
    def rough(x, y):
        return 0.06 * np.sin(1.3 * np.asarray(x) + 0.4 * np.asarray(y)) + 0.02 * np.sin(3.1 * np.asarray(y))

    def where(t):
        return {"x": 2.0 * t, "z": 0.02 * math.sin(t), "roll": 0.01 * math.sin(2 * t), "pitch": 0.01}

    whole, one = make(rough, integral_per_s2=0.3)
    flows, heights = go(whole, 4.0, where)
    first, _ = make(rough, integral_per_s2=0.3)
    go(first, 1.7, where)
    saved = first.save()
    go(first, 0.5, where, start=85)  # must not touch what was saved
    second, two = make(rough, integral_per_s2=0.3)
    second.load(saved)
    again, seen = go(second, 2.3, where, start=85)
    assert again == flows[85:]
    for a, b in zip(seen, heights[85:], strict=True):
        assert (a.heights.tobytes(), a.readings.tobytes()) == (b.heights.tobytes(), b.readings.tobytes())
        assert (a.lift, a.tilt) == (b.lift, b.tilt)
    assert np.concatenate(two.cuts).tobytes() == np.concatenate(one.cuts[-len(two.cuts) :]).tobytes()


def test_the_cylinder_is_exact_however_it_is_stepped():
    """Dead time 0.1 s, lag 0.2 s: place = rate * (s - lag * (1 - exp(-s / lag))), s = time since 0.1 s."""

    def place(step_ms):
        cylinder = Cylinder(100_000_000, 0.2, (-1.0, 1.0))
        cylinder.command(0, 0.3)
        step = step_ms * 1_000_000
        for k in range(700 // step_ms):
            cylinder.advance(k * step, step)
        return cylinder.place

    expected = 0.3 * (0.6 - 0.2 * (1.0 - math.exp(-3.0)))
    assert [place(ms) for ms in (1, 7, 35, 700)] == pytest.approx([expected] * 4, rel=1e-12)


def test_the_cylinder_stops_at_its_stroke_and_leaves_it_at_once():
    cylinder = Cylinder(0, 0.1, (-0.5, 0.5))
    cylinder.command(0, 1.0)
    for k in range(100):
        cylinder.advance(k * DT, DT)
    assert cylinder.place == 0.5
    cylinder.command(100 * DT, -1.0)
    cylinder.advance(100 * DT, DT)
    s = 0.02
    assert cylinder.place == pytest.approx(0.5 - (s - 0.1 * (1.0 - math.exp(-s / 0.1))))


def test_feelers_delay_smooth_and_saturate():
    feelers = Feelers(np.zeros(1), 0.1, 50_000_000, 0.4)
    read = [float(feelers.read((k + 1) * DT, DT, np.array([9.0]))[0]) for k in range(60)]
    t = 0.02 * (np.arange(60) + 1) - 0.05
    smooth = np.where(t > 0, 0.4 * (1.0 - np.exp(-t / 0.1)), 0.0)
    np.testing.assert_allclose(read, smooth, atol=2e-3)  # straight lines between samples
    assert read[-1] == pytest.approx(0.4, abs=1e-4)


def test_the_integral_neither_winds_up_nor_stays_in_the_dead_band():
    controller = Controller(2.0, 1.0, 0.01, (-0.2, 0.3), 0.02)
    assert [controller.rate(1.0) for _ in range(500)] == [0.3] * 500
    assert controller.sum == 0.0
    for _ in range(10):
        controller.rate(0.05)
    assert controller.sum == pytest.approx(10 * 0.04 * 0.02)
    for _ in range(500):
        rate = controller.rate(0.005)
    assert rate == pytest.approx(0.0, abs=1e-9)
