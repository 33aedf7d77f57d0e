"""`swath test compare`: bytes, verdicts, differences; on made results, and on one that was run."""

from pathlib import Path

import numpy as np
import pytest

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


def test_the_interval_holds_the_difference_as_often_as_it_says():
    """Also with a run now and then that goes wild, which upsets a mean."""
    rng, held = np.random.default_rng(6), 0
    for _ in range(400):
        values = rng.normal(0.01, 0.03, 20)
        values[rng.random(20) < 0.05] += 5.0 * rng.choice([-1, 1])
        told = difference(values)
        held += told.low <= 0.01 <= told.high
    assert 0.92 <= held / 400 <= 0.985


def test_a_margin_is_shown_only_when_both_sides_exclude_more():
    rng = np.random.default_rng(7)
    for count, shown in ((6, False), (200, True)):
        assert (difference(rng.normal(0.0, 0.01, count)).within <= 0.003) == shown


def test_what_would_have_been_seen_is_seen_in_four_of_five_cases():
    rng, seen = np.random.default_rng(8), 0
    size = 0.03 * 2.8016 / np.sqrt(30 * 0.955)
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
