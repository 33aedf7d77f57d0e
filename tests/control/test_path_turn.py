"""A headland turn onto the next pass: what the steering can turn to is followed, what it cannot is not."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from swath.control.steer.guidance_line import GuidanceLine, along_bends
from swath.control.steer.path import Begin, Params, Segment
from swath.control.turns import clothoid, limits_of
from swath.control.turns.dubins import Place, shortest
from swath.machine.machine_sheet import dynamics_of, load_machine
from tests.control.path_drive import PathDrive

COMBINE = load_machine("lexion-700")
SPEED, RUN, PASS = 7 / 3.6, 20.0, 25.0  # m/s; m before the turn and behind it


def farthest(rows, line):
    """Largest distance of a drive from a line behind its first RUN metres [m]."""
    way, errors = None, []
    for _, x, y, *_ in rows:
        found = line.project(x, y, way, 8.0)
        way = found.distance
        if way > RUN:
            errors.append(abs(found.left))
    return float(np.max(errors))


def arcs(start, end, limits):
    """The shortest turn of arcs and straights, its curvature jumps."""
    return clothoid.bends_of(shortest(start, end, limits.radius), limits.radius)


def largest_error(plan, share, seed, shift=12.0, distance=3.0):
    """Largest distance from the path, from the begin of a turn of 6.4 m to a pass some way beside [m].

    share: of the steering's rate that the turn takes; shift: of the next pass [m]; distance: of the law [m]
    """
    limits = limits_of(COMBINE.wheelbase, 6.4, dynamics_of(COMBINE).steer_rate, SPEED)
    limits = replace(limits, sharpness=share * limits.sharpness)
    pieces = plan(Place(0.0, 0.0, 0.0), Place(-3.0, -shift, pi), limits)
    bends = [Segment(p.length, p.begin, p.end) for p in pieces if p.length > 1e-6]
    segments = (Segment(RUN), *bends, Segment(PASS))
    line = GuidanceLine(along_bends(-RUN, 0.0, 0.0, [s.bend for s in segments]))
    params = Params(segments=segments, begin=Begin(-RUN, 0.0, 0.0), distance_m=distance)
    seconds = (line.length - 5.0) / SPEED
    rows, _ = PathDrive(params, machine=COMBINE, speed=SPEED, start=(-RUN, 0.0, 0.0), seed=seed).run(seconds)
    return farthest(rows, line)


@pytest.mark.parametrize("seed", [1, 9])
def test_a_turn_of_clothoids_is_followed(seed):
    """5 cm with seed 1; seed 9 was not looked at before."""
    assert largest_error(clothoid.plan, 0.6, seed) < 0.08


def test_a_curvature_that_jumps_is_not():
    assert largest_error(arcs, 1.0, 1) > 0.5


@pytest.mark.parametrize(("shift", "seed"), [(11.7, 1), (23.4, 9)])
def test_a_turn_to_a_pass_farther_off_is_followed_by_a_softer_law(shift, seed):
    assert largest_error(clothoid.plan, 0.6, seed, shift, distance=6.0) < 0.2
