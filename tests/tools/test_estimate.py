"""`swath test estimate`: rare failures of known probability, what is refused, the same however interrupted.

Coverage is asked of so many repeats that a right interval of 95 % fails with the stated chance.
"""

import json
from math import sqrt
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from benchmarks.rare_failures import RARE, SHAPES, estimated
from pydantic import TypeAdapter
from scipy.stats import binom

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.function_test.case import Varied
from swath.tools.function_test.estimate.estimate import Estimate, distribution_of, run_estimate
from swath.tools.function_test.estimate.rare import (
    ESS_LEAST,
    OVERLOOKED_MOST,
    Hunt,
    effective,
    exposure,
    fit,
    log_exposure,
    rate_of,
    tempered,
)
from swath.tools.function_test.journal import read_journals
from swath.tools.function_test.judging.judged import UNJUDGED
from swath.tools.function_test.one_run import no_result
from tests.tools.fake_work import here

CASE = """
format: swath test case 1
objective: keeps an analytic limit
source: made
scenario: straight
set: {"field.edge.gaps": [{start_m: 20, end_m: 22, depth_m: 1}]}
vary:
  end_m: {key: field.edge.gaps.0.end_m, at: [22], range: [21, 31]}
  stems: {key: field.stand.stems_per_m2, at: [400], range: [100, 600]}
expect: {edge_rmse_m: {max: 0.3}}
"""
SELDOM = 1e-2  # share of the square in which two shares add up to more than 2 - SIDE
SIDE = sqrt(2 * SELDOM)


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "analytic.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


class Formula:
    """Instead of runs: a limit of 0.3 that is broken where both shares of the ranges add up to more.

    shift: by which a run with another stubble, the cheap level here, is nearer to it; stop: after so many
    runs; verdict: changes what a run comes to
    """

    def __init__(self, side=SIDE, shift=0.0, stop=None, verdict=None):
        self.side, self.shift, self.stop, self.verdict, self.done = side, shift, stop, verdict, 0

    def __call__(self, runs, folder, workers, done):
        here(self.result)(runs, folder, workers, done)

    def result(self, run):
        if self.done == self.stop:
            raise KeyboardInterrupt
        self.done += 1
        shares = (run.point["end_m"] - 21) / 10, (run.point["stems"] - 100) / 500
        is_cheap = any("stubble_height_m" in text for text in run.sets)
        value = 0.3 * (1 + sum(shares) - 2 + self.side + (self.shift if is_cheap else 0.0))
        entry = {"subject": "combine", "name": "edge_rmse_m", "limit": {"max": 0.3}, "value": value,
                 "result": "fail" if value > 0.3 else "pass"}  # fmt: skip
        known = {"metrics": {"edge_rmse_m": value}, "expect": [entry], "digest": f"{value}"}
        found = {**no_result(run, ""), "verdict": entry["result"], "reason": "too far", **known}
        return found if self.verdict is None else self.verdict(run, found)


@pytest.fixture
def runs(monkeypatch):
    """Sets what a run comes to."""

    def set_to(formula):
        monkeypatch.setattr("swath.tools.function_test.session.run_all", formula)
        monkeypatch.setattr("os.fsync", lambda file: None)
        return formula

    return set_to


def none(result):
    """For each new result."""


@pytest.mark.draws
@pytest.mark.parametrize("name", ["half space, 6", "two regions, 2", "four corners, 2"])
def test_the_interval_covers_a_known_probability(name):
    """25 repeats; fewer than 20 of a right interval are inside with a chance of 0.7 %."""
    assert binom.cdf(19, 25, 0.95) < 0.01
    shape, d = SHAPES[name]
    found = [estimated(shape(d), d, 2000, seed) for seed in range(25)]
    assert sum(rate.low <= RARE <= rate.high for rate in found) >= 20
    assert np.median([rate.half_width for rate in found]) < 0.25
    assert np.mean([rate.value for rate in found]) == pytest.approx(RARE, rel=0.1)


def test_weights_of_an_unbiased_rate():
    """Drawn at twice the rate with weights of a half: a mean of 0.02 for a chance of 0.02."""
    rng = np.random.default_rng(4)
    fails = rng.random(100_000) < 0.04
    rate = rate_of(np.full(100_000, 0.5), fails)
    assert rate.value == pytest.approx(0.02, rel=0.05)
    assert rate.ess == pytest.approx(fails.sum())
    sd = sqrt(0.04 * 0.96 / 100_000) / 2
    assert rate.high - rate.value == pytest.approx(1.96 * sd, rel=0.05)
    assert rate_of(np.ones(10), np.zeros(10, dtype=bool)).value == 0.0


def test_a_fit_finds_two_regions_and_a_tempered_weight_leaves_half_effective():
    rng = np.random.default_rng(1)
    places = np.vstack([rng.normal((4, 0), 0.3, (300, 2)), rng.normal((0, -4), 0.3, (100, 2))])
    found = fit(places, np.ones(400))
    assert np.round(sorted(found.means.tolist()), 1) == pytest.approx(np.array([[0, -4], [4, 0]]), abs=0.1)
    assert sorted(found.shares) == pytest.approx([0.375, 0.625], abs=0.02)  # half alike, half by weight
    six = np.vstack([rng.normal(at, 0.3, (60, 3)) for at in (*(4.0 * np.eye(3)), *(-4.0 * np.eye(3)))])
    assert len(fit(six, np.ones(360)).shares) == 6
    assert effective(tempered(rng.normal(0, 5, 200))) == pytest.approx(100, rel=0.05)
    z = rng.standard_normal((50, 2))
    assert exposure(2).log_density(z) == pytest.approx(log_exposure(z))


def test_failures_where_the_search_found_none_leave_no_number():
    """Half of the weight of 200 failures lies outside the regions that were found."""
    fails, outside = np.arange(1000) < 200, np.arange(1000) < 100
    sound = rate_of(np.full(1000, 0.01), fails)
    assert sound.ess >= ESS_LEAST
    assert sound.overlooked == 0.0
    found = rate_of(np.full(1000, 0.01), fails, outside)
    assert found.overlooked == pytest.approx(0.5)
    assert found.overlooked > OVERLOOKED_MOST


def test_a_region_that_is_missed_is_called_overlooked():
    """The search sees failures of one side only; the last round meets those of the other side."""
    rng, hunt = np.random.default_rng(1), Hunt(2, 200)
    while hunt.left:
        places = hunt.next(rng)
        hunt.tell(places, np.clip(2.0 - places[:, 0], -1.0, 1.0))
    hunt.last()
    assert hunt.overlooked(np.array([[3.0, 0.0], [-3.0, 0.0]])).tolist() == [False, True]


def test_a_search_in_which_nothing_is_judged_goes_on():
    rng, hunt = np.random.default_rng(1), Hunt(2, 60)
    while hunt.left:
        places = hunt.next(rng)
        hunt.tell(places, np.full(len(places), np.nan))
    assert hunt.last().draw(rng, 5).shape == (5, 2)


def test_without_values_the_grid_is_the_ends_of_the_range():
    varied = TypeAdapter(Varied)
    assert varied.validate_python({"key": "run.distance_m", "range": [1, 3]}).at == [1.0, 3.0]
    sets = {"up": {"run.distance_m": 1}, "down": {"run.distance_m": 2}}
    assert varied.validate_python({"sets": sets}).at == ["up", "down"]
    with pytest.raises(InputError, match=r"values of the grid, as \[0.5, 1.5\], or a range"):
        Varied(key="run.distance_m")


def test_a_value_lies_where_its_share_of_the_exposure_does():
    ends = {"key": "run.distance_m", "at": [1.0], "range": (0.0, 10.0)}
    assert distribution_of(Varied(**ends)).value(0.3) == 3.0
    halves = distribution_of(Varied(**ends, exposure=[3, 1]))
    assert [halves.value(share) for share in (0.375, 0.75, 0.875)] == [2.5, 5.0, 7.5]
    uneven = distribution_of(Varied(**ends, buckets=[0.0, 1.0, 10.0], exposure=[1, 1]))
    assert [uneven.value(share) for share in (0.25, 0.5, 0.75)] == [0.5, 1.0, 5.5]
    named = distribution_of(Varied(key="combine.edge", at=["otsu", "profile"], exposure=[9, 1]))
    assert [named.value(share) for share in (0.0, 0.89, 0.91, 1.0)] == ["otsu", "otsu", "profile", "profile"]


def test_a_category_of_an_odd_is_drawn_by_the_exposure_of_its_sets():
    sets = {"up": {"run.distance_m": 1}, "down": {"run.distance_m": 2}}
    drawn = distribution_of(Varied(at=["up"], sets=sets, exposure=[1, 3]))
    assert [drawn.value(share) for share in (0.2, 0.3)] == ["up", "down"]
    assert distribution_of(Varied(at=["up"], sets=sets)).value(0.9) == "up"


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"exposure": [1, 2], "buckets": [0, 5, 9, 10]}, "expected 3 shares"),
        ({"exposure": [0, 0]}, "one above 0"),
        ({"buckets": [0, 5]}, "upper end of `range`"),
        ({"buckets": [0, 7, 5, 10]}, "each above the last"),
    ],
)
def test_a_wrong_exposure_is_refused(wrong, told):
    with pytest.raises(InputError, match=told):
        Varied(key="run.distance_m", at=[1.0], range=(0.0, 10.0), **wrong)


def test_a_case_is_estimated_and_a_stop_changes_nothing(case_file, tmp_path, runs, capsys):
    line = ["test", "estimate", str(case_file), "--budget", "400", "--out"]
    whole = runs(Formula())
    assert main([*line, str(tmp_path / "a"), "--at-most", "0.1"]) == 0
    said, progress = capsys.readouterr()
    assert [line.split(" of ")[0] for line in progress.splitlines()] == [str(n) for n in range(40, 401, 40)]
    assert "any limit broken with probability" in said
    assert "at most 0.1: shown" in said
    assert whole.done == 400
    runs(Formula(stop=100))
    assert main([*line, str(tmp_path / "b")]) == 130
    rest = runs(Formula())
    assert main([*line, str(tmp_path / "b"), "--at-most", "1e-4"]) == 1
    assert rest.done == 300
    a, b = (json.loads((tmp_path / name / "summary.json").read_text()) for name in "ab")
    assert a["low"] <= SELDOM <= a["high"]
    for name in ("at_most", "verdict"):
        del a[name], b[name]
    assert a == b
    first, second = ((tmp_path / name / "results.parquet").read_bytes() for name in "ab")
    assert first == second
    assert ET.parse(tmp_path / "b" / "junit.xml").find(".//failure") is not None
    value = ET.parse(tmp_path / "a" / "junit.xml").find(".//property[@name='probability']").get("value")
    assert float(value) == pytest.approx(a["probability"], rel=1e-5)
    capsys.readouterr()
    assert main(["test", "report", str(tmp_path / "b")]) == 1
    said = capsys.readouterr().out
    assert f"{a['probability']:.3g}" in said
    assert "at most 0.0001: broken" in said


def test_another_estimate_in_the_folder_is_refused(case_file, tmp_path, runs):
    runs(Formula())
    out = tmp_path / "out"
    run_estimate(out, Estimate(str(case_file), budget=20), 1, none)
    with pytest.raises(InputError, match=r"another estimate \(budget 20, now 21\)"):
        run_estimate(out, Estimate(str(case_file), budget=21), 1, none)
    with pytest.raises(InputError, match="expected one of edge_rmse_m"):
        run_estimate(out, Estimate(str(case_file), limit="edge_rms_m"), 1, none)
    with pytest.raises(InputError, match="20 runs or more"):
        run_estimate(out, Estimate(str(case_file), budget=19), 1, none)


CHEAP = ("field.edge.stubble_height_m=0.1",)


def cheap(case_file):
    """With so few runs one draw in three has too few effective failures for a number; this one has enough."""
    return Estimate(str(case_file), budget=300, cheap=CHEAP, cheap_budget=200, seed=4)


@pytest.mark.parametrize("shift", [0.05, -0.02])
def test_a_biased_cheap_level_finds_and_the_dear_one_gives_the_number(shift, case_file, tmp_path, runs):
    """At a cheap level that fails sooner, or later, than the dear one; the number is that of the dear one."""
    done = runs(Formula(shift=shift))
    found = run_estimate(tmp_path / "out", cheap(case_file), 1, none)
    assert done.done == 200 + 240 + 300
    assert found.refusals == []
    assert found.rate.low <= SELDOM <= found.rate.high
    cheap_rate = found.cheap_rate
    assert cheap_rate.low <= (SIDE + shift) ** 2 / 2 <= cheap_rate.high
    assert {r["id"] for r in read_journals(tmp_path / "out" / "journal")} == {r["id"] for r in found.results}
    assert sum(1 for _ in read_journals(tmp_path / "out" / "cheap" / "journal")) == 200 + 240


def test_levels_that_disagree_are_told(case_file, tmp_path, runs):
    """The cheap level breaks the limit only in the tip of the corner."""
    runs(Formula(side=0.2, shift=-0.16))
    found = run_estimate(tmp_path / "out", cheap(case_file), 1, none)
    assert found.unseen > 0.9
    assert any("two levels disagree" in said for said in found.refusals)
    assert found.plain["probability"] is None


def test_too_few_failures_and_none_are_told(case_file, tmp_path, runs, capsys):
    runs(Formula(side=-1.0))
    assert main(["test", "estimate", str(case_file), "--budget", "40", "--out", str(tmp_path / "none")]) == 3
    assert "no number: no failure in the 20 runs of the last round" in capsys.readouterr().out
    runs(Formula())
    assert main(["test", "estimate", str(case_file), "--budget", "20", "--out", str(tmp_path / "few")]) == 3
    assert "no number" in capsys.readouterr().out
    assert ET.parse(tmp_path / "few" / "junit.xml").find(".//skipped") is not None
    assert "No number is given" in (tmp_path / "few" / "report.html").read_text()


def test_runs_that_are_not_judged_leave_no_number_where_they_weigh(case_file, tmp_path, runs):
    def outside(run, result):
        if run.point["stems"] < 595:
            return result
        (entry,) = result["expect"]
        told = {"verdict": UNJUDGED, "reason": "not judged: lidar beyond", "expect": [
            {**entry, "rests_outside": ["combine.lidar"]}],
            "credibility": {"combine.lidar": {"level": "empirical", "quantities": []}}}  # fmt: skip
        return {**result, **told}

    runs(Formula(verdict=outside))
    found = run_estimate(tmp_path / "out", Estimate(str(case_file), budget=400), 1, none)
    assert any("not judged: lidar beyond" in said for said in found.refusals)
    runs(Formula(verdict=lambda run, result: no_result(run, "crashed") if run.seed == 1 else result))
    found = run_estimate(tmp_path / "one", Estimate(str(case_file), budget=400), 1, none)
    assert found.refusals == []


def test_a_limit_that_is_kept_or_not_leads_nowhere_and_is_told(case_file, tmp_path, runs):
    def kept_or_not(run, result):
        (entry,) = result["expect"]
        told = {**entry, "name": "distance_m", "limit": {"min": 39}, "value": 40.0, "result": "pass"}
        return {**result, "verdict": "pass", "expect": [told]}

    text = case_file.read_text().replace("edge_rmse_m: {max: 0.3}", "distance_m: {min: 39}")
    case_file.write_text(text)
    runs(Formula(verdict=kept_or_not))
    found = run_estimate(tmp_path / "out", Estimate(str(case_file), budget=40), 1, none)
    assert "all have the same margin" in found.text
