"""The Stanford diagram: samples in its fields, episodes, and the rate that a way without any shows."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from swath.judge.evaluators.edge_detection import WRONG_M, EdgeSeries
from swath.report.html import escaped
from swath.tools.function_test.judging.integrity import (
    BIN_COUNT,
    BIN_M,
    episodes_per_km,
    integrity_of,
    pooled,
)
from swath.tools.function_test.page import SIDE, boundary, stanford

COUNT = 1000


def series(error, sd, confidence=0.9):
    ones = np.ones(COUNT)
    distance = np.linspace(0.0, 100.0, COUNT)
    known = ones > 0
    return EdgeSeries(distance, distance, ones, ones, error * ones, known, known, confidence * ones, ~known,
                      sd * ones, ones)  # fmt: skip


def test_a_detector_that_is_wrong_and_says_so_is_no_hazard():
    told = integrity_of(series(0.5, 0.4), 0.0)
    assert (told["hazardous"], told["episodes"], told["samples"]) == (0, 0, COUNT)
    assert told["bins"] == [[16, 19, COUNT]]
    assert told["km"] == pytest.approx(0.1)


def test_episodes_are_unbroken_stretches():
    error = np.zeros(COUNT)
    error[100:151], error[500:515] = 0.4, -0.4
    told = integrity_of(series(error, 0.03), 0.0)
    assert (told["hazardous"], told["episodes"]) == (66, 2)
    assert told["longest_m"] == pytest.approx(5.0, abs=0.02)
    assert integrity_of(series(error, 0.03), 20.0)["episodes"] == 1  # after settling


def test_an_episode_is_longer_than_a_metre():
    error = np.zeros(COUNT)
    error[300:310] = 0.4  # 0.9 m
    assert integrity_of(series(error, 0.03), 0.0)["episodes"] == 0
    error[310:312] = 0.4
    assert integrity_of(series(error, 0.03), 0.0)["episodes"] == 1


def test_sure_of_an_edge_where_none_is_is_a_hazard():
    assert integrity_of(series(np.nan, 0.03), 0.0)["episodes"] == 1
    told = integrity_of(series(np.nan, 0.03, 0.4), 0.0)
    assert told["episodes"] == 0
    assert told["bins"] == [[19, 19, COUNT]]  # not sure: unavailable


def test_without_a_standard_deviation_confidence_tells():
    assert integrity_of(series(0.4, np.nan, 0.6), 0.0)["episodes"] == 1
    assert integrity_of(series(0.4, np.nan, 0.4), 0.0)["episodes"] == 0


def test_runs_are_pooled_and_a_clean_way_shows_a_rate():
    """0 episodes in 30 km show 0.1 per km: the rule of three."""
    clean = integrity_of(series(0.01, 0.03), 0.0)
    together = pooled([clean] * 300)
    assert together["km"] == pytest.approx(30.0)
    assert together["bins"] == [[0, 3, 300 * COUNT]] or together["bins"] == [[0, 2, 300 * COUNT]]
    assert episodes_per_km(together["episodes"], together["km"]) == pytest.approx(0.0999, abs=0.0002)


def test_a_boundary_is_drawn_where_one_value_does_for_nine_of_ten():
    runs = [(float(v), v < 7) for v in range(10)]
    assert boundary(runs) == (6.5, "below")
    assert boundary([(v, not passes) for v, passes in runs]) == (6.5, "above")
    assert boundary([(v, int(v) % 2 == 0) for v, _ in runs]) is None
    assert boundary([(v, True) for v, _ in runs]) is None
    assert boundary([(v, v != 5) for v, _ in runs]) is None  # one run that fails is no boundary


def test_the_diagram_shades_what_is_counted_as_hazardous():
    """Right of the alert limit and below the diagonal; the page says what an episode is."""
    cell = SimpleNamespace(integrity=integrity_of(series(0.5, 0.03), 0.0), candidate="mine")
    found = stanford([cell], 0)
    assert "1 hazardous episodes in 0.1 km" in found.caption
    drawn = escaped(found)
    ((x, y),) = re.findall(r'<rect x="([^"]*)" y="([^"]*)"[^>]*fill=', drawn)
    side, cell_px = SIDE, SIDE / BIN_COUNT
    alert = WRONG_M / (BIN_M * BIN_COUNT) * side
    assert float(x) > alert
    assert side - float(y) - cell_px < float(x)
    (corners,) = re.findall(r'<polygon class="hazard" points="([^"]*)"', drawn)
    assert [tuple(map(float, p.split(","))) for p in corners.split()] == [
        (alert, side), (alert, side - alert), (side, 0.0), (side, side)
    ]  # fmt: skip
