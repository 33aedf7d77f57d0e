"""A headland turn onto the next pass: what the steering can turn to is followed, what it cannot is not."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from swath.control.job.passes import Pass
from swath.control.steer.guidance_line import GuidanceLine, along_bends
from swath.control.steer.path import Begin, Params, Segment
from swath.job.path import Pose
from swath.job.turns import clothoid, dubins, limits_of
from swath.machine.machine_sheet import dynamics_of, load_machine
from swath.signals.setup import ControlSetup
from tests.control.path_drive import PathDrive
from tests.levels.limits import make
from tests.machine.machine_fakes import STREAM

COMBINE = load_machine("lexion-700")
SPEED, RUN, PASS = 7 / 3.6, 20.0, 25.0  # m/s; m before the turn and behind it


def farthest(rows, line):
    """Largest distance of a drive from a line behind its first RUN metres [m]."""
    way, errors = None, []
    for _, x, y, *_ in rows:
        found = line.project(x, y, way, 8.0)
        way = found.way
        if way > RUN:
            errors.append(abs(found.left))
    return float(np.max(errors))


def largest_error(turn, share, seed):
    """Largest distance from the path, from the begin of a turn of 6.4 m to a pass 12 m beside [m].

    share: of the steering's rate that the turn takes
    """
    limits = limits_of(COMBINE.wheelbase, 6.4, dynamics_of(COMBINE).steer_rate, SPEED)
    limits = replace(limits, sharpness=share * limits.sharpness)
    pieces = turn.plan(Pose(0.0, 0.0, 0.0), Pose(-3.0, -12.0, pi), limits)
    bends = [Segment(p.length, p.first, p.last) for p in pieces if p.length > 1e-6]
    segments = (Segment(RUN), *bends, Segment(PASS))
    line = GuidanceLine(along_bends(-RUN, 0.0, 0.0, [s.bend for s in segments]))
    params = Params(segments=segments, begin=Begin(-RUN, 0.0, 0.0))
    seconds = (line.length - 5.0) / SPEED
    rows, _ = PathDrive(params, machine=COMBINE, speed=SPEED, start=(-RUN, 0.0, 0.0), seed=seed).run(seconds)
    return farthest(rows, line)


@pytest.mark.parametrize("seed", [1, 9])
def test_a_turn_of_clothoids_is_followed(seed):
    """5 cm with seed 1; seed 9 was not looked at before."""
    assert largest_error(clothoid, 0.6, seed) < 0.08


def test_a_curvature_that_jumps_is_not():
    assert largest_error(dubins, 1.0, 1) > 0.5


def error_in_planned_turn(shift, seed, distance=6.0, **more):
    """Largest distance from the path that level `harvest` plans, in the turn and 20 m of the next pass [m].

    shift: of the next pass [m]; distance: of the steering law [m]
    """
    knife = COMBINE.knife_x
    passes = (Pass(((0.0, 0.0), (RUN, 0.0))), Pass(((RUN, -shift), (RUN - PASS, -shift))))
    job = make("job", "harvest", ControlSetup(COMBINE, {}, "left", 0.1), passes=passes, **more)
    path = job.reset(STREAM)["path"]
    line = GuidanceLine(list(zip(path.x.tolist(), path.y.tolist(), strict=True)))
    drive = PathDrive(
        Params(distance_m=distance), machine=COMBINE, speed=SPEED, start=(-knife, 0.0, 0.0), seed=seed,
        path=lambda _: path,
    )  # fmt: skip
    rows, _ = drive.run((line.length - 5.0) / SPEED)
    return farthest(rows, line)


@pytest.mark.parametrize(("shift", "seed"), [(11.7, 1), (23.4, 9)])
def test_a_turn_that_the_job_plans_is_followed(shift, seed):
    """14 cm at most with seeds 1 and 9."""
    assert error_in_planned_turn(shift, seed) < 0.2
