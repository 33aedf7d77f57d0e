"""Metrics: closed forms, signs, and limits."""

import json

import numpy as np
import pytest

from swath.documents.json_file import json_safe
from swath.judge.evaluator import SETTLING_M, Event
from swath.judge.evaluators.lateral_error import lateral_metrics
from swath.judge.evaluators.mass_balance import balance_error
from swath.judge.limits import check_metric, check_samples, entry_of, exit_code_of
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit


def test_lateral_of_a_sine_is_its_closed_form():
    distance = np.sort(np.random.default_rng(0).uniform(0, 110, 20000))
    error = 0.03 + 0.1 * np.sin(2 * np.pi * (distance - 10) / 5)
    found = lateral_metrics(distance, error, settling=SETTLING_M)
    assert found["lateral_bias_m"] == pytest.approx(0.03, abs=2e-4)
    assert found["lateral_rms_m"] == pytest.approx(np.sqrt(0.03**2 + 0.1**2 / 2), abs=2e-4)


def test_lateral_ignores_settling_and_sampling():
    """A slow stretch with many samples weighs no more than its length; the first 10 m do not count."""
    distance = np.concatenate(
        [np.linspace(0, 10, 50), np.linspace(10.001, 20, 100000), np.linspace(20.001, 30, 11)]
    )
    error = np.where(distance < 10, 5.0, np.where(distance < 20.0005, 0.0, 1.0))
    found = lateral_metrics(distance, error, settling=SETTLING_M)
    assert found["lateral_bias_m"] == pytest.approx(0.5, abs=0.01)


def test_too_short_a_run_has_no_lateral_error():
    found = lateral_metrics(np.linspace(0, 9, 50), np.zeros(50), settling=SETTLING_M)
    assert all(np.isnan(v) for v in found.values())


@pytest.mark.parametrize(
    ("value", "limit", "passes"),
    [
        (0.05, {"max": 0.05}, True),
        (0.0501, {"max": 0.05}, False),
        (0.9, {"min": 0.95}, False),
        (0.97, {"min": 0.95, "max": 1.0}, True),
        (None, {"max": 1.0}, False),
        (float("nan"), {"max": 1.0}, False),
        (float("inf"), {"min": 1.0}, False),
        ("text", {"max": 1.0}, False),
    ],
)
def test_both_bounds_count_and_what_is_no_number_fails(value, limit, passes):
    limit = Limit(**limit)
    entry = entry_of(Expectation("combine", "edge_rmse_m", limit), [check_metric(limit, value)])
    assert entry["result"] == ("pass" if passes else "fail")
    assert ("reason" in entry) is not passes
    assert exit_code_of([entry]) == (0 if passes else 1)
    json.dumps(entry, allow_nan=False)


T = np.arange(0.0, 10.0, 0.02)
TRACKS = {
    "t_s": T,
    "distance_m": 2.0 * T,
    "lateral_error_m": np.where((T > 4.0) & (T < 5.0), 0.5, 0.1),
    "edge_confidence": np.where((T > 3.9) & (T < 5.1), 0.2, 0.9),
    "clearance_m": np.abs(9.0 - T) + 1.2,
    "never": np.full(len(T), np.nan),
}
GAP = Event(round(4e9), "gap", "combine", 0.0, 0.0, 8.0, "", round(5e9), end_distance=10.0)


def samples(name, event=None, **keys):
    return check_samples(Limit.model_validate(keys), TRACKS, name, event)


def test_always_tells_the_worst_sample():
    value, reason = samples("lateral_error_m", min=-0.3, max=0.3, hold="always")
    assert value == 0.5
    assert reason == "0.5 is more than 0.3"
    assert samples("clearance_m", min=1.0, hold="always") == (pytest.approx(1.2), "")


def test_never_off_while_confident():
    sure = {"edge_confidence": {"min": 0.5}}
    assert samples("lateral_error_m", min=-0.3, max=0.3, hold="always", **{"while": sure}) == (0.1, "")
    value, reason = samples("lateral_error_m", max=0.3, hold="always", **{"while": {"never": {"min": 0.0}}})
    assert value is None
    assert "no sample at which never" in reason


def test_recovered_within_three_metres_of_the_gap():
    assert samples("lateral_error_m", GAP, max=0.2, hold="eventually", after="gap", within_m=3)[1] == ""
    value, reason = samples("lateral_error_m", GAP, max=0.05, hold="eventually", after="gap", within_m=3)
    assert value == 0.1
    assert "never within the bounds" in reason


def test_stopped_one_metre_before_the_post():
    assert samples("clearance_m", min=1.0, hold="always")[1] == ""
    assert samples("clearance_m", min=1.5, hold="always")[1] != ""


def test_share_of_time():
    assert samples("lateral_error_m", max=0.2, hold=0.9) == (pytest.approx(0.9, abs=0.01), "")
    assert samples("lateral_error_m", max=0.2, hold=0.95)[1].endswith("of the time, expected 0.95")


def test_a_window_chooses_samples():
    assert samples("lateral_error_m", max=0.2, hold="always", from_m=10.0)[1] == ""
    assert samples("lateral_error_m", max=0.2, hold="always", to_s=4.0)[1] == ""
    assert samples("lateral_error_m", max=0.2, hold="always", from_s=4.0, to_s=4.5)[1] != ""
    assert samples("lateral_error_m", GAP, max=0.2, hold="always", before="gap", within_s=2)[1] == ""


def test_what_could_not_be_judged_fails_and_says_why():
    assert samples("never", max=1.0, hold="always") == (None, "nothing was measured")
    assert "never opened" in samples("lateral_error_m", max=1.0, hold="always", from_s=99.0)[1]
    assert "no column" in samples("fix_x_m", max=1.0, hold="always")[1]
    entry = entry_of(Expectation("combine", "x", Limit(max=1.0, after="gap", within_m=3.0)), [])
    assert entry["result"] == "fail"
    assert entry["reason"] == "the window never opened: there was no event gap"


def test_balance():
    assert balance_error(0.0, 0.0) == 0.0
    assert balance_error(10.0, 9.0) == pytest.approx(0.1)
    assert balance_error(0.0, 1.0) == float("inf")


def test_json_safe_knows_numpy_and_nan():
    text = json.dumps(
        json_safe({"a": np.float32(0.5), "b": np.array([1.0, np.nan]), "c": (np.bool_(True), np.inf)})
    )
    assert json.loads(text) == {"a": 0.5, "b": [1.0, None], "c": [True, None]}
