"""A recorded run again with the log in the place of slots: everything else comes out to the last bit."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.registry import Level
from swath.documents.yaml_document import read_document
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.mcap_log import McapLog
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.machine_types import MACHINE_TYPES
from swath.tools.rerun.comparison import RecordingComparison
from swath.tools.rerun.rerun import plan_rerun
from tests.whole.small import small


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("again") / "run"
    run_job(small("run.record=full", "run.distance_m=2.5", "combine.lidar.sub_rays=1"), folder)
    return folder


def again(source, out, slots=None, sets=()):
    plan = plan_rerun(source, slots=slots, sets=["run.record=full", *sets])
    return plan, plan.run(out, report=False).summary


def identical(summary):
    return {slot: told["identical"] for slot, told in summary["rerun"]["slots"].items()}


def test_sensors_and_motion_from_the_log_leave_the_rest_as_it_was(recorded, tmp_path):
    plan, summary = again(recorded, tmp_path / "out")
    assert plan.played == ("combine.motion", "combine.lidar", "combine.odometry", "combine.imu")
    told = identical(summary)
    assert set(told) == {f"combine.{s}" for s in ("header", "process", "edge", "steer", "speed", "steering")}
    assert all(told.values())
    before = json.loads((recorded / "summary.json").read_text())
    assert summary["digest"] == before["digest"]  # the played slots too
    assert summary["edge_rmse_m"] == before["edge_rmse_m"]
    assert summary["simulated_s"] == before["simulated_s"]
    assert any("lidar: form: plays combine.lidar of" in note for note in summary["notes"])


TOGETHER = (
    ("motion", "imu"),
    ("header", "lidar", "speed"),
    ("process", "odometry", "edge", "steering"),
    ("steer",),
)


@pytest.mark.parametrize("slots", TOGETHER, ids="+".join)
def test_any_slot_may_be_the_log(recorded, tmp_path, slots):
    """Everything upstream is recorded, so everything downstream must be the same: so must the digest."""
    alone = tmp_path / "sent.mcap"  # the file is enough
    alone.write_bytes((recorded / "run.mcap").read_bytes())
    plan, summary = again(alone, tmp_path / "out", slots)
    assert plan.played == tuple(f"combine.{slot}" for slot in slots)
    assert all(identical(summary).values())
    assert len(identical(summary)) == 10 - len(slots)
    assert summary["digest"] == json.loads((recorded / "summary.json").read_text())["digest"]


def test_a_played_steering_law_keeps_its_overlap(recorded):
    """Against which metrics and the report measure the lateral error."""
    meant = assemble(small()).machines["combine"].overlap
    assert meant != 0.0
    assert assemble(plan_rerun(recorded, slots=["steer"]).scenario).machines["combine"].overlap == meant


def test_that_was_every_slot():
    assert {s for slots in TOGETHER for s in slots} == set(MACHINE_TYPES["combine"])


def test_another_detector_changes_what_hangs_on_it_and_nothing_else(recorded, tmp_path):
    _, summary = again(recorded, tmp_path / "out", sets=["combine.edge.level=otsu"])
    told = identical(summary)
    assert not told["combine.edge"]
    assert told["combine.header"]
    assert told["combine.process"]
    assert "edge: " in summary["rerun"]["slots"]["combine.edge"]["differs_in"]
    first = summary["rerun"]["slots"]["combine.edge"]["differs_from_s"]
    assert summary["rerun"]["slots"]["combine.steer"]["differs_from_s"] > first


def test_a_cut_log_ends_the_run_where_it_ends(recorded, tmp_path):
    data = (recorded / "run.mcap").read_bytes()
    alone = tmp_path / "cut.mcap"
    alone.write_bytes(data[: int(0.6 * len(data))])
    _, summary = again(alone, tmp_path / "out")
    log = McapLog(alone)
    assert not summary["incomplete"]
    assert all(identical(summary).values())
    assert 0.3 < summary["simulated_s"] < 2.0
    ended = [n for n in summary["notes"] if "ended at" in n]
    assert len(ended) == 1
    assert summary["ended"] == {"reason": "log_over", "text": ended[0]}
    [cut] = [n for n in summary["notes"] if "lidar: damaged: recording broke off after" in n]
    list(log.messages(log.topics()))
    assert next(iter(log.notes)) in cut


@pytest.mark.parametrize(("shifted", "is_same"), [(5, False), (-1, True)])
def test_a_sample_at_another_time_is_a_difference_but_for_a_shorter_last_step(recorded, shifted, is_same):
    log = McapLog(recorded / "run.mcap")
    slot = "combine.process"
    samples = list(exact_samples(log.messages([exact_topic(slot, "load")])))[:12]
    compared = RecordingComparison(McapLog(recorded / "run.mcap"), [slot], played=())
    times = [t for t, _ in samples]
    times[shifted] -= 1_000_000
    for t, (_, sample) in zip(times, samples, strict=True):
        compared(slot, t, {"load": sample})
    found = compared.summarize(times[-1])["rerun"]["slots"][slot]
    assert found["identical"] == is_same
    assert ("another time" in found.get("differs_in", "")) != is_same


def test_a_killed_run_can_be_played(tmp_path):
    out = tmp_path / "killed"
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from tests.whole.small import small\n"
        "from swath.runtime.hooks import RunHook\n"
        "from swath.runtime.job import run_job\n"
        "class Kill(RunHook):\n"
        "    def begin(self, run): run.observers.append(self)\n"
        "    def __call__(self, slot, t, outputs):\n"
        "        if t > 1.8 * 10**9: os.kill(os.getpid(), signal.SIGKILL)\n"
        "run_job(small('run.record=full'), Path(sys.argv[1]), hooks=[Kill()])\n"
    )
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code, str(out)], env=env, check=False)
    assert done.returncode == -signal.SIGKILL
    assert not (out / "summary.json").exists()
    _, summary = again(out, tmp_path / "out")
    assert all(identical(summary).values())
    assert 0.5 < summary["simulated_s"] < 1.81
    assert any("recording broke off after" in n for n in summary["notes"])


def test_on_the_command_line(recorded, tmp_path, capsys):
    assert (
        main(["rerun", str(recorded / "run.mcap"), "--slots", "combine.lidar", "--out", str(tmp_path / "a")])
        == 0
    )
    text = capsys.readouterr().out
    assert "played from the log: combine.lidar" in text
    assert text.count("identical") == 9
    assert {p.name for p in (tmp_path / "a").iterdir()} >= {"summary.json", "run.mcap", "report.html"}
    written = read_document(tmp_path / "a" / "scenario.yaml").data
    assert written["machines"]["combine"]["lidar"]["level"] == "log"
    assert written["machines"]["combine"]["lidar"]["rate_hz"] == 25


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (["--slots", "lider"], "--slots = lider: expected some of combine.motion"),
        (["--slots", "combine.process,cart.lidar"], "--slots = cart.lidar"),
        (["--set", "combine.edge.levle=otsu"], "unknown key"),
    ],
)
def test_what_cannot_be_is_said(recorded, tmp_path, capsys, args, text):
    assert main(["rerun", str(recorded), "--out", str(tmp_path / "no"), *args]) == 2
    assert text in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_the_recording_is_not_written_over(recorded, capsys):
    before = (recorded / "run.mcap").read_bytes()
    assert main(["rerun", str(recorded), "--out", str(recorded)]) == 2
    assert "expected a new or empty folder" in capsys.readouterr().err
    assert main(["rerun", str(recorded), "--out", str(recorded), "--replace"]) == 2
    assert "expected another folder, run.mcap in it is played" in capsys.readouterr().err
    assert (recorded / "run.mcap").read_bytes() == before


def test_a_recording_without_samples_is_refused(tmp_path):
    run_job(small("run.record=standard", "run.distance_m=0.2"), tmp_path / "plain")
    with pytest.raises(InputError, match=r"run\.record: exact"):
        plan_rerun(tmp_path / "plain")


def test_what_was_changed_on_the_way_is_changed_again(tmp_path):
    events = [
        {"t_s": 0.3, "set": "combine.speed.speed_kmh", "value": 5},
        {"t_s": 0.4, "set": "combine.odometry.level", "value": "ideal"},  # of a slot that is played then
    ]
    run_job(small("run.distance_m=1"), tmp_path / "changed", events=events)
    plan = plan_rerun(tmp_path / "changed")
    summary = plan.run(tmp_path / "out", report=False).summary
    assert all(identical(summary).values())
    assert summary["events"] == events[:1]


def test_save_and_load_in_the_middle_of_a_log(recorded):
    from swath.record.digest import Digest
    from swath.runtime.assembly import assemble
    from swath.runtime.loop import drive

    plan = plan_rerun(recorded)
    whole, first = Digest(), Digest()
    drive(assemble(plan.scenario), [whole])
    world = assemble(plan.scenario)
    drive(world, [first], until_s=1.0)
    other = assemble(plan.scenario)
    other.load(world.save())
    drive(other, [first], resume=True)
    assert first.hex == whole.hex


def test_a_link_level_is_listed():
    from swath.scenario.slots import CATALOGUE

    assert "log" in CATALOGUE.registry.links()
    level = CATALOGUE.registry.get("steer", "log")
    assert isinstance(level, Level)
    assert level.is_link
    assert replace(level.params(), start_s=1.0).start_s == 1.0
