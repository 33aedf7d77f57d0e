import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.machine.motion.kinematic import Kinematic, Params
from swath.signals import SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, Ground, drive, site, slope


def make(**kwargs):
    motion = Kinematic(Params(start_speed_kmh=7.2), site(**kwargs))
    motion.reset(STREAM)
    return motion


@pytest.mark.parametrize("dt", [0.001, 0.01, 0.1])
def test_circle_in_closed_form_at_any_step(dt):
    motion = make()
    steer = 0.2
    states = drive(motion, 9.0, dt=dt, steering=SteerState(0, steer, 0.0), speed=SpeedCommand(0, 2.0))
    kappa = math.tan(steer) / 3.9
    way = 2.0 * np.array([s.t for s in states]) * 1e-9
    position = np.array([s.pose.position for s in states])
    np.testing.assert_allclose(position[:, 0], np.sin(kappa * way) / kappa, atol=1e-10)
    np.testing.assert_allclose(position[:, 1], (1 - np.cos(kappa * way)) / kappa, atol=1e-10)
    assert states[-1].yaw_rate == pytest.approx(2.0 * kappa)
    assert states[-1].distance == pytest.approx(18.0)


def test_steering_left_swings_the_tail_right():
    state = drive(make(), 0.2, steering=SteerState(0, 0.3, 0.0), speed=SpeedCommand(0, 2.0))[-1]
    assert state.pose.position[1] > 0.0
    assert state.pose.apply([-3.9, 0.0, 0.0])[1] < 0.0


def test_left_and_right_mirror():
    left, right = (
        drive(make(), 3.0, steering=SteerState(0, a, 0.0), speed=SpeedCommand(0, 2.5))[-1]
        for a in (0.3, -0.3)
    )
    np.testing.assert_array_equal(left.pose.position * [1, -1, 1], right.pose.position)


def test_saved_state_goes_on_byte_for_byte():
    inputs = {"steering": SteerState(0, 0.1, 0.0), "speed": SpeedCommand(0, 1.0)}
    motion, other = make(), make()
    drive(motion, 1.0, **inputs)
    kept = motion.save()
    first = drive(motion, 1.0, **inputs)[-1]
    other.load(kept)
    second = drive(other, 1.0, **inputs)[-1]
    assert first.pose.position.tobytes() == second.pose.position.tobytes()
    assert (first.speed, first.distance, first.yaw_rate) == (second.speed, second.distance, second.yaw_rate)


def test_accelerates_and_brakes_at_the_sheet_limits():
    motion = Kinematic(Params(), site())
    motion.reset(STREAM)
    straight = SteerState(0, 0.0, 0.0)
    up = [s.speed for s in drive(motion, 2.0, steering=straight, speed=SpeedCommand(0, 3.0))]
    assert max(np.diff(up)) == pytest.approx(0.5 * 0.01)
    drive(motion, 10.0, steering=straight, speed=SpeedCommand(0, 3.0))
    down = [s.speed for s in drive(motion, 2.0, steering=straight, speed=SpeedCommand(0, 0.0))]
    assert min(np.diff(down)) == pytest.approx(-0.8 * 0.01)
    assert drive(motion, 60.0, steering=straight, speed=SpeedCommand(0, 99.0))[-1].speed == pytest.approx(
        20 / 3.6
    )


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.5, -1.9])
@pytest.mark.parametrize(("along", "left"), [(0.1, 0.0), (0.0, 0.12), (-0.15, 0.08)])
def test_stands_flat_on_a_plane(yaw, along, left):
    start = Pose.from_euler((3.0, -2.0, 0.0), yaw=yaw)
    state = make(ground=slope(along, left), start=start).reset(STREAM)["state"]
    normal = np.array([-along, -left, 1.0]) / math.hypot(along, left, 1.0)
    np.testing.assert_allclose(state.pose.rotation[:, 2], normal, atol=1e-12)
    assert state.pose.position[2] == pytest.approx(along * 3.0 + left * -2.0)
    assert state.pose.euler()[2] == pytest.approx(yaw)


def test_uphill_lifts_the_nose_and_left_rise_lifts_the_left():
    roll, pitch, _ = make(ground=slope(0.1, 0.0)).reset(STREAM)["state"].pose.euler()
    assert (roll, pitch) == (pytest.approx(0.0), pytest.approx(-math.atan(0.1)))
    roll, pitch, _ = make(ground=slope(0.0, 0.1)).reset(STREAM)["state"].pose.euler()
    assert (roll, pitch) == (pytest.approx(math.atan(0.1)), pytest.approx(0.0))


def test_rear_axle_does_not_roll_the_body():
    tilted_rear = Ground(lambda x, y: np.where(x < -2.0, 0.1 * y, 0.0))
    roll, pitch, _ = make(ground=tilted_rear).reset(STREAM)["state"].pose.euler()
    assert roll == pytest.approx(0.0, abs=1e-12)
    assert pitch == pytest.approx(0.0, abs=1e-12)


def test_tyres_bridge_short_waves():
    def amplitude(wavelength):
        wave = Ground(lambda x, y: 0.05 * np.cos(2 * np.pi * x / wavelength) + 0 * y)
        states = drive(make(ground=wave), 4.0, steering=SteerState(0, 0.0, 0.0), speed=SpeedCommand(0, 2.0))
        return np.ptp([s.pose.position[2] for s in states]) / 0.1

    assert amplitude(4.0) == pytest.approx(np.sinc(0.8 / 4.0), rel=0.01)
    assert amplitude(1.6) == pytest.approx(np.sinc(0.5), rel=0.03)
    assert amplitude(0.8) < 0.05
