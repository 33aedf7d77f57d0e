"""Detectors in shadow, and on stored scans: what the one at the wheel said comes out again, bit for bit."""

import json
from pathlib import Path

import pytest

import swath
from swath.core.errors import InputError
from swath.record.digest import Digest
from swath.runtime.job import run_job
from swath.runtime.kept import KeptFields
from swath.tools.function_test.judged import in_shadow
from swath.tools.function_test.one_run import do_run
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin, open_session
from swath.tools.function_test.shadow import ShadowHook
from tests.whole.small import small

ROOT = Path(__file__).parents[2]
LIDAR = "combine.lidar={level: empirical, sector_deg: [-40, 40], step_deg: 1.0}"


def scenario(*sets):
    return small("run.distance_m=13", "run.max_duration_s=12", LIDAR, "field.obstacles=[]", *sets)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A run with three shadows: the detector at the wheel, the same with a fault, another one."""
    shadows = {
        "same": scenario(),
        "biased": scenario("combine.edge.fault={bias: {offset_cm: 10}}"),
        "otsu": scenario("combine.edge.level=otsu"),
    }
    return run_job(scenario(), tmp_path_factory.mktemp("run") / "run", hooks=[ShadowHook(shadows)])


def test_a_shadow_of_the_detector_at_the_wheel_says_the_same(driven):
    same = driven.summary["shadow"]["same"]
    edge = {k: v for k, v in driven.summary.items() if k in same["metrics"]}
    assert same["metrics"] == edge
    assert edge["edge_sample_count"] > 20


def test_another_detector_says_something_else(driven):
    told = driven.summary["shadow"]
    assert len({one["digest"] for one in told.values()}) == 3
    shift = told["biased"]["metrics"]["edge_bias_m"] - told["same"]["metrics"]["edge_bias_m"]
    assert shift == pytest.approx(-0.10, abs=1e-9)  # to the left, away from the crop
    assert told["otsu"]["metrics"]["edge_rmse_m"] != told["same"]["metrics"]["edge_rmse_m"]


def test_shadows_do_not_change_the_run(driven, tmp_path):
    assert run_job(scenario(), tmp_path / "run").summary["digest"] == driven.summary["digest"]


def test_only_the_detector_may_differ(tmp_path):
    hook = ShadowHook({"slow": scenario("combine.speed.speed_kmh=3")})
    with pytest.raises(InputError, match=r"candidate = slow: expected changes of combine\.edge alone"):
        run_job(scenario(), tmp_path / "run", hooks=[hook])


def test_a_detector_on_stored_scans_needs_no_world(driven, monkeypatch):
    """The same samples as in shadow: their digest."""

    def refuse(*args, **options):
        raise AssertionError("a world is built")

    monkeypatch.setattr("swath.runtime.assembly.build_field", refuse)
    for name, sets in (("same", {}), ("otsu", {"combine.edge": "otsu"})):
        edges, digest = swath.detect(driven.folder, sets=sets), Digest()
        period = 40_000_000
        for number, edge in enumerate(edges):
            digest("combine.edge", number * period, {"edge": edge})
        assert digest.hex == driven.summary["shadow"][name]["digest"]
    with pytest.raises(InputError, match="expected a part of control"):
        swath.detect(driven.folder, slot="lidar")


def test_the_five_lines_of_the_page_run(driven, capsys):
    text = (ROOT / "docs" / "how-to" / "function-tests.md").read_text(encoding="utf-8")
    lines = text.partition("```py\n")[2].partition("```")[0]
    own = f"{ROOT / 'examples' / 'my_edge_detector.py'}:MyEdgeDetector"
    lines = lines.replace("runs/tuesday", str(driven.folder)).replace("my_detector.py:MyEdgeDetector", own)
    exec(compile(lines, "function-tests.md", "exec"), {})
    assert capsys.readouterr().out.count(f" of {len(swath.detect(driven.folder))}\n") == 2


CASE = """
format: swath test case 1
objective: detects
source: estimated
scenario: straight
set:
  run: {distance_m: 12, record: none}
  combine.lidar: {level: empirical, step_deg: 2, sector_deg: [-40, 40]}
seeds: 1
expect: {edge_rmse_m: {max: 0.2}, lateral_rms_m: {max: 0.2}}
"""


def test_candidates_in_shadow_are_judged_by_limits_on_detection(tmp_path):
    (tmp_path / "detects.yaml").write_text(CASE, encoding="utf-8")
    candidates = {"wheel": (), "far": ("combine.edge.fault={bias: {offset_cm: 50}}",)}
    plan = Plan(str(tmp_path / "detects.yaml"), candidates=candidates, shadow=True)
    (run,) = plan.runs()
    assert run.candidate == "wheel"
    begin(tmp_path / "out", plan)
    assert [found.id for found in open_session(tmp_path / "out").plan.runs()] == [run.id]
    result = json.loads(json.dumps(do_run(run, KeptFields())))
    (shadow,) = in_shadow(result, run.shadows)
    assert (result["verdict"], shadow["verdict"]) == ("pass", "fail")
    assert [entry["name"] for entry in shadow["expect"]] == ["edge_rmse_m"]
    assert shadow["candidate"] == "far"
    assert shadow["id"] == f"{result['id']}-far"
