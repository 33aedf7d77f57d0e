"""Metrics: closed forms, signs, and limits."""

import json

import numpy as np
import pytest
from swath.judge.metrics import (
    METRICS,
    balance_error,
    edge_metrics,
    evaluate,
    is_broken,
    json_safe,
    lateral_metrics,
)
from swath.scenario.metric_names import LIMITABLE_METRICS


def test_lateral_of_a_sine_is_its_closed_form():
    distance = np.sort(np.random.default_rng(0).uniform(0, 110, 20000))
    error = 0.03 + 0.1 * np.sin(2 * np.pi * (distance - 10) / 5)
    found = lateral_metrics(distance, error)
    assert found["lateral_bias_m"] == pytest.approx(0.03, abs=2e-4)
    assert found["lateral_rms_m"] == pytest.approx(np.sqrt(0.03**2 + 0.1**2 / 2), abs=2e-4)


def test_lateral_ignores_settling_and_sampling():
    """A slow stretch with many samples weighs no more than its length; the first 10 m do not count."""
    distance = np.concatenate(
        [np.linspace(0, 10, 50), np.linspace(10.001, 20, 100000), np.linspace(20.001, 30, 11)]
    )
    error = np.where(distance < 10, 5.0, np.where(distance < 20.0005, 0.0, 1.0))
    assert lateral_metrics(distance, error)["lateral_bias_m"] == pytest.approx(0.5, abs=0.01)


def test_too_short_a_run_has_no_lateral_error():
    found = lateral_metrics(np.linspace(0, 9, 50), np.zeros(50))
    assert all(np.isnan(v) for v in found.values())


def test_edge_shares_count_only_where_a_true_edge_is():
    exists = np.array([True] * 8 + [False] * 2)
    found = np.array([True] * 6 + [False] * 2 + [True, False])
    error = np.array([0.1, -0.1, 0.1, -0.1, 0.1, -0.1] + [np.nan] * 4)
    got = edge_metrics(error, exists, found)
    assert got["detection_availability"] == 0.75
    assert got["false_edge_share"] == 0.5
    assert got["edge_rmse_m"] == pytest.approx(0.1)
    assert got["edge_bias_m"] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("value", "limit", "verdict"),
    [
        (0.05, {"max": 0.05}, "kept"),
        (0.0501, {"max": 0.05}, "broken"),
        (0.9, {"min": 0.95}, "broken"),
        (0.97, {"min": 0.95, "max": 1.0}, "kept"),
        (None, {"max": 1.0}, "broken"),
        (float("nan"), {"max": 1.0}, "broken"),
        (float("inf"), {"min": 1.0}, "broken"),
        ("text", {"max": 1.0}, "broken"),
    ],
)
def test_verdicts(value, limit, verdict):
    expect = evaluate({"edge_rmse_m": limit}, {"edge_rmse_m": value})
    assert expect["edge_rmse_m"]["verdict"] == verdict
    assert is_broken(expect) == (verdict == "broken")
    json.dumps(expect, allow_nan=False)


def test_an_unknown_metric_breaks_its_limit():
    assert is_broken(evaluate({"no_such": {"max": 1.0}}, {}))


def test_balance():
    assert balance_error(0.0, 0.0) == 0.0
    assert balance_error(10.0, 9.0) == pytest.approx(0.1)
    assert balance_error(0.0, 1.0) == float("inf")


def test_json_safe_knows_numpy_and_nan():
    text = json.dumps(
        json_safe({"a": np.float32(0.5), "b": np.array([1.0, np.nan]), "c": (np.bool_(True), np.inf)})
    )
    assert json.loads(text) == {"a": 0.5, "b": [1.0, None], "c": [True, None]}


def test_every_metric_a_limit_can_be_set_on_has_a_meaning():
    assert set(METRICS) - set(LIMITABLE_METRICS) == {"digest", "incomplete", "expect"}
    assert set(LIMITABLE_METRICS) < set(METRICS)
