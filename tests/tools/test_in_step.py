"""`swath test run` drives runs in step where that is cheaper: every line is what that run alone comes to."""

import json

import pytest

from swath.commands.main import main
from swath.runtime.kept import KeptFields
from swath.tools.function_test.journal import Journal, read_journals, write_table
from swath.tools.function_test.one_run import results_in
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.pool import TOGETHER, in_chunks, run_all
from swath.tools.function_test.session import begin
from tests.tools.fake_work import do_run

pytestmark = pytest.mark.usefixtures("code_allowed")

CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set:
  run.distance_m: 1.0
  combine.lidar.level: profile
  combine.lidar.sector_deg: [-30, 30]
  combine.header.level: profile
  combine.motion.level: kinematic
  combine.motion.start_speed_kmh: 7
  combine.edge: otsu
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8]}
seeds: 2
expect: {distance_m: {min: 1}, lateral_error_m: {hold: always, max: 0.5}}
"""
KILLS = """
import os, signal
from swath.control.edge.otsu import Otsu, Params

class Kills(Otsu):
    def __init__(self, params, setup):
        super().__init__(Params(), setup)

    def reset(self, stream):
        self.is_last = stream.seed == 2
        return super().reset(stream)

    def step(self, t, dt, inputs):
        if self.is_last and t > 300_000_000:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(t, dt, inputs)
"""


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "drives.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


PRIVATE = ("cpu_s", "edge_us", "worker")  # of a journal: who did it, and how long it took


def line(result):
    """As in a journal, without what tells who did it, of the run and of its shadows."""

    def told(of):
        return {k: told(v) if isinstance(v, dict) else v for k, v in of.items() if k not in PRIVATE}

    return json.dumps(told(result), sort_keys=True)


def both(runs, monkeypatch):
    """Lines of runs in step and one by one, by name."""
    assert [len(chunk) for chunk in in_chunks(runs, 1)] == [len(runs)]
    one_by_one = {run.id: line(do_run(run, KeptFields())) for run in runs}
    with monkeypatch.context() as patch:
        patch.setattr("swath.tools.function_test.one_run.run_unrecorded", _refused)
        in_step = {result["id"]: line(result) for result in results_in(runs, KeptFields())}
    return in_step, one_by_one


def _refused(scenario, fields, *, hooks):
    raise AssertionError("this run went alone")


@pytest.mark.parametrize(
    ("change", "verdicts"),
    [
        ("", {"pass"}),
        ("expect: {distance_m: {max: 0.5}}", {"fail"}),
        ("expect: {lateral_rms_m: {max: 0.0001}}", {"not judged"}),
        ("expect: {lateral_p95_m: {max: 0.5, from_m: 0.2, to_m: 0.8}}", None),
        ("met: [ground_speed_kmh, crop_height_m]", {"pass"}),
        ("  field.weather: {wind_m_s: 3, cloud_percent: 5}\n", {"pass"}),
    ],
    ids=["passes", "fails", "nothing measured", "a part of the way", "what was met", "who asked"],
)
def test_in_step_a_line_is_what_it_is_alone(case_file, monkeypatch, change, verdicts):
    text = case_file.read_text(encoding="utf-8")
    if change.startswith("expect"):
        text = text.replace(text[text.index("expect") :], change)
    elif change.startswith(" "):
        text = text.replace("set:\n", f"set:\n{change}")
    elif change:
        text += change
    case_file.write_text(text, encoding="utf-8")
    in_step, one_by_one = both(list(Plan(str(case_file)).runs()), monkeypatch)
    assert in_step == one_by_one
    if verdicts:
        assert {json.loads(told)["verdict"] for told in in_step.values()} == verdicts


def test_detectors_in_shadow_go_along_in_step(case_file, monkeypatch):
    candidates = {"seven": ["combine.edge.min_step_m=0.2"], "nine": ["combine.edge.min_step_m=0.3"]}
    in_step, one_by_one = both(
        list(Plan(str(case_file), candidates=candidates, shadow=True).runs()), monkeypatch
    )
    assert in_step == one_by_one
    assert set(json.loads(next(iter(in_step.values())))["shadow"]) == {"nine"}


def test_runs_of_other_machines_sensors_and_rates_go_together_and_stay_what_they_are(case_file, monkeypatch):
    text = case_file.read_text(encoding="utf-8")
    varied = [
        "rate: {key: combine.lidar.rate_hz, at: [25, 50]}",
        "sensor: {key: combine.lidar.sensor, at: [sick-lms511-hr, sick-lms291]}",
        "machine: {key: combine.machine, at: [lexion-700-class, combine-5m]}",
        "track: {key: combine.motion, at: [kinematic, single_track]}",
        "late: {key: combine.edge.fault.latency_ms, at: [0, 80]}",
    ]
    for vary in varied:
        own = "vary:\n  " + vary + "\nseeds: 1" + text.partition("seeds: 2")[2]
        case_file.write_text(text.partition("vary:")[0] + own, encoding="utf-8")
        in_step, one_by_one = both(list(Plan(str(case_file)).runs()), monkeypatch)
        assert in_step == one_by_one, vary


def test_a_run_that_cannot_be_made_in_step_is_done_alone_and_tells_why(case_file):
    text = case_file.read_text(encoding="utf-8").replace("at: [5, 8]", "at: [5, 900]")
    case_file.write_text(text, encoding="utf-8")
    runs = tuple(Plan(str(case_file), seeds=1).runs())
    told = [line(result) for result in results_in(runs, KeptFields())]
    assert told == [line(do_run(run, KeptFields())) for run in runs]
    assert "speed_kmh" in json.loads(told[1])["reason"]


@pytest.mark.parametrize(
    "sets",
    [("combine.lidar.level=empirical",), ("combine.camera=rays",), ("combine.lidar.level=mine.py:Mine",)],
)
def test_runs_that_gain_nothing_go_alone(case_file, sets):
    runs = list(Plan(str(case_file), sets=sets).runs())
    assert list(in_chunks(runs, 2)) == [(run,) for run in runs]


@pytest.mark.parametrize(("count", "workers", "most"), [(5, 2, 3), (2 * TOGETHER + 2, 1, TOGETHER)])
def test_workers_share_the_runs_of_a_case(case_file, count, workers, most):
    runs = list(Plan(str(case_file), drawn=0, seeds=count).runs())[:count]
    chunks = list(in_chunks(runs, workers))
    assert [run for chunk in chunks for run in chunk] == runs
    assert max(map(len, chunks)) == most


def test_the_command_does_runs_in_step_and_goes_on_where_it_was(case_file, tmp_path, capsys):
    out = tmp_path / "out"
    runs = list(Plan(str(case_file)).runs())
    alone = [do_run(run, KeptFields()) for run in runs]
    session = begin(out, Plan(str(case_file)))
    journal = Journal(session.journals, "before")
    journal.add(alone[0])
    journal.close()
    assert main(["test", "run", str(case_file), "--out", str(out), "--workers", "1"]) == 3
    assert "4 of 4 passed" in capsys.readouterr().out
    lines = list(read_journals(session.journals))
    assert sorted(map(line, lines)) == sorted(map(line, alone))
    assert (out / "results.parquet").read_bytes() == write_table(tmp_path, alone).read_bytes()


@pytest.mark.draws
def test_a_run_that_kills_its_process_costs_none_beside_it(case_file, tmp_path):
    case_file.write_text(CASE.replace("[5, 8]", "[5]"), encoding="utf-8")
    (tmp_path / "kills.py").write_text(KILLS, encoding="utf-8")
    sets = f'combine.edge={{"level": "{tmp_path}/kills.py:Kills"}}'
    runs = list(Plan(str(case_file), sets=(sets,), seeds=3).runs())
    done = []
    run_all(runs, tmp_path / "journal", 1, done.append)
    assert sorted(result["id"] for result in done) == sorted(run.id for run in runs)
    assert {(r["seed"], r["reason"]) for r in done if r["verdict"] == "error"} == {
        (2, "ended its process 2 times, exit code -9")
    }
    assert {line(result) for result in done} <= {
        line(result) for result in read_journals(tmp_path / "journal")
    }
