"""Whole runs of two versions of swath against each other, in CPU time of interleaved processes.

python benchmarks/versions.py [--base FOLDER] [--base-python PYTHON] [--rounds 5] [--out out/bench]

FOLDER is a checkout of the older version (default: 0.1.0, from this repository's history into a temporary
folder), PYTHON one in which its dependencies are installed; its `src` comes first on the path. Without PYTHON
they are installed once, in the versions that it pins, into an environment beside the results: 0.8 GB by pip.
Every process computes on one thread and counts user and system time, imports included. A simulated second is
the difference of two runs of the same scenario, divided by the difference of their simulated times. 1,000
runs: a run of 60 s in a process that has made one already, 500 times; with 0.1.0 the standard messages are
recorded, as its example of many runs does. Prints a table, writes versions.json.
"""

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import environment, machine, write_json

RUN = "import sys, runpy; from importlib.util import find_spec as f;" \
      "m = 'swath.commands.main' if f('swath.commands.main') else 'swath.cli';" \
      "sys.argv[0] = 'swath'; runpy.run_module(m, run_name='__main__')"  # fmt: skip
NOW = "now"
FIRST = "2d89b5d"  # commit of 0.1.0
RUNS_BEFORE = """
import tempfile, time, swath
sets = {"combine.lidar.level": "empirical", "run.max_duration_s": 60, "run.record": "standard"}
with tempfile.TemporaryDirectory() as folder:
    for seed in (1, 2):
        started = time.process_time()
        swath.run("straight", folder + f"/{seed}", sets=sets, seed=seed, report=False)
    print(500 * (time.process_time() - started))
"""
RUNS_NOW = """
import time, swath
sets = {"combine.lidar.level": "empirical", "run.max_duration_s": 60}
runs = swath.batch({"scenario": "straight", "sets": sets, "seed": seed} for seed in (1, 2))
next(runs).summary
started = time.process_time()
next(runs).summary
print(500 * (time.process_time() - started))
"""
LINE = """
import sys, time
sys.path[:0] = ["benchmarks", "."]
from ray_scenes import make_beams, make_scene
from swath.rays.engine import RayCaster
caster = RayCaster(make_scene(600.0, first=(7, -6), tiles=(13, 13)), threads=1)
o, d = make_beams(1, 16000, beams=400)
for _ in range(4):
    started = time.process_time()
    for line in d.reshape(40, 1, 400, 3):
        caster.cast_image(o[0, 0], line, range_max=60.0)
print((time.process_time() - started) / 40)
"""
EMPIRICAL = ("combine.lidar.level=empirical",)


@dataclass(frozen=True)
class Row:
    """What is measured: a whole run, or with `more` [m] a simulated second between two runs.

    short: distance [m] of the shorter run, None = that of the scenario; only_now: arguments of this version
    code: of the older version and of this one, in place of a run; it prints what it measured [s]
    """

    title: str
    scenario: str
    goal: str
    short: float | None = None
    more: float = 0.0
    sets: tuple[str, ...] = ()
    only_now: tuple[str, ...] = ()
    code: tuple[str, str] | None = None


ROWS = (
    Row("demo", "laser-pilot", "1/3"),
    Row("simulated second, plants", "straight", "1/3", 10.0, 30.0),
    Row("simulated second, empirical", "straight", "1/5", 10.0, 50.0, EMPIRICAL),
    Row("before and after, alone", "straight", "1.5 s of 5.2", 0.1),
    Row("simulated second, empirical, recorded before, not now", "straight", "1/8", 10.0, 50.0, EMPIRICAL,
        ("--set=run.record=none", "--no-replay")),
    Row("1,000 runs of 60 s, empirical, two cores", "straight", "10 of 85 min", code=(RUNS_BEFORE, RUNS_NOW)),
    Row("line of 400 single rays, 100k plants", "", "0.5 of 1.9 ms", code=(LINE, LINE)),
)  # fmt: skip


@dataclass(frozen=True)
class Version:
    """A checkout and the Python that runs it."""

    name: str
    root: Path
    python: str

    def printed_s(self, code: str) -> float:
        """The number that a program prints in a process of its own; RuntimeError when it cannot run."""
        return float(self._done(code, (), fine=(0,)).split()[-1])

    def cpu_s(self, arguments: Sequence[str]) -> float:
        """CPU time [s] of `swath ARGUMENTS` in a process of its own; RuntimeError when it cannot run."""
        before = os.times()
        self._done(RUN, arguments, fine=(0, 1, 3))  # a limit fails, or is not measured, in a short run
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    def _done(self, code: str, arguments: Sequence[str], fine: Sequence[int]) -> str:
        env = environment(PYTHONPATH=str(self.root / "src"))
        command = [self.python, "-c", code, *arguments]
        done = subprocess.run(command, env=env, cwd=self.root, capture_output=True, text=True)
        if done.returncode not in fine:
            raise RuntimeError(f"{self.name}: {' '.join(arguments)}: {done.stderr.strip()[-400:]}")
        return done.stdout


@contextmanager
def checkout(folder: Path | None) -> Iterator[Path]:
    """The older version: a folder that is there, or 0.1.0 as this repository's history has it."""
    if folder is not None:
        yield folder.resolve()
        return
    here = Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory(prefix="swath-0.1.0-") as made:
        packed = subprocess.run(["git", "archive", FIRST], cwd=here, capture_output=True)
        if packed.returncode:
            raise SystemExit(f"0.1.0 ({FIRST}) is not in this repository's history: give --base FOLDER")
        subprocess.run(["tar", "-x", "-C", made], input=packed.stdout, check=True)
        yield Path(made)


def own_python(base: Path, folder: Path) -> str:
    """Python of a virtual environment with what a checkout depends on and pins, made where there is none."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pins = (base / "constraints.txt").read_text(encoding="utf-8")
    installed = folder / "installed.txt"  # written last: what is half made is made again
    if not installed.is_file() or installed.read_text(encoding="utf-8") != pins:
        print(f"installing what the older version needs into {folder}", file=sys.stderr)
        venv.create(folder, with_pip=True, clear=True)
        wanted = tomllib.loads((base / "pyproject.toml").read_text(encoding="utf-8"))["project"][
            "dependencies"
        ]
        command = [python, "-m", "pip", "install", "--quiet", "-c", base / "constraints.txt", *wanted]
        if subprocess.run(command, check=False).returncode:
            raise SystemExit("that did not work: give --base-python a Python that has it all")
        installed.write_text(pins, encoding="utf-8")
    return str(python.absolute())


def measure(row: Row, version: Version, folder: Path) -> float:
    """CPU seconds of a row: of the run, or per simulated second between the shorter and the longer one."""
    if row.code is not None:
        return version.printed_s(row.code[version.name == NOW])
    found = [
        (version.cpu_s(arguments), simulated_s(folder))
        for arguments in commands(row, folder, is_now=version.name == NOW)
    ]
    if len(found) == 1:
        return found[0][0]
    (cpu, seconds), (cpu_more, seconds_more) = found
    return (cpu_more - cpu) / (seconds_more - seconds)


def commands(row: Row, folder: Path, *, is_now: bool) -> Iterator[list[str]]:
    """Arguments of the runs of a row."""
    lengths = [row.short, row.short + row.more] if row.more and row.short is not None else [row.short]
    for length in lengths:
        sets = [*row.sets, *([] if length is None else [f"run.distance_m={length:g}"])]
        more = row.only_now if is_now else ()
        yield [
            "run",
            row.scenario,
            "--out",
            str(folder),
            "--quiet",
            *(f"--set={text}" for text in sets),
            *more,
        ]


def simulated_s(folder: Path) -> float:
    """Simulated time of the run in a folder [s]."""
    return float(json.loads((folder / "summary.json").read_text(encoding="utf-8"))["simulated_s"])


def interleaved(rows: Sequence[Row], versions: Sequence[Version], rounds: int, warm: int) -> dict[str, Any]:
    """Seconds of each row and version in every round; `warm` rounds before them are not counted."""
    found: dict[str, Any] = {row.title: {v.name: [] for v in versions} for row in rows}
    shuffler = random.Random(1)
    with tempfile.TemporaryDirectory() as base:
        for number in range(1 - warm, rounds + 1):
            jobs = [(row, version) for row in rows for version in versions]
            shuffler.shuffle(jobs)
            for row, version in jobs:
                seconds = measure(row, version, Path(base) / f"{version.name}-{rows.index(row)}")
                if number > 0:
                    found[row.title][version.name].append(seconds)
                print(f"{number}/{rounds} {row.title}, {version.name}: {shown(seconds)}", file=sys.stderr)
    return found


def shown(seconds: float) -> str:
    """A time with the unit that suits it."""
    if seconds >= 300.0:
        return f"{seconds / 60.0:.1f} min"
    return f"{seconds:.2f} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def show(rows: Sequence[Row], versions: Sequence[Version], found: Mapping[str, Any]) -> None:
    """The table."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="CPU time of whole processes, one thread, medians", title_justify="left")
    for column in ("", *(v.name for v in versions), "ratio of rounds", "goal"):
        table.add_column(column, justify="right" if column else "left")
    base, now = versions
    for row in rows:
        seconds = found[row.title]
        ratios = sorted(b / a for a, b in zip(seconds[base.name], seconds[now.name], strict=True))
        middle = [shown(statistics.median(seconds[v.name])) for v in versions]
        spread = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
        table.add_row(row.title, *middle, spread, row.goal)
    Console().print(table)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write versions.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--base", type=Path, help="checkout of the older version (default: 0.1.0)")
    parser.add_argument("--base-python", help="its Python (default: of an environment of its own)")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--warm", type=int, default=1, help="rounds before, which compile what is missing")
    parser.add_argument("--rows", type=int, nargs="*", help="numbers of rows, from 0 (default: all)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args(arguments)
    rows = ROWS if options.rows is None else [ROWS[i] for i in options.rows]
    here = Path(__file__).resolve().parent.parent
    with checkout(options.base) as base:
        python = options.base_python or own_python(base, options.out / "environment-before")
        versions = [Version("before", base, python), Version(NOW, here, sys.executable)]
        found = interleaved(rows, versions, options.rounds, options.warm)
    show(rows, versions, found)
    data = {"machine": machine(), "cpu_s": found}
    write_json(options.out, "versions", data)
    return data


if __name__ == "__main__":
    main()
