"""How often a recorder looks changes no byte on disk: now and then, every 20 ms or at every sample."""

import pytest

from swath.core.schedule import NS
from swath.record.recorder import Recorder
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import load_scenario

KERNELS = "combine.lidar.level=profile", "combine.header.level=profile"
POLE = {"t_s": 0.5, "set": "obstacles.pole", "value": "{kind: post, x_m: 20, y_m: 6}"}


class Counts(RunHook):
    """Counts how often the recorder looks, and the messages that are heard."""

    def __init__(self, *, hears):
        self.hears, self.looks, self.heard = hears, 0, {}

    def begin(self, run):
        take = run.recorder.take

        def counted(seen):
            self.looks += 1
            take(seen)

        run.recorder.take = counted
        if self.hears:
            run.recorder.file.taps.append(self.hear)

    def hear(self, topic, t, data, build, is_latched):
        self.heard.setdefault(topic, []).append((t, bytes(data)))
        assert build().__msgtype__


@pytest.mark.parametrize(
    ("scenario", "detail"), [("straight", "exact"), ("straight", "standard"), ("record-run", "full")]
)
def test_a_recording_is_the_same(scenario, detail, tmp_path, monkeypatch):
    sets = ["run.max_duration_s=1.0", "combine.lidar.level=empirical", f"run.record={detail}"]
    events = [POLE] if detail == "exact" else []
    ways = {"seldom": Counts(hears=False), "heard": Counts(hears=True), "each": Counts(hears=True)}
    for name, hook in ways.items():
        monkeypatch.setattr(Recorder, "is_late", name != "each")
        run_job(load_scenario(scenario, sets=sets), tmp_path / name, hooks=[hook], events=events)
        for file in ("run.mcap", "tracks.parquet"):
            assert (tmp_path / name / file).read_bytes() == (tmp_path / "seldom" / file).read_bytes(), file
    assert ways["heard"].heard == ways["each"].heard
    assert ways["seldom"].looks < 10 < 45 < ways["heard"].looks < 100 < ways["each"].looks


class Asks(RunHook):
    """Asks for the newest row before every tick, and notes the newest state."""

    READS_TRACKS = True

    def __init__(self):
        self.found = []

    def begin(self, run):
        def ask(t):
            state, (tracks,) = run.world.graph.latest("combine.motion", "state"), run.recorder.tracks.values()
            row = tracks.newest()
            self.found.append((t, state.t / NS, row["t_s"][0], state.distance, row["distance_m"][0]))

        run.world.graph.before_tick.append(ask)


def test_whoever_asks_for_the_newest_row_gets_it_between_two_looks():
    hook = Asks()
    run_unrecorded(load_scenario("straight", sets=["run.max_duration_s=0.6", *KERNELS]), hooks=[hook])
    assert len(hook.found) > 100
    assert all(t == row_t and way == row_way for _, t, row_t, way, row_way in hook.found)
    assert {t for _, t, *_ in hook.found} > {0.0, 0.5}
