"""A machine that tips over ends the run, in words; one that stands on a slope does not."""

from math import radians

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.judge.evaluator import EvaluatorSetup
from swath.judge.evaluators.rollover import FASTEST, LEVEL, Rollover
from swath.signals import MachineState


class Slope:
    """Ground that falls to the right."""

    def __init__(self, percent):
        self.percent = percent

    def ground_height(self, x, y):
        return np.asarray(x) * 0.0 + 0.01 * self.percent * np.asarray(y)


def watch(percent=0.0):
    return Rollover(EvaluatorSetup(Slope(percent), {}, "combine"))


def show(watched, roll, t=1_000_000_000, pitch=0.0):
    pose = Pose.from_euler((3.0, -2.0, 0.5), radians(roll), radians(pitch), 0.4)
    watched.see("combine.motion", t, {"state": MachineState(t, pose, 2.0, 0.0, 0.0, 0.0, 7.0)})


@pytest.mark.parametrize("percent", [-60.0, 0.0, 60.0])
def test_a_machine_on_the_ground_has_not_rolled_over(percent):
    watched = watch(percent)
    normal = np.array([0.0, -0.01 * percent, 1.0]) / np.hypot(1.0, 0.01 * percent)
    ahead = np.array([1.0, 0.0, 0.0])
    pose = Pose(np.zeros(3), np.stack([ahead, np.cross(normal, ahead), normal], axis=1))
    watched.see("combine.motion", 0, {"state": MachineState(0, pose, 2.0, 0.0, 0.0, 0.0, 7.0)})
    assert watched.metrics() == {"rollover_count": 0.0}
    assert watched.end_reason(0) == ""


@pytest.mark.parametrize(("roll", "pitch"), [(25.0, 0.0), (-40.0, 0.0), (0.0, 30.0), (170.0, 0.0)])
def test_one_that_tips_ends_the_run_with_time_and_place(roll, pitch):
    watched = watch()
    show(watched, 0.1 * roll, 700_000_000, 0.1 * pitch)
    show(watched, roll, pitch=pitch)
    show(watched, roll, 2_000_000_000, pitch)
    (event,) = watched.events()
    assert (event.t, event.kind, event.machine, event.x, event.y) == (10**9, "rollover", "combine", 3.0, -2.0)
    assert watched.end_reason(2_000_000_000).startswith(
        "rolled over at 1.0 s, x = 3.0 m, y = -2.0 m: tilted by"
    )
    assert watched.metrics() == {"rollover_count": 1.0}
    assert LEVEL.component.LIMITS == {"rollover_count": {"max": 0.0}}


@pytest.mark.parametrize("seed", range(20))
def test_it_is_found_as_if_looked_at_all_the_time(seed):
    """Tilts as fast as a machine can: it rests meanwhile, and misses nothing."""
    draw = np.random.default_rng(seed)
    resting, watching, tilt, shown = watch(), watch(), 0.0, 0
    for t in range(0, 4_000_000_000, 20_000_000):
        tilt = max(tilt + 0.02 * draw.uniform(-0.5, 1.0) * FASTEST, 0.0)
        shown += t >= resting.rests_until
        watching.rests_until = 0
        for each in (resting, watching):
            show(each, np.degrees(tilt), t)
        if watching.events():
            break
    assert [e.t for e in resting.events()] == [e.t for e in watching.events()]
    assert shown < 0.8 * (t / 20_000_000 + 1)
