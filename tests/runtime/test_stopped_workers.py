"""Ctrl-C and SIGTERM to all processes of a group: nothing but one line of the driver is printed."""

import os
import signal
import subprocess
import sys

import pytest

from tests.waiting import PATIENCE_S, until

BATCH = """
import signal, sys, swath
signal.signal(signal.SIGINT, lambda *_: sys.exit(9))
signal.signal(signal.SIGTERM, lambda *_: sys.exit(9))
if __name__ == "__main__":
    sets = ["combine.lidar.level=empirical", "run.distance_m=200", "run.max_duration_s=200", "expect={}"]
    runs = [{"scenario": "straight", "sets": sets, "seed": s, "out": f"out/{s}"} for s in (1, 2, 3, 4)]
    print("up", flush=True)
    for run in swath.batch(runs, workers=2):
        print(run.index, run.error)
"""
TEST = [sys.executable, "-m", "swath", "test", "run", "straight-clean", "--workers", "2", "--out", "out"]
STOPPED = "swath: stopped; what is done is kept, the same command goes on"
pytestmark = pytest.mark.skipif(os.name == "nt", reason="process groups of POSIX")


def started(folder, words):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with (folder / "said").open("wb") as said:
        return subprocess.Popen(
            words, cwd=folder, env=env, start_new_session=True, stdout=said, stderr=subprocess.STDOUT
        )


def members(group):
    """Processes of a group, but for its leader."""
    words = ["ps", "-o", "pid=", "-g", str(group)]
    listed = subprocess.run(words, capture_output=True, text=True, check=False)
    return [int(n) for n in listed.stdout.split() if int(n) != group]


@pytest.mark.parametrize(
    ("which", "moment", "number"),
    [
        ("test", "starting", signal.SIGTERM),
        ("test", "running", signal.SIGINT),
        ("batch", "starting", signal.SIGINT),
        ("batch", "running", signal.SIGTERM),
    ],
)
def test_the_workers_of_a_stopped_group_say_nothing(tmp_path, which, moment, number):
    """Either kind of workers, moment and signal beside either of the others; runs are marked incomplete."""
    (tmp_path / "runs.py").write_text(BATCH)
    driver = started(tmp_path, TEST if which == "test" else [sys.executable, "runs.py"])
    files, least = ("out/**/worker-*", 0) if which == "test" else ("out/*/run.mcap", 1)
    try:
        until(lambda: len(members(driver.pid)) >= 3, "two workers and what counts the resources are there")
        if moment == "running":
            until(lambda: sum(f.stat().st_size >= least for f in tmp_path.glob(files)) >= 2, "both work")
        os.killpg(driver.pid, number)
        assert driver.wait(PATIENCE_S) == (9 if which == "batch" else 128 + number)
        said = (tmp_path / "said").read_text()
        assert "Traceback" not in said
        assert said.splitlines()[-1] == ("up" if which == "batch" else STOPPED)
        until(lambda: not members(driver.pid), "all are gone")
    finally:
        if driver.poll() is None:
            os.killpg(driver.pid, signal.SIGKILL)
    if (which, moment) == ("batch", "running"):
        summaries = [folder / "summary.json" for folder in (tmp_path / "out").iterdir()]
        assert len(summaries) >= 2
        assert all('"incomplete": true' in file.read_text() for file in summaries)
