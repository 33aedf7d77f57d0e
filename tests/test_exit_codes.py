"""The table of exit codes in docs/reference/commands.md: one meaning for all commands."""

from pathlib import Path

import pytest

from swath.commands.main import main
from swath.runtime.credibility import SUMMARY as CREDIBILITY
from swath.terminal.outcome import exit_code
from swath.tools.function_test.command import _finish_odd, finish
from swath.tools.function_test.estimate.command import tell
from swath.tools.function_test.estimate.estimate import Estimate, run_estimate
from swath.tools.function_test.journal import Journal
from swath.tools.function_test.one_run import no_result
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin
from tests.tools.odd_files import conducted, small_odd

SETS = ["--set", "combine.lidar.level=empirical", "--set", "run.record=none"]
SHORT = ["run", "straight", *SETS, "--no-report"]
CASE = """
format: swath test case 1
objective: drives
source: made
scenario: straight
set: {run.distance_m: 12, combine.lidar.level: empirical}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8], range: [4, 12]}
seeds: 4
expect: {distance_m: {min: 6}}
claim: {pass_rate: 0.5, confidence: 0.6}
"""
PASS, FAIL, ERROR, OPEN = (
    ("pass", ""),
    ("fail", "too short"),
    ("error", "no such part"),
    ("not judged", "wind"),
)


def told(run, verdict, value=12.0):
    """A result with a verdict and its reason."""
    value = 4.0 if verdict is FAIL else value
    entry = {"subject": "combine", "name": "distance_m", "limit": {"min": 6}, "value": value,
             "result": "fail" if verdict[0] == "fail" else "pass"}  # fmt: skip
    if verdict is OPEN:
        entry["rests_outside"] = ["combine.lidar"]
    expect = [] if verdict is ERROR else [entry]
    wind = {"quantity": "wind_lean_deg", "met": [6.0, 6.0], "checked": [0.0, 0.0]}
    outside = {CREDIBILITY: {"combine.lidar": {"level": "empirical", "quantities": [wind]}}}
    return {
        **(outside if verdict is OPEN else {}),
        **no_result(run, ""),
        "verdict": verdict[0],
        "reason": verdict[1],
        "expect": expect,
    }


@pytest.fixture
def case_file(tmp_path):
    (tmp_path / "drives.yaml").write_text(CASE, encoding="utf-8")
    return str(tmp_path / "drives.yaml")


def test_every_command_is_in_the_table_of_the_docs():
    table = Path("docs/reference/commands.md").read_text(encoding="utf-8").partition("## Exit codes")[2]
    head, _, *rows = [line for line in table.partition("\n## ")[0].splitlines() if line.startswith("|")]
    assert all(name in head for name in ("`run`", "`test run`", "`--odd`", "`test estimate`", "`fleet run`"))
    assert [row.split("|")[1].strip() for row in rows] == ["0", "1", "2", "3", "70", "130, 143"]


@pytest.mark.parametrize(
    ("results", "code"),
    [
        ((), 0),
        (("pass",), 0),
        (("pass", "fail", "not judged"), 1),
        (("pass", "not measured"), 3),
        (("not judged", "not judged"), 3),
        (("pass", "not judged"), 3),
        (("shown",), 0),
        (("shown", "broken", "not shown"), 1),
        (("shown", "not shown"), 3),
        (("never driven", "shown"), 3),
    ],
)
def test_nothing_judged_is_not_a_pass(results, code):
    assert exit_code(results) == code


@pytest.mark.parametrize(
    ("sets", "code", "said"),
    [
        (["run.distance_m=12", "expect={distance_m: {min: 6}}"], 0, "pass"),
        (["run.distance_m=12", "expect={distance_m: {min: 60}}"], 1, "fail"),
        (["run.distance_m=6", "expect={edge_bias_m: {max: 9}}"], 3, "not measured"),
        (["run.distance_m=12", "expect={edge_bias_m: {max: 9}}", "field.stand.wind={speed_m_s: 8}"], 3,
         "not judged"),
        (["run.distance_m=12", "expect={distance_m: {mon: 6}}"], 2, "did you mean 'min'"),
    ],
)  # fmt: skip
def test_run(tmp_path, capsys, sets, code, said):
    changes = [word for text in sets for word in ("--set", text)]
    assert main([*SHORT, *changes, "--out", str(tmp_path / "run")]) == code
    found = capsys.readouterr()
    assert said in found.out + found.err


@pytest.mark.parametrize(
    "line", ['scan = inputs["scan"]', "class MyEdgeDetector:", "self.offset = np.nan\n        return"]
)
def test_a_part_that_calls_exit_ends_no_run_as_done(tmp_path, capsys, line):
    """In its step, where it is loaded, and in its reset."""
    before, _, after = Path("examples/my_edge_detector.py").read_text(encoding="utf-8").partition(line)
    own, indent = tmp_path / "own.py", before[len(before.rstrip(" ")) :]
    own.write_text(f"{before}raise SystemExit(0)\n{indent}{line}{after}", encoding="utf-8")
    level = f"combine.edge.level={own}:MyEdgeDetector"
    assert main([*SHORT, "--set", level, "--set", "run.distance_m=3", "--out", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert "own.py:" in said
    assert "SystemExit" in said or "called sys.exit(0)" in said


@pytest.mark.parametrize(
    ("verdicts", "code", "said"),
    [
        ([PASS] * 8, 0, "1 shown"),
        ([PASS] * 4 + [FAIL] * 4, 3, "1 not shown"),
        ([FAIL] * 8, 1, "1 broken"),
        ([OPEN] * 8, 3, "1 not judged"),
        ([PASS] * 7 + [OPEN], 3, "1 not judged"),
        ([ERROR] * 8, 3, "8 of 8 runs came to an error, nothing is judged from them: no such part"),
        ([PASS] * 7 + [ERROR], 3, "1 of 8 runs came to an error"),
    ],
)
def test_test_run(tmp_path, case_file, capsys, verdicts, code, said):
    session = begin(tmp_path / "out", Plan(case_file))
    journal = Journal(session.journals, "made")
    for run, verdict in zip(session.left(), verdicts, strict=True):
        journal.add(told(run, verdict))
    journal.close()
    assert finish(session.folder, session, again=False) == code
    assert main(["test", "report", str(session.folder)]) == code
    assert said in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("verdict", "code", "said"),
    [
        (PASS, 3, "60 of 60 runs pass"),
        (FAIL, 1, "0 of 60 runs pass"),
        (ERROR, 3, "60 of 60 runs came to an error, nothing is judged from them: no such part"),
        (OPEN, 3, "60 runs not judged"),
    ],
)
def test_a_campaign(tmp_path, monkeypatch, capsys, verdict, code, said):
    """Of a part that cannot be built no bucket is broken."""
    if verdict[0] in ("error", "not judged"):
        monkeypatch.setattr("tests.tools.odd_files.result_of", lambda run, fails: told(run, verdict))
    odd = small_odd(tmp_path)
    made = conducted(monkeypatch, tmp_path / "out", odd, 60, 1, lambda run, chance: verdict is FAIL)
    assert _finish_odd(made) == code
    text = " ".join(capsys.readouterr().out.split())
    assert said in text
    if code == 3:
        assert {cell.verdict for cell in made.cells} <= {"not shown", "never driven", "shown"}
        assert "cause" not in text


@pytest.mark.parametrize(
    ("at_most", "share", "code"),
    [(None, 0.5, 0), (0.9, 0.5, 0), (0.01, 0.5, 1), (0.9, 0.0, 3)],
)
def test_an_estimate(tmp_path, case_file, monkeypatch, at_most, share, code):
    def run_here(planned, journals, workers, done):
        journal = Journal(journals, "here")
        for run in planned:
            value = 4.0 if run.point["speed_kmh"] > 12 - 8 * share else 12.0 + run.point["speed_kmh"]
            done(journal.add(told(run, FAIL if value < 6 else PASS, value)))
        journal.close()

    monkeypatch.setattr("swath.tools.function_test.session.run_all", run_here)
    found = run_estimate(tmp_path / "out", Estimate(case_file, budget=200), 1, lambda result: None)
    assert tell(found, at_most) == code


def test_a_fleet_is_done_or_refused(capsys):
    """A job has no limits: nothing is judged, so nothing can fail."""
    assert main(["fleet", "run", "small-field", "--set", "fleet.plans=1"]) == 0
    assert main(["fleet", "run", "small-field", "--set", "combines={}"]) == 2
