"""The command: which levels there are, and where those of 0.2 went."""

import json
import math
from pathlib import Path

import pytest

from swath.commands.main import main
from swath.terminal import tables
from tests.printed import are_whole


@pytest.mark.parametrize(
    ("level", "said"),
    [
        ("kinematic", "expected events or driven; it is `driven` now"),
        ("sensors", "expected events or driven; whole fields have no level with sensors now, version 0.2"),
        ("granted", "expected events or driven"),
    ],
)
def test_a_level_that_is_not_there_says_what_is(capsys, level, said):
    assert main(["fleet", "run", "small-field", "--level", level]) == 2
    assert f"--level = {level}: {said}" in " ".join(capsys.readouterr().err.split())


def test_draws_are_of_events_alone(capsys):
    assert main(["fleet", "run", "small-field", "--level", "driven", "--spread", "5"]) == 2
    assert "expected the level events, not driven" in capsys.readouterr().err


def test_results_of_another_job_are_not_replaced(capsys, tmp_path):
    for name in ("north", "south"):
        (tmp_path / f"{name}.yaml").write_text(
            "format: swath fleet 1\nfield: {boundary_m: [[0, 0], [60, 0], [60, 40], [0, 40]]}\n"
            "combines: {combine: {}}\ntruck: {x_m: 20, y_m: -30}\nfleet: {plans: 2}\n"
        )
    out = ["--out", str(tmp_path / "out of both")]
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out]) == 0
    before = (tmp_path / "out of both" / "results.json").read_bytes()
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out]) == 0
    assert main(["fleet", "run", str(tmp_path / "south.yaml"), *out]) == 2
    assert "an earlier south, not of north" in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "out of both" / "results.json").read_bytes() == before
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out, "--set", "fleet.plans=1"]) == 2
    assert "not of north with no changes" in " ".join(capsys.readouterr().err.split())
    assert main(["fleet", "run", str(tmp_path / "south.yaml"), *out, "--replace"]) == 0
    page = (tmp_path / "out of both" / "report.html").read_text()
    assert "; machines at" not in page  # the job has no summary


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "combines.combine.machine=foo",
            "combines.combine.machine = foo: expected a file or one of combine-5m,",
        ),
        ("truck.machine=foo", "truck.machine = foo: expected a file or one of grain-truck"),
        ("field.ways_m=[[[2000,2000],[2100,2100]]]", "field.ways_m[0] = "),
    ],
)
def test_what_leads_nowhere_is_named_by_its_key(capsys, change, said):
    assert main(["fleet", "run", "small-field", "--set", "fleet.plans=1", "--set", change]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert said in told
    assert "grain-cart" not in told


LONG_NAMES = """
format: swath fleet 1
name: the long field behind the old mill
summary: three machines with names as long as people give them
field: {boundary_m: [[0, 0], [75, 0], [75, 60], [0, 60]]}
combines: {combine_of_the_neighbour_2019: {}, second_combine_with_9_m_header: {}}
carts: {tractor_and_chaser_bin_of_the_pool: {}}
truck: {x_m: 30, y_m: -30}
"""


@pytest.mark.parametrize(("columns", "job"), [(80, "small-field"), (80, "long"), (60, "small-two-combines")])
def test_what_a_job_prints_is_whole_and_says_where_the_hours_went(
    columns, job, capsys, monkeypatch, tmp_path
):
    monkeypatch.setenv("COLUMNS", str(columns))
    widths, printed = tables._widths, []
    monkeypatch.setattr(tables, "_widths", lambda *told: printed.append(told[:2]) or widths(*told))
    if job == "long":
        job = str(tmp_path / "long.yaml")
        Path(job).write_text(LONG_NAMES)
    out = tmp_path / "all that came out"
    assert main(["fleet", "run", job, "--set", "fleet.plans=1", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    pages = [line for line in lines if line.startswith(("report: ", "replay: "))]
    assert [Path(line.split(": ", 1)[1]) for line in pages] == [out / "report.html", out / "replay.html"]
    assert all(Path(line.split(": ", 1)[1]).is_file() for line in pages)
    are_whole([line for line in lines if line not in pages], columns, printed)
    rows = next(rows for heads, rows in printed if "cutting" in heads)
    ends = json.loads((out / "results.json").read_text())["duration_s"] / 3600.0
    assert len(rows) >= 2
    for _, *cells in rows:
        *parts, whole = map(float, cells)
        assert math.fsum(parts) == pytest.approx(whole, abs=0.0006 * len(cells))
        assert whole == pytest.approx(ends, abs=0.0006)
