"""summary.json: strict JSON, one machine at the top, several by name."""

import json

from swath.judge.catalogue import load_evaluators
from swath.judge.limits import exit_code_of
from swath.judge.summary import make_summary, versions, write_summary
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit
from tests.evaluated import evaluation_of
from tests.fake_run import ArcEdge, GridField, drive, machine


def make(*names, seconds=6.0, **limits):
    ground = GridField(ArcEdge())
    expect = [Expectation(*name.split("."), Limit(**limit)) for name, limit in limits.items()]
    evaluation = evaluation_of(ground, *(machine(name=name) for name in names), expect=expect)
    drive([evaluation], ground, seconds=seconds)
    return make_summary(
        {"name": "straight", "seed": 1},
        evaluation,
        {},
        sensors={"combine": {"unmeasured_beam_share": 0.25}},
        simulated_s=20.0,
        wall_s=10.0,
        ray_count=7,
        digest="ab",
        incomplete=False,
        cost={"combine.lidar": (0.5, 10)},
    )


def test_the_metrics_of_one_machine_stand_at_the_top():
    summary = make("combine", **{"field.real_time_factor": {"min": 1.5}, "combine.area_cut_m2": {"min": 1}})
    absent = {name for name in load_evaluators().metrics if name not in summary}
    groups = {load_evaluators().metrics[name].group for name in absent}
    assert groups <= {
        "Safety",
        "Header height",
        "Crop and engine",
        "Unloading",
        "Positioning",
        "Passes",
        "Pictures",
    }
    assert summary["format"] == "swath summary 2"
    assert summary["real_time_factor"] == 2.0
    assert summary["unmeasured_beam_share"] == 0.25
    assert "machines" not in summary
    assert exit_code_of(summary["expect"]) == 0
    limit = {"subject": "field", "name": "real_time_factor", "limit": {"min": 1.5}}
    assert summary["expect"][0] == {**limit, "value": 2.0, "result": "pass"}


def test_several_machines_have_their_own_metrics_and_limits():
    limits = {"combine.grain_cut_kg": {"min": 1}, "cart.grain_cut_kg": {"min": 1}}
    summary = make("combine", "cart", **limits)
    assert summary["machines"]["combine"]["grain_cut_kg"] > 1.0
    counts = dict.fromkeys(("contact_count", "rollover_count", "stop_count"), 0.0)
    assert summary["machines"]["cart"] == {**counts, "distance_m": 0.0}
    assert summary["field"] == {k: summary[k] for k in ("mass_balance_error", "stubble_straw_kg")}
    assert "lateral_rms_m" not in summary
    grain, implied = summary["expect"][:2], summary["expect"][2:]
    assert [(e["subject"], e["result"]) for e in grain] == [("combine", "pass"), ("cart", "fail")]
    assert {(e["subject"], e["name"]) for e in implied} == {
        (subject, name) for subject in ("combine", "cart") for name in ("contact_count", "rollover_count")
    }


def test_missing_numbers_are_null_and_fail(tmp_path):
    summary = make("combine", seconds=1.0, **{"combine.lateral_rms_m": {"max": 1}})
    assert exit_code_of(summary["expect"]) == 1
    path = write_summary(tmp_path, summary)
    read = json.loads(path.read_text(), parse_constant=lambda text: 1 / 0)
    assert read["lateral_rms_m"] is None
    assert read == summary
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]


def test_versions_name_what_results_depend_on():
    found = versions()
    assert {"swath", "numpy", "python", "platform", "c_library", "processor"} <= set(found)
    assert all(found.values())
