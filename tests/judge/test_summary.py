"""summary.json: strict JSON, the contract's names, verdicts."""

import json

import numpy as np
from swath.judge.metrics import METRICS, is_broken

from swath.judge.summary import make_summary, versions, write_summary


def make(**changes):
    metrics = dict.fromkeys(METRICS, 0.01) | changes
    for name in ("digest", "incomplete", "expect", "real_time_factor", "ray_count"):
        metrics.pop(name)
    return make_summary(
        {"name": "straight", "seed": 1},
        metrics,
        {"lateral_rms_m": {"max": 0.05}, "real_time_factor": {"min": 1.5}},
        simulated_s=20.0,
        wall_s=10.0,
        ray_count=7,
        digest="ab",
        incomplete=False,
        cost={"combine.lidar": (0.5, 10)},
    )


def test_all_names_of_the_contract_are_there():
    summary = make()
    assert set(METRICS) <= set(summary)
    assert summary["real_time_factor"] == 2.0
    assert not is_broken(summary["expect"])
    assert summary["expect"]["real_time_factor"] == {"value": 2.0, "limit": {"min": 1.5}, "verdict": "kept"}


def test_missing_numbers_are_null_and_break_their_limit(tmp_path):
    summary = make(lateral_rms_m=float("nan"), edge_rmse_m=np.float64("inf"))
    assert is_broken(summary["expect"])
    path = write_summary(tmp_path, summary)
    read = json.loads(path.read_text(), parse_constant=lambda text: 1 / 0)
    assert read["lateral_rms_m"] is None
    assert read["edge_rmse_m"] is None
    assert read == summary
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_versions_name_what_results_depend_on():
    assert {"swath", "numpy", "python", "platform"} <= set(versions())
