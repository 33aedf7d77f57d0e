"""No sequence of `test run`, edit, `report`, `compare` and `again` loses a stored run."""

import json
import random
import re
import shutil

import pyarrow.parquet as pq
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.foreign_code import Gate, load_python, through
from swath.tools.function_test.command import finish
from swath.tools.function_test.compare import compare
from swath.tools.function_test.journal import Journal
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin, check_version, open_session, own_code
from tests.tools.fake_work import fake_work, fake_works

CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set: {run.distance_m: 6, combine.edge.level: my.py:Mine}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8]}
seeds: 2
expect: {distance_m: {min: 6}}
"""
DETECTOR = """
from swath.control.edge.otsu import Otsu


class Mine(Otsu):
    \"\"\"Version %d.\"\"\"
"""


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A case with a detector of one's own, and a way to do some of its runs."""
    (tmp_path / "case.yaml").write_text(CASE, encoding="utf-8")
    (tmp_path / "my.py").write_text(DETECTOR % 0, encoding="utf-8")
    monkeypatch.setattr("swath.tools.function_test.session.results_in", fake_works)
    return tmp_path


def do(folder, out="out", most=99):
    """`swath test run CASE --allow-code --out OUT`, stopped after some runs."""
    with through(Gate(None)):
        session = begin(folder / out, Plan(str(folder / "case.yaml")))
        journal = Journal(session.journals, "made")
        for run in list(session.left())[:most]:
            journal.add(fake_work(run, None))
        journal.close()
        return finish(folder / out, session, again=False) if most > 9 else None


def rows(out):
    return {row["id"] for row in pq.read_table(out / "results.parquet").to_pylist()}


def every_row(out):
    """Runs in the tables of a folder and of what was put aside in it."""
    return set().union(*(rows(table.parent) for table in out.rglob("results.parquet")))


def every_line(out):
    return {json.loads(line)["id"] for file in out.rglob("*.jsonl") for line in file.read_text().splitlines()}


@pytest.mark.parametrize("seed", range(4))
def test_no_sequence_loses_a_stored_run(made, seed, capsys):
    draw, out, version = random.Random(seed), made / "out", 0
    do(made)
    shutil.copytree(out, made / "first")
    told, written = every_row(out), every_line(out)
    for _ in range(8):
        step = draw.choice(["run", "stopped run", "edit", "edit", "beside", "report", "compare", "case"])
        if step in ("run", "stopped run"):
            do(made, most=99 if step == "run" else 1)
        elif step == "edit":
            version = draw.choice([0, 1, 2])
            (made / "my.py").write_text(DETECTOR % version, encoding="utf-8")
        elif step == "beside":
            (made / "unrelated.py").write_text(f"A = {draw.random()}\n", encoding="utf-8")
        elif step == "case":
            text = CASE.replace("min: 6}", f"min: {draw.choice([5, 6])}}}")
            (made / "case.yaml").write_text(text, encoding="utf-8")
        elif step == "report":
            before = out.is_dir() and (out / "results.parquet").is_file() and rows(out)
            assert main(["test", "report", str(out)]) in (0, 1, 3)
            assert not before or before <= rows(out)
        elif (out / "results.parquet").is_file():
            assert main(["test", "compare", str(made / "first"), str(out)]) == 0
        assert told <= every_row(out), step
        assert written <= every_line(out), step
        told, written = every_row(out), every_line(out)
    for folder in out.glob("earlier/*"):
        if (folder / "results.parquet").is_file():
            kept = rows(folder)
            assert main(["test", "report", str(folder)]) in (0, 1, 3)
            assert rows(folder) == kept


def test_an_edited_detector_is_told_and_its_runs_are_judged_again(made, capsys):
    do(made)
    kept = rows(made / "out")
    (made / "my.py").write_text(DETECTOR % 1, encoding="utf-8")
    capsys.readouterr()
    assert main(["test", "report", str(made / "out")]) == 3  # without --allow-code
    said = capsys.readouterr().out
    assert "made by another version of my.py" in said
    assert "4 of 4 passed" in said
    assert rows(made / "out") == kept
    (made / "my.py").unlink()
    assert main(["test", "report", str(made / "out")]) == 3
    assert rows(made / "out") == kept
    (made / "case.yaml").unlink()
    assert main(["test", "report", str(made / "out")]) == 2
    assert rows(made / "out") == kept


def test_a_repeated_run_after_an_edit_keeps_the_runs_before_to_compare_with(made, capsys):
    do(made)
    before = rows(made / "out")
    (made / "my.py").write_text(DETECTOR % 1, encoding="utf-8")
    do(made)
    aside = made / "out" / "earlier" / "1"
    assert f"are kept in {aside}" in capsys.readouterr().out
    assert rows(aside) == before
    assert not rows(made / "out") & before
    assert main(["test", "compare", str(aside), str(made / "out")]) == 0
    assert "4 of 4 pairs are the same bytes" in capsys.readouterr().out


def test_the_same_runs_whether_code_may_run_or_not(made):
    do(made)
    with through(Gate()):
        names = [run.id for run in Plan(str(made / "case.yaml")).runs()]
    assert names == [run.id for run in open_session(made / "out").runs()]


def test_a_run_in_which_a_file_was_edited_is_not_stored(made, capsys):
    with through(Gate(None)):
        session = begin(made / "out", Plan(str(made / "case.yaml")))
    journal = Journal(session.journals, "made")
    first, second, *_ = session.left()
    assert journal.add(fake_work(first, None))["verdict"] == "pass"
    (made / "my.py").write_text(DETECTOR % 1, encoding="utf-8")
    changed = journal.add(fake_work(second, None))
    journal.close()
    assert (changed["verdict"], changed["reason"]) == ("changed", "my.py (changed)")
    assert every_line(made / "out") == {first.id}
    with through(Gate(None)):
        check_version(made / "out")
    assert "go on with the copy of my.py (changed)" in capsys.readouterr().out
    named = Gate(frozenset({(made / "my.py").resolve()}))  # the copy may be somebody else's
    with through(named), pytest.raises(InputError, match=r"my\.py \(changed\); copies .* --allow-code"):
        check_version(made / "out")


def test_a_folder_of_the_version_before_is_read_by_what_its_runs_are(made, capsys):
    """It holds no file of planned runs, and its runs are called otherwise."""
    do(made)
    file = next((made / "out" / "journal").glob("*.jsonl"))
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for number, line in enumerate(lines):
        line["id"] = f"{number:016x}"
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    (made / "out" / "journal" / "runs.parquet").unlink()
    assert main(["test", "report", str(made / "out")]) == 3
    assert "4 of 4 passed" in capsys.readouterr().out
    assert rows(made / "out") == {f"{number:016x}" for number in range(4)}


def test_a_table_is_never_replaced_by_a_shorter_one(made, capsys):
    do(made)
    kept = rows(made / "out")
    for file in (made / "out" / "journal").glob("*.jsonl"):
        file.unlink()
    assert main(["test", "report", str(made / "out")]) == 2
    assert "expected 4 runs, as it holds" in capsys.readouterr().err
    assert rows(made / "out") == kept


def test_a_campaign_goes_on_with_the_code_that_it_began_with(made, capsys):
    """A file beside it is none of its own; one of its own that is edited or gone is read from the copy."""
    edits = iter([
        lambda: (made / "notes.py").write_text("A = 1\n"),
        lambda: (made / "my.py").write_text(DETECTOR % 7),
        (made / "my.py").unlink,
        lambda: None,
    ])  # fmt: skip
    with through(Gate(None)):
        session = begin(made / "out", Plan(str(made / "case.yaml")))
        session.do_share(1, 1, lambda result: next(edits)())
        assert len(session.results()) == 4
        named = [run.id for run in session.runs()]
        session.write()
        assert [run.id for run in session.runs()] == named
        with own_code(made / "out"):
            assert load_python("key", made / "my.py").Mine.__doc__ == "Version 0."
            assert open_session(made / "out").changed == ""
    assert open_session(made / "out").changed == "my.py (gone)"


@pytest.mark.parametrize(("edit", "told"), [("tables.csv", "tables.csv (changed)"), ("", "")])
def test_a_campaign_stops_for_a_file_without_a_copy_and_names_it(made, edit, told, capsys):
    (made / "tables.csv").write_text("1")
    (made / "my.py").write_text(f"TABLE = 'tables.csv'\n{DETECTOR % 0}")
    with through(Gate(None)):
        session = begin(made / "out", Plan(str(made / "case.yaml")))
        change = iter([lambda: (made / (edit or "other.csv")).write_text("22"), *[lambda: None] * 9])
        if told:
            with pytest.raises(InputError, match=re.escape(told)):
                session.do_share(1, 1, lambda result: next(change)())
        else:
            session.do_share(1, 1, lambda result: next(change)())
        assert len(session.results()) == (1 if told else 4)


def test_runs_that_were_stopped_are_compared(made, capsys):
    do(made)
    do(made, "stopped", most=2)
    (made / "my.py").write_text(DETECTOR % 1, encoding="utf-8")
    assert not (made / "stopped" / "results.parquet").exists()
    assert main(["test", "compare", str(made / "out"), str(made / "stopped")]) == 0
    assert "2 of 2 pairs are the same bytes" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"results\.parquet or plan\.json"):
        compare(str(made / "out"), str(made))
