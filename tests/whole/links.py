"""Links put in the places of what commands write: what they lead to stays as it was.

    nice python -m tests.whole.links                      # each place of each command, with each kind of link
    python -m tests.whole.links --only "run,test run"

A command runs once, to see what it writes; then links lie there. It has to put new files in their places, or
to end with exit code 2. Prints a row for each command.
"""

import argparse
import contextlib
import io
import os
import random
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from swath.commands.main import main
from swath.core.files.whole_file import PART
from swath.documents.data_sheets import find_sheet
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
CAMERA = "combine.camera={{level: rays, reach_m: 14, mount: {{at: axle, x_m: 2, z_m: 3, pitch_deg: 20}}}}"
# Of every command that writes: its line with {new}, where it writes, and {run}, {tests}, {field}: finished
# folders to read.
WRITES = {
    "run": "run {s} --out {new} --save-every-s 0.1 --save-field {new}/left/field.npz",
    "report": "report {run}",
    "view": "view {run}",
    "branch": "branch {run} --at 0.3 --out {new}",
    "diff": "diff {run} {run}",
    "new": "new scenario {new}/my.yaml",
    "field import": f"field import {LOG} --replace --out {{new}}/field",
    "field agopengps": "field agopengps {field} --out {new}/field",
    "height-map build": "height-map build {run} --out {new}/map.npz",
    "test run": "test run {case} --workers 1 --out {new}",
    "test report": "test report {tests}",
    "test work": "test work {tests} --shard 1/1",
    "rerun": "rerun {run} --replace --out {new}",
    "part": "part process --input {run} --out {new}",
    "run-log": "run-log {run} --out {new}/log.asc",
    "yield-log": "yield-log {run} --out {new}/log.csv --interval-s 0.1",
    "fmu export": "fmu export {s} --slot process --out {new}/x.fmu",
    "ros2 package": "ros2 package --out {new}",
    "osi": "osi {run} --out {new}/x.osi",
    "schema": "schema --out {new}/schema.json",
}
LONG = {  # take longer: all places by command alone
    "test again": "test again {tests} {id}",
    "field export": "field export {s} --to sdf --out {new}/world",
    "scan": "scan {s} --out {new}",
    "fleet run": "fleet run small-field --out {new}",
    "dataset": f"dataset straight --set '{CAMERA}' --count 2 --width-px 64 --height-px 48 --workers 1 "
    "--out {new}",
    "lab stand": "lab stand --out {new} --stems-per-m2 200 --sensor sick-lms111 --seeds 1",
    "test search": "test search {case} --budget 8 --workers 1 --out {new}",
    "test estimate": "test estimate {case} --budget 20 --workers 1 --out {new}",
    "test plan-field": "test plan-field {case} --other combine.process=organs --runs 2 --pairs 8 "
    "--metric grain_cut_kg --workers 1 --out {new}",
    "tune": "tune {case} --param combine.speed.speed_kmh=3..6 --tries 10 --each 1 --proof 10 --workers 1 "
    "--out {new}",
    "twin fit": "twin fit {still} --still --sheet sick-lms111 --out {new}",
    "twin check": "twin check {twin} {still} --still --out {new}",
    "compare scans": "compare scans {long} {long} --out {new}",
    "compare log": "compare log lexion-700 {engine} --out {new}",
    "calibrate lidar": "calibrate lidar --quick --narrow --lines 2 --sub-rays 1 --out {new}/table.npz",
    "reda": "reda --crop-height-m 0.6 --stems-per-m2 300 --weather clear --sensor lidar --repeats 1 "
    "--workers 1 --out {new}",
}
READS = ("report", "view", "branch", "diff", "rerun", "run-log", "yield-log", "osi", "height-map build",
         "test report", "test again", "test work")  # fmt: skip
OURS = ("report.html", "replay.html", "diff.html", "results.parquet", "junit.xml")  # that they make anew
SAYS = {  # whose folder it is
    "scenario.yaml", "summary.json", "plan.json", "runs.parquet", "tune.json", "search.json", "estimate.json",
    "plan-field.json", "dataset.json", "field.yaml", "twin.json",
}  # fmt: skip
KINDS = ("symbolic", "dangling", "folder", "hard")
CODES = (0, 1, 2, 3, 4)


class Inputs:
    """Finished folders to read, made once."""

    def __init__(self, folder: Path) -> None:
        from tests.fuzz.kinds import KINDS as FILES

        self.folder = folder
        (folder / "s.yaml").write_text(small(*SHORT).resolved())
        (folder / "long.yaml").write_text(small("run.record=exact", "run.distance_m=3").resolved())
        (folder / "case.yaml").write_text(CASE)
        ranges, angle = np.random.default_rng(1).uniform(2.0, 2.01, (40, 61)), np.arange(61) - 30.0
        times = 0.02 * np.arange(40)
        np.savez(folder / "still.npz", ranges_m=ranges, angle_deg=angle, scan_time_s=times)
        FILES["log-engine"].make(folder)
        (folder / "log.csv").rename(folder / "engine.csv")

    def made(self, name: str, line: str) -> Path:
        """A folder that a command made."""
        if not (out := self.folder / name).exists():
            assert quietly(line.format(p=self.folder, out=out)) in CODES
        return out

    def put(self, wanted: str, place: Path) -> dict[str, Path | str]:
        """Copies of what a line names, at a place."""
        lines = {
            "run": "run {p}/s.yaml --save-every-s 0.1 --out {out}",
            "long": "run {p}/long.yaml --out {out}",
            "tests": "test run {p}/case.yaml --workers 1 --out {out}",
            "field": f"field import {LOG} --out {{out}}",
            "twin": "twin fit {p}/still.npz --still --sheet sick-lms111 --out {out}",
        }
        files = ("s.yaml", "case.yaml", "engine.csv", "still.npz")
        known: dict[str, Path | str] = {f.partition(".")[0]: self.folder / f for f in files}
        for name, line in lines.items():
            if f"{{{name}}}" in wanted:
                known[name] = shutil.copytree(self.made(name, line), place / name)
        if "{id}" in wanted:
            from tests.tools.fake_work import finished

            known["id"] = min(finished(place / "tests" / "journal"))
        return known


def quietly(line: str) -> int:
    """The exit code of a command line, and nothing on the screen."""
    import shlex

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(shlex.split(line))
    quietly.said = said.getvalue()  # type: ignore[attr-defined]
    return code


class Place:
    """A folder with the input of a command, and files of the user elsewhere that nobody may touch."""

    def __init__(self, path: Path, name: str, inputs: Inputs) -> None:
        self.path, self.name = path, name
        self.home = path.with_name(f"{path.name}-home") / "folder"
        self.victim = self.home / "thesis.txt"
        self.home.mkdir(parents=True)
        for file in ("thesis.txt", "0.save", "field.bin", "scan.csv", "plan.json", "driver-1.jsonl"):
            (self.home / file).write_text("years of work")
        path.mkdir()
        line = {**WRITES, **LONG}[name]
        self.line = line.format(**inputs.put(line, path), new=path / "new")
        (path / "new").mkdir()
        self.before = self.look()

    def look(self) -> dict[Path, object]:
        """What is there of the user's, by path: bytes and number of the file."""
        found = self.home.parent.rglob("*")
        return {f: (f.read_bytes(), f.stat().st_ino) if f.is_file() else None for f in found}

    def run(self) -> int:
        """Run the command; AssertionError where it ends wrong, or something of the user's changed."""
        before, names = Path.cwd(), self.victim.stat().st_nlink
        os.chdir(self.path)
        try:
            code = quietly(self.line)
        finally:
            os.chdir(before)
        said = quietly.said  # type: ignore[attr-defined]
        assert code in CODES, said
        assert self.look() == self.before, (self.line, said)
        assert self.victim.stat().st_nlink <= names
        return code

    def plant(self, file: Path, kind: str) -> None:
        """Put a link in the place of a file or folder."""
        if file.is_dir() and not file.is_symlink():
            shutil.rmtree(file)
        file.unlink(missing_ok=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        if kind == "hard":
            os.link(self.victim, file)
        else:
            there = {"symbolic": self.victim, "dangling": self.home / "nothing", "folder": self.home}
            file.symlink_to(there[kind])


class Written:
    """A command that ran once as it is: the places of what it wrote, from where its input lies.

    files: whose places links may take; says: contents of those that say whose folder it is
    """

    def __init__(self, name: str, folder: Path, inputs: Inputs) -> None:
        self.name, self.folder, self.inputs, self._count = name, folder, inputs, 0
        place = Place(folder / "first", name, inputs)
        had = set(place.path.rglob("*"))
        assert place.run() != 2, quietly.said  # type: ignore[attr-defined]
        found = {f for f in place.path.rglob("*") if f not in had or f.name in OURS}
        read = {f.parent for f in had if f.is_file() and name in READS}
        self.files = sorted(f.relative_to(place.path) for f in found if f.is_file())
        folders = {f for f in found if f.is_dir()} | (read - {place.path} if name == "test work" else set())
        inner = {f for f in folders if f != place.path / "new" and str(f) not in place.line.split()}
        self.folders = sorted(f.relative_to(place.path) for f in inner)
        self.says = {f: (place.path / f).read_bytes() for f in self.files if f.name in SAYS}
        assert self.files, quietly.said  # type: ignore[attr-defined]

    def place(self) -> Place:
        """A new place for it."""
        self._count += 1
        return Place(self.folder / str(self._count), self.name, self.inputs)

    def attempt(self, planted: dict[Path, str]) -> int:
        """Run it with these links, by place and kind; the exit code. AssertionError as of `run`."""
        place = self.place()
        for name, content in self.says.items():
            if name not in planted and not any(name.is_relative_to(link) for link in planted):
                (place.path / name).parent.mkdir(parents=True, exist_ok=True)
                (place.path / name).write_bytes(content)
        for name, kind in planted.items():
            place.plant(place.path / name, kind)
        try:
            return place.run()
        except AssertionError as error:
            raise AssertionError(f"{self.name}, {planted}: {error}") from error
        finally:
            shutil.rmtree(place.path)
            shutil.rmtree(place.home.parent)

    def in_all_files(self, kind: str | random.Random) -> dict[Path, str]:
        """Links in the places of all files and of those beside them; a Random draws the kinds."""
        places = [
            f
            for name in self.files
            if name not in self.says
            for f in (name, name.with_name(name.name + PART))
        ]
        return {f: kind if isinstance(kind, str) else kind.choice(KINDS) for f in places}


def all_of(written: Written) -> tuple[int, int]:
    """Each place with each kind; how many attempts there were, and how many were refused."""
    codes = []
    for kind in KINDS:
        codes.append(written.attempt(written.in_all_files(kind)))
        alone = written.files if codes[-1] == 2 else written.says  # it did not come to the others
        codes += [written.attempt({file: kind}) for file in alone]
        if kind != "hard":
            codes += [written.attempt({folder: kind}) for folder in written.folders]
    return len(codes), codes.count(2)


def run_all() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default=",".join({**WRITES, **LONG}), help="names of commands")
    names = parser.parse_args().only.split(",")
    print("| command | files | folders | attempts | refused | s |\n|---|---|---|---|---|---|", flush=True)
    failed = 0
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made).resolve()
        (folder / "inputs").mkdir()
        inputs = Inputs(folder / "inputs")
        for name in names:
            began = time.monotonic()
            place = folder / name.replace(" ", "-")
            place.mkdir()
            try:
                written = Written(name, place, inputs)
                count, refused = all_of(written)
                sizes = f"{len(written.files)} | {len(written.folders)} | {count} | {refused}"
            except AssertionError as error:
                failed, sizes = failed + 1, f"FAILED {error}"
            print(f"| {name} | {sizes} | {time.monotonic() - began:.0f} |", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    run_all()
