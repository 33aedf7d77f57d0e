"""Links in folders lead nobody astray: what a command writes is new, what links lead to stays as it was."""

import os
import shutil
import subprocess
import sys
from functools import cache

import pytest

from swath.commands.main import main, make_parser, subcommands
from swath.core.errors import InputError
from swath.core.files.place import own_folder
from swath.core.files.whole_file import (
    PART,
    open_to_append,
    open_to_keep,
    open_to_write,
    write_whole,
)
from swath.documents.data_sheets import find_sheet
from swath.runtime.job import run_job
from swath.runtime.saves import Saves
from tests.whole.small import small

LOG = find_sheet("jobs", "small-field").parents[1] / "logs" / "sample-log.csv.gz"
SHORT = ("run.distance_m=1", "combine.lidar.sub_rays=1", "run.record=exact")
CASE = """
format: swath test case 1
objective: none
source: none
scenario: straight
set: {run.distance_m: 0.5, combine.edge: truth, combine.lidar: "off"}
vary:
  speed: {key: combine.motion.start_speed_kmh, at: [5], range: [4, 6]}
seeds: 1
expect:
  distance_m: {min: 0.1}
"""
# Of every command that writes: its line with {new}, where it writes, and {run}, a finished run to read.
WRITES = {
    "run": "run {s} --out {new} --save-every-s 0.1",
    "report": "report {run}",
    "view": "view {run}",
    "branch": "branch {run} --at 0.3 --out {new}",
    "diff": "diff {run} {run}",
    "new": "new scenario {new}/my.yaml",
    "field import": f"field import {LOG} --out {{new}}/field",
    "fleet run": "fleet run small-field --out {new}",
    "lab stand": "lab stand --out {new} --stems-per-m2 200 --sensor sick-lms111 --seeds 1",
    "height-map build": "height-map build {run} --out {new}/map.npz",
    "test run": "test run {case} --workers 1 --out {new}",
    "test search": "test search {case} --budget 8 --workers 1 --out {new}",
    "test estimate": "test estimate {case} --budget 20 --workers 1 --out {new}",
    "rerun": "rerun {run} --out {new}",
    "part": "part process --scenario {s} --out {new}",
    "scan": "scan {s} --out {new}",
    "dataset": "dataset straight --count 1 --width-px 64 --height-px 48 --out {new}",
    "field export": "field export {s} --to sdf --out {new}/world",
    "run-log": "run-log {run} --out {new}/log.asc",
    "yield-log": "yield-log {run} --out {new}/log.csv --interval-s 0.1",
    "fmu export": "fmu export {s} --slot process --out {new}/x.fmu",
    "ros2 package": "ros2 package --out {new}",
    "osi": "osi {run} --out {new}/x.osi",
    "schema": "schema --out {new}/schema.json",
}
READS = ("report", "view", "branch", "diff", "rerun", "run-log", "yield-log", "osi", "height-map build")
# Those that take long or need other input; they write with the same functions, as the last test here holds.
OTHERS = {
    "paper",
    "compare log",
    "compare scans",
    "reda",
    "calibrate lidar",
    "calibrate engine",
    "field agopengps",
    "test work",
    "test report",
    "test again",
    "test plan-field",
    "tune",
}
NOTHING = {
    "scenarios", "docs", "levels", "metrics", "sheets", "field show", "fleet list", "test list",
    "test compare", "test levels", "odd check", "fmu show", "fmu check", "ros2 play", "can box", "can listen",
    "can dbc", "completion",
}  # fmt: skip


def test_every_command_is_looked_at():
    commands = {leaf.prog.removeprefix("swath ") for leaf in subcommands(make_parser()[0])}
    assert commands == {*WRITES, *OTHERS, *NOTHING}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    out = tmp_path_factory.mktemp("ran") / "run"
    run_job(small(*SHORT), out, hooks=[Saves(0.1)])
    return out


class Place:
    """A folder with input, and a file of the user elsewhere that nobody may touch."""

    def __init__(self, path, ran):
        self.path, self.ran = path, ran
        self.home = path / "home" / "folder"
        self.victim = self.home / "thesis.txt"
        self.home.mkdir(parents=True)
        for file in (self.victim, self.home / "0.save", self.home / "field.bin", self.home / "scan.csv"):
            file.write_text("years of work")
        self.before = self.look()
        (path / "s.yaml").write_text(small(*SHORT).resolved())
        (path / "case.yaml").write_text(CASE)
        shutil.copytree(ran, path / "run")

    def look(self):
        return {f: (f.read_bytes(), f.stat().st_ino) for f in self.home.parent.rglob("*") if f.is_file()}

    def line(self, command, new):
        p = self.path
        known = {
            "s": p / "s.yaml",
            "run": p / "run",
            "case": p / "case.yaml",
            "new": new,
        }
        return WRITES[command].format(**known).split()


def written(folder):
    """Files and folders that a command left, relative to its folder."""
    return sorted(f.relative_to(folder) for f in folder.rglob("*"))


@pytest.fixture(scope="module")
def as_it_is(ran, tmp_path_factory):
    """A function that runs a command once without links: its place, and what it wrote there."""

    @cache
    def run(command):
        folder = tmp_path_factory.mktemp("as_it_is")
        os.chdir(folder)
        first = Place(folder / "a", ran)
        new = first.path / "new"
        new.mkdir()
        had = set(first.path.rglob("*"))
        main(first.line(command, new))
        found = [f for f in first.path.rglob("*") if f not in had or f.parent == first.path / "run"]
        return first, [f.relative_to(first.path) for f in found]

    return run


@pytest.mark.parametrize("kind", ["symbolic", "hard"])
@pytest.mark.parametrize("command", WRITES)
def test_links_in_the_place_of_what_is_written(command, kind, ran, as_it_is, tmp_path, monkeypatch, capfd):
    """The command once as it is, to see what it writes; then with a link in the place of each of it."""
    monkeypatch.chdir(tmp_path)
    first, made = as_it_is(command)
    monkeypatch.chdir(tmp_path)
    assert made, capfd.readouterr()
    place = Place(tmp_path / "b", ran)
    (place.path / "new").mkdir()
    for name in made:
        for file in (place.path / name, place.path / f"{name}{PART}"):
            if (first.path / name).is_dir() or "home" in name.parts:
                continue
            if not file.parent.is_dir():
                file.parent.mkdir(parents=True)
            is_read = command in READS and file.exists()
            if is_read and file.name not in ("report.html", "replay.html", "diff.html"):
                continue
            if file.name in ("scenario.yaml", "summary.json"):  # they say that it is an earlier run
                shutil.copyfile(first.path / name, file)
                continue
            file.unlink(missing_ok=True)
            os.link(place.victim, file) if kind == "hard" else file.symlink_to(place.victim)
    count = place.victim.stat().st_nlink
    code = main(place.line(command, place.path / "new"))
    assert code in (0, 1, 2, 3), capfd.readouterr().err
    after = place.look()
    assert {file: after[file] for file in place.before} == place.before, capfd.readouterr().err
    assert place.victim.stat().st_nlink <= count


@pytest.mark.parametrize("name", ["saves", "journal", "images", "masks", "parts", "kept"])
@pytest.mark.parametrize("command", ["run", "branch", "rerun", "test run", "dataset"])
def test_folders_that_are_links(command, name, ran, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    place = Place(tmp_path / "a", ran)
    shutil.copytree(place.path / "run", place.path / "new")
    shutil.rmtree(place.path / "new" / name, ignore_errors=True)
    (place.path / "new" / name).symlink_to(place.home)
    assert main(place.line(command, place.path / "new")) in (0, 1, 2, 3)
    if command in ("test run", "dataset"):
        shutil.rmtree(place.path / "new")
        (place.path / "new").mkdir()
        (place.path / "new" / name).symlink_to(place.home)
        assert main(place.line(command, place.path / "new")) in (0, 1, 2, 3)
    assert place.look() == place.before


@pytest.mark.parametrize("kind", ["symbolic", "hard", "dangling", "fifo"])
def test_a_lock_that_is_none_is_refused(kind, ran, tmp_path, capsys):
    place = Place(tmp_path / "a", ran)
    lock = place.path / "run" / "run.lock"
    if kind == "hard":
        os.link(place.victim, lock)
    elif kind == "fifo":
        os.mkfifo(lock)
    else:
        lock.symlink_to(place.victim if kind == "symbolic" else tmp_path / "nothing")
    code = [sys.executable, "-m", "swath.commands.main"]
    line = [*code, *place.line("run", place.path / "run")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    assert "expected a file" in done.stderr
    assert place.victim.read_text() == "years of work"
    assert not (tmp_path / "nothing").exists()


def test_a_link_is_replaced_and_a_folder_refused(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("a")
    for name in ("x", f"x{PART}"):
        (tmp_path / name).symlink_to(victim)
    write_whole(tmp_path / "x", "b")
    assert (victim.read_text(), (tmp_path / "x").read_text(), (tmp_path / "x").is_symlink()) == (
        "a",
        "b",
        False,
    )
    (tmp_path / "y").symlink_to(tmp_path / "nowhere")
    with open_to_write(tmp_path / "y") as file:
        file.write(b"c")
    assert not (tmp_path / "nowhere").exists()
    (tmp_path / "l").symlink_to(victim)
    os.link(victim, tmp_path / "h")
    (tmp_path / "d").symlink_to(tmp_path)
    for act, name in ((open_to_append, "l"), (open_to_append, "h"), (own_folder, "d"), (own_folder, "l")):
        with pytest.raises(InputError, match="link"):
            act(tmp_path / name)
    with pytest.raises(InputError):
        open_to_keep(tmp_path / "l", os.O_RDWR)


@pytest.mark.parametrize(("mode", "is_used"), [(0o700, True), (0o755, True), (0o777, False), (0o1777, True)])
def test_a_cache_of_kernels_is_one_that_others_cannot_change(tmp_path, mode, is_used):
    from swath.kernels import _is_own, _is_usable

    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(mode)
    assert _is_own(tmp_path / "cache") == is_used
    assert _is_usable(tmp_path / "cache" / "warp") == is_used


@pytest.mark.parametrize("planted", ["link", "open to all"])
def test_compiled_kernels_lie_where_nobody_else_can_write(planted, tmp_path, monkeypatch):
    import swath.kernels as kernels

    monkeypatch.setattr(kernels.tempfile, "tempdir", str(tmp_path))
    place = tmp_path / f"swath-warp-{os.getuid()}"
    assert kernels._own_temporary() == place
    place.rmdir()
    if planted == "link":
        (tmp_path / "theirs").mkdir()
        place.symlink_to(tmp_path / "theirs")
    else:
        place.mkdir()
        place.chmod(0o777)
    found = kernels._own_temporary()
    assert found != place
    assert found.stat().st_mode & 0o777 == 0o700
