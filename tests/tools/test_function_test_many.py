"""A function test of very many runs: what is kept of them, and that nothing is left out of the verdict."""

import hashlib
import json
import shutil
import tracemalloc
from dataclasses import asdict
from math import fsum

import pyarrow.parquet as pq
import pytest

from swath.commands.main import main
from swath.tools.function_test.case import read_case
from swath.tools.function_test.cells import DRAWN_MAX, POINTS_MAX, cells_of
from swath.tools.function_test.journal import Journal
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin

pytestmark = pytest.mark.usefixtures("code_allowed")

CASE = """
format: swath test case 1
objective: drives
source: made
scenario: straight
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 6, 7, 8, 9], range: [4, 12]}
  side: {key: combine.edge_side, at: [left, right]}
seeds: 3
tags: [steering]
expect: {lateral_p95_m: {max: 0.1}}
mean: {lateral_p95_m: {max: 0.2}}
"""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "drives.yaml"
    path.write_text(CASE, encoding="utf-8")
    return read_case(path)


def result(number, value, point):
    entry = {"subject": "combine", "name": "lateral_p95_m", "limit": {"max": 0.1}, "value": value}
    verdict, reason = (
        ("fail", f"combine.lateral_p95_m: {value:g} is more than 0.1") if value > 0.1 else ("pass", "")
    )
    return {
        "id": hashlib.sha256(str(number).encode()).hexdigest()[:16], "case": "drives", "candidate": "base",
        "point": point, "seed": number, "verdict": verdict, "reason": reason, "digest": "", "incidents": [],
        "metrics": {"lateral_p95_m": value}, "expect": [{**entry, "result": verdict}],
        "steering": {"classes": [[number % 3, 1]], "squares": 1e-4},
    }  # fmt: skip


def made(count):
    """Every 500th run fails, each by another amount; the worst is the last of them but one."""
    for number in range(count):
        value = 0.05 if number % 500 else 0.15 + 1e-6 * (number if number < count - 600 else count - number)
        speed = 4.0 + 8.0 * (number * 7919 % count) / count
        yield result(number, value, {"speed_kmh": speed, "side": "left" if number % 2 else "right"})


def test_a_cell_counts_all_runs_and_keeps_the_worst_and_a_sample(case):
    (cell,) = cells_of([case], ["base"], {"drives": 20_000}, made(20_000))
    assert (cell.count, cell.passed, cell.failed.count) == (20_000, 19_960, 40)
    assert cell.worst.seed == 19_000
    margins = [run.margin for run in cell.failed.runs]
    assert margins == sorted(margins)
    assert len(margins) == 40
    assert 0.8 * DRAWN_MAX < len(cell.drawn.runs) < 1.2 * DRAWN_MAX
    assert {run.point["side"] for run in cell.drawn.runs} == {"left", "right"}
    mean = fsum(r["metrics"]["lateral_p95_m"] for r in made(20_000)) / 20_000
    assert cell.means[0].startswith(f"lateral_p95_m: mean {mean:.4g} (")
    (group,) = cell.groups.values()
    assert group.text.endswith("; side right")
    assert len(cell.steering) == 1
    assert next(iter(cell.steering.values()))[0] == 20_000 > POINTS_MAX


def test_what_is_kept_does_not_grow_with_the_runs(case):
    peaks = []
    for count in (2_000, 16_000):
        tracemalloc.start()
        cells_of([case], ["base"], {"drives": count}, made(count))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0]


@pytest.mark.parametrize("drawn", [0, 4])
def test_the_runs_of_a_plan_are_read_back_as_they_were_planned(case, tmp_path, drawn):
    for shadow in (False, True):
        candidates = {"base": (), "otsu": ("combine.edge.level=otsu",)}
        plan = Plan(str(tmp_path / "drives.yaml"), drawn=drawn, candidates=candidates, shadow=shadow)
        runs = list(plan.runs())
        assert len(runs) == plan.counts["drives"] * len(plan.steering)
        session = begin(tmp_path / f"{drawn} {shadow}", plan)
        (tmp_path / "drives.yaml").write_text("not read", encoding="utf-8")
        assert [asdict(run) for run in session.runs()] == json.loads(json.dumps([asdict(r) for r in runs]))
        (tmp_path / "drives.yaml").write_text(CASE, encoding="utf-8")


def test_the_table_is_in_the_order_of_the_plan(case, tmp_path):
    session = begin(tmp_path / "out", Plan(str(tmp_path / "drives.yaml")))
    journal = Journal(session.journals, "made")
    runs = list(session.plan.runs())
    for number, run in enumerate(runs[:-1]):
        journal.add({**result(number, 0.01 * number, {}), "id": run.id})
    journal.close()
    rows = pq.read_table(session.table()).to_pylist()
    assert [row["id"] for row in rows] == [run.id for run in runs[:-1]]
    assert [json.loads(row["point"]) for row in rows] == [run.point for run in runs[:-1]]
    assert [round(100 * row["metric.lateral_p95_m"]) for row in rows] == list(range(len(runs) - 1))


def test_other_limits_judge_what_is_stored(case, tmp_path, capsys):
    """The limits belong to the names of the runs, and yet a report with new ones finds them."""
    out, file = tmp_path / "out", tmp_path / "drives.yaml"
    session = begin(out, Plan(str(file)))
    journal = Journal(session.journals, "made")
    for run in session.plan.runs():
        journal.add({**result(run.seed, 0.05, dict(run.point)), "id": run.id})
    journal.close()
    assert main(["test", "report", str(out)]) == 3
    assert "30 of 30 passed" in capsys.readouterr().out
    file.write_text(CASE.replace("{max: 0.1}", "{max: 0.04}"), encoding="utf-8")
    assert main(["test", "report", str(out)]) == 1
    said = capsys.readouterr().out
    assert "0 of 30 passed, shows <= 9.5 %; 95 % is asked" in said
    assert f"swath test again {out} " in said
    assert sum(1 for _ in begin(out, Plan(str(file))).left()) == 30  # done again by `run`, in the same folder


def test_files_of_a_case_are_beside_it(case, tmp_path, monkeypatch):
    """As those of candidates: whatever folder the command is given in."""
    folder = tmp_path / "mine"
    folder.mkdir()
    shutil.copy("examples/my_evaluator.py", folder)
    added = "set: {evaluators: [my_evaluator.py:SteeringReversals]}\n"
    (folder / "drives.yaml").write_text(CASE + added, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    plan = Plan(str(folder / "drives.yaml"))
    plan.check()
    before = [run.id for run in plan.runs()]
    monkeypatch.chdir(folder)
    assert before == [run.id for run in Plan(str(folder / "drives.yaml")).runs()]
    with (folder / "my_evaluator.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    assert not set(before) & {run.id for run in Plan(str(folder / "drives.yaml")).runs()}
