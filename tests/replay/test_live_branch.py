"""Back and branch in the live page: another run goes on, the page follows it, and a fresh run is the same."""

import json
import threading

import pytest

pytest.importorskip("websockets")

from swath.replay.live.view import LiveView
from swath.runtime.changes import read_events
from swath.runtime.job import run_job
from swath.runtime.run_control import RunControl
from swath.runtime.saves import Saves
from swath.scenario.scenario import parse_scenario
from tests.replay.test_live import TEXT, Watcher
from tests.waiting import PATIENCE_S, ended, until


class Going:
    """A run in a thread of its own, saved on the way or not."""

    def __init__(self, out, saves=None):
        self.control = RunControl(is_paused=True, saves=saves)
        self.view, self.made, self.error = LiveView(self.control), None, None
        self._hooks = [self.view, *([saves] if saves else [])]
        self._thread = threading.Thread(target=self._drive, args=(out,), daemon=True)
        self._thread.start()

    def _drive(self, out):
        try:
            self.made = run_job(parse_scenario(TEXT), out, hooks=self._hooks)
        except BaseException as error:
            self.error = error
        finally:
            self.view.close()

    def end(self):
        self.control.pause(False)
        ended(self._thread)
        assert self.error is None
        return self.made


def test_back_another_parameter_and_on(tmp_path):
    going = Going(tmp_path / "run", Saves(0.4))
    page = Watcher(going.view)
    assert page.is_there.wait(PATIENCE_S)
    assert page.ask("set", key="combine.edge.level", value="otsu")[0]
    assert going.control.step(2.0)[0]
    until(lambda: page.states[-1]["no_way_back"] == "", "the page knows of a way back")
    change = {"key": "combine.speed.speed_kmh", "value": "4"}
    ok, text = page.ask("branch", at_s=9.0, **change)
    assert (ok, "expected a time of the run, above 0 and up to 2" in text) == (False, True)
    ok, text = page.ask("branch", at_s=1.5, key="combine.speed.speed_kmh", value="-3")
    assert (ok, "combine.speed.speed_kmh = -3" in text) == (False, True)
    shown = len(page.frames)
    ok, text = page.ask("branch", at_s=1.5, **change)
    assert (ok, text) == (True, f"goes on from 1.5 s in {tmp_path / 'run-branch'}")
    second = Watcher(going.view)  # the page that was told to load again
    assert second.is_there.wait(PATIENCE_S)
    assert going.control.step() == (True, "at 1.5 s")  # paused again where it goes on
    made = going.end()
    assert len(page.frames) >= shown
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["incomplete"]
    assert made.folder == tmp_path / "run-branch"
    assert made.summary["branch"] == {"of": "run", "at_s": 1.5, "saved_s": pytest.approx(1.2, abs=0.03)}
    assert not made.summary["incomplete"]
    fresh = run_job(parse_scenario(TEXT), tmp_path / "fresh", events=read_events(made.folder)).summary
    assert fresh["events"] == made.summary["events"]
    assert fresh["digest"] == made.summary["digest"]
    for name in ("tracks.parquet", "run.mcap"):
        assert (made.folder / name).read_bytes() == (tmp_path / "fresh" / name).read_bytes()


def test_without_saves_the_page_says_why_there_is_no_way_back(tmp_path):
    going = Going(tmp_path / "run")
    page = Watcher(going.view)
    assert page.is_there.wait(PATIENCE_S)
    assert going.control.step(0.1)[0]
    ok, text = page.ask("branch", at_s=0.05, key="combine.speed.speed_kmh", value="4")
    assert (ok, text) == (False, page.states[-1]["no_way_back"])
    assert "--save-every" in text
    assert going.end().folder == tmp_path / "run"
