"""What the first runs show to tell nothing: on drawn results, and in every tool that does runs in batches."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swath.commands.main import main
from swath.tools.function_test import cheaper
from swath.tools.function_test.field_plan.page import write_plan
from swath.tools.function_test.field_plan.plan import FieldPlan, plan_field
from swath.tools.function_test.judging import first_batch
from swath.tools.function_test.judging.first_batch import telling_nothing
from swath.tools.function_test.judging.margin import MARGIN
from swath.tools.function_test.one_run import no_result
from swath.tools.tune.tune import Tune, run_tune
from tests.tools.fake_work import here
from tests.tools.odd_files import result_of as odd_result
from tests.tools.odd_files import write_odd

TOOLS = Path(first_batch.__file__).parents[2]
ENGINES = {"function_test/session.py", "function_test/one_run.py", "function_test/pool.py"}
NO_LIMITS = {"twin/bank.py"}  # its runs are judged by nothing
CASE = """
format: swath test case 1
objective: keeps a limit
source: made
scenario: straight
set: {run.distance_m: 12, combine.edge: {level: truth}, combine.lidar.level: empirical}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [4, 5, 6, 7, 8, 9], range: [4, 9]}
  stems: {key: field.stand.stems_per_m2, at: [300, 400], range: [200, 600]}
seeds: 3
expect: {distance_m: {min: 25}, lateral_rms_m: {max: 0.5}}
"""


def entry(name, limit, value, result):
    reason = {} if result == "pass" else {"reason": "made"}
    return {"subject": "combine", "name": name, "limit": limit, "value": value, "result": result, **reason}


def too_short(run, *, is_always=True, acts=True):
    """A run that is shorter than its limit, in each run or by chance; its line changes with its settings."""
    sets = [text for text in run.sets if acts or ".steer." not in text]
    rng = np.random.default_rng([run.seed, *"".join(sets).encode()])
    rms, distance = 0.1 + 0.01 * rng.random(), 20.0 if is_always or rng.random() < 0.5 else 30.0
    verdict = "fail" if distance < 25.0 else "pass"
    entries = [
        entry("distance_m", {"min": 25}, distance, verdict),
        entry("lateral_rms_m", {"max": 0.5}, rms, "pass"),
    ]
    return {**no_result(run, ""), "verdict": verdict, "reason": "distance_m: made" * (verdict == "fail"),
            "expect": entries, "metrics": {"distance_m": distance, "lateral_rms_m": rms},
            "digest": f"{rms}"}  # fmt: skip


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "made.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


def ignore(result):
    """For each new result."""


TUNE = ["--aim", "lateral_rms_m", "--tries", "10", "--each", "3", "--proof", "10"]
TWO_SLOTS = ["--param", "combine.steer.lookahead_m=2..8", "--param", "combine.lidar.rate_hz=5..25"]
DRIVEN = {  # by module that does runs in batches: the command, before its folder
    "tune/tune.py": ["tune", "CASE", *TWO_SLOTS, *TUNE],
    "function_test/search/search.py": ["test", "search", "CASE", "--budget", "24"],
    "function_test/estimate/estimate.py": ["test", "estimate", "CASE", "--budget", "120"],
    "function_test/odd/campaign.py": ["test", "run", "--odd", "ODD", "--runs", "110"],
    "function_test/field_plan/plan.py": ["test", "plan-field", "CASE", "--pairs", "12", "--runs", "2"],
    "function_test/command.py": ["test", "run", "CASE"],
    "function_test/cheaper.py": ["test", "levels", "CASE"],
}


def drive(tool, case, out):
    """The command of a tool, in a folder where it has one."""
    folder = [] if "cheaper" in tool else ["--out", str(out), "--workers", "1"]
    paths = {"CASE": str(case), "ODD": str(write_odd(out.parent / "odd")) if "odd" in tool else ""}
    assert main([paths.get(word, word) for word in DRIVEN[tool]] + folder) in (0, 1, 3, 4)


def does_runs(module):
    """Whether a module asks for runs: of a session, or at once."""
    calls = [
        node.func for node in ast.walk(ast.parse(module.read_text("utf-8"))) if isinstance(node, ast.Call)
    ]
    is_of_session = any(
        isinstance(call, ast.Attribute)
        and (call.attr == "made" or (call.attr == "do" and ast.unparse(call.value) == "session"))
        for call in calls
    )
    return is_of_session or any(isinstance(call, ast.Name) and call.id == "results_in" for call in calls)


def test_every_tool_that_does_runs_in_batches_is_driven_here():
    found = {path.relative_to(TOOLS).as_posix() for path in TOOLS.rglob("*.py") if does_runs(path)}
    assert found - ENGINES - NO_LIMITS == set(DRIVEN)


@pytest.fixture
def told(monkeypatch):
    """Runs are made by `too_short`; each line with how many runs there were before it."""
    lines, count, how = [], [0], {}

    def work(run):
        count[0] += 1
        if run.met:
            return {**odd_result(run, True), "expect": [entry("distance_m", {"min": 11.5}, 10.0, "fail")]}
        return too_short(run, **how)

    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(work))
    monkeypatch.setattr(cheaper, "results_in", lambda runs, fields: [work(run) for run in runs])
    monkeypatch.setattr(cheaper, "_changes", lambda run: iter(["combine.motion.level=kinematic"] * 5))
    monkeypatch.setattr(first_batch, "print", lambda line: lines.append((count[0], line)), raising=False)
    return lines, count, how


@pytest.mark.parametrize("tool", DRIVEN)
def test_a_limit_that_every_run_breaks_is_named_before_more_is_spent(tool, case_file, told, tmp_path):
    lines, count, _ = told
    drive(tool, case_file, tmp_path / "out")
    (at, line), *more = [(at, line) for at, line in lines if "combine.distance_m (min" in line]
    counted = at - ("cheaper" in tool)  # which does the first run twice, so that all have what it loads
    limit = f"combine.distance_m (min {'11.5' if 'odd' in tool else '25'})"
    assert line == f"note    all {counted} runs break {limit}"
    assert not more
    assert 0 < at <= count[0] / 2
    pages = [path.read_text("utf-8") for path in (tmp_path / "out").glob("*.html")]
    assert any(f"The first runs: {line.removeprefix('note    ')}" in page for page in pages) == (
        "cheaper" not in tool
    )


@pytest.mark.parametrize("tool", [tool for tool in DRIVEN if "odd" not in tool])
def test_what_some_runs_break_is_not_named(tool, case_file, told, tmp_path):
    lines, _, how = told
    how["is_always"] = False
    drive(tool, case_file, tmp_path / "out")
    assert not [line for _, line in lines if "runs break" in line]


def test_a_slot_that_never_acts_is_named_beside_one_that_does(case_file, told, tmp_path):
    """In 3 runs of it alone, after 3 as shipped and 12 of the first four settings; and on the page."""
    lines, count, how = told
    how.update(acts=False, is_always=False)
    params = ("combine.steer.lookahead_m=2..8", "combine.lidar.rate_hz=5..25")
    asked = Tune((str(case_file),), params, ("lateral_rms_m",), tries=10, each=3, proof=10)
    found = run_tune(tmp_path / "two", asked, 1, ignore)
    assert [at for at, line in lines if "combine.steer changes none of 3 runs" in line] == [21]
    assert not [line for _, line in lines if "combine.lidar changes" in line]
    assert len(found.telling_nothing) == 1
    del lines[:]
    count[0] = 0
    asked = replace(asked, params=params[:1])
    alone = run_tune(tmp_path / "one", asked, 1, ignore)
    assert len(alone.telling_nothing) == 2
    assert [at for at, line in lines if "combine.steer changes none of 12 runs" in line] == [15]
    assert [at for at, line in lines if "lateral_rms_m is changed by none of 5 candidates in 15" in line] == [
        15
    ]


def test_no_share_of_a_doubt_is_told_where_levels_differ_nowhere(case_file, told, tmp_path, capsys):
    """Both levels break one limit in a shortened way, by as much: that is the margin of both."""
    out = tmp_path / "out"
    line = ["test", "plan-field", str(case_file), "--pairs", "12", "--runs", "3", "--out", str(out)]
    assert main(line) == 0
    printed = capsys.readouterr().out
    assert "no doubt to share: margin is the same in 12 of 12 pairs" in printed
    assert "both levels break combine.distance_m in 12 of 12 pairs" in told[0][-1][1]
    for text in (printed, (out / "report.html").read_text("utf-8"), (out / "passes.csv").read_text("utf-8")):
        assert "of the doubt" not in text
        assert " 44" not in text
    _, _, how = told
    how["is_always"] = False
    found = plan_field(tmp_path / "b", FieldPlan(str(case_file), pairs=12, runs=3), 1, ignore)
    assert not found.doubts_nothing
    assert "of the doubt" in write_plan(found).read_text("utf-8")


def drawn(rng):
    """Results, and what must be named of them: over cases, candidates, limits, metrics, bytes."""
    cases, places = [f"case{n}" for n in range(rng.integers(1, 4))], int(rng.integers(1, 4))
    names = ["base", *(f"c{n}" for n in range(rng.integers(0, 3)))]
    how = {
        f"limit{n}": str(rng.choice(["fail", "pass", "mixed", "not measured", "one case"])) for n in range(4)
    }
    metric = {f"m{n}": str(rng.choice(["constant", "missing", "varies", "by place"])) for n in range(4)}
    acts = {name: bool(rng.random() < 0.5) for name in names[1:]}
    results = []
    for case in cases:
        for place in range(places):
            for name in names:
                number = len(results)
                outcome = {
                    limit: {"mixed": "pass" if number % 2 else "fail",
                            "one case": "fail" if case == cases[0] else "pass"}.get(said, said)
                    for limit, said in how.items()
                }  # fmt: skip
                values = {"constant": 3.5, "missing": None, "varies": number, "by place": (case + str(place))}
                metrics = {m: hash(values[k]) if k == "by place" else values[k] for m, k in metric.items()}
                changed = acts.get(name, False) and place == 0
                results.append({
                    "case": case, "candidate": name, "seed": place, "point": {"x": place}, "verdict": "fail",
                    "expect": [entry(limit, {"max": 1}, 2.0, said) for limit, said in outcome.items()],
                    "metrics": metrics, "digest": f"{case} {place} {name * changed}",
                })  # fmt: skip
    return results, names, acts


@pytest.mark.parametrize("seed", range(40))
def test_what_is_named_is_what_is_alike_in_all_runs(seed):
    """Held against a count by hand: of limits over all runs, else in a case; of metrics; of candidates."""
    results, names, acts = drawn(np.random.default_rng(seed))
    found = telling_nothing(results, [f"m{n}" for n in range(4)], {name: [name] for name in names})
    alike = set()
    for limit in {e["name"] for r in results for e in r["expect"]}:
        of = {r["case"]: [] for r in results}
        for r in results:
            of[r["case"]] += [e["result"] for e in r["expect"] if e["name"] == limit]
        whole = [said for some in of.values() for said in some]
        groups = {"": whole} if len(set(whole)) == 1 else {f" of {case}": some for case, some in of.items()}
        alike |= {f"combine.{limit} (max 1){case}" for case, some in groups.items()
                  if len(some) > 1 and len(set(some)) == 1 and some[0] != "pass"}  # fmt: skip
    for metric in [f"m{n}" for n in range(4)] if len(results) > 1 else []:
        values = [r["metrics"][metric] for r in results]
        places = {}
        for r in results:
            places.setdefault((r["case"], r["seed"]), set()).add(r["metrics"][metric])
        if len(set(values)) == 1 or (len(names) > 1 and all(len(some) == 1 for some in places.values())):
            alike.add(metric)
    alike |= {name for name, is_acting in acts.items() if not is_acting}
    assert set(found) == alike


def test_errors_and_single_runs_say_nothing():
    rng = np.random.default_rng(3)
    results, names, _ = drawn(rng)
    errors = [{**result, "verdict": "error"} for result in results]
    assert telling_nothing(errors, [MARGIN], {name: [name] for name in names}) == {}
    assert telling_nothing(results[:1], [MARGIN]) == {}
    assert telling_nothing([], [MARGIN], {"a": ["a"]}) == {}
