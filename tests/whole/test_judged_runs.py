"""Limits, windows, events and a user's own evaluator on short runs of the real field."""

import json
from pathlib import Path

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.report.report import ReportWriter
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import parse_scenario
from tests.whole.small import TEXT

pytestmark = pytest.mark.usefixtures("code_allowed_in_module")

OWN = Path(__file__).parents[2] / "examples" / "my_evaluator.py"
JUDGED = f"""
evaluators: ["{OWN}:SteeringReversals"]
expect:
  steering_reversals_per_100_m: {{max: 2000, from_m: 1}}
  lateral_error_m:
    - {{min: -0.5, max: 0.5, hold: always, while: {{edge_confidence: {{min: 0.2}}}}}}
    - {{min: -0.25, max: 0.25, hold: eventually, after: gap, within_m: 1}}
  speed_m_s: {{min: 1.5, hold: 0.9, from_s: 0.5}}
  area_cut_m2: {{min: 5, max: 13, from_m: 1, to_m: 2}}
  lateral_p95_m: {{max: 0.5, after: edge_lost, within_m: 3}}
"""
GAP = "field.edge.gaps=[{start_m: 1, end_m: 2.5, depth_m: 1}]"
ON = "combine.speed.guard.when_lost=ignore"  # drives on where it sees no edge
STOPS = """
class Stops:
    OF_FIELD = True
    METRICS = ()
    LIMITS = {"mass_balance_error": {"max": -1.0}}

    def __init__(self, setup):
        self.setup = setup

    def see(self, slot, t, outputs):
        pass

    def metrics(self):
        return {}

    def end_reason(self, t):
        return "half a second is enough" if t >= 500_000_000 else ""
"""


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "judged"
    scenario = parse_scenario(TEXT + JUDGED, sets=[GAP, ON])
    assert parse_scenario(scenario.resolved()) == scenario
    return run_job(scenario, out, hooks=[ReportWriter()]), out


def test_limits_on_samples_windows_and_own_metrics_are_judged(judged):
    result, _ = judged
    *entries, lost, contact, rollover = result.summary["expect"]
    implied = {(e["name"], e["result"]) for e in (contact, rollover)}
    assert implied == {("contact_count", "pass"), ("rollover_count", "pass")}
    assert [e["name"] for e in entries if e["result"] == "fail"] == []
    assert len(entries) == 5
    assert entries[4]["value"] == pytest.approx(12.3, rel=0.1)
    assert lost["reason"] == "the window never opened: there was no event edge_lost"
    assert result.exit_code == 1


def test_limits_on_samples_are_judged_without_a_folder_too(judged):
    summary = run_unrecorded(parse_scenario(TEXT + JUDGED, sets=[GAP, ON]))
    assert summary["expect"] == judged[0].summary["expect"]
    assert summary["digest"] == judged[0].summary["digest"]


def test_what_happened_is_in_summary_and_report(judged):
    _, out = judged
    (gap,) = json.loads((out / "summary.json").read_text())["incidents"]
    assert (gap["kind"], gap["machine"]) == ("gap", "combine")
    assert gap["end_distance_m"] - gap["distance_m"] == pytest.approx(1.5, abs=0.1)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "passes a gap of 1.5 m" in page
    assert "steering reversals" in page
    assert "✗ fail" in page


def test_a_limit_under_an_earlier_name_is_judged_and_told(tmp_path):
    (tmp_path / "stops.py").write_text(STOPS)
    end = f'evaluators: ["{tmp_path / "stops.py"}:Stops"]\n'
    old, new = (
        parse_scenario(f"{TEXT}{end}expect: {{{name}: {{min: 2}}}}\n")
        for name in ("thing_contrast", "thing_contrast_true")
    )
    assert old == new
    summaries = [run_unrecorded(scenario) for scenario in (old, new)]
    told = "expect.thing_contrast: it is called thing_contrast_true"
    assert [told in s["notes"] for s in summaries] == [True, False]
    assert summaries[0]["expect"] == summaries[1]["expect"]
    assert summaries[0]["expect"][0]["name"] == "thing_contrast_true"


def test_an_evaluator_ends_the_run_and_brings_its_limit(tmp_path):
    (tmp_path / "stops.py").write_text(STOPS)
    ending = f'evaluators: ["{tmp_path / "stops.py"}:Stops"]\n'
    result = run_job(parse_scenario(TEXT + ending), tmp_path / "a")
    assert result.summary["simulated_s"] == pytest.approx(0.5, abs=0.01)
    assert "half a second is enough" in result.summary["notes"][-1]
    assert result.summary["incomplete"] is False
    assert result.exit_code == 1
    entry = next(e for e in result.summary["expect"] if e["result"] == "fail")
    assert (entry["subject"], entry["name"]) == ("field", "mass_balance_error")
    ending += "expect: {mass_balance_error: {max: 1}}\n"
    assert run_job(parse_scenario(TEXT + ending), tmp_path / "b").exit_code == 0


def test_the_outcome_is_printed(tmp_path, capsys):
    (tmp_path / "s.yaml").write_text(TEXT + JUDGED)
    words = [
        "--set",
        GAP,
        "--set",
        "run.max_duration_s=1.2",
        "--out",
        str(tmp_path / "out"),
        "--no-defaults",
        "--no-report",
    ]
    assert main(["run", str(tmp_path / "s.yaml"), *words]) == 1
    said = capsys.readouterr().out
    assert "combine gap: passes a gap" in said
    assert "the run ended at max_duration_s = 1.2, after" in said
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["ended"]["reason"] == "time"
    assert "fail    combine.lateral_p95_m after edge_lost, within_m 3: the window never opened" in said


TWO = TEXT + "  cart:\n    machine: lexion-700-class\n    start: {x_m: -60, y_m: 0}\n"


@pytest.mark.parametrize(
    ("text", "keys", "said"),
    [
        (TEXT, "lateral_p59_m: {max: 1}", "unknown metric, did you mean 'lateral_p95_m'?"),
        (TEXT, "lateral_eror_m: {max: 1}", "did you mean 'lateral_error_m'?"),
        (TEXT, "lateral_rms_m: {max: 1, after: gpa}", "after = gpa: unknown event, did you mean 'gap'?"),
        (TEXT, "speed_m_s: {max: 1, while: {edge_confidense: {min: 0}}}", "did you mean 'edge_confidence'?"),
        (TEXT, "lateral_rms_m: {max: 1, hold: always}", "expected no hold, lateral_rms_m is a metric"),
        (TEXT, "speed_m_s: {max: 1, hold: alway}", "hold = alway"),
        (TEXT, "ray_count: {max: 1, from_m: 1}", "expected no window, ray_count is of the whole run"),
        (TEXT, "lateral_rms_m: {max: 1, within_m: 3}", "expected after or before with within_m"),
        (TEXT, "lateral_rms_m: {max: 1, before: gap}", "expected within_m or within_s with before"),
        (TEXT, "lateral_rms_m: {max: 1, from_m: 3, to_m: 2}", "expected a window that begins before it ends"),
        (TEXT, "lateral_rms_m: [{max: 1}, {mx: 1}]", "expect.lateral_rms_m.1.mx: unknown key"),
        (
            TWO,
            "lateral_rms_m: {max: 1}",
            "lateral_rms_m: unknown machine, expected one of combine, cart",
        ),
        (TWO, "combine: {mass_balance_error: {max: 1}}", "mass_balance_error: expected under field"),
        (TWO, "field: {lateral_rms_m: {max: 1}}", "lateral_rms_m: expected under a machine's name"),
        (TWO, "crat: {lateral_rms_m: {max: 1}}", "unknown machine, did you mean 'cart'?"),
    ],
)
def test_limits_that_cannot_be_meant_are_refused(text, keys, said):
    with pytest.raises(InputError) as error:
        parse_scenario(f"{text}expect:\n  {keys}\n")
    assert said in str(error.value)
