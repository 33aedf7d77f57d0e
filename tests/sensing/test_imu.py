"""Inertial unit: gravity, turns, lever arms, and noise whose Allan deviation is the data sheet's."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.record.digest import sample_bytes
from swath.sensing.imu.error import PRESETS, UNITS, Axis, ErrorImu, Params
from swath.sensing.imu.strapdown import GRAVITY, Place
from tests.sensing.driven_states import circle, column, feed, setup_of, standing, state, straight

IdealImu, IdealParams = PRESETS["ideal"].component, PRESETS["ideal"].params
STEP = 10_000_000
PERIOD = 0.01
AXLE = Place(z_m=0.0)
QUIET = {
    "noise_factor": 0.0,
    "walk_factor": 0.0,
    **dict.fromkeys(("gyro_bias_deg_s", "accel_bias_mg", "gyro_scale_percent", "accel_scale_percent"), 0.0),
}


def ideal(place=AXLE, start=None):
    sensor = IdealImu(IdealParams(place), setup_of(start=start, period=PERIOD))
    sensor.reset(Stream(1, "combine.imu"))
    return sensor


def error(seed=1, **params):
    sensor = ErrorImu(Params(**{"mount": AXLE, **params}), setup_of(period=PERIOD))
    sensor.reset(Stream(seed, "combine.imu"))
    return sensor


def rates(samples):
    return np.stack([column(samples, f"rate_{a}") for a in "xyz"], axis=1)


def forces(samples):
    return np.stack([column(samples, f"force_{a}") for a in "xyz"], axis=1)


def bits(samples):
    return [sample_bytes("combine.imu", "inertial", s.t, s) for s in samples]


def turned_by(vector):
    """Rotation about an axis by its length [rad] (Rodrigues)."""
    x, y, z = vector
    across, angle = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), np.linalg.norm(vector)
    half = 0.5 * np.sinc(0.5 * angle / np.pi)
    return np.eye(3) + np.sinc(angle / np.pi) * across + 2.0 * half**2 * across @ across


def test_at_rest_on_a_slope_it_feels_gravity_only():
    pitch, roll = 0.12, -0.07
    felt = GRAVITY * np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    samples = feed(ideal(), standing(pitch=pitch, roll=roll, yaw=2.0), 5, step=STEP)
    np.testing.assert_allclose(forces(samples), np.tile(felt, (5, 1)), atol=1e-9)
    np.testing.assert_allclose(rates(samples), 0.0, atol=1e-12)
    turned = ideal(Place(yaw_deg=90.0))  # its x axis is the machine's left
    samples = feed(turned, standing(pitch=pitch, roll=roll), 3, step=STEP)
    np.testing.assert_allclose(forces(samples)[-1], [felt[1], -felt[0], felt[2]], atol=1e-9)


def test_before_the_first_step_it_rests_at_the_start():
    sensor = IdealImu(IdealParams(AXLE), setup_of(start=Pose.from_euler((1.0, 2.0, 3.0), yaw=1.0)))
    sample = sensor.reset(Stream(1, "x"))["inertial"]
    assert (sample.t, sample.force_z, sample.rate_z) == (0, GRAVITY, 0.0)


def test_a_steady_turn_presses_outward_with_speed_times_yaw_rate():
    speed, radius = 2.0, 20.0
    samples = feed(ideal(), circle(speed, radius), 50, step=STEP)
    np.testing.assert_allclose(rates(samples), np.tile([0.0, 0.0, speed / radius], (50, 1)), atol=1e-10)
    inward = speed * speed / radius
    np.testing.assert_allclose(forces(samples), np.tile([0.0, inward, GRAVITY], (50, 1)), atol=1e-6)
    ahead, left = 3.0, -1.0  # lever arm: the unit turns on a circle of its own
    samples = feed(ideal(Place(x_m=ahead, y_m=left, z_m=2.0)), circle(speed, radius), 50, step=STEP)
    turn = speed / radius
    felt = [-(turn**2) * ahead, inward - turn**2 * left, GRAVITY]
    np.testing.assert_allclose(forces(samples), np.tile(felt, (50, 1)), atol=1e-6)


def test_speeding_up_is_felt_and_adds_up():
    path = lambda s: Pose.from_euler((0.5 * 0.8 * s * s, 0.0, 0.0))  # noqa: E731
    samples = feed(ideal(), path, 100, step=STEP)
    np.testing.assert_allclose(forces(samples), np.tile([0.8, 0.0, GRAVITY], (100, 1)), atol=1e-9)


def test_turn_rates_add_up_to_the_turn_and_forces_to_the_speed():
    def bumpy(s):
        return Pose.from_euler((2 * s, 0.3 * np.sin(3 * s), 0.05 * np.sin(40 * s)), yaw=0.4 * np.sin(2 * s))

    samples = feed(ideal(), bumpy, 200, step=STEP)
    assert rates(samples)[:, 2].sum() * PERIOD == pytest.approx(bumpy(2.0).euler()[2], abs=1e-9)
    up = (forces(samples)[1:, 2] - GRAVITY).sum() * PERIOD
    begin, end = ((bumpy(t).position[2] - bumpy(t - 0.005).position[2]) / 0.005 for t in (0.01, 2.0))
    assert up == pytest.approx(end - begin, abs=1e-9)


def test_a_mean_over_a_period_damps_what_is_fast():
    for f in (5.0, 30.0, 60.0):  # 60 Hz folds down to 40 Hz

        def rolling(s, f=f):
            return Pose.from_euler(np.zeros(3), roll=0.01 * np.sin(2 * np.pi * f * s))

        found = rates(feed(ideal(), rolling, 300, step=STEP))[:, 0]
        expected = 0.01 * 2 * np.pi * f * np.sinc(f * PERIOD)
        assert np.sqrt(2.0) * found.std() == pytest.approx(expected, rel=0.01)
        seen = np.fft.rfftfreq(len(found), PERIOD)[np.argmax(np.abs(np.fft.rfft(found)))]
        assert seen == pytest.approx(min(f, 100.0 - f), abs=0.4)


@pytest.mark.parametrize("vector", [[0.3, -1.2, 2.0], [1e-9, 0.0, 2e-9], [0.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
def test_large_and_tiny_turns_from_one_state_to_the_next(vector):
    place, sensor = np.zeros(3), ideal()
    for k, turn in enumerate((np.eye(3), turned_by(np.array(vector)))):
        there = state(lambda _, turn=turn: Pose(place, turn), k * STEP)
        sample = sensor.step(k * STEP, STEP, {"state": (there,)})["inertial"]
    np.testing.assert_allclose(rates([sample])[0] * PERIOD, vector, atol=1e-12)


def test_without_errors_it_equals_ideal():
    a, b = (feed(s, circle(2.0, 20.0), 20, step=STEP) for s in (error(**QUIET), ideal()))
    assert bits(a) == bits(b)


def test_white_noise_has_the_allan_deviation_of_the_data_sheet_at_one_second():
    unit, seconds, one = "bmi088", 400, round(1.0 / PERIOD)
    sensor = error(**{**QUIET, "noise_factor": 1.0}, unit=unit)
    samples = feed(sensor, standing(), seconds * one, step=STEP, state_step=STEP)
    for found, axis in ((rates(samples), UNITS[unit].gyro), (forces(samples), UNITS[unit].accel)):
        means = found.reshape(seconds, one, 3).mean(axis=1)
        allan = np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2))
        assert allan == pytest.approx(axis.density, rel=0.08)
    assert samples[0].rate_sd == pytest.approx(rates(samples).std(), rel=0.02)
    assert samples[0].force_sd == pytest.approx((forces(samples) - [0, 0, GRAVITY]).std(), rel=0.02)


def test_data_sheet_figures_in_si():
    unit = UNITS["mti-1"]
    assert np.degrees(unit.gyro.density) * 60.0 == pytest.approx(0.42)  # deg/sqrt(h), as published beside it
    assert unit.accel.density == pytest.approx(120e-6 * 9.80665)
    assert UNITS["adis16470"].accel.density * 60.0 == pytest.approx(0.037)


def test_the_walk_of_the_bias_gives_the_least_allan_deviation():
    axis = Axis(density=0.007, instability=10.0 / 3600.0)
    tau = np.geomspace(0.1, 1e4, 20_001)
    allan = np.sqrt(axis.density**2 / tau + axis.walk**2 * tau / 3.0)
    assert allan.min() == pytest.approx(axis.instability, rel=1e-6)


def test_the_bias_walks_as_far_as_it_says():
    ends = []
    for seed in range(150):
        sensor = error(seed, **{**QUIET, "walk_factor": 1.0})
        for k in range(20):  # 20 steps of 5 s
            out = sensor.step(k * 5 * 10**9, 5 * 10**9, {"state": (state(standing(), (k + 1) * 5 * 10**9),)})
        ends.append([out["inertial"].rate_x, out["inertial"].force_x])
    sd = np.std(ends, axis=0)
    unit = UNITS["mti-1"]
    assert sd == pytest.approx([unit.gyro.walk * 10.0, unit.accel.walk * 10.0], rel=0.15)


def test_bias_and_scale_are_drawn_once_per_unit():
    biases = []
    for seed in range(200):
        only = {**QUIET, "gyro_bias_deg_s": 0.1, "accel_bias_mg": 2.0}
        samples = feed(error(seed, **only), standing(), 3, step=STEP)
        assert np.ptp(rates(samples), axis=0).max() < 1e-12
        biases.append([np.degrees(samples[0].rate_x), samples[0].force_y / 9.80665e-3])
    assert np.std(biases, axis=0) == pytest.approx([0.1, 2.0], rel=0.15)
    scaled = [
        feed(error(s, **{**QUIET, "accel_scale_percent": 1.0}), standing(), 1, step=STEP)[0].force_z / GRAVITY
        for s in range(200)
    ]
    assert np.std(scaled) == pytest.approx(0.01, rel=0.15)


def test_equal_seeds_give_equal_bytes_and_a_saved_one_goes_on():
    path = circle(2.0, 20.0)
    whole = bits(feed(error(), path, 40, step=STEP))
    assert bits(feed(error(), path, 40, step=STEP)) == whole
    assert bits(feed(error(seed=2), path, 40, step=STEP)) != whole
    for make in (error, ideal):
        one, two = make(), make()
        first = bits(feed(one, path, 17, step=STEP))
        saved = one.save()
        feed(one, path, 5, step=STEP, first=17)  # what was saved stays as it was
        two.load(saved)
        rest = bits(feed(two, path, 23, step=STEP, first=17))
        assert first + rest == bits(feed(make(), path, 40, step=STEP))


def test_without_a_new_state_the_reading_stays():
    sensor = ideal()
    feed(sensor, circle(2.0, 20.0), 3, step=STEP)
    before = sensor.step(30_000_000, STEP, {"state": ()})["inertial"]
    assert before.rate_z == pytest.approx(0.1)
    assert before.t == 40_000_000


def test_a_unit_put_in_while_driving_starts_at_rest():
    sensor = ideal()
    sensor.step(10**9, STEP, {"state": (state(straight(2.0), 10**9),)})
    sample = sensor.step(10**9 + STEP, STEP, {"state": (state(straight(2.0), 10**9 + STEP),)})["inertial"]
    assert (sample.force_x, sample.force_z) == (0.0, GRAVITY)
    assert sensor.step(0, STEP, {"state": (state(straight(2.0), 10**9 + 2 * STEP),)})[
        "inertial"
    ].force_x == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_rates_and_forces_lead_along_drawn_motions_however_many_states_come_in_a_step(count):
    """Rates turn the attitude on to that of the newest state. Forces, in the attitude half way between two
    differences of places (its turn is even), lead from one of them to the next.
    """
    rng = np.random.default_rng(count)
    place = Place(x_m=1.3, y_m=-0.4, z_m=2.1, roll_deg=3.0, pitch_deg=-7.0, yaw_deg=20.0)
    sensor, mount = ideal(place), place.pose()
    pose, begin = Pose.from_euler((3.0, 4.0, 1.0), 0.05, -0.02, 1.0), 0
    sensor.step(-STEP, STEP, {"state": (state(lambda _: pose, 0),)})
    known, velocity = [(0, pose)], None
    for step in range(100):
        first = known[-1][1]
        for k in range(count):
            turn = rng.normal(0.0, 0.02, 3) if step > 20 else np.zeros(3)  # at first it goes straight
            pose = pose @ Pose.from_euler(rng.normal(0.0, 0.02, 3), *turn)
            known.append((begin + (k + 1) * STEP // count, pose))
        states = tuple(state(lambda _, there=there: there, t) for t, there in known[-count:])
        sample = sensor.step(begin, STEP, {"state": states})["inertial"]
        rate, force = (mount.rotation @ seen([sample])[0] for seen in (rates, forces))
        turned = first.rotation @ turned_by(rate * PERIOD)
        np.testing.assert_allclose(turned, pose.rotation, atol=1e-12)
        (s, before), (e, after) = [(t / 1e9, there.point(*mount.position)) for t, there in known[-2:]]
        now = 0.5 * (s + e), (np.array(after) - before) / (e - s)
        if velocity is not None:
            half = 0.5 * (velocity[0] + now[0]) - begin / 1e9
            felt = first.rotation @ turned_by(rate * half) @ force - [0.0, 0.0, GRAVITY]
            np.testing.assert_allclose(velocity[1] + felt * (now[0] - velocity[0]), now[1], atol=1e-10)
        velocity, begin = now, begin + STEP
