import math

import numpy as np
import pytest

from swath.core.schedule import NS
from swath.core.units import DEG
from swath.machine.steering import actuator, ideal
from swath.signals import SteerCommand
from tests.machine.machine_fakes import STREAM, site

WHEELBASE = 3.9


def make(**params):
    steering = actuator.Actuator(actuator.Params(**params), site())
    steering.reset(STREAM)
    return steering


def run(steering, commands, dt, until):
    """Angles at every step end. commands: (time [ns], curvature); the newest one is at the input."""
    angles = []
    for t in range(0, until, dt):
        newest = [c for c in commands if c[0] <= t + dt][-1]
        out = steering.step(t, dt, {"command": SteerCommand(newest[0], newest[1], True)})["steering"]
        angles.append(out.angle)
    return np.array(angles)


def curvature(angle):
    return math.tan(angle) / WHEELBASE


def test_dead_time_is_exact_to_the_nanosecond():
    dt, dead = 5_000_000, 0.123_456_789
    steering = make(dead_time_s=dead, lag_s=0.2, dead_band_percent=0.0)
    angles = run(steering, [(0, 0.0), (100_000_000, curvature(5 * DEG))], dt, NS)
    times = np.arange(1, len(angles) + 1) * dt * 1e-9
    gone = times - 0.1 - dead
    # inside rate * lag = 3 deg the approach is exponential, before that a ramp of 15 deg/s
    ramp = (5 - 3) / 15
    expected = np.where(gone < ramp, 15 * gone, 5 - 3 * np.exp(-(gone - ramp) / 0.2))
    np.testing.assert_allclose(angles, np.where(gone > 0, expected, 0.0) * DEG, atol=1e-12)


@pytest.mark.parametrize("dt", [1_000_000, 20_000_000, 100_000_000])
def test_same_answer_at_any_step(dt):
    commands = [(0, 0.0), (200_000_000, curvature(0.3)), (700_000_000, curvature(-0.1))]
    fine = run(make(), commands, 1_000_000, 2 * NS)
    coarse = run(make(), commands, dt, 2 * NS)
    np.testing.assert_allclose(coarse, fine[dt // 1_000_000 - 1 :: dt // 1_000_000], atol=1e-12)


def test_rate_limit_and_angle_limit():
    angles = run(make(), [(0, 10.0)], 10_000_000, 6 * NS)
    assert np.max(np.diff(angles)) == pytest.approx(15 * DEG * 0.01)
    band = 0.04 * 0.2 * 15 * DEG
    assert angles[-1] == pytest.approx(42 * DEG - band, abs=1e-6)


def test_dead_band_leaves_the_stated_rest_error():
    angles = run(make(), [(0, curvature(3 * DEG))], 10_000_000, 5 * NS)
    assert 3 * DEG - angles[-1] == pytest.approx(0.12 * DEG, abs=1e-7)
    assert not np.any(run(make(), [(0, curvature(0.1 * DEG))], 10_000_000, NS))


def test_rate_is_the_slope_of_the_angle():
    steering = make(dead_time_s=0.0)
    command = {"command": SteerCommand(0, curvature(0.2), True)}
    outs = [steering.step(t, 1_000_000, command)["steering"] for t in range(0, NS, 1_000_000)]
    slopes = np.diff([o.angle for o in outs]) / 1e-3
    rates = np.array([o.rate for o in outs])
    np.testing.assert_allclose(slopes, 0.5 * (rates[1:] + rates[:-1]), atol=1e-3)


def test_mirror():
    np.testing.assert_array_equal(
        run(make(), [(0, 0.05)], 10_000_000, NS), -run(make(), [(0, -0.05)], 10_000_000, NS)
    )


def test_disengaged_holds_the_wheels():
    steering = make(dead_time_s=0.0)
    run(steering, [(0, 0.1)], 10_000_000, NS // 2)
    off = {"command": SteerCommand(NS // 2, 0.0, False)}
    held = steering.step(NS // 2, 10_000_000, off)["steering"].angle
    assert steering.step(NS // 2 + 10_000_000, 10_000_000, off)["steering"].angle == held > 0.0


def test_save_keeps_the_commands_under_way():
    commands = [(0, 0.0), (400_000_000, 0.1), (450_000_000, -0.2)]
    whole = make()
    first = run(whole, commands, 10_000_000, NS // 2)
    kept = whole.save()
    after = [
        whole.step(t, 10_000_000, {"command": SteerCommand(450_000_000, -0.2, True)})["steering"]
        for t in range(NS // 2, NS, 10_000_000)
    ]
    other = make()
    other.load(kept)
    again = [
        other.step(t, 10_000_000, {"command": SteerCommand(450_000_000, -0.2, True)})["steering"]
        for t in range(NS // 2, NS, 10_000_000)
    ]
    assert after == again
    assert [len(part) for part in kept["queue"]] == [2, 2, 2]
    assert first[-1] == 0.0


def test_ideal_takes_the_angle_at_once_within_the_limit():
    steering = ideal.IdealSteering(ideal.Params(), site())
    steering.reset(STREAM)
    out = steering.step(0, NS // 100, {"command": SteerCommand(0, 0.1, True)})["steering"]
    assert out.angle == pytest.approx(math.atan(0.39))
    out = steering.step(0, NS // 100, {"command": SteerCommand(0, -9.0, True)})["steering"]
    assert out.angle == pytest.approx(-42 * DEG)
