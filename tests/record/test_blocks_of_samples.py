"""What a recorder takes in blocks is on disk what it writes sample by sample, byte for byte."""

import pytest

from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

POLE = {"t_s": 0.5, "set": "obstacles.pole", "value": "{kind: post, x_m: 20, y_m: 6}"}


class Hears(RunHook):
    """Has somebody hear the messages: then each sample is written at its time."""

    def begin(self, run):
        run.recorder.file.taps.append(lambda *message: None)
        assert not run.recorder.is_late


class Beside(RunHook):
    """Watches how the recorder goes along."""

    def begin(self, run):
        self.recorder = run.recorder
        assert run.recorder.is_late


@pytest.mark.parametrize(
    ("scenario", "detail"), [("straight", "exact"), ("straight", "standard"), ("record-run", "full")]
)
def test_a_recording_is_the_same(scenario, detail, tmp_path):
    sets = ["run.max_duration_s=1.0", "combine.lidar.level=empirical", f"run.record={detail}"]
    hooks, events = [Beside(), Hears()], [POLE] if detail == "exact" else []
    for name, hook in zip(("blocks", "each"), hooks, strict=True):
        run_job(load_scenario(scenario, sets=sets), tmp_path / name, hooks=[hook], events=events)
    for file in ("run.mcap", "tracks.parquet"):
        assert (tmp_path / "blocks" / file).read_bytes() == (tmp_path / "each" / file).read_bytes(), file
    assert hooks[0].recorder.is_late
