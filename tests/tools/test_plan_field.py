"""`swath test plan-field`: where real passes are proposed, and what becomes of the form that comes back."""

import csv
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.runtime.credibility import NEVER_CHECKED
from swath.signals import Scan
from swath.tools.compare_log.steering_fit import compare_steering
from swath.tools.distributions import wasserstein1
from swath.tools.function_test.case import read_case
from swath.tools.function_test.evidence import EVIDENCE
from swath.tools.function_test.field_plan.form import FORM, compared, fixed, write_form
from swath.tools.function_test.field_plan.plan import (
    OTHER,
    Condition,
    FieldPlan,
    alike,
    choose,
    conditions_of,
    draw,
    places_of,
    plan_field,
    spread,
)
from swath.tools.function_test.field_plan.seen import SCANS, ScanHeights, heights_of
from swath.tools.function_test.odd.dossier import write_dossier
from swath.tools.function_test.one_run import no_result
from tests.tools.fake_work import driven_here, here
from tests.tools.odd_files import DENSITY, conducted, result_of, small_odd
from tests.tools.test_compare_log import write_log as write_engine
from tests.tools.test_compare_steering import write_log as write_steering

CASE = """
format: swath test case 1
objective: keeps its line
source: made
scenario: straight
set: {run.distance_m: 4, combine.lidar.level: empirical, combine.edge: {level: truth}}
vary:
  crop:
    at: [wheat, barley]
    sets: {wheat: {field.stand.crop: wheat}, barley: {field.stand.crop: barley}}
    exposure: [1, 3]
  stems: {key: field.stand.stems_per_m2, range: [200, 600], exposure: [3, 1]}
expect: {lateral_rms_m: {max: 0.5}}
"""


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "made.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


def is_wrong(point):
    return point["crop"] == "wheat" and point["stems"] > 400


@pytest.fixture
def levels(monkeypatch):
    """Runs are not driven: two levels differ by 1 cm, and by 20 cm where one of them is wrong."""

    def work(run):
        rng = np.random.default_rng(run.seed + 1000 * (run.candidate == OTHER))
        off = 0.2 if run.candidate == OTHER and is_wrong(run.point) else 0.0
        value = 0.1 + off + 0.01 * rng.standard_normal()
        entry = {"subject": "combine", "name": "lateral_rms_m", "limit": {"max": 0.5}, "value": value,
                 "result": "pass"}  # fmt: skip
        return {**no_result(run, ""), "verdict": "pass", "expect": [entry], "digest": run.id,
                "metrics": {"lateral_rms_m": value}}  # fmt: skip

    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(work))


def planned(folder, source, **more):
    return plan_field(folder, FieldPlan(str(source), metric="lateral_rms_m", **more), 1, lambda result: None)


def test_passes_go_where_levels_differ_and_not_twice_to_one_place(case_file, levels, tmp_path):
    found = planned(tmp_path / "a", case_file, pairs=60, runs=4)
    where = [each.condition.point for each in found.passes]
    assert is_wrong(where[0])
    assert len({tuple(point.values()) for point in where}) == len(where)
    assert 0.0 < sum(each.narrows for each in found.passes) < 1.0


def test_what_passes_narrow_is_what_the_posterior_variance_says(case_file):
    """Against the covariance of a Gaussian process given all measurements at once."""
    case = read_case(case_file)
    rng = np.random.default_rng(3)
    points = draw(case, None, 40, 1)
    conditions = [Condition(p, float(rng.normal()), float(rng.random()), ()) for p in points]
    scale = spread(case, conditions)
    passes = choose(case, conditions, scale, 5)
    places = places_of(case, points)
    prior = scale[:, None] * alike(places, places) * scale
    at = [conditions.index(each.condition) for each in passes]
    noise = np.median(np.abs([c.apart for c in conditions])) ** 2
    across = prior[:, at]
    after = prior - across @ np.linalg.solve(prior[np.ix_(at, at)] + noise * np.eye(5), across.T)
    weight = np.array([c.unshown for c in conditions])
    left = (weight * after.diagonal()).sum() / (weight * prior.diagonal()).sum()
    assert sum(each.narrows for each in passes) == pytest.approx(1.0 - left)
    assert all(a.narrows >= b.narrows for a, b in pairwise(passes))


def test_passes_that_were_driven_count_for_the_next_ones(case_file):
    case = read_case(case_file)
    points = draw(case, None, 40, 2)
    conditions = [Condition(p, 0.3 if is_wrong(p) else 0.01, 1.0, ()) for p in points]
    scale = spread(case, conditions)
    first, second = choose(case, conditions, scale, 2)
    (again,) = choose(case, conditions, scale, 1, [first.condition.point])
    assert again.condition == second.condition
    assert again.narrows > second.narrows  # of what is left


def test_conditions_come_as_often_as_they_occur(case_file):
    points = draw(read_case(case_file), None, 400, 1)
    assert np.mean([p["crop"] == "wheat" for p in points]) == pytest.approx(0.25, abs=0.07)
    assert np.mean([p["stems"] > 400 for p in points]) == pytest.approx(0.25, abs=0.07)


def test_a_level_that_was_never_checked_there_counts_as_far_off(case_file):
    case = read_case(case_file)
    conditions = [Condition(p, 0.1 * (n % 2) + 0.01, 1.0, ("lidar wind",) if n == 4 else ())
                  for n, p in enumerate(draw(case, None, 20, 5))]  # fmt: skip
    known = [Condition(c.point, c.apart, 1.0, ()) for c in conditions]
    more, less = spread(case, conditions), spread(case, known)
    assert more[4] >= np.quantile([c.apart for c in conditions], 0.9) > less[4]
    assert (np.delete(more, 4) == np.delete(less, 4)).all()


def test_the_form_comes_back_and_becomes_evidence(case_file, levels, tmp_path, capsys):
    """A pass driven in simulation by another seed stands for the real one."""
    out = tmp_path / "a"
    line = ["test", "plan-field", str(case_file), "--metric", "lateral_rms_m", "--runs", "2"]
    line += ["--out", str(out)]
    assert main(line) == 0
    rows = list(csv.DictReader((out / FORM).read_text().splitlines()))
    assert len(rows) == 2
    assert "stems counted" in rows[0]["measure"]
    assert "swath compare scans" in rows[0]["record"]
    first = rows[0]
    sets = {"run.distance_m": 4, "combine.lidar.level": "empirical", "combine.edge": "{level: truth}",
            "field.stand.crop": first["crop"], "field.stand.stems_per_m2": first["stems"]}  # fmt: skip
    changes = [word for key, value in sets.items() for word in ("--set", f"{key}={value}")]
    drive = ["run", "straight", *changes, "--seed", "77", "--no-report", "--no-replay"]
    assert main([*drive, "--out", str(out / "field")]) in (0, 1, 3)
    first["scans"], first["date"] = "field", "2026-08-01"
    with (out / "filled.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, first)
        writer.writeheader()
        writer.writerows(rows)
    assert main([*line, "--filled", str(out / "filled.csv")]) == 0
    (evidence,) = csv.DictReader((out / EVIDENCE).read_text().splitlines())
    assert evidence["compared"] == "scans"
    assert 0.0 <= float(evidence["value"]) < 0.1
    assert evidence["date"] == "2026-08-01"
    assert "2026-08-01" in (out / "report.html").read_text(encoding="utf-8")
    text = (out / "filled.csv").read_text().replace(f",{first['crop']},", ",oats,", 1)
    (out / "filled.csv").write_text(text)
    assert main([*line, "--filled", str(out / "filled.csv")]) == 2
    assert "crop = oats: expected one of wheat, barley in pass 1" in capsys.readouterr().err


def test_logs_that_come_back_are_compared_with_the_machine(case_file, levels, tmp_path):
    """A steering log of one pass and an engine log of another: the numbers of `swath compare log`."""
    plan = planned(tmp_path / "a", case_file, pairs=12, runs=3)
    rows = list(csv.DictReader(write_form(plan).read_text().splitlines()))
    write_steering(tmp_path / "steer.csv", passes=6, seconds=6.0, rate=5)
    write_engine(tmp_path / "engine.csv", machines=1, count=200)
    rows[0]["log"], rows[1]["log"] = "steer.csv", "engine.csv"
    with (tmp_path / "filled.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    steer, engine = compared(plan, tmp_path / "filled.csv")
    parts = compare_steering("lexion-700-class", tmp_path / "steer.csv").parts
    assert [row["value"] for row in steer.rows] == [f"{part.rmse[0]:.4g}" for part in parts]
    assert {row["unit"] for row in engine.rows} == {"%", "l/h"}
    assert {row["compared"] for row in (*steer.rows, *engine.rows)} == {"log"}
    assert steer.point == plan.passes[0].condition.point


def test_the_form_names_what_does_not_vary(case_file, levels, tmp_path):
    same = fixed(planned(tmp_path / "a", case_file, pairs=12))
    assert "field.terrain.slope_percent 1.0" in same
    assert "combine.speed.speed_kmh 7.0" in same
    assert "combine.edge_side left" in same
    assert not any("stems_per_m2" in text or "field.stand.crop" in text for text in same)


def test_the_mean_distance_of_quantiles_is_how_far_heights_lie_apart(case_file):
    rng = np.random.default_rng(7)
    clouds = [
        np.concatenate([rng.normal(0.1, 0.03, 4000), rng.normal(high, 0.1, 4000)]) for high in (0.9, 0.6)
    ]
    seen = []
    for heights in clouds:
        setup = SimpleNamespace(name="m", machine=SimpleNamespace(mounting={"lidar": Pose.identity()}))
        evaluator = ScanHeights(setup)
        up = np.full(8000, np.pi / 2)
        scan = Scan(
            0, np.zeros(8000), np.zeros(8000), up, heights[:, None].astype(np.float32), heights[:, None]
        )
        evaluator.see("m.lidar", 0, {"scan": scan})
        evaluator.see("m.gnss", 0, {"scan": scan})  # it is not mounted
        seen.append(heights_of(evaluator.metrics()))
    assert np.abs(np.subtract(*seen)).mean() == pytest.approx(wasserstein1(*clouds), abs=0.01)
    assert heights_of(ScanHeights(setup).metrics()) is None


def test_levels_are_compared_by_what_scanners_see(case_file, tmp_path, monkeypatch):
    """A lower crop breaks no limit of a detector that knows the truth; its echoes lie lower."""
    case_file.write_text(CASE.replace("distance_m: 4", "distance_m: 0.4"), encoding="utf-8")
    monkeypatch.setattr("swath.tools.function_test.session.run_all", driven_here())
    asked = FieldPlan(str(case_file), metric=SCANS, pairs=8, runs=2, other=("field.stand.height_factor=0.7",))
    found = plan_field(tmp_path / "a", asked, 1, lambda result: None)
    assert all(0.02 < c.apart < 1.0 for c in found.conditions)


def test_what_was_met_and_never_checked_counts_of_the_parts_that_are_compared(case_file):
    points = draw(read_case(case_file), None, 4, 1)
    never = {"combine.lidar": ["rain_mm_h"], "combine.process": ["other_crop"]}
    results = [
        {"point": p, "verdict": "pass", "expect": [], "metrics": {"x": float(n * k)}, NEVER_CHECKED: never}
        for n, p in enumerate(points)
        for k in (0, 1)
    ]
    lidar = conditions_of(results, "x", None, ("combine.lidar.level=plants",))
    assert all(c.unchecked == ["combine.lidar rain_mm_h"] for c in lidar)
    assert not any(c.unchecked for c in conditions_of(results, "x", None, ("combine.speed.speed_kmh=5",)))


def test_a_dossier_says_what_is_not_shown_and_shows_the_evidence(tmp_path, monkeypatch):
    folder = tmp_path / "dossier"
    made = conducted(monkeypatch, folder, small_odd(tmp_path), 60, 3, lambda run, number: False)

    def work(run):
        off = 0.5 if run.candidate == OTHER and run.point[DENSITY] > 500 else 0.001 * (run.seed % 5)
        return {**result_of(run, False), "metrics": {"lateral_rms_m": off}}

    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(work))
    other = ("combine.motion.level=single_track",)
    found = planned(tmp_path / "a", folder, other=other, runs=3, pairs=30)
    assert all(0.0 < c.unshown <= 1.0 for c in found.conditions)
    assert all(made.odd.domain.holds(c.point) for c in found.conditions)
    assert found.passes[0].condition.point[DENSITY] > 500
    (folder / EVIDENCE).write_text("pass,conditions,compared,number,value\n1,speed 5,scans,heights,0.012\n")
    assert "Evidence from the field" in write_dossier(made).read_text(encoding="utf-8")


def test_a_case_without_another_level_is_refused(case_file, tmp_path):
    case_file.write_text(
        CASE.replace("combine.lidar.level: empirical", 'combine.lidar: "off"'), encoding="utf-8"
    )
    with pytest.raises(InputError, match="a level to compare with"):
        planned(tmp_path / "a", case_file)
