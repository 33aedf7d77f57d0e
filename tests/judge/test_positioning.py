"""Pose, fix and path of a made run, judged."""

import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.judge.evaluators.delays import DOUBT, Delays
from swath.judge.evaluators.positioning import Positioning
from swath.signals import Fix, GuidanceState, MachineState, PoseEstimate, SteerCommand

NAN = math.nan


class Setup:
    name = "combine"


def judged():
    """10 s: the pose 5 cm off with sd 5 cm on each axis; no fix from 4 to 6 s; on a path after 8 s."""
    evaluator = Positioning(Setup())
    spread = np.diag([0.05**2, 0.05**2, 0.01**2, 0.1**2])
    for i in range(100):
        t = i * 100_000_000
        pose = Pose.from_euler((2.0, 0.2 * i, 0.0), yaw=math.pi)
        evaluator.see("motion", t, {"state": MachineState(t, pose, 2.0, 0.0, 0.0, 0.0, 0.2 * i)})
        found = PoseEstimate(t, 2.03, 0.2 * i + 0.04, -math.pi + 0.01, 2.1, 0.0, spread, 0.1)
        evaluator.see("pose", t, {"pose": found})
        quality = 1 if 40 <= i < 60 else 4
        evaluator.see("gnss", t, {"fix": Fix(t, *[NAN] * 8, quality)})
        evaluator.see("steer", t, {"guidance": GuidanceState(t, i >= 80, 0.0, 0.0, 0.0, 0.0)})
    return evaluator


def test_what_the_numbers_come_to():
    found = judged().metrics()
    assert found["pose_error_rms_m"] == pytest.approx(0.05)
    assert found["pose_error_max_m"] == pytest.approx(0.05)
    assert found["pose_heading_rms_rad"] == pytest.approx(0.01)
    assert found["pose_nees"] == pytest.approx(0.36 + 0.64 + 1.0 + 1.0)
    assert found["fix_share"] == pytest.approx(0.8)
    assert found["fix_lost_max_s"] == pytest.approx(2.0)
    assert found["path_share"] == pytest.approx(0.2)


def test_a_loss_of_the_fix_is_an_event_with_an_end():
    (event,) = judged().events()
    assert (event.t, event.end_t) == (4_000_000_000, 6_000_000_000)
    assert event.kind == "fix_lost"
    assert (event.distance, event.end_distance) == pytest.approx((8.0, 12.0))


def test_without_these_parts_there_is_nothing_to_say():
    assert Positioning(Setup()).metrics() == {}
    assert list(Positioning(Setup()).events()) == []


@pytest.mark.parametrize(("late_s", "is_told"), [(0.2, False), (3.5, True), (-3.5, True)])
def test_a_time_stamp_that_can_hardly_be_is_told(late_s, is_told):
    delays = Delays(Setup())
    for t in range(0, 10**9, 10**8):
        command = SteerCommand(t - round(late_s * 1e9), 0.0, True)
        delays.see("steer", t, {"command": command})
    assert delays.notes == ([f"command_delay_s {late_s} s: {DOUBT}"] if is_told else [])
