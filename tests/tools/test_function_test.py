"""`swath test`: cases, plans, verdicts, workers that die, journals, judging again."""

import json
import os
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow.parquet as pq
import pytest
from docs.make.cases import PAGE, PICTURES, page

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.foreign_code import Gate, through
from swath.tools.function_test.candidates import read_candidates
from swath.tools.function_test.case import find_cases, read_case
from swath.tools.function_test.cells import Cell, cells_of
from swath.tools.function_test.journal import Journal, results_of, write_table
from swath.tools.function_test.judging.judged import PresentLimits, unjudged_lines
from swath.tools.function_test.judging.margin import margin
from swath.tools.function_test.judging.ranking import HEAD, Measured, by_tag, ranking
from swath.tools.function_test.judging.verdict import BROKEN, NOT_SHOWN, SHOWN, log_capital, needed, verdict
from swath.tools.function_test.junit import write_junit
from swath.tools.function_test.one_run import scenario_of
from swath.tools.function_test.page import write_matrix
from swath.tools.function_test.plan import Plan, plan_of
from swath.tools.function_test.pool import run_all
from swath.tools.function_test.session import Session, begin, open_session
from tests.tools.fake_work import fake_works, finished

pytestmark = pytest.mark.usefixtures("code_allowed")

CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set: {run.distance_m: 6, combine.lidar.level: empirical}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8], range: [4, 12]}
seeds: 2
expect: {distance_m: {min: 6}}
"""


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "drives.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


def results(cell_runs, limit=None):
    """Made results of a case: (value, point) each."""
    metric = "distance_m"
    entry = {"subject": "combine", "name": metric, "limit": limit or {"max": 1.0}}
    return [
        {
            "id": f"{i:016x}", "case": "drives", "candidate": "base", "point": {"speed_kmh": speed},
            "seed": 1, "verdict": "fail" if value > 1.0 else "pass", "reason": "", "metrics": {metric: value},
            "expect": [{**entry, "value": value, "result": "fail" if value > 1.0 else "pass"}],
            "incidents": [], "digest": "",
        }
        for i, (value, speed) in enumerate(cell_runs)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("passed", "count", "expected"),
    [
        (59, 59, SHOWN),
        (58, 58, NOT_SHOWN),
        (92, 93, SHOWN),
        (91, 92, NOT_SHOWN),
        (31, 50, BROKEN),
        (0, 0, NOT_SHOWN),
    ],
)
def test_a_complete_plan_is_judged_by_the_exact_interval(passed, count, expected):
    """59 and 93 runs with no and one failure: the tables of Clopper and Pearson, and of Wilks."""
    assert verdict(passed, count, 0.95, 0.95, is_complete=True) == expected
    assert needed(0.95, 0.95) == 59
    assert needed(0.99, 0.95) == 299


def test_looking_early_claims_falsely_in_less_than_one_of_twenty():
    """True rate on the edge of the claim, looked at after every run of 1000: Ville's inequality."""
    rng = np.random.default_rng(3)
    for is_for in (True, False):
        false = 0
        for _ in range(60):
            passed = np.cumsum(rng.random(600) < 0.95)
            looks = range(19, 600, 20)
            false += any(log_capital(int(passed[n]), n + 1, 0.95, is_for=is_for) >= np.log(20) for n in looks)
        assert false <= 8  # 5 % of 60 is 3; more than 8 has a chance of 0.003
    assert verdict(66, 66, 0.95, 0.95, is_complete=False) == NOT_SHOWN
    assert verdict(67, 67, 0.95, 0.95, is_complete=False) == SHOWN
    assert verdict(20, 40, 0.95, 0.95, is_complete=False) == BROKEN


def test_the_page_of_the_catalogue_is_that_of_its_files_and_every_case_has_a_picture():
    cases = find_cases("catalogue")
    assert PAGE.read_text(encoding="utf-8") == page(cases), "run: python -m docs.make.cases"
    assert {p.stem for p in PICTURES.iterdir()} == {case.name for case in cases}, (
        "python -m docs.make.cases --draw"
    )


def test_the_bundled_cases_can_be_read_and_their_scenarios_too():
    cases = find_cases("catalogue")
    assert len(cases) >= 40
    Plan("catalogue", seeds=1).check()
    for case in cases:
        for name, varied in case.file.vary.items():
            if varied.range is not None:
                low, high = varied.range
                assert all(low <= p[name] <= high for p in case.drawn(5, 1))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("seeds: 2", "seeds: 0", "seeds = 0: expected >= 1"),
        ("range: [4, 12]", "range: [12, 4]", "expected two numbers, the lower one first"),
        ("objective: drives", "objektive: drives", "did you mean 'objective'"),
        (
            "source: estimated",
            "source: estimated\nknown: [{why: x, at: {speed: 5}}]",
            "expected a parameter of vary",
        ),
        ("swath test case 1", "swath test case 9", "expected `swath test case 1`"),
    ],
)
def test_a_bad_case_is_refused_with_its_place(case_file, old, new, expected):
    case_file.write_text(CASE.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as found:
        read_case(case_file)
    assert expected in str(found.value)
    assert "drives.yaml" in str(found.value)


def test_a_run_is_named_by_all_that_it_depends_on(case_file, tmp_path):
    plan = Plan(str(case_file))
    names = [run.id for run in plan.runs()]
    assert len(set(names)) == 4
    assert names == [run.id for run in Plan(str(case_file)).runs()]
    detector = tmp_path / "mine.py"
    detector.write_text("x = 1\n", encoding="utf-8")
    sets = {"mine": [f'combine.edge.level="{detector}:Mine"']}
    before = [run.id for run in Plan(str(case_file), candidates=sets).runs()]
    detector.write_text("x = 2\n", encoding="utf-8")
    assert not set(before) & {run.id for run in Plan(str(case_file), candidates=sets).runs()}
    drawn = [run.point for run in Plan(str(case_file), drawn=5).runs()]
    assert drawn[::1][:3] == [run.point for run in Plan(str(case_file), drawn=3).runs()][:3]


def test_what_is_refused_of_a_candidate_names_the_file_where_it_stands(case_file, tmp_path, capsys):
    (tmp_path / "mine.py").write_text("class Edge: pass")
    (tmp_path / "own.yaml").write_text('mine: {combine.edge.level: "mine.py:Edge"}')
    line = ["test", "run", str(case_file), "--out", str(tmp_path / "out")]
    with through(Gate()):
        assert main([*line, "--with", str(tmp_path / "own.yaml")]) == 2
    said = capsys.readouterr().err
    assert "names code, which runs with your rights: allow it with --allow-code" in said
    assert said.endswith("/own.yaml)\n")
    assert main([*line, "--set", "combine.edge.level=otsuu"]) == 2
    assert capsys.readouterr().err.endswith("(--set combine.edge.level=otsuu)\n")


def test_an_own_detector_is_tried_where_there_is_one_to_replace(case_file, tmp_path):
    """In every machine that has an edge detector; a case without one, or without the machine, is left out."""
    (tmp_path / "mine.py").write_text("class Edge: pass", encoding="utf-8")
    folder = tmp_path / "cases"
    folder.mkdir()
    text = case_file.read_text(encoding="utf-8").partition("scenario: ")[0]
    for name, scenario in (("one", "straight"), ("two", "two-combines"), ("none", "record-run")):
        (folder / f"{name}.yaml").write_text(f"{text}scenario: {scenario}\nexpect: {{}}\n", encoding="utf-8")
    own = read_candidates(tmp_path / "mine.py:Edge")
    assert list(own) == ["shipped", "Edge"]
    plan = Plan(str(folder), candidates=own, seeds=1)
    given = {run.case: run.sets for run in plan.runs() if run.candidate == "Edge"}
    keys = {name: [t.partition("=")[0] for t in sets if "edge.level" in t] for name, sets in given.items()}
    assert keys == {"two": ["west.edge.level", "east.edge.level"], "one": ["combine.edge.level"]}
    assert plan.left_out == {"none": "no parts of kind edge that could be replaced"}
    assert set(Plan(str(folder), candidates=own, seeds=1, shadow=True).left_out) == {"none", "two"}
    named = Plan(str(folder), candidates={"a": ("combine.edge.level=otsu",)}, seeds=1)
    assert named.left_out == {"two": "no machine combine"}
    with pytest.raises(InputError, match="combin: "):
        Plan(str(folder), candidates={"a": ("combin.edge.level=otsu",)}).check()


def test_candidates_are_ranked_by_what_passes_and_then_by_their_error(case_file):
    """Two that pass alike, one of which is 2 cm worse in every pair, and one that fails half of the runs."""
    cells = []
    for name, worse, fails in (("far", 0.02, 0), ("near", 0.0, 0), ("bad", 0.0, 5)):
        cell = Cell(Plan(str(case_file)).found[0], name, 10, measured=Measured())
        for seed in range(10):
            metrics = {"edge_rmse_m": 0.01 + 0.001 * seed + worse, "sure_wrong_share": 0.1 * (seed < fails)}
            verdict = "fail" if seed < fails else "pass"
            cell.add({"id": f"{seed}", "point": {}, "seed": seed, "expect": [], "metrics": metrics,
                      "verdict": verdict, "reason": "x: y" * (seed < fails), "edge_us": 80.0})  # fmt: skip
        cells.append(cell)
    rows = ranking(cells)
    assert [row[1] for row in rows] == ["near", "far", "bad"]
    assert [row[2] for row in rows] == ["10 of 10", "10 of 10", "5 of 10"]
    assert rows[0][3] == "0.0145 m (0.0123 to 0.0167)"
    beside = "10 pairs cannot exclude harm in 30 % of runs, worst tenth -0.02 m"
    assert rows[0][5] == f"-0.02 m (-0.02 to -0.02); {beside}"
    assert rows[1][5] == ""
    assert rows[2][7:] == ["5 %", "5 of 10", "80 us"]
    assert all(len(row) == len(HEAD) for row in rows)
    head, tagged = by_tag(cells)
    assert head[1:] == ["far", "near", "bad"]
    assert all(row[1:] == ["10 of 10", "10 of 10", "5 of 10"] for row in tagged)


def test_a_run_that_kills_its_worker_is_named_and_costs_no_other(case_file, tmp_path, monkeypatch):
    runs = list(Plan(str(case_file), seeds=6).runs())
    monkeypatch.setenv("FAKE_WORK_KILLS", runs[3].id)
    done = []
    run_all(runs, tmp_path / "journal", 2, done.append, work=fake_works)
    assert sorted(r["id"] for r in done) == sorted(r.id for r in runs)
    (error,) = [r for r in done if r["verdict"] == "error"]
    assert error["id"] == runs[3].id
    assert "ended its process 2 times" in error["reason"]
    assert finished(tmp_path / "journal") == {r.id for r in runs}


def test_the_table_has_the_same_bytes_however_the_work_was_split(tmp_path):
    rows = results([(0.5, 5), (2.0, 8), (0.7, 5)])
    written = []
    for number, order in enumerate(([0, 1, 2], [2, 0, 1])):
        folder = tmp_path / str(number)
        for place, index in enumerate(order):
            journal = Journal(folder / "journal", f"w{place % (number + 1)}")
            journal.add({**rows[index], "cpu_s": float(place)})
            journal.close()
        with (folder / "journal" / "w0.jsonl").open("ab") as file:
            file.write(b'{"id": "torn')  # by a kill
        found = results_of(folder / "journal", [row["id"] for row in rows])
        written.append(write_table(folder, found).read_bytes())
        journal = Journal(folder / "journal", "w0")
        journal.add({**rows[0], "id": "f" * 16})
        journal.close()
        assert "f" * 16 in finished(folder / "journal")  # not glued to the torn line
    assert written[0] == written[1]
    table = pq.read_table(tmp_path / "0" / "results.parquet")
    assert table.column("metric.distance_m").to_pylist() == [0.5, 2.0, 0.7]


def test_known_failures_do_not_count_and_are_told_when_they_pass(case_file):
    case_file.write_text(CASE + "known: [{why: too fast, at: {speed_kmh: 8}}]\n", encoding="utf-8")
    case = read_case(case_file)
    cells = cells_of([case], ["base"], {"drives": 4}, results([(0.5, 5), (2.0, 8), (0.3, 8), (2.0, 5)]))
    (cell,) = cells
    assert [run.margin for run in cell.surprises.runs] == [pytest.approx(0.7)]
    assert [run.point["speed_kmh"] for run in cell.failed.runs] == [5]
    assert cell.text.startswith("1 of 2 passed")
    assert cell.text.endswith("; 2 of 4 runs lie where a failure is known")
    (cell,) = cells_of([case], ["base"], {"drives": 1}, results([(2.0, 8)]))
    assert (cell.text, cell.verdict) == ("1 of 1 runs lie where a failure is known", "not shown")
    known = results([(2.0, 8)], limit={"max": 1.0})
    (cell,) = cells_of([case], ["base"], {"drives": 1}, known)
    page = write_matrix(case_file.parent / "report.html", [cell]).read_text(encoding="utf-8")
    assert "Known failures" in page
    assert "too fast" in page


def test_a_failure_is_known_over_a_range_with_its_ends(case_file):
    case_file.write_text(CASE + "known: [{why: too fast, at: {speed_kmh: [7, 9]}}]\n", encoding="utf-8")
    case = read_case(case_file)
    points = [{"speed_kmh": speed} for speed in (6.9, 7, 8.2, 9, 9.1)]
    assert [case.known(point) for point in points] == ["", "too fast", "too fast", "too fast", ""]


def test_stored_results_are_judged_against_new_limits(case_file):
    result = results([(0.5, 5)], limit={"max": 1.0})[0]
    case_file.write_text(CASE.replace("{distance_m: {min: 6}}", "{distance_m: {max: 0.4}}"), encoding="utf-8")
    again = PresentLimits(read_case(case_file)).judge(result)
    assert (again["verdict"], again["expect"][0]["limit"]) == ("fail", {"max": 0.4})
    assert "0.5 is more than 0.4" in again["reason"]
    assert margin(result) == pytest.approx(0.5)
    none = {
        "subject": "combine",
        "name": "rollover_count",
        "limit": {"max": 0.0},
        "value": 0.0,
        "result": "pass",
    }
    assert margin({**result, "expect": [*result["expect"], none]}) == pytest.approx(0.5)
    none = {**none, "value": 1.0, "result": "fail"}
    assert margin({**result, "expect": [*result["expect"], none]}) == -1.0
    assert margin(again) == pytest.approx(-0.25)


def test_means_are_shown_broken_or_neither(case_file):
    for bound, expected in ((1.0, SHOWN), (0.1, BROKEN), (0.505, NOT_SHOWN)):
        case_file.write_text(CASE + f"mean: {{distance_m: {{max: {bound}}}}}\n", encoding="utf-8")
        runs = results([(0.4 + 0.002 * i, 5) for i in range(100)])
        (cell,) = cells_of([read_case(case_file)], ["base"], {"drives": 100}, runs)
        assert cell.verdict == expected, bound
        assert cell.means[0].startswith("distance_m: mean 0.499")


def test_runs_are_done_gone_on_with_and_made_again(case_file, tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["test", "run", str(case_file), "--out", str(out), "--seeds", "1", "--draw", "1", "--workers", "1"]
    assert main(argv) == 3  # a run passes, which shows little
    text = capsys.readouterr().out
    assert "1 of 1 passed, shows >= 5 %; 59 without a failure are needed for 95 %" in text
    table = (out / "results.parquet").read_bytes()
    lines = sum(p.read_bytes().count(b"\n") for p in (out / "journal").glob("*.jsonl"))
    assert main(argv) == 3  # nothing is left to do
    assert (out / "results.parquet").read_bytes() == table
    assert sum(p.read_bytes().count(b"\n") for p in (out / "journal").glob("*.jsonl")) == lines == 1
    assert len(ET.parse(out / "junit.xml").findall(".//testcase")) == 2
    assert main([*argv[:5], "--seeds", "2"]) == 2
    assert "another plan (seeds 1, now 2; drawn 1, now 0)" in capsys.readouterr().err
    name = pq.read_table(out / "results.parquet").column("id").to_pylist()[0]
    assert main(["test", "again", str(out), name[:6]]) == 0
    assert "the same digest as in the test" in capsys.readouterr().out
    assert (out / "kept" / name / "report.html").is_file()


def test_shares_of_a_plan_come_to_the_whole(case_file, tmp_path, monkeypatch):
    session = begin(tmp_path / "out", Plan(str(case_file), seeds=3))
    monkeypatch.setattr("swath.tools.function_test.session.results_in", fake_works)
    for share in (1, 2, 3):
        open_session(tmp_path / "out").do_share(share, 3, lambda result: None)
    assert list(session.left()) == []
    assert [r["id"] for r in session.results()] == [r.id for r in session.plan.runs()]
    data = json.loads((tmp_path / "out" / "plan.json").read_text(encoding="utf-8"))
    with pytest.raises(InputError, match="this version of swath"):
        plan_of({**data, "code": "other"})


@pytest.mark.drawn
def test_the_page_and_the_junit_file_name_what_failed(case_file, tmp_path):
    runs = results([(0.5, 5), (2.0, 8)])
    runs[1]["reason"] = "combine.distance_m: 2 is more than <1>"
    cells = cells_of([read_case(case_file)], ["base"], {"drives": 2}, runs)
    page = write_matrix(tmp_path / "report.html", cells).read_text(encoding="utf-8")
    assert page.count("<circle") == 4  # two runs, in the matrix and over the speed
    assert "2 is more than &lt;1&gt;" in page
    assert os.path.getsize(write_junit(tmp_path / "junit.xml", cells)) > 100
    (failure,) = ET.parse(tmp_path / "junit.xml").findall(".//failure")
    assert failure.get("message") == "combine.distance_m: 2 is more than <1>"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("", ""),
        ("field.stand.stems_per_m2=60", "the level was checked for stems_per_m2 120 to 600 only"),
        ("field.stand.wind={speed_m_s: 4}", "the level was checked for wind_lean_deg 0 only"),
        ("field.stand={level: uniform, crop: maize}", "there is no table of maize"),
        ("field.stand.lean_deg=30", "the level was checked for lean_deg 0 to 20 only"),
        ("expect={edge_rmse_m: {max: 0.05}}", "its bias is that large"),
        ("expect={edge_rmse_m: {max: 0.08}}", ""),
    ],
)
def test_the_cheap_level_is_left_where_it_cannot_carry_a_limit(case_file, change, why):
    plan = Plan(str(case_file), sets=(change,) if change else ())
    for run in plan.runs():
        assert why in run.why_dear
        assert bool(why) == bool(run.why_dear)
        scenario = scenario_of(run)
        assert scenario.machines["combine"].slots["lidar"].level == ("plants" if why else "empirical")


def test_a_level_for_all_is_taken_where_it_can_be(tmp_path, case_file):
    text = case_file.read_text(encoding="utf-8").replace(", combine.lidar.level: empirical", "")
    case_file.write_text(text, encoding="utf-8")
    levels = {
        wanted: {scenario_of(run).machines["combine"].slots["lidar"].level
                 for run in Plan(str(case_file), level=wanted).runs()}
        for wanted in ("", "plants", "empirical")
    }  # fmt: skip
    assert levels == {"": {"plants"}, "plants": {"plants"}, "empirical": {"empirical"}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("field.stand={level: uniform, crop: maize}", ["driven at plants", "there is no table of maize"]),
        ("combine.lidar=off", ["driven at no scanner"]),
        ("run.distance_m=20", []),
    ],
)
def test_a_level_that_is_not_the_one_asked_for_is_told(case_file, tmp_path, change, said):
    sets = (change, "combine.edge.level=truth") if "off" in change else (change,)
    plan = Plan(str(case_file), level="empirical", sets=sets)
    session, count = Session(tmp_path / "out", plan), len(list(plan.runs()))
    lines = session.level_lines()
    assert [text in line for text, line in zip(said, lines, strict=True)] == [True] * len(said)
    if said:
        assert lines[0].startswith(f"--level empirical: {count} of {count} runs")
    if len(said) > 1:
        assert f": {count} runs at plants: " in lines[1]


def test_each_run_that_is_not_judged_is_counted_by_its_own_reason():
    made = [("not judged", "not judged: combine.lidar beyond"), ("not judged", "combine.edge_rmse_m: "),
            ("not judged", "combine.edge_rmse_m: "), ("open", ""), ("error", "crashed")]  # fmt: skip
    lines = unjudged_lines({"verdict": verdict, "reason": reason} for verdict, reason in made)
    assert lines == [
        "1 runs not judged: a level was outside the range in which it was checked",
        "2 runs not judged: a limit was not measured",
        "1 runs not judged: no limit is on what it did",
    ]
