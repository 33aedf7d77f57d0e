"""Whole runs of two versions of swath against each other, in CPU time of interleaved processes.

python benchmarks/versions.py --base FOLDER [--base-python PYTHON] [--rounds 5] [--out out/bench]

FOLDER is a checkout of the older version (`git worktree add FOLDER 2d89b5d` for 0.1.0), PYTHON one in which
its dependencies are installed (default: this one; its `src` comes first on the path). Every process
computes on one thread and counts user and system time, imports included. A simulated second is the
difference of two runs of the same scenario, divided by the difference of their simulated times. Prints a
table, writes versions.json.
"""

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import environment, machine, write_json

RUN = "import sys, runpy; from importlib.util import find_spec as f;" \
      "m = 'swath.commands.main' if f('swath.commands.main') else 'swath.cli';" \
      "sys.argv[0] = 'swath'; runpy.run_module(m, run_name='__main__')"  # fmt: skip
NOW = "now"
EMPIRICAL = ("combine.lidar.level=empirical",)


@dataclass(frozen=True)
class Row:
    """What is measured: a whole run, or with `more` [m] a simulated second between two runs.

    short: distance [m] of the shorter run, None = that of the scenario; only_now: arguments of this version
    """

    title: str
    scenario: str
    goal: str
    short: float | None = None
    more: float = 0.0
    sets: tuple[str, ...] = ()
    only_now: tuple[str, ...] = ()


ROWS = (
    Row("demo", "laser-pilot", "1/3"),
    Row("simulated second, plants", "straight", "1/3", 10.0, 30.0),
    Row("simulated second, empirical", "straight", "1/5", 10.0, 50.0, EMPIRICAL),
    Row("before and after, alone", "straight", "1.5 s of 5.2", 0.1),
    Row("simulated second, empirical, recorded before, not now", "straight", "1/8", 10.0, 50.0, EMPIRICAL,
        ("--set=run.record=none", "--no-replay")),
)  # fmt: skip


@dataclass(frozen=True)
class Version:
    """A checkout and the Python that runs it."""

    name: str
    root: Path
    python: str

    def cpu_s(self, arguments: Sequence[str]) -> float:
        """CPU time [s] of `swath ARGUMENTS` in a process of its own; RuntimeError when it cannot run."""
        env = environment(PYTHONPATH=str(self.root / "src"))
        before = os.times()
        done = subprocess.run(
            [self.python, "-c", RUN, *arguments], env=env, cwd=self.root, capture_output=True, text=True
        )
        after = os.times()
        if done.returncode not in (0, 1):  # 1: a limit fails, which a short run may well do
            raise RuntimeError(f"{self.name}: swath {' '.join(arguments)}: {done.stderr.strip()[-400:]}")
        return after.children_user + after.children_system - before.children_user - before.children_system


def measure(row: Row, version: Version, folder: Path) -> float:
    """CPU seconds of a row: of the run, or per simulated second between the shorter and the longer one."""
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
                print(f"{number}/{rounds} {row.title}, {version.name}: {seconds:.2f} s", file=sys.stderr)
    return found


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
        middle = [f"{statistics.median(seconds[v.name]):.3f} s" for v in versions]
        spread = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
        table.add_row(row.title, *middle, spread, row.goal)
    Console().print(table)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write versions.json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--base", type=Path, required=True, help="checkout of the older version")
    parser.add_argument("--base-python", default=sys.executable, help="its Python")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--warm", type=int, default=1, help="rounds before, which compile what is missing")
    parser.add_argument("--rows", type=int, nargs="*", help="numbers of rows, from 0 (default: all)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    options = parser.parse_args(arguments)
    rows = ROWS if options.rows is None else [ROWS[i] for i in options.rows]
    here = Path(__file__).resolve().parent.parent
    versions = [
        Version("before", options.base.resolve(), options.base_python),
        Version(NOW, here, sys.executable),
    ]
    found = interleaved(rows, versions, options.rounds, options.warm)
    show(rows, versions, found)
    data = {"machine": machine(), "cpu_s": found}
    write_json(options.out, "versions", data)
    return data


if __name__ == "__main__":
    main()
