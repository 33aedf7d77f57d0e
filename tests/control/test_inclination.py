"""Which way is up, from rates and forces of a machine that drives, turns, speeds up and rolls."""

from math import fsum, nan

import numpy as np
import pytest

from swath.control.inclination import BIAS, KNOWN, Inclination
from swath.core.frames import Pose, rotation_matrix
from swath.signals import Inertial

DEG = np.pi / 180


def drive(*, seconds=20.0, hz=100, per_call=4, mounting=None, bias=0.0, attitude=None, speed=None, yaw=0.0):
    """(estimated, true) upward directions after the last call. attitude(t) -> roll, pitch [rad]."""
    attitude, speed = attitude or (lambda t: (0.0, 0.0)), speed or (lambda t: 2.0)
    mounting = mounting or Pose.identity()
    turned = lambda t: rotation_matrix(*attitude(t), yaw * t)  # noqa: E731
    filtered, waiting, dt = Inclination(mounting), [], 1.0 / hz
    for k in range(1, round(seconds * hz) + 1):
        t = k * dt
        a, b = turned(t - dt), turned(t)
        skew = (a.T @ b - b.T @ a) / 2 / dt
        rate = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        v = [r[:, 0] * speed(at) for r, at in ((a, t - dt), (b, t))]
        force = b.T @ ((v[1] - v[0]) / dt + np.array([0.0, 0.0, 9.81]))
        rate, force = mounting.rotation.T @ rate + bias, mounting.rotation.T @ force
        waiting.append(Inertial(round(t * 1e9), *rate, *force))
        if k % per_call == 0:
            filtered.take(tuple(waiting), speed(t))
            waiting = []
    return filtered, turned(seconds)[2]


def angle(filtered, up):
    return np.arccos(min(1.0, float(filtered.up @ up))) / DEG


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (5.0, 0.0), (-6.0, 4.0)])
def test_a_standing_tilt(roll, pitch):
    filtered, up = drive(seconds=1.0, attitude=lambda t: (roll * DEG, pitch * DEG))
    assert angle(filtered, up) < 0.02
    assert filtered.rise[1] == pytest.approx(np.tan(roll * DEG) / np.cos(0), abs=2e-3)
    assert np.sign(filtered.rise[0]) == -np.sign(pitch)


def test_a_first_sample_that_says_something_else_is_soon_forgotten():
    """Put down on a slope, a machine slides before its tyres hold it."""
    filtered = Inclination(None)
    for k in range(1, 51):
        aside = 0.0 if k <= 2 else 9.8 * np.sin(7.0 * DEG)
        filtered.take((Inertial(k * 40_000_000, 0.0, 0.0, 0.0, 0.0, aside, 9.8),), 0.0)
        if k == 20:
            assert filtered.rise[1] > 0.85 * np.sin(7.0 * DEG)
    assert filtered.rise[1] > 0.95 * np.sin(7.0 * DEG)
    assert np.abs(filtered.numbers[BIAS:KNOWN]).max() < 0.05 * DEG


def test_waves_in_the_ground_are_followed():
    waves = lambda t: (0.02 * np.sin(0.3 * t), 0.08 * np.sin(0.31 * t + 1.0))  # noqa: E731
    assert angle(*drive(attitude=waves)) < 0.2


def test_bends_and_speeding_up_are_no_tilt():
    assert angle(*drive(yaw=0.2)) < 0.1
    assert angle(*drive(seconds=4.0, speed=lambda t: 0.5 * max(0.0, t - 0.2))) < 0.3


def test_a_biased_unit_mounted_askew():
    askew = Pose.from_euler((0.0, 0.0, 1.5), 3 * DEG, -5 * DEG, 30 * DEG)
    filtered, up = drive(seconds=90.0, mounting=askew, bias=0.2 * DEG, attitude=lambda t: (4 * DEG, 0.0))
    assert angle(filtered, up) < 0.2


def test_without_a_unit_nothing_is_known():
    filtered = Inclination(None)
    filtered.take(None, 2.0)
    filtered.take((Inertial(1, *[float("nan")] * 6),), 2.0)
    assert not filtered.is_known
    assert filtered.rise == (0.0, 0.0)


def test_a_saved_filter_goes_on():
    filtered, _ = drive(attitude=lambda t: (0.05, 0.0))
    other = Inclination(None)
    other.load(filtered.save())
    sample = (Inertial(20_040_000_000, 0.0, 0.01, 0.0, 0.0, 0.4, 9.8),)
    for f in (filtered, other):
        f.take(sample, 2.0)
    assert (filtered.up == other.up).all()


@pytest.mark.parametrize("count", [1, 5, 90])
def test_samples_of_a_step_count_by_their_mean(count):
    """However many there are; one in which a number is missing does not count."""
    rng = np.random.default_rng(count)
    mounting = Pose.from_euler((1.0, 0.0, 2.0), 0.2, -0.1, 1.5)
    each, mean, t = Inclination(mounting), Inclination(mounting), 0
    for _ in range(20):
        rows = np.hstack([rng.normal(0.0, 0.2, (count, 3)), rng.normal([0, 0, 9.81], 1.0, (count, 3))])
        samples = [Inertial(t + 10_000_000 * (k + 1), *row) for k, row in enumerate(rows.tolist())]
        t = samples[-1].t
        broken = [Inertial(t, 0.0, nan, 0.0, 0.0, 0.0, 5.0)]
        each.take(broken + samples + broken, 2.0)
        mean.take([Inertial(t, *(fsum(column) / count for column in zip(*rows.tolist(), strict=True)))], 2.0)
        assert each.save() == mean.save()
    other = Inclination(mounting)
    other.load(each.save())
    assert other.rise == each.rise != (0.0, 0.0)


def test_a_force_without_a_direction_changes_nothing():
    filtered, _ = drive(attitude=lambda t: (0.05, 0.0))
    up = filtered.up
    filtered.take((Inertial(20_040_000_000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1),), 2.0)
    assert (filtered.up == up).all()
