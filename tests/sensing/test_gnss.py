"""Satellite receiver: lever arm, latency, noise that has the sizes it says, losses."""

from dataclasses import replace

import numpy as np
import pytest

from swath.core.random import Stream
from swath.documents.validation import validate
from swath.documents.yaml_document import parse
from swath.record.digest import sample_bytes
from swath.sensing.gnss.antenna import Place
from swath.sensing.gnss.error import PRESETS, ErrorGnss, Loss, Params
from swath.sensing.gnss.receiver_errors import FIGURES
from swath.signals import FIX_QUALITIES
from tests.sensing.driven_states import circle, column, feed, rolling, setup_of, standing, state, straight

IdealGnss, IdealParams = PRESETS["ideal"].component, PRESETS["ideal"].params
TOP = Place(x_m=0.0, y_m=0.0, z_m=4.0)
EXACT = {"noise_cm": 0.0, "wander_cm": 0.0, "velocity_noise_m_s": 0.0, "latency_ms": 0.0}


def error(seed=1, origin=None, **params):
    sensor = ErrorGnss(Params(**params), setup_of(origin))
    sensor.reset(Stream(seed, "combine.gnss"))
    return sensor


def ideal(place=TOP):
    sensor = IdealGnss(IdealParams(place), setup_of())
    sensor.reset(Stream(1, "combine.gnss"))
    return sensor


def bits(samples):
    return [sample_bytes("combine.gnss", "fix", s.t, s) for s in samples]


def test_roll_and_pitch_move_the_antenna():
    (fix,) = feed(ideal(), standing(roll=0.1), 1)
    assert (fix.x, fix.y, fix.z) == pytest.approx((10.0, 20.0 - 4.0 * np.sin(0.1), 0.5 + 4.0 * np.cos(0.1)))
    (fix,) = feed(ideal(Place(x_m=1.5, y_m=-0.4, z_m=4.0)), standing(pitch=0.05, yaw=np.pi / 2), 1)
    ahead, up = 1.5 * np.cos(0.05) + 4.0 * np.sin(0.05), 4.0 * np.cos(0.05) - 1.5 * np.sin(0.05)
    assert (fix.x, fix.y, fix.z) == pytest.approx((10.0 + 0.4, 20.0 + ahead, 0.5 + up))


def test_a_rolling_machine_that_stands_has_a_speed_over_ground():
    amplitude, frequency = 0.03, 0.5
    fixes = feed(ideal(), rolling(amplitude, frequency), 20)
    for fix in fixes:
        rate = amplitude * 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * (fix.t * 1e-9 - 0.01))
        assert fix.speed == pytest.approx(abs(4.0 * rate), abs=1e-3)  # mean of the 20 ms before


def test_speed_and_course_on_a_circle():
    place = Place(x_m=2.0, y_m=0.0, z_m=4.0)
    for fix in feed(ideal(place), circle(2.0, 20.0), 30):
        turn = 2.0 / 20.0
        assert fix.speed == pytest.approx(np.hypot(2.0, 2.0 * turn), rel=1e-5)
        heading = turn * (fix.t * 1e-9 - 0.01)
        assert fix.course == pytest.approx(heading + np.arctan2(2.0 * turn, 2.0), abs=1e-5)
        assert fix.quality == FIX_QUALITIES.index("fix")


def test_backwards_the_course_is_where_it_goes_and_at_rest_there_is_none():
    (fix,) = feed(ideal(), straight(-1.0, yaw=0.5), 1)
    assert fix.course == pytest.approx(0.5 - np.pi)
    (fix,) = feed(ideal(), standing(), 1)
    assert fix.speed == 0.0
    assert np.isnan(fix.course)


def test_without_errors_it_equals_ideal():
    exact = error(antenna=TOP, **EXACT)
    assert [s.x for s in feed(exact, circle(2.0, 20.0), 10)] == [
        s.x for s in feed(ideal(), circle(2.0, 20.0), 10)
    ]
    a, b = (feed(s, straight(2.0, 0.3), 10) for s in (error(antenna=TOP, **EXACT), ideal()))
    for name in ("t", "x", "y", "z", "speed", "course", "quality", "horizontal_sd"):
        np.testing.assert_array_equal(column(a, name), column(b, name))


def test_a_sample_is_late_and_says_when_it_was_measured():
    sensor = error(antenna=TOP, **{**EXACT, "latency_ms": 62.0})
    fixes = feed(sensor, straight(2.0), 12)
    for k, fix in enumerate(fixes):
        assert fix.t == (k + 1) * 100_000_000 - 62_000_000
        assert fix.x == pytest.approx(2.0 * fix.t * 1e-9, abs=1e-12)
        assert fix.speed == pytest.approx(2.0)
    late = feed(error(antenna=TOP, **{**EXACT, "latency_ms": 350.0}), straight(2.0), 6)
    assert [s.quality for s in late] == [0, 0, 0, 4, 4, 4]  # nothing was measured before the start
    assert [s.t for s in late[:4]] == [0, 0, 0, 50_000_000]
    assert np.isnan(late[0].x)


def test_the_wandering_error_is_gauss_markov():
    sensor = error(noise_cm=0.0, wander_cm=30.0, wander_s=2.0, vertical_factor=1.0, latency_ms=0.0)
    fixes = feed(sensor, standing(), 4000, step=500_000_000, state_step=500_000_000)
    off = np.stack([column(fixes, n) for n in "xyz"]) - np.array([[11.0], [20.0], [4.4]])
    assert off.std() == pytest.approx(0.30, rel=0.06)
    for lag_s in (0.5, 2.0, 4.0):
        lag = round(lag_s * 2)
        found = np.mean(off[:, lag:] * off[:, :-lag]) / np.mean(off**2)
        assert found == pytest.approx(np.exp(-lag_s / 2.0), abs=0.06)


def test_each_receiver_is_as_far_off_as_it_says():
    for receiver, quality in (("rtk", "fix"), ("dgps", "dgps")):
        firsts = np.array(
            [[f.x - 11.0, f.y - 20.0, f.z - 4.4] for k in range(400)
             for f in feed(error(seed=k, receiver=receiver, latency_ms=0.0), standing(), 1)]
        )  # fmt: skip
        (fix,) = feed(error(receiver=receiver), standing(), 1)
        assert FIX_QUALITIES[fix.quality] == quality
        assert firsts[:, :2].std() == pytest.approx(fix.horizontal_sd, rel=0.08)
        assert firsts[:, 2].std() == pytest.approx(fix.vertical_sd, rel=0.1)
        assert fix.vertical_sd / fix.horizontal_sd == pytest.approx(1.75)
    fixes = feed(error(), straight(2.0), 4000, state_step=20_000_000)
    white = np.diff(column(fixes, "y")).std() / np.sqrt(2.0)
    assert white == pytest.approx(FIGURES["fix"].noise, rel=0.05)
    assert column(fixes, "speed").std() == pytest.approx(0.03, rel=0.05)


def test_two_passes_of_a_differential_receiver_lie_as_far_apart_as_published():
    apart = replace(FIGURES["dgps"], noise=0.0).difference(900.0)
    assert apart == pytest.approx(0.20, abs=0.005)  # 15 to 25 cm pass to pass


def test_a_lost_fix_leaves_what_it_leaves():
    losses = (Loss(1.0, 2.0, "float"), Loss(1.5, 1.8), Loss(3.0, 3.25, "dgps"))
    fixes = feed(error(losses=losses, latency_ms=0.0), standing(), 40)
    for fix in fixes:
        s = fix.t * 1e-9
        expected = (
            "none" if 1.5 <= s < 1.8 else "float" if 1.0 <= s < 2.0 else "dgps" if 3.0 <= s < 3.25 else "fix"
        )
        assert FIX_QUALITIES[fix.quality] == expected
        assert np.isnan(fix.x) == (expected == "none")
    by_name = {FIX_QUALITIES[f.quality]: f.horizontal_sd for f in fixes if f.quality}
    assert by_name["fix"] < 0.02 < by_name["float"] < by_name["dgps"]


def errors_of(text):
    document = parse(text)
    return [str(e) for e in validate(Params, document.data, (), document)[1]]


def test_losses_that_are_none_are_refused():
    assert errors_of("losses: [{from_s: 3, to_s: 4, quality: single}]") == []
    assert "to_s = 2.0: expected > from_s = 3" in errors_of("losses: [{from_s: 3, to_s: 2.0}]")[0]
    better = errors_of("receiver: dgps\nlosses: [{from_s: 3, to_s: 4, quality: float}]")[0]
    assert "expected one of none, single, less than the receiver's" in better


def test_equal_seeds_give_equal_bytes_and_a_saved_one_goes_on():
    path = circle(2.0, 20.0)
    whole = bits(feed(error(), path, 40))
    assert bits(feed(error(), path, 40)) == whole
    assert bits(feed(error(seed=2), path, 40)) != whole
    one, two = error(), error(seed=1)
    feed(one, path, 17)
    saved = one.save()
    feed(one, path, 5, first=17)  # what was saved stays as it was
    two.load(saved)
    assert bits(feed(two, path, 23, first=17)) == whole[17:]
    a, b = ideal(), ideal()
    feed(a, path, 3)
    b.load(a.save())
    assert bits(feed(b, path, 5, first=3)) == bits(feed(ideal(), path, 8))[3:]


def test_a_receiver_put_in_while_driving_knows_one_state():
    sensor = error(**EXACT)
    fix = sensor.step(0, 100_000_000, {"state": (state(straight(2.0), 5_000_000_000),)})["fix"]
    assert fix.x == pytest.approx(11.0)
