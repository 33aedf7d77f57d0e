"""The edge filter against a closed-form canopy with a known edge; its smoother against a dense solution."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from swath.control.edge import filter as level
from swath.control.edge.filter import HEAD, NODE, NODES, EdgeFilter, Params
from swath.core.random import Stream
from tests.control.closed_loop import Course, setup_of
from tests.control.edge_drive import along
from tests.control.synthetic_edge import mounting


def made(side="left", mounted=None, rows=0.0):
    setup = replace(setup_of(side, 0.04, mounted or mounting(side)), crop_height=0.85, row_spacing=rows)
    detector = EdgeFilter(Params(slip_percent=0.0, delay=0.0), setup)  # rays of the synthetic canopy are thin
    detector.reset(Stream(1, "edge"))
    return detector


drive = partial(along, made)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_straight_edge(side):
    edges, error = drive(side=side)
    assert all(e.is_found for e in edges[75:])
    assert np.sqrt(np.mean(error[100:] ** 2)) < 0.05
    assert np.abs(error[-50:]).max() < 0.04
    assert all(abs(v) < 3.0 * e.offset_sd for v, e in zip(error[100:], edges[100:], strict=True))
    assert edges[-1].confidence > 0.7
    assert edges[-1].seen_to > edges[-1].reference_x + 2.0
    assert not edges[-1].is_held


def test_thin_stands_are_found():
    edges, error = drive(stand={"density": 80.0}, metres=16.0)
    assert all(e.is_found for e in edges[100:])
    assert np.abs(error[100:]).max() < 0.15


@pytest.mark.parametrize("radius", [15.0, -15.0])
def test_tight_bends(radius):
    edges, error = drive(Course(radius, 8.0, y=6.0), metres=24.0)
    assert all(e.is_found for e in edges[100:])
    assert np.abs(error[100:]).max() < 0.2


@pytest.mark.parametrize(("tip", "where"), [(0.12, 6.0), (0.85, 100.0), (0.85, -100.0)])
def test_no_edge_in_stubble_or_in_crop_alone(tip, where):
    far = lambda x, y: np.full_like(x, where)  # noqa: E731
    assert not any(e.is_found for e in drive(stand={"tip": tip}, inside=far, metres=8.0)[0])


def test_a_notch_is_not_followed():
    notch = lambda x, y: 6.0 - y - np.where((x > 18.0) & (x < 21.0), 1.0, 0.0)  # noqa: E731
    edges, error = drive(inside=notch, metres=22.0)
    assert all(e.is_found for e in edges[75:])
    assert np.abs(error[75:]).max() < 0.2


@pytest.mark.parametrize("teeth", [0.0, 0.15])
def test_a_gap_without_crop_near_is_bridged(teeth):
    """No wall within reach for 7 m: the line goes on, and says how little it knows."""

    def gap(x, y):
        return 6.0 - y - np.where((x > 18.0) & (x < 25.0), 5.0, teeth * np.abs((x % 4.0) / 2.0 - 1.0))

    edges, error = drive(inside=gap, metres=26.0)
    late = slice(150, None)
    assert all(e.is_found for e in edges[late])
    assert all(abs(v + teeth / 2) < 2.5 * e.offset_sd for v, e in zip(error[late], edges[late], strict=True))
    assert max(e.offset_sd for e in edges[late]) > 0.1
    assert np.abs(error[late] + teeth / 2).max() < 0.25


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("rows", [0.45, 0.8])
def test_the_edge_of_row_crops_is_half_a_spacing_outside_the_outermost_row(side, rows):
    sign = 1.0 if side == "left" else -1.0

    def inside(x, y):  # rows of canopies 0.2 m wide, the outermost one half a spacing behind the edge
        depth = 6.0 - sign * y
        return np.where(depth > 0.0, 0.1 - np.abs(depth % rows - 0.5 * rows), -1.0)

    edges, error = drive(side=side, inside=inside, rows=rows, metres=24.0)
    late = slice(200, None)
    assert all(e.is_found for e in edges[late])
    assert np.abs(error[late]).max() < 0.08
    assert all(abs(v) < 2.5 * e.offset_sd for v, e in zip(error[late], edges[late], strict=True))
    _, unknown = drive(side=side, inside=inside, metres=24.0)
    assert sign * unknown[late].mean() < -0.08  # without the rows it is the wall


@pytest.mark.parametrize("tilt", [-0.35, 0.0, 0.35])
def test_a_stand_that_leans(tilt):
    """Its tops stand 0.3 m beside its feet: told with that deviation, or found."""
    edges, error = drive(stand={"tilt": tilt, "tip": 0.85 / np.hypot(1.0, tilt)}, metres=24.0)
    late = slice(200, None)
    assert all(e.is_found for e in edges[late])
    assert all(abs(v) < 2.5 * e.offset_sd for v, e in zip(error[late], edges[late], strict=True))
    assert np.abs(error[late]).max() < (0.2 if tilt >= 0.0 else 0.35)
    assert np.abs(error[-50:]).max() < (0.12 if tilt >= 0.0 else 0.35)


@pytest.mark.parametrize("spread", [0.05, 0.15])
def test_plants_that_spread_about_their_feet(spread):
    edges, error = drive(stand={"lean": spread}, metres=20.0)
    assert all(e.is_found for e in edges[150:])
    assert np.abs(error[150:]).max() < 0.08


def test_beams_that_never_answer_tell_nothing():
    """Three of four of those that look beside the edge: taken as lost rays they would move it by 0.2 m."""
    detector = made()
    take = detector.step

    def dirty(t, dt, inputs):
        ranges = inputs["scan"].ranges.copy()
        ranges[[i for i in range(90, 110) if i % 4]] = np.nan
        return take(t, dt, {**inputs, "scan": replace(inputs["scan"], ranges=ranges)})

    detector.step = dirty
    edges, error = along(lambda side, mounted: detector, metres=16.0)
    assert all(e.is_found for e in edges[120:])
    assert abs(error[-1]) < min(0.1, 3.0 * edges[-1].offset_sd)


def test_goes_on_from_a_saved_moment():
    detector = made()
    drive_on = partial(along, lambda side, mounted: detector)
    drive_on(metres=8.0)
    state = detector.save()
    first, _ = drive_on(metres=3.0, seed=1, begin=200)
    detector.load(state)
    again, _ = drive_on(metres=3.0, seed=1, begin=200)
    assert repr(first) == repr(again)  # nan is nan


def chain(detector):
    """(nodes in order as rows of numbers, mean and covariance before the first, variance of teeth)."""
    state = detector._state[0]
    first, count = int(state[9]), int(state[10])
    rows = [state[HEAD + ((first + k) % NODES) * NODE :][:NODE] for k in range(count)]
    return rows, state[17:21], state[21:37].reshape(4, 4), state[14]


def test_smoothing_is_the_dense_solution_of_the_same_chain():
    """All nodes as one normal vector, given the same sites."""
    detector, p = made(), Params()
    along(lambda side, mounted: detector, metres=9.0)
    rows, mean, cov, tooth2 = chain(detector)
    n = len(rows)
    assert n > 10
    precision, pull = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    prior = np.linalg.inv(cov)
    precision[:4, :4], pull[:4] = prior, prior @ mean
    for k, row in enumerate(rows):
        here = slice(4 * k, 4 * k + 4)
        if k:
            a, b, turn, gust = row[4], row[5], row[6], row[55]
            r = np.exp(-a / p.tooth_m)
            f = np.array([[1, a, a * a / 2, 0], [0, 1, a, 0], [0, 0, 1, 0], [0, 0, 0, r]])
            noise = np.array([1e-12, p.turn_noise**2 * a, gust * a, tooth2 * (1 - r * r)])
            both = np.hstack([-f, np.eye(4)])
            span = slice(4 * k - 4, 4 * k + 4)
            weight = both.T / noise
            precision[span, span] += weight @ both
            pull[span] += weight @ np.array([-b, -turn, 0.0, 0.0])
        if row[10] >= 1e-6:
            wall = np.array([1.0, 0.0, 0.0, 1.0])
            precision[here, here] += row[10] * np.outer(wall, wall)
            pull[here] += row[9] * wall
    dense = np.linalg.solve(precision, pull).reshape(n, 4)
    told = np.array([row[34:38] for row in rows])
    seen = [k for k, row in enumerate(rows) if row[7] > 0.5]  # others may be newer than the last update
    assert len(seen) > 8
    assert np.abs(dense[seen, 0] - told[seen, 0]).max() < 0.02


def test_python_lays_memory_out_as_the_compiled_step_has_it():
    source = level.__file__.removesuffix(".py") + ".cpp"
    with open(source, encoding="utf-8") as file:
        text = file.read()
    assert f"STATE = {level.STATE}, GRIDS = {level.GRIDS};" in text
    text = text.partition("struct Numbers {")[2].partition("};")[0]
    names = [name.strip() for name in text.replace("D ", "").replace(";", "").split(",")]
    params = [name for name in Params.__dataclass_fields__ if name not in level.OTHERS]
    assert all(param.startswith(name) for param, name in zip(params, names, strict=True))
