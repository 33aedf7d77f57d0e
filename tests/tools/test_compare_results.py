"""`swath test compare`: bytes, verdicts, differences; on made results, and on one that was run."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.decisions import LEFT_OUT, SEEN, called_better, held

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.function_test.compare import METRICS, SAME_BYTES, WORSE, Comparison, compare
from swath.tools.function_test.journal import write_table
from swath.tools.function_test.judging.paired import difference, holm, verdict_test
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin
from tests.tools.fake_work import driven_here

FIELD_SD, NOISE_SD = 0.03, 0.006  # of a metric between fields, and of one field between two versions [m]


def made(rng, count, bias=0.0, changed=1.0, field=None):
    """Results of a version: metrics of the same fields, with noise of its own in a share of the runs."""
    field = np.random.default_rng(1).normal(0, FIELD_SD, count) if field is None else field
    rows = []
    for i in range(count):
        is_changed = i < changed * count
        value = field[i] + is_changed * (bias + rng.normal(0, NOISE_SD))
        metrics = {"lateral_bias_m": value, "lateral_rms_m": abs(value) + 0.02, "edge_bias_m": value + 0.01}
        rows.append(
            {
                "id": f"{i:016x}", "case": "a" if i % 2 else "b", "candidate": "base", "point": {"x": i // 4},
                "seed": i % 4, "verdict": "pass" if abs(value) < 0.08 else "fail", "reason": "",
                "metrics": metrics, "expect": [], "incidents": [],
                "digest": f"{value if is_changed else i}",
            }
        )  # fmt: skip
    return rows


def in_memory(old, new):
    return Comparison(list(zip(old, new, strict=True)), METRICS, 0)


def stored(folder: Path, rows) -> str:
    folder.mkdir(exist_ok=True)
    write_table(folder, rows)
    return str(folder)


@pytest.fixture
def folders(tmp_path):
    return lambda old, new: (stored(tmp_path / "old", old), stored(tmp_path / "new", new))


def test_what_did_not_change_is_the_same_bytes(folders, capsys):
    rng = np.random.default_rng(4)
    old, new = folders(made(rng, 40, changed=0.0), made(rng, 40, changed=0.0))
    found = compare(old, new)
    assert found.outcomes == [SAME_BYTES] * 40
    assert not found.shown
    assert main(["test", "compare", old, new]) == 0
    assert "40 of 40 pairs are the same bytes" in capsys.readouterr().out


def test_equal_versions_are_told_apart_in_one_of_twenty_comparisons_at_most():
    """200 comparisons of 24 pairs that differ by noise alone."""
    false = 0
    for trial in range(200):
        rng = np.random.default_rng(trial)
        false += bool(in_memory(made(rng, 24), made(rng, 24)).shown)
    assert false <= 10


def test_a_bias_of_1_cm_is_found_in_20_pairs():
    found = 0
    for trial in range(50):
        rng = np.random.default_rng(1000 + trial)
        found += "lateral_bias_m" in in_memory(made(rng, 20), made(rng, 20, bias=0.01)).shown
    assert found >= 47  # sd of a difference 0.85 cm
    quiet = [made(np.random.default_rng(5), 20), made(np.random.default_rng(5), 20, bias=0.01)]
    told = in_memory(*quiet).differences["lateral_bias_m"]
    assert told.estimate == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize("name", [*SEEN, *LEFT_OUT])
def test_the_interval_holds_the_mean_of_differences_that_few_runs_decide(name):
    """As often as it says less five deviations; what is worse is called better less often than that."""
    rng, family = np.random.default_rng([6, *name.encode()]), {**SEEN, **LEFT_OUT}[name]
    own, student = held(family, rng, 32, 200, 0.95)
    assert own >= max(student, 190 - 5 * 3.1)
    assert called_better(family, rng, 60, 0.95) <= 60 * 0.025 + 5 * 1.2


def test_student_alone_does_not_hold_the_mean_that_few_runs_decide():
    """So the drawn differences can tell an interval that holds from one that does not."""
    own, student = held(SEEN["bad runs, one way"], np.random.default_rng(6), 32, 400, 0.95)
    assert own - student > 5


def test_rare_harm_is_chosen_and_proven_by_the_mean():
    """Better by 0.1 in nine of ten runs, worse by 1.5 in the others: worse by the mean, better by the median.

    No run is bad in 0.3 % of the samples of 48 to 80 pairs; only there is it called better.
    """
    rng = np.random.default_rng(11)
    drawn = [np.where(rng.random(int(n)) < 0.1, -1.5, 0.1) for n in rng.integers(48, 81, 300)]
    told = [difference(d.tolist()) for d in drawn]
    assert sum(t.low > 0.0 for t in told) <= 6
    assert sum(t.low <= -0.06 <= t.high for t in told) >= 276
    assert all(t.estimate == pytest.approx(float(d.mean())) for t, d in zip(told, drawn, strict=True))


def test_beside_what_is_better_stands_what_the_runs_cannot_exclude(folders, capsys):
    """60 pairs: 3 / 60, and the six pairs in which the error grows most."""
    rows = [{**row, "verdict": "pass"} for row in made(np.random.default_rng(3), 60)]
    less = [{**row, "digest": f"n{i}",
             "metrics": {"lateral_rms_m": row["metrics"]["lateral_rms_m"] + (0.01 if i < 3 else -0.02)}}
            for i, row in enumerate(rows)]  # fmt: skip
    assert main(["test", "compare", *folders(rows, less), "--metric", "lateral_rms_m"]) == 0
    said = "lateral_rms_m better: 60 pairs cannot exclude harm in 5 % of runs, worst tenth -0.005"
    assert said in capsys.readouterr().out


def test_a_limit_that_all_runs_of_both_break_is_named(folders, capsys):
    broken = {
        "subject": "combine",
        "name": "distance_m",
        "limit": {"min": 25},
        "value": 4.0,
        "result": "fail",
    }
    rows = [{**row, "verdict": "fail", "expect": [broken]} for row in made(np.random.default_rng(3), 6)]
    assert main(["test", "compare", *folders(rows, rows)]) == 0
    assert "note    all 12 runs break combine.distance_m (min 25)" in capsys.readouterr().out


@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_what_is_shown_is_what_the_interval_excludes(confidence):
    """Whatever is drawn; a sign that all pairs have is not shown by so few that chance gives it."""
    rng = np.random.default_rng(12)
    for family in (*SEEN.values(), *LEFT_OUT.values()):
        for _ in range(20):
            d, _ = family(rng, int(rng.integers(2, 40)))
            told = difference(d.tolist(), confidence)
            assert (told.p <= 1.0 - confidence) == (not told.low <= 0.0 <= told.high)
            assert difference((-d[::-1]).tolist(), confidence).estimate == -told.estimate
            assert told.p >= 2.0 ** (1 - len(d))
            assert told.worst_tenth("higher") <= told.estimate <= told.worst_tenth("lower")


def test_a_margin_is_shown_only_when_both_sides_exclude_more():
    rng = np.random.default_rng(7)
    for count, shown in ((6, False), (200, True)):
        assert (difference(rng.normal(0.0, 0.01, count)).within <= 0.003) == shown


def test_what_would_have_been_seen_is_seen_in_four_of_five_cases():
    rng, seen = np.random.default_rng(8), 0
    size = 0.03 * 2.8993 / np.sqrt(30)  # Student's quantiles of 29 degrees of freedom
    for _ in range(300):
        values = rng.normal(size, 0.03, 30)
        seen += difference(values).p <= 0.05
    assert 0.74 <= seen / 300 <= 0.87


def test_verdicts_are_judged_by_those_that_changed():
    assert verdict_test(0, 5) == pytest.approx(0.0625)  # 2 / 2^5
    assert verdict_test(0, 6) == pytest.approx(0.03125)
    assert verdict_test(0, 0) == 1.0
    assert holm({"a": 0.01, "b": 0.03, "c": 0.04}) == {"a"}  # 0.05 / 3, then 0.05 / 2
    assert holm({"a": 0.01, "b": 0.02, "c": 0.04}) == {"a", "b", "c"}


def test_a_version_that_fails_more_often_is_worse(folders, capsys):
    rows = made(np.random.default_rng(9), 40, changed=0.0)
    rows = [{**row, "verdict": "pass"} for row in rows]
    worse = [
        {**row, "verdict": "fail" if i < 12 else "pass", "digest": f"n{i}"} for i, row in enumerate(rows)
    ]
    old, new = folders(rows, worse)
    assert main(["test", "compare", old, new]) == 1
    assert main(["test", "compare", new, old]) == 0
    assert compare(old, new).outcomes.count(WORSE) == 12
    assert "verdicts: worse" in capsys.readouterr().out


def test_results_without_common_runs_and_other_folders_are_refused(folders, tmp_path):
    rows = made(np.random.default_rng(1), 4)
    old, new = folders(rows, [{**row, "seed": 90} for row in rows])
    for pair in ((old, new), (old, str(tmp_path)), (f"{old}:otsu", new)):
        with pytest.raises(InputError, match="expected"):
            compare(*pair)


CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set: {run.distance_m: 2, run.record: none, combine.lidar: {level: empirical, step_deg: 2}}
seeds: 2
expect: {distance_m: {min: 1}}
"""


def test_candidates_of_one_folder_that_were_run(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("swath.tools.function_test.session.run_all", driven_here())
    (tmp_path / "drives.yaml").write_text(CASE, encoding="utf-8")
    (tmp_path / "them.yaml").write_text(
        "base: {}\nnamed: {combine.edge.fault: {latency_ms: 0}}\nslow: {combine.speed.speed_kmh: 5}\n",
        encoding="utf-8",
    )
    out = str(tmp_path / "out")
    main(["test", "run", str(tmp_path / "drives.yaml"), "--with", str(tmp_path / "them.yaml"),
          "--out", out, "--workers", "1"])  # fmt: skip
    assert compare(f"{out}:base", f"{out}:named").outcomes == [SAME_BYTES] * 2
    assert compare(f"{out}:base", f"{out}:slow").outcomes.count(SAME_BYTES) == 0
    capsys.readouterr()


@pytest.mark.parametrize(
    ("level", "change", "bias", "expected"),
    [
        ("empirical", "combine.edge.level=otsu", 0.01, "undecided at empirical"),
        ("empirical", "combine.edge.level=otsu", 0.06, "changed"),
        ("empirical", "combine.edge.hold_m=3", 0.01, "changed"),
        ("plants", "combine.edge.level=otsu", 0.01, "changed"),
    ],
)
def test_the_cheap_level_does_not_rank_detectors_that_differ_by_less_than_its_bias(
    tmp_path, level, change, bias, expected
):
    text = CASE.replace("level: empirical, step_deg: 2", f"level: {level}").replace("seeds: 2", "seeds: 4")
    (tmp_path / "drives.yaml").write_text(text, encoding="utf-8")
    plan = Plan(str(tmp_path / "drives.yaml"), candidates={"base": (), "other": (change,)})
    begin(tmp_path / "out", plan)
    rng = np.random.default_rng(4)
    rows = [
        {**row, "candidate": name, "id": f"{name} {row['id']}"}
        for name, shift in (("base", 0.0), ("other", bias))
        for row in made(rng, 40, bias=shift)
    ]
    stored(tmp_path / "out", rows)
    found = compare(f"{tmp_path / 'out'}:base", f"{tmp_path / 'out'}:other", ["edge_bias_m"])
    assert found.says("edge_bias_m") == expected
