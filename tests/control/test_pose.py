"""The pose of a machine by its sensors: consistent, over latency, outages and wrong positions."""

import math

import numpy as np
import pytest

from swath.control.pose.ekf import EkfPose
from swath.control.pose.ekf import Params as EkfParams
from swath.control.pose.kalman import Kalman, Motion, Noise, Wander
from swath.control.pose.raw import Params as RawParams
from swath.control.pose.raw import RawPose
from swath.control.pose.receiver import AntennaPlace
from swath.control.steer.path import Begin, Params, Segment
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.record.message_factory import MessageFactory, RecordedMachine, Source
from swath.record.positioning_messages import pose_messages
from swath.sensing.gnss.error import Loss
from swath.signals import Fix, Inertial, Odometry, PoseEstimate
from swath.signals.setup import ControlSetup
from tests.control.path_drive import COMBINE, PERIOD, PathDrive

COURSE = Params(segments=(Segment(10.0), Segment(30.0, 0.05), Segment(60.0)), begin=Begin(heading_deg=0.0))
EKF = {"pose": EkfPose, "pose_params": EkfParams(tilt_deg=0.0, tilt_start_deg=0.0)}  # a plane


def test_the_filter_is_as_sure_as_it_is_right():
    """Mean NEES of four states over 6 seeds that nothing was set on: chi-square of 24 within 99.9 %."""
    means = []
    for seed in range(700, 706):
        drive = PathDrive(COURSE, seed=seed, **EKF)
        drive.run(12.0)
        means.append(drive.nees(10.0).mean())
    assert 7.7 / 6 < np.mean(means) < 52.6 / 6


def test_a_filter_that_knows_no_wander_is_wrong_and_sure(monkeypatch):
    monkeypatch.setattr("swath.control.pose.ekf.ASSUMED", {"fix": (1.0, 120.0)})
    means = []
    for seed in range(700, 704):
        drive = PathDrive(COURSE, seed=seed, **EKF)
        drive.run(12.0)
        means.append(drive.nees(10.0).mean())
    assert np.mean(means) > 7.5


@pytest.mark.parametrize("pose", [EkfPose, RawPose])
def test_through_an_outage_the_error_stays_within_what_is_said(pose):
    params = EkfParams(tilt_deg=0.0, tilt_start_deg=0.0) if pose is EkfPose else RawParams()
    away = {"losses": (Loss(10.0, 25.0),)}
    worst = []
    for seed in (31, 32):
        drive = PathDrive(COURSE, seed=seed, gnss=away, pose=pose, pose_params=params)
        drive.run(24.5)
        last, x, y, *_ = drive.poses[-1]
        assert last.fix_age > 14.0
        worst.append(math.hypot(last.x - x, last.y - y) / last.position_sd)
    assert max(worst) < 4.0
    assert last.position_sd > 0.1


def test_a_position_far_off_is_left_out_and_taken_when_it_stays():
    part = EkfPose(EkfParams(gate_s=3.0), ControlSetup(COMBINE, {"fix": Pose.identity()}, "left", 0.02))
    part.reset(Stream(1, "pose"))
    found = {}
    for i in range(1, 1200):
        t = i * PERIOD
        aside = 2.0 if t > 10_000_000_000 else 0.0
        fix = Fix(
            t - t % 100_000_000, 2e-9 * (t - t % 100_000_000), aside, 0.0, 2.0, 0.0, 0.011, 0.02, 0.03, 4
        )
        wheels = (Odometry(t, 2.0, 0.0, 0.0),)
        found[t // 1_000_000] = part.step(
            t - PERIOD, PERIOD, {"fix": fix, "odometry": wheels, "inertial": ()}
        )["pose"]
    assert abs(found[12_900].y) < 0.1
    assert found[12_900].fix_age == pytest.approx(2.9, abs=0.2)
    assert found[20_000].y == pytest.approx(2.0, abs=0.1)


def test_two_antennas_give_the_heading_that_a_course_does_not():
    """A machine that crabs by 2 deg: by the course the heading is off by as much."""
    part = {
        k: EkfPose(EkfParams(), ControlSetup(COMBINE, {"fix": Pose.identity()}, "left", 0.02)) for k in (0, 1)
    }
    for p in part.values():
        p.reset(Stream(1, "pose"))
    crab = math.radians(2.0)
    for i in range(1, 1500):
        t = i * PERIOD
        at = t - t % 100_000_000
        for k, p in part.items():
            heading = (0.0, 0.004) if k else (math.nan, math.nan)
            place = 2e-9 * at * math.cos(crab), 2e-9 * at * math.sin(crab), 0.0
            fix = Fix(at, *place, 2.0, crab, 0.011, 0.02, 0.03, 4, heading=heading[0], heading_sd=heading[1])
            inputs = {"fix": fix, "odometry": (Odometry(t, 2.0, 0.0, 0.0),), "inertial": ()}
            pose = p.step(t - PERIOD, PERIOD, inputs)["pose"]
            if k:
                assert math.isnan(pose.heading) or abs(pose.heading) < math.radians(0.6)
        last = pose
    assert abs(last.heading) < math.radians(0.2)
    one = part[0].step(t, PERIOD, inputs | {"fix": None})["pose"]
    assert one.heading == pytest.approx(crab, abs=math.radians(0.7))


def test_one_step_of_the_covariance_is_that_of_finite_differences():
    noise = Noise(0.0, 0.0, 0.0, 1e-9, 30.0)
    step = Motion(0, 0.5, 0.2, 0.0, 0.03, 2.0, (0.0, 0.0, 0.2), (1.0, 0.0))
    start = np.array([1.0, 2.0, 0.7, 1.8, 0.01, 0.03, 0.02, 0.1, -0.1])

    def gone(state):
        one = Kalman(noise)
        one.wander, one.state, one.covariance = Wander(0.0, 120.0), state.copy(), np.eye(9)
        one.go(step)
        return one

    def slope(i):
        h = 1e-6 * np.eye(9)[i]
        return (gone(start + h).state - gone(start - h).state) / 2e-6

    f = np.column_stack([slope(i) for i in range(9)])
    exact = f @ f.T
    assert np.allclose(gone(start).covariance[2:, 2:], exact[2:, 2:], atol=1e-6)
    assert np.allclose(gone(start).covariance, exact, atol=0.3)  # x, y: the bias within a step is left out


def test_the_antenna_is_brought_to_the_axle_also_on_a_slope():
    """Leaning 5 deg to the right, an antenna 4 m up stands 0.35 m to the right of the axle."""
    antenna = Pose.from_euler((1.0, 0.0, 4.0))
    place = AntennaPlace(ControlSetup(COMBINE, {"fix": antenna}, "left", 0.02))
    assert place.offset() == pytest.approx((1.0, 0.0))
    lean = math.radians(5.0)
    up = Inertial(PERIOD, 0.0, 0.0, 0.0, 0.0, 9.81 * math.sin(lean), 9.81 * math.cos(lean))
    place.inclination.take((up,), 0.0)
    assert place.offset() == pytest.approx((1.0, -4.0 * math.sin(lean)), abs=1e-9)
    with pytest.raises(InputError, match="whose place is known"):
        AntennaPlace(ControlSetup(COMBINE, {}, "left", 0.02))


def test_the_message_has_the_covariance_in_its_place():
    source = Source(MessageFactory(), RecordedMachine("combine", COMBINE, "left"), "pose", "pose")
    spread = np.diag([1.0, 2.0, 3.0, 4.0])
    spread[0, 2] = spread[2, 0] = 0.5
    (sent,) = pose_messages(source, PoseEstimate(5, 1.0, 2.0, 0.3, 2.0, 0.1, spread, 0.1))
    place = np.reshape(sent.message.pose.covariance, (6, 6))
    assert (place[0, 0], place[1, 1], place[5, 5], place[0, 5]) == (1.0, 2.0, 3.0, 0.5)
    assert sent.message.twist.covariance[0] == 4.0
    assert sent.message.child_frame_id == "combine/pose"
    (sent,) = pose_messages(source, PoseEstimate(5, math.nan, math.nan, math.nan, 2.0, 0.1, spread, 0.1))
    assert sent.delivery == "announced"


@pytest.mark.parametrize("level", [EkfPose, RawPose])
@pytest.mark.parametrize("reverse", [1.0, -1.0])
@pytest.mark.parametrize("said", [0.01, math.nan])
def test_a_receiver_without_courses_on_a_circle(level, reverse, said):
    """Positions alone, 1 Hz, of an antenna that stands aside; forward and backward, accuracy told or not."""
    radius, speed, antenna = 15.0, 2.0 * reverse, Pose.from_euler((1.0, 0.4, 3.9))
    turn = speed / radius
    params = EKF["pose_params"] if level is EkfPose else RawParams()
    part = level(params, ControlSetup(COMBINE, {"fix": antenna}, "left", PERIOD / NS))
    part.reset(Stream(1, "pose"))

    def at(t):
        heading = 0.3 + turn * t / NS
        x, y = radius * math.sin(heading), -radius * math.cos(heading)
        return Pose.from_euler((x, y, 0.0), yaw=heading)

    fix = None
    for k in range(1, 15 * 50 + 1):
        t = k * PERIOD
        if k % 50 == 0:
            x, y, z = at(t).apply(antenna.position)
            fix = Fix(t, x, y, z, math.nan, math.nan, said, said, math.nan, 4)
        inputs = {"fix": fix, "odometry": (Odometry(t, speed, turn, 0.0),), "inertial": None}
        pose = part.step(t - PERIOD, PERIOD, inputs)["pose"]
    assert pose.heading == pytest.approx(math.remainder(at(t).euler()[2], math.tau), abs=math.radians(0.5))
    assert math.hypot(*(at(t).position[:2] - (pose.x, pose.y))) < 0.05
    assert np.isfinite(pose.covariance).all() or (level is RawPose and math.isnan(said))
