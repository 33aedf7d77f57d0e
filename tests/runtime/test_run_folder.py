"""A run folder whatever happens to the run: stopped, killed, a full disk, two runs at once."""

import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from swath import __version__
from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.files.output_folder import LOCK, held
from swath.core.files.whole_file import NamedFile, write_whole
from swath.core.process.stopping import Terminated, stoppable, unstopped
from swath.record import mcap_file
from swath.record.mcap_file import McapFile
from swath.report.report import ReportWriter
from swath.runtime import job
from swath.runtime.folder import choose_run_folder, occupied, run_name
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from tests.link.fmu_scenario import scenario

pytestmark = pytest.mark.usefixtures("code_allowed")

SHORT = "run.max_duration_s=0.4"
ROOT = Path(__file__).parents[2]


class Send(RunHook):
    """Sends a signal in the middle of a run, or when its report is drawn."""

    def __init__(self, number, *, at_report=False):
        self.number, self.at_report = number, at_report

    def begin(self, run):
        if not self.at_report:
            run.observers.insert(0, self.see)

    def see(self, slot, t, outputs):
        if t >= 200_000_000:
            signal.raise_signal(self.number)

    def finish(self, summary):
        if self.at_report:
            signal.raise_signal(self.number)


def python(code, *args):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    return subprocess.run([sys.executable, "-c", code, *args], env=env, capture_output=True, text=True)


@pytest.mark.parametrize(
    ("number", "kind"), [(signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)]
)
def test_both_signals_leave_a_summary_that_says_incomplete(tmp_path, number, kind):
    before = signal.getsignal(number)
    with pytest.raises(kind):
        run_job(scenario(SHORT), tmp_path / "run", hooks=[Send(number)])
    assert signal.getsignal(number) is before
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["incomplete"] is True
    assert not (tmp_path / "run" / LOCK).exists()


@pytest.mark.parametrize(
    "name", ["write_whole", "Recorder", "Interventions", "make_evaluation", "_progress_bar", "drive"]
)
def test_a_stop_while_a_run_begins_leaves_a_summary_too(monkeypatch, tmp_path, name):
    """From the folder on, before and after each of what is made there."""
    made = getattr(job, name)

    for is_after in (False, True):

        def stopped(*args, is_after=is_after, **kwargs):
            if not is_after:
                signal.raise_signal(signal.SIGTERM)
            found = made(*args, **kwargs)
            if is_after:
                signal.raise_signal(signal.SIGTERM)
            return found

        monkeypatch.setattr(job, name, stopped)
        folder = tmp_path / f"run {is_after}"
        with pytest.raises(Terminated):
            run_job(scenario(SHORT), folder, hooks=[ReportWriter()])
        assert json.loads((folder / "summary.json").read_text())["incomplete"] is True
        assert not (folder / LOCK).exists()


class Finalized:
    """Is sent a signal where Python drops the exception."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_stop_in_a_finalizer_is_not_lost(tmp_path):
    class Drop(RunHook):
        def begin(self, run):
            run.observers.append(lambda slot, t, outputs: Finalized() if t == 100_000_000 else None)

    with pytest.raises(Terminated):
        run_job(scenario("run.max_duration_s=0.6"), tmp_path / "run", hooks=[Drop()])
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["incomplete"] is True


def test_the_exit_code_of_sigterm_is_143(monkeypatch, tmp_path, capsys):
    def stop(args):
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("swath.commands.scenarios.run", stop)
    assert main(["scenarios"]) == 143
    assert capsys.readouterr().err == "swath: stopped\n"


def test_a_stop_waits_until_the_summary_is_whole(monkeypatch, tmp_path):
    def write(folder, summary):
        signal.raise_signal(signal.SIGTERM)
        write_whole(folder / "summary.json", json.dumps(summary))

    monkeypatch.setattr("swath.runtime.job.write_summary", write)
    with pytest.raises(Terminated):
        run_job(scenario(SHORT), tmp_path / "run")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["incomplete"] is False


def test_a_run_stopped_while_its_report_was_drawn_gets_one(tmp_path, capsys):
    folder = tmp_path / "run"
    with pytest.raises(Terminated):
        run_job(scenario(SHORT), folder, hooks=[Send(signal.SIGTERM, at_report=True), ReportWriter()])
    summary = (folder / "summary.json").read_text()
    assert json.loads(summary)["incomplete"] is False
    assert not (folder / "report.html").exists()
    assert main(["report", str(folder)]) == 0
    assert capsys.readouterr().out == f"{folder}/report.html\n"
    assert json.loads(summary)["digest"] in (folder / "report.html").read_text()
    assert (folder / "summary.json").read_text() == summary


def test_the_report_of_a_killed_run_shows_what_it_left_and_says_so(tmp_path, capsys):
    """A kill leaves a recording without an end, and no summary."""
    folder = tmp_path / "run"
    run_job(scenario(SHORT), folder)
    (folder / "summary.json").unlink()
    recording = folder / "run.mcap"
    recording.write_bytes(recording.read_bytes()[: recording.stat().st_size * 2 // 3])
    assert main(["report", str(folder)]) == 0
    assert "note    the run was killed" in capsys.readouterr().out
    page = (folder / "report.html").read_text()
    assert "the run was killed: this is what its recording holds" in page
    assert "Incomplete." in page
    recording.unlink()
    assert main(["report", str(folder)]) == 2
    (folder / "run.lock").write_text("{}")
    with held(folder, ("*",), "run"):
        assert main(["report", str(folder)]) == 2  # it goes on
    assert "does not write to" in capsys.readouterr().err


def test_a_second_stop_does_not_wait():
    reached = []

    def stop():
        signal.raise_signal(signal.SIGINT)
        reached.append(len(reached))

    def stop_twice():
        with stoppable(), unstopped():
            stop()
            stop()

    with pytest.raises(KeyboardInterrupt):
        stop_twice()
    assert reached == [0]


def test_a_handler_of_the_caller_stays():
    heard = []
    mine = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with stoppable():
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, mine)
    assert heard == [signal.SIGTERM]


def test_two_runs_at_once_into_one_folder(tmp_path):
    folder, seen = tmp_path / "run", []

    class Second(RunHook):
        def begin(self, run):
            with pytest.raises(InputError, match=rf"process {os.getpid()} \(run of fmu\)") as found:
                run_job(scenario(SHORT), folder)
            seen.append(found.value)
            with pytest.raises(InputError, match="does not write to"):
                choose_run_folder("fmu", 3, folder)

    assert run_job(scenario(SHORT), folder, hooks=[Second()]).summary["incomplete"] is False
    assert len(seen) == 1
    assert (folder / "run.mcap").stat().st_size > 1000
    run_job(scenario(SHORT), folder)


LEFT = {
    "before anything": [],
    "an empty lock": [LOCK],
    "while the scenario was written": [LOCK, "scenario.yaml.part"],
    "before the recording": [LOCK, "scenario.yaml"],
    "while it was recorded": [LOCK, "scenario.yaml", "run.mcap"],
    "while the tracks were written": [LOCK, "scenario.yaml", "run.mcap", "tracks.parquet.part"],
    "a full disk, 0.1.0": ["scenario.yaml", "run.mcap", "summary.json.part", "tracks.parquet.part"],
    "while the report was drawn": [
        "scenario.yaml",
        "run.mcap",
        "tracks.parquet",
        "summary.json",
        "report.html.part",
    ],
}


@pytest.mark.parametrize("moment", LEFT)
def test_what_a_killed_run_leaves_does_not_refuse_the_next(moment, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for name in LEFT[moment]:
        (folder / name).write_text("name: small\n" if name == "scenario.yaml" else "")
    assert choose_run_folder("small", 1, folder) == folder
    with occupied(folder, "small"):
        assert {f.name for f in folder.iterdir()} <= {LOCK, "scenario.yaml"}
        write_whole(folder / "scenario.yaml", "name: small\n")
    assert run_name(folder) == "small"  # ended without a summary: still a run's folder
    if "scenario.yaml" in LEFT[moment]:
        with pytest.raises(InputError, match="an earlier run of bend"):
            choose_run_folder("bend", 1, folder)


def test_a_folder_with_the_users_own_scenario_is_no_run(tmp_path):
    (tmp_path / "scenario.yaml").write_text("name: small\n")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        choose_run_folder("small", 1, tmp_path)


def test_a_run_is_replaced_by_the_same_command_and_by_no_other(tmp_path):
    """With the same changes, also after an edit of the file; other changes ask for --replace."""
    folder, at, other = tmp_path / "run", "small with seed=3", "small with seed=4"

    def lies(summary, version=__version__, events=()):
        folder.mkdir(exist_ok=True)
        (folder / "scenario.yaml").write_text(f"name: small\nsummary: {summary}\n")
        told = {"name": "small", "swath": version, "events": events}
        (folder / "summary.json").write_text(json.dumps(told))

    lies(at)
    assert choose_run_folder("small", 3, folder, summary=at) == folder
    for summary in (other, "as its author says", ""):
        with pytest.raises(InputError, match="--replace writes over it"):
            choose_run_folder("small", 3, folder, summary=summary)
        assert choose_run_folder("small", 3, folder, summary=summary, replace=True) == folder
    events = [{"t_s": 1.5, "set": "combine.speed.speed_kmh", "value": 5}]
    for has, asks in (([], events), (events, []), (events, [{**events[0], "value": 4}])):
        lies(at, events=has)
        with pytest.raises(InputError, match="--replace writes over it"):
            choose_run_folder("small", 3, folder, summary=at, events=asks)
    assert choose_run_folder("small", 3, folder, summary=at, events=events) == folder
    lies("as its author says")
    assert choose_run_folder("small", 3, folder, summary="as its author says now") == folder
    with pytest.raises(InputError, match="an earlier run of small with seed=4"):
        choose_run_folder("small", 4, folder, summary=other)
    lies("as its author says", "0.1.0")  # a version that did not tell its changes
    assert choose_run_folder("small", 4, folder, summary=other) == folder
    with pytest.raises(InputError, match="earlier run of bend"):
        choose_run_folder("bend", 4, folder, summary="")
    assert choose_run_folder("bend", 4, folder, summary="", replace=True) == folder
    (folder / "summary.json").unlink()
    with pytest.raises(InputError, match="expected a new or empty folder"):
        choose_run_folder("small", 3, folder, replace=True)  # nobody's run


def test_a_killed_process_holds_no_lock(tmp_path):
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from swath.runtime.folder import occupied\n"
        "with occupied(Path(sys.argv[1]), 'small'):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert python(code, str(tmp_path / "run")).returncode == -signal.SIGKILL
    assert (tmp_path / "run" / LOCK).exists()
    assert choose_run_folder("small", 1, tmp_path / "run") == tmp_path / "run"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_names_the_file(tmp_path, monkeypatch):
    def full(path):
        opened = NamedFile(str(path), "xb", opener=lambda *_: os.open("/dev/full", os.O_WRONLY))
        return io.BufferedWriter(opened)

    monkeypatch.setattr(mcap_file, "open_to_write", full)
    file = McapFile(tmp_path / "run.mcap")
    for act in (lambda: file.attach("a", "text/plain", b"x" * 100_000), file.close):
        with pytest.raises(OSError, match=r"No space left on device: '.*run\.mcap'"):
            act()
    file.close()


def test_a_file_that_does_not_fit_names_itself_and_leaves_nothing_whole(tmp_path):
    code = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
        "from swath.runtime.job import run_job\n"
        "from tests.link.fmu_scenario import scenario\n"
        "try: run_job(scenario(), Path(sys.argv[1]))\n"
        "except OSError as error: print(error)\n"
    )
    found = python(code, str(tmp_path / "run"))
    assert f"File too large: '{tmp_path}/run/run.mcap'" in found.stdout, found.stderr
    left = tmp_path / "run" / "summary.json"
    assert not left.exists() or json.loads(left.read_text())["incomplete"] is True
    assert not list((tmp_path / "run").glob("*.part"))
    assert (
        run_job(scenario(SHORT), choose_run_folder("fmu", 3, tmp_path / "run")).summary["incomplete"] is False
    )


def test_a_scan_is_replaced_by_the_same_scan_and_by_no_other(tmp_path, capsys):
    def scan(*words):
        return main(["scan", "straight", "--format", "csv", "--out", str(tmp_path / "scan"), *words])

    assert scan("--seed", "3") == 0
    made = (tmp_path / "scan" / "scan.csv").read_bytes()
    assert scan("--seed", "4") == 2
    assert "--replace writes over it" in capsys.readouterr().err
    assert (tmp_path / "scan" / "scan.csv").read_bytes() == made
    assert scan("--seed", "3") == 0
    assert (tmp_path / "scan" / "scan.csv").read_bytes() == made
    assert scan("--seed", "4", "--replace") == 0
    assert (tmp_path / "scan" / "scan.csv").read_bytes() != made
