"""Covariances of recordings: what a level knows, tiny where it is exact, 1e6 where nobody knows."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.record.motion_messages import EXACT_START, covariance, gone
from swath.runtime.job import run_job
from swath.sensing.odometry.error import ErrorOdometry, Params
from swath.signals import MachineState, SteerState
from tests.machine.machine_fakes import site
from tests.record.test_record_positioning import decoded
from tests.whole.small import small

pytestmark = pytest.mark.usefixtures("code_allowed")

NS = 1_000_000_000
SETS = ("run.max_duration_s=1.0", "combine.lidar=off", "combine.edge=truth")


def messages(folder, *sets, topics):
    run_job(small(*SETS, *sets), folder / "run")
    return decoded(folder / "run", *topics)


def test_odometry_says_how_far_off_it_may_be(tmp_path):
    sets = ("combine.odometry={level: error, slip_percent: 3, speed_scale_percent: 4, gyro_bias_deg_s: 0.3}",)
    found = messages(tmp_path, *sets, topics=("/combine/odometry/odometry", "/combine/motion/state"))
    first, *_, last = found["/combine/odometry/odometry"]
    twist = np.reshape(last.twist.covariance, (6, 6))
    speed = last.twist.twist.linear.x
    assert twist[0, 0] == pytest.approx(0.02**2 + (0.05 * speed) ** 2, rel=1e-9)
    assert twist[5, 5] == pytest.approx(np.radians(0.1) ** 2 + np.radians(0.3) ** 2, rel=1e-9)
    assert [twist[i, i] for i in (1, 2, 3, 4)] == [1e6] * 4
    place = np.reshape(last.pose.covariance, (6, 6))
    assert place[0, 0] > np.reshape(first.pose.covariance, (6, 6))[0, 0]
    assert np.linalg.eigvalsh(place).min() > 0.0
    assert place[5, 5] >= np.radians(0.3) ** 2 * 0.9
    assert place[2, 2] == 1e6
    state = found["/combine/motion/state"][-1]
    assert np.diag(np.reshape(state.twist.covariance, (6, 6))) == pytest.approx([1e-12] * 6)


def test_exact_levels_are_not_unknown(tmp_path):
    sets = ("combine.odometry=ideal", "combine.imu=ideal", "combine.gnss=ideal",
            "field.origin={latitude_deg: 51.5, longitude_deg: 9.2}")  # fmt: skip
    topics = ("/combine/odometry/odometry", "/combine/imu/inertial", "/combine/gnss/fix")
    odometry, inertial, fixes = messages(tmp_path, *sets, topics=topics).values()
    assert 0.0 < odometry[-1].twist.covariance[0] <= 1e-12
    assert 0.0 < inertial[-1].angular_velocity_covariance[0] <= 1e-12
    assert inertial[-1].orientation_covariance[0] == -1.0
    assert fixes[-1].position_covariance_type == 2
    assert 0.0 < fixes[-1].position_covariance[0] <= 1e-12


def test_nobody_knows_how_far_off_an_odometry_of_ones_own_is(tmp_path):
    (tmp_path / "own.py").write_text(
        "from swath.core.component import KeepsState, Port\n"
        "from swath.signals import MachineState, Odometry\n"
        "class Own(KeepsState):\n    inputs = (Port('state', MachineState),)\n"
        "    outputs = (Port('odometry', Odometry),)\n    def __init__(self, params, setup): pass\n"
        "    def reset(self, stream):\n        return {'odometry': Odometry(0, 0.0, 0.0, 0.0)}\n"
        "    def step(self, t, dt, inputs):\n        s = inputs['state']\n"
        "        return {'odometry': Odometry(t + dt, s.speed, s.yaw_rate, 0.0)}\n"
    )
    topic = "/combine/odometry/odometry"
    (found,) = messages(tmp_path, f"combine.odometry={tmp_path}/own.py:Own", topics=(topic,)).values()
    twist, place = (np.diag(np.reshape(m.covariance, (6, 6))) for m in (found[-1].twist, found[-1].pose))
    assert twist.tolist() == place.tolist() == [1e6] * 6


def test_dead_reckoning_is_as_far_off_as_its_covariance_says():
    """300 machines with errors of their own on one bend: spread of their ends against the covariance."""
    params = Params(
        slip_percent=0.0,
        speed_scale_percent=3.0,
        speed_noise_m_s=0.3,
        gyro_bias_deg_s=0.3,
        gyro_noise_deg_s=4.0,
    )
    speed, turn, dt, count = 2.0, 0.08, 0.1, 200
    state = MachineState(0, Pose.identity(), speed, 0.0, turn, 0.0, 0.0)
    ends = []
    for seed in range(300):
        part = ErrorOdometry(params, site())
        part.reset(Stream(seed, "odometry"))
        x = y = heading = 0.0
        for k in range(count):
            sample = part.step(k * NS // 10, NS // 10, {"state": state, "steering": SteerState(0, 0.0, 0.0)})[
                "odometry"
            ]
            middle = heading + 0.5 * sample.yaw_rate * dt
            x, y = x + sample.speed * dt * np.cos(middle), y + sample.speed * dt * np.sin(middle)
            heading += sample.yaw_rate * dt
        ends.append((x, y, heading))
    doubt = EXACT_START
    for k in range(count):
        known = part.errors(SimpleNamespace(speed=speed))
        doubt = gone(doubt, (k + 0.5) * turn * dt, speed, dt, known["speed"], known["yaw_rate"])
    said, found = np.reshape(covariance(doubt), (3, 3)), np.cov(np.transpose(ends))
    assert np.sqrt(np.diag(found)) == pytest.approx(np.sqrt(np.diag(said)), rel=0.12)
    assert found[1, 2] / np.sqrt(found[1, 1] * found[2, 2]) == pytest.approx(
        said[1, 2] / np.sqrt(said[1, 1] * said[2, 2]), abs=0.08
    )
