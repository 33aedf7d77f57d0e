"""The bias of a gyroscope, told from steering angle and inertial unit."""

from math import atan, fsum, nan

import numpy as np
import pytest
import warp as wp

from swath.control.inertial_kernel import turn
from swath.control.inertial_memory import SAMPLES
from swath.control.yaw_rate import BIAS, UP, no_bias
from swath.core.frames import Pose
from swath.core.units import DEG
from swath.kernels import launch_on
from swath.signals import Inertial, Odometry

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
BASE, DT = 3.75, 0.02


@wp.kernel(enable_backward=False)
def step(memory: wp.array(dtype=wp.float64)):
    turn(memory)


class YawRate:
    """The compiled estimate, launched alone."""

    def __init__(self, wheelbase, mounting):
        self.numbers = no_bias(wheelbase, mounting)

    def of(self, odometry, samples, seconds):
        """The yaw rate [rad/s] less the bias, after samples of the unit and so many seconds."""
        rows = [(s.t, s.rate_x, s.rate_y, s.rate_z, 0.0, 0.0, 0.0) for s in samples or ()]
        rate = odometry.yaw_rate
        self.numbers[:5] = len(rows), rate, odometry.speed, odometry.steer_angle, seconds
        memory = np.concatenate([self.numbers, *rows])
        launch_on(step, memory)()
        self.numbers = memory[:SAMPLES]
        return rate - self.numbers[BIAS]


def left_over(bias, *, turn=0.0, speed=2.0, unit=0.0, angle=0.0, seconds=8.0, has_unit=True, has_angle=True):
    """What is left of a gyro bias [deg/s]; others are off by `unit` [deg/s], `angle` [deg]."""
    rate, rng = YawRate(BASE, Pose(np.zeros(3), np.eye(3))), np.random.default_rng(3)
    wheels = atan(turn * BASE / speed) if speed else 0.0
    for _ in range(round(seconds / DT)):
        noise = 0.1 * DEG * rng.standard_normal(2)
        steer = wheels + angle * DEG if has_angle else nan
        odometry = Odometry(0, speed, turn + bias * DEG + noise[0], steer)
        felt = [Inertial(0, 0.0, 0.0, turn + unit * DEG + noise[1], 0.0, 0.0, 9.81)]
        told = rate.of(odometry, felt if has_unit else None, DT)
    return (told - noise[0] - turn) / DEG


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turn", [0.0, 0.01])
def test_a_large_bias_is_taken_off(sign, turn):
    assert left_over(0.5 * sign, turn=turn) == pytest.approx(0.0, abs=0.05)
    assert left_over(0.5 * sign, turn=turn, unit=-0.05, angle=0.1) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("other", [{"unit": 0.5}, {"angle": 2.0}, {"has_unit": False, "angle": 6.0}])
def test_one_other_sensor_that_is_off_is_not_believed(other):
    assert left_over(0.0, **other) == pytest.approx(0.0, abs=0.04)


def test_sound_sensors_leave_the_gyroscope_alone():
    assert left_over(0.02, unit=0.1, angle=-0.2) == pytest.approx(0.02, abs=0.02)
    assert left_over(0.3, has_unit=False, has_angle=False) == pytest.approx(0.3, abs=1e-9)
    assert np.isnan(YawRate(BASE, None).of(Odometry(0, 2.0, nan, 0.0), None, DT))


def test_a_machine_at_rest_does_not_turn():
    assert left_over(0.3, speed=0.0, has_unit=False) == pytest.approx(0.0, abs=0.03)
    assert abs(left_over(0.3, has_unit=False)) > 0.1  # one sensor against one, on the way


def test_the_bias_is_estimated_anew_every_half_second():
    rate, told = YawRate(BASE, Pose(np.zeros(3), np.eye(3))), []
    for k in range(250):
        odometry = Odometry(0, 2.0, 0.5 * DEG, 0.01 * np.sin(k))
        told.append(rate.of(odometry, [Inertial(0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81)], DT))
    changes = np.flatnonzero(np.diff(told))
    assert len(changes) == 10
    assert (np.diff(changes) == 25).all()


@pytest.mark.parametrize("count", [1, 4, 90])
def test_samples_of_a_step_count_by_their_mean(count):
    """However many there are; one in which a number is missing does not count."""
    rng = np.random.default_rng(count)
    mounting = Pose.from_euler((1.0, 0.0, 2.0), 0.2, -0.1, 1.5)
    each, mean = YawRate(BASE, mounting), YawRate(BASE, mounting)
    up = mounting.rotation[2].tolist()
    for call in range(60):
        rows = rng.normal(0.0, 0.1, (count, 3))
        turns = [fsum(a * b for a, b in zip(up, row, strict=True)) for row in rows.tolist()]
        felt = [Inertial(0, *row, 0.0, 0.0, 9.81) for row in rows.tolist()]
        turn = fsum(turns) / count
        broken = [Inertial(0, nan, 0.0, 0.0, 0.0, 0.0, 9.81)]
        steer = nan if call % 11 == 0 else float(rng.normal(0.0, 0.2))
        odometry = Odometry(0, float(rng.normal(2.0, 0.5)), float(rng.normal(0.0, 0.05)), steer)
        alone = Inertial(0, *(turn * v for v in up), 0.0, 0.0, 9.81)
        assert each.of(odometry, felt + broken, DT) == pytest.approx(
            mean.of(odometry, [alone], DT), abs=1e-15
        )
    known = each.numbers[UP.stop :]
    assert all(known[:5])
    assert known == pytest.approx(mean.numbers[UP.stop :], abs=1e-14)
