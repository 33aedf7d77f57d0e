"""The Stanford diagram: samples in its fields, episodes, and the rate that a way without any shows."""

import numpy as np
import pytest

from swath.judge.evaluators.edge_detection import EdgeSeries, bridges_gaps
from swath.tools.function_test.charts import boundary
from swath.tools.function_test.integrity import episodes_per_km, integrity_of, pooled

COUNT = 1000


def series(error, sd, confidence=0.9, across=np.nan):
    ones = np.ones(COUNT)
    distance = np.linspace(0.0, 100.0, COUNT)
    known = ones > 0
    return EdgeSeries(distance, distance, ones, ones, error * ones, known, known, confidence * ones, ~known,
                      sd * ones, across * ones)  # fmt: skip


def test_a_detector_that_is_wrong_and_says_so_is_no_hazard():
    told = integrity_of(series(0.5, 0.4), 0.0)
    assert (told["hazardous"], told["episodes"], told["samples"]) == (0, 0, COUNT)
    assert told["bins"] == [[16, 19, COUNT]]
    assert told["km"] == pytest.approx(0.1)


def test_episodes_are_unbroken_stretches():
    error = np.zeros(COUNT)
    error[100:151], error[500:502] = 0.4, -0.4
    told = integrity_of(series(error, 0.03), 0.0)
    assert (told["hazardous"], told["episodes"]) == (53, 2)
    assert told["longest_m"] == pytest.approx(5.0, abs=0.02)
    assert integrity_of(series(error, 0.03), 20.0)["episodes"] == 1  # after settling


def test_that_a_detector_bridges_a_gap_is_told_where_it_does():
    assert bridges_gaps(series(-1.2, 0.03, across=0.02))
    assert bridges_gaps(series(np.nan, 0.03, across=0.02))  # the gap is deeper than an edge is matched
    assert not bridges_gaps(series(0.05, 0.03, across=0.02))  # as where the gap is shallow
    assert not bridges_gaps(series(0.05, 0.03, across=1.2))  # it follows the gap
    assert not bridges_gaps(series(-1.2, 0.03))  # no gap


def test_beside_a_gap_the_line_across_it_is_the_edge():
    """The far wall, 1.2 m in, is not to be followed: whoever is sure of it is wrong."""
    across = np.full(COUNT, np.nan)
    across[300:400] = 0.0
    error = np.where(np.isfinite(across), -1.2, 0.0)
    assert integrity_of(series(error, 0.03, across=across), 0.0)["episodes"] == 0
    told = integrity_of(series(0.0, 0.03, across=1.2 + across), 0.0)
    assert (told["hazardous"], told["episodes"]) == (100, 1)


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
