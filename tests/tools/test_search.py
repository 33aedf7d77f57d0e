"""`swath test search`: the boundary of an analytic margin, the same however it is interrupted."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.function_test.journal import read_journals
from swath.tools.function_test.search.boundary import Boundary, first_points, next_points, sobol_points
from swath.tools.function_test.search.gaussian_process import fit, matern
from swath.tools.function_test.search.search import Search, open_search, run_search
from swath.tools.function_test.session import open_session
from tests.tools.fake_work import analytic_value, analytic_work, here

CASE = """
format: swath test case 1
objective: keeps an analytic limit
source: made
scenario: straight
vary:
  length_m: {key: field.edge.gaps.0.end_m, at: [2], range: [0.5, 4]}
  depth_m: {key: field.edge.gaps.0.depth_m, at: [1], range: [0.2, 2]}
  stems: {key: field.stand.stems_per_m2, at: [400], range: [100, 600]}
  speed_kmh: {key: combine.speed.speed_kmh, at: [7], range: [3, 12]}
set: {"field.edge.gaps": [{start_m: 20, end_m: 22, depth_m: 1}]}
seeds: 2
expect: {edge_rmse_m: {max: 0.3}}
"""
RANGES = {"length_m": (0.5, 4.0), "depth_m": (0.2, 2.0), "stems": (100.0, 600.0), "speed_kmh": (3.0, 12.0)}


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "analytic.yaml"
    path.write_text(CASE.replace("[0.5, 4]", "[20.5, 24]").replace("at: [2]", "at: [22]"), encoding="utf-8")
    return path


@pytest.fixture
def without_runs(monkeypatch):
    """Runs are not driven: their value is a formula."""
    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(analytic_work))


def margin_of(cube):
    """The margin of the analytic value, (n,), at points of the unit cube (n, 4)."""
    low, high = np.array(list(RANGES.values())).T
    return np.array([(0.3 - analytic_value(*point)) / 0.3 for point in low + cube * (high - low)])


def searched(budget=64):
    points = first_points(4, budget)
    while len(points) < budget:
        points = np.vstack([points, next_points(points, np.clip(margin_of(points), -1, 1), 4)])
    return Boundary(list(RANGES), points, np.clip(margin_of(points), -1, 1))


def test_64_runs_tell_where_an_analytic_margin_in_four_parameters_is_negative():
    others = np.random.default_rng(9).random((2000, 4))
    passes = margin_of(others) >= 0.0
    assert 0.3 < passes.mean() < 0.7
    found = searched()
    assert np.mean(found.passes(others) == passes) >= 0.95
    evenly = sobol_points(64, 4)
    spread = Boundary(list(RANGES), evenly, np.clip(margin_of(evenly), -1, 1))
    assert np.mean(found.passes(others) == passes) > np.mean(spread.passes(others) == passes)
    passing, unknown = found.shares
    assert passing == pytest.approx(passes.mean(), abs=0.04)
    assert unknown < 0.5


def test_the_sensitivities_are_those_of_a_function_with_known_ones():
    """y = 2 a + b: variances 4/12 and 1/12, so shares of 0.8 and 0.2, and nothing of c."""
    points = sobol_points(60, 3)
    found = Boundary(["a", "b", "c"], points, (2 * points[:, 0] + points[:, 1] - 1.5) / 1.5)
    for (_, first, total), expected in zip(found.sensitivities(), (0.8, 0.2, 0.0), strict=True):
        assert first == pytest.approx(expected, abs=0.03)
        assert total == pytest.approx(expected, abs=0.03)


def test_the_covariance_is_that_of_the_matern_class():
    """Against its spectral density: Student's t with 5 degrees of freedom (Rasmussen & Williams, 4.15)."""
    for r in (0.0, 0.3, 1.7):
        value, _ = quad(lambda s: (5 + s**2) ** -3.0, 0, np.inf, weight=None) if r == 0 else quad(
            lambda s: (5 + s**2) ** -3.0, 0, np.inf, weight="cos", wvar=r)  # fmt: skip
        whole, _ = quad(lambda s: (5 + s**2) ** -3.0, 0, np.inf)
        assert matern(np.array(r)) == pytest.approx(value / whole, rel=1e-6)


def test_a_fit_finds_the_noise_and_which_parameter_does_not_matter():
    rng = np.random.default_rng(2)
    points = sobol_points(80, 2)
    values = np.sin(5 * points[:, 0]) + rng.normal(0, 0.1, 80)
    process = fit(points, values)
    assert process.noise == pytest.approx(0.1, rel=0.3)
    assert process.lengths[1] > 3 * process.lengths[0]
    others = rng.random((400, 2))
    mean, sd = process.predict(others)
    off = np.abs(mean - np.sin(5 * others[:, 0]))
    assert np.mean(off <= 1.96 * sd) > 0.85
    without = fit(np.delete(points, 7, 0), np.delete(values, 7))
    assert process.left_out()[7] == pytest.approx(without.predict(points[7:8])[0][0], abs=0.03)


def test_a_search_that_is_stopped_goes_on_to_the_same_runs(case_file, tmp_path, without_runs, monkeypatch):
    search, done = Search(str(case_file)), []
    whole = run_search(tmp_path / "whole", search, 28, 1, done.append)
    assert len(done) == len(whole.results) == 28
    assert {r["seed"] for r in whole.results} == {1, 2}

    def stop(result):
        stopped.append(result)
        if len(stopped) == 19:
            raise KeyboardInterrupt

    stopped = []
    with pytest.raises(KeyboardInterrupt):
        run_search(tmp_path / "again", search, 28, 1, stop)
    again = run_search(tmp_path / "again", search, 28, 1, stopped.append)
    assert [r["id"] for r in again.results] == [r["id"] for r in whole.results]
    assert len(list(read_journals(tmp_path / "again" / "journal"))) == 28  # nothing was done twice
    for name in ("plan.json", "search.json"):
        texts = [(tmp_path / folder / name).read_bytes() for folder in ("whole", "again")]
        assert texts[0] == texts[1]
    opened = open_search(open_session(tmp_path / "whole"))
    assert [r["id"] for r in opened.results] == [r["id"] for r in whole.results]
    with pytest.raises(InputError, match="another search"):
        run_search(tmp_path / "whole", Search(str(case_file), batch=2), 28, 1, done.append)


def test_an_error_is_no_failure_and_not_asked_again(case_file, tmp_path, without_runs, monkeypatch):
    """Errors from 9 km/h on: what is shown rests on the others, and their place draws no further runs."""
    monkeypatch.setenv("ANALYTIC_ERRORS", "1")
    found = run_search(tmp_path / "out", Search(str(case_file)), 32, 1, lambda result: None)
    judged = [r for r in found.results if r["verdict"] != "error"]
    assert 8 <= len(judged) < 32
    assert len(found.boundary.margins) == found.passed()[1] == len(judged)
    points = [tuple(r["point"].values()) for r in found.results]
    assert len(set(points)) == len(points)
    assert any(f"{32 - len(judged)} runs came to an error, the first: crashed" in s for s in found.shows)
    nothing = replace(found, results=[r for r in found.results if r["verdict"] == "error"] * 4)
    with pytest.raises(InputError, match=r"0 .*came to an error, the first: crashed.*expected 8 judged runs"):
        _ = nothing.boundary


@pytest.mark.drawn
def test_the_command_tells_the_boundary_and_checks_it(case_file, tmp_path, without_runs, capsys):
    out, held = str(tmp_path / "out"), str(tmp_path / "held")
    search = ["test", "search", str(case_file), "--out", out, "--budget", "24", "--limit", "edge_rmse_m"]
    main(["test", "run", str(case_file), "--draw", "40", "--seeds", "1", "--out", held])
    capsys.readouterr()
    assert main([*search, "--check", held]) == 0
    text = capsys.readouterr().out
    right = int(text.partition(" of 40 other runs")[0].split()[-1])
    assert right >= 34
    page = (Path(out) / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 6  # pairs of four parameters
    assert f"{right} of 40" in page
    assert main(["test", "report", out]) == 0
    assert "24 runs" in capsys.readouterr().out
    assert json.loads((Path(out) / "search.json").read_text())["limit"] == "edge_rmse_m"
    assert os.path.getsize(Path(out) / "results.parquet") > 0


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (["--limit", "edge_rms_m"], "did you mean 'edge_rmse_m'"),
        (["--budget", "3"], "expected 8 runs or more"),
        (["--batch", "0"], "expected 1 run or more"),
    ],
)
def test_what_cannot_be_searched_is_refused(case_file, tmp_path, argv, expected, capsys):
    assert main(["test", "search", str(case_file), "--out", str(tmp_path / "out"), *argv]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    case_file.write_text(CASE.replace(", range:", ", at: [1], range:").partition("vary:")[0]
                         + "expect: {distance_m: {min: 1}}\n", encoding="utf-8")  # fmt: skip
    assert main(["test", "search", str(case_file), "--out", str(tmp_path / "out")]) == 2
    assert "a parameter with a range" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("most", "expected"),
    [(30.0, ["8 of 8 passed, shows >= 68.8 %; 59 without a failure are needed for 95 %"]), (0.3, None)],
)
def test_counts_like_a_test(case_file, tmp_path, without_runs, most, expected):
    """Never "100 % pass, 0 % not known": that is what a model expects, eight runs show less."""
    folder = tmp_path / "search"
    found = run_search(folder, Search(str(case_file)), 8, 1, lambda result: None)
    limit = {"limit": {"max": most}, "result": "pass"}
    kept = [{**r, "verdict": "pass", "expect": [{**r["expect"][0], **limit}]} for r in found.results]
    results = kept if most > 1.0 else found.results
    shows = replace(found, results=results).shows
    if expected is not None:
        assert shows == expected
        return
    passed = sum(r["verdict"] == "pass" for r in found.results[:4])
    assert f"of the first 4 runs, spread evenly over the ranges, {passed} pass, shows >= " in shows[0]
    assert shows[1].startswith("expected between the runs, not shown: ")
