"""A run folder from start to end: what is in it, that a limit counts, that Ctrl-C leaves something valid."""

import json

import numpy as np
import pytest
from benchmarks.sub_rays import study

from swath.commands.main import main
from swath.core.errors import InputError
from swath.report.report import ReportWriter
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from swath.tools.scan.scan import scan_job
from tests.whole.small import TEXT, small

CONTRACT = {
    "edge_rmse_m",
    "edge_bias_m",
    "detection_availability",
    "lateral_rms_m",
    "lateral_p95_m",
    "lateral_bias_m",
    "header_use",
    "uncut_area_m2",
    "area_cut_m2",
    "grain_cut_kg",
    "mass_balance_error",
    "distance_m",
    "real_time_factor",
    "ray_count",
    "digest",
    "incomplete",
    "expect",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "small"
    return run_job(small(), out, hooks=[ReportWriter()]), out


@pytest.mark.drawn
def test_folder_and_summary_keep_the_contract(finished):
    result, out = finished
    assert {p.name for p in out.iterdir()} == {
        "summary.json",
        "tracks.parquet",
        "metadata.yaml",
        "run.mcap",
        "report.html",
        "scenario.yaml",
    }
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary) >= CONTRACT
    assert summary["incomplete"] is False
    assert summary["distance_m"] >= 4.0
    assert summary["area_cut_m2"] > 12.0
    assert summary["mass_balance_error"] < 1e-9
    assert summary["header_use"] is None  # nothing counts before 10 m of settling
    assert summary["area_cut_m2"] / (12.3 * summary["distance_m"]) > 0.9
    assert result.exit_code == 0


def test_the_resolved_scenario_runs_to_the_same_digest(finished, tmp_path):
    result, out = finished
    again = run_job(load_scenario(out), tmp_path / "again")
    assert again.summary["digest"] == result.summary["digest"]


def test_a_broken_limit_is_exit_code_1(tmp_path, capsys):
    file = tmp_path / "s.yaml"
    file.write_text(TEXT + "expect:\n  area_cut_m2: {min: 1000}\n")
    code = main(["run", str(file), "--out", str(tmp_path / "out"), "--set", "run.max_duration_s=0.2"])
    assert code == 1
    assert "fail    combine.area_cut_m2" in capsys.readouterr().out


def test_ctrl_c_leaves_a_valid_folder_marked_incomplete(tmp_path):
    class Stop(RunHook):
        def begin(self, run):
            run.observers.insert(0, self.see)

        def see(self, slot, t, outputs):
            if t >= 400_000_000:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_job(small(), tmp_path / "cut", hooks=[ReportWriter(), Stop()])
    summary = json.loads((tmp_path / "cut" / "summary.json").read_text())
    assert summary["incomplete"] is True
    from mcap.reader import make_reader

    with (tmp_path / "cut" / "run.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert 300_000_000 < max(times) <= 400_000_000
    from pyarrow.parquet import read_table

    assert read_table(tmp_path / "cut" / "tracks.parquet").num_rows > 10


def test_several_echoes_reach_the_files_of_a_scan(tmp_path):
    sets = [
        f"combine.lidar.{s}" for s in ("echo=all", "within=nearest", "sub_rays=19", "sensor=sick-lms511-sr")
    ]
    scan_job(small(*sets), tmp_path / "scan", formats=["csv", "npz", "ply"])
    assert sorted(f.name for f in (tmp_path / "scan").iterdir()) == [
        "scan.csv",
        "scan.npz",
        "scan.of.txt",
        "scan.ply",
    ]
    data = np.load(tmp_path / "scan" / "scan.npz")
    ranges, intensity = data["ranges_m"], data["intensity"]
    assert ranges.shape == intensity.shape == (81, 5)
    both = np.isfinite(ranges[:, 1])
    assert 1 <= both.sum() < 81
    assert (ranges[both, 1] - ranges[both, 0]).min() > 0.6  # half the pulse less noise
    assert np.isfinite(data["points_true_m"][both, 1]).all()
    with (tmp_path / "scan" / "scan.csv").open() as file:
        numbers = [int(line.split(",")[1]) for line in file.readlines()[1:]]
    assert numbers.count(1) == both.sum()


def test_heights_converge_with_the_number_of_sub_rays():
    rows, sentence = study(small())
    runs = [(3, "full"), (4, "full"), (3, "reduced")]
    counts = (1, 7, 19, 37, 61)
    assert [(r["seed"], r["detail"], r["sub_rays"]) for r in rows] == [
        (*run, n) for run in runs for n in counts
    ]
    for run in runs:
        own = [r for r in rows if (r["seed"], r["detail"]) == run]
        change = [r["change_rms_m"] for r in own]
        assert change[0] > change[1] > change[2] > change[-1] == 0.0
        assert abs(own[2]["mean_m"] - own[-1]["mean_m"]) < 0.01
    assert "sub-rays" in sentence
    assert "detail `reduced` move the heights by W1" in sentence
    at_most = {(r["seed"], r["detail"]): r["w1_mm"] for r in rows if r["sub_rays"] == 61}
    assert at_most[3, "full"] == 0.0
    assert 0.0 < at_most[3, "reduced"] < 0.5 * at_most[4, "full"]


def test_a_scan_is_not_taken_after_the_end_of_the_run(tmp_path):
    with pytest.raises(InputError, match="expected a time of the run, which ends at"):
        scan_job(small("run.max_duration_s=0.5"), tmp_path / "scan", at_s=90.0, formats=["csv"])


@pytest.mark.drawn
def test_scan_writes_a_picture_and_files(tmp_path):
    files = scan_job(small(), tmp_path / "scan", at_s=0.3)
    assert [f.name for f in files] == ["scan.png", "scan.csv", "scan.npz", "scan.ply"]
    lines = (tmp_path / "scan" / "scan.csv").read_text().splitlines()
    assert lines[0].startswith("beam,echo,time_s")
    assert len(lines) > 60
