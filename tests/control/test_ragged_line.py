"""An edge with bites is smoothed along its outer line."""

import numpy as np
import pytest

from tests.control.block_rig import Rig
from tests.control.test_likelihood_ratio import SPEED, drive

INNER, DEEP = 0.35, 0.2  # weight of a point inside the line, where one outside counts 1; m: bites


def saw(depth, period, *, length=20.0, radius=np.inf):
    """Points of a saw along an edge that bends in its last 5 m, and a track at its newest place."""
    x = np.arange(-length, 0.01, 0.4)
    u = depth * (x / period % 1.0) + 0.5 * np.maximum(x + 5.0, 0.0) ** 2 / radius
    rows = np.column_stack([x, u, np.full(len(x), 1e-4), x + length])
    return Rig().set_points(rows).begin(x[-1], u[-1], 5.0 / radius, 0.0, length)


@pytest.mark.parametrize(("depth", "period"), [(0.4, 4.0), (0.6, 5.0)])
def test_the_line_along_a_saw_is_the_expectile_of_its_depths(depth, period):
    rig = saw(depth, period)
    rig("bites_line", 0.0)
    share = np.sqrt(INNER) / (1.0 + np.sqrt(INNER))
    rig("ahead", -7.0)
    assert rig.arc["u"] == pytest.approx(share * depth, abs=0.12 * depth)
    assert abs(rig.arc["angle"]) < 0.01


def test_bites_are_told_from_bends():
    bites = lambda *of, **more: saw(*of, **more)("bites", 0.0)[0]  # noqa: E731
    assert bites(0.4, 6.0) > DEEP
    assert bites(0.0, 6.0) == 0.0
    assert all(bites(0.0, 6.0, radius=r) < 0.8 * DEEP for r in (12.0, -12.0, 20.0))


@pytest.mark.parametrize(("depth", "period"), [(0.45, 4.5), (0.6, 7.0)])
def test_a_saw_is_smoothed(depth, period):
    """Told is a line that leaves no crop standing, and turns by less than the saw does."""
    edges, error = drive(inside=lambda x, y: 6.0 - y - depth * (x / period % 1.0), metres=36.0)
    late = slice(round(25.0 / (SPEED * 0.04)), None)
    assert all(e.is_found and 0.05 < e.confidence < 0.5 for e in edges[late])
    inside = -error[late]
    assert inside.min() > -0.15
    assert inside.max() < 0.3
    assert np.std([e.heading for e in edges[late]]) < 0.5 * depth / period
    deviation = np.mean([e.offset_sd for e in edges[late]])
    assert deviation > 0.25 * depth


@pytest.mark.parametrize(("depth", "period", "begin"), [(0.55, 8.0, 4.0), (0.5, 5.0, 2.5)])
def test_a_saw_is_smoothed_from_its_first_tooth_on(depth, period, begin):
    """Its wall lies to and fro before its depth is seen: no tooth is followed, none is left standing."""
    edges, error = drive(inside=lambda x, y: 6.0 - y - depth * ((begin - x) / period % 1.0), metres=26.0)
    inside = -error[60:]
    assert all(e.is_found and e.confidence < 0.5 for e in edges[60:])
    assert inside.max() < 0.15
    assert inside.min() > -0.1
