"""Runs stopped at random moments, all into one folder: nothing whole that is not, and the next run works.

    nice python -m benchmarks.kills --count 40

For SIGKILL, SIGTERM and SIGINT, without and with an FMU in the process (a part of swath, exported). Half of
the moments are spread over the whole life of the process, half over the time in which it has the folder.
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.runtime.folder import LOCK, RUN_FILES
from swath.scenario.scenario import load_scenario

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
STOPPED = {signal.SIGTERM: 143, signal.SIGINT: 130}
SCENARIO = """
format: swath scenario 2
name: killed
seed: 3
run: {distance_m: 3, max_duration_s: 6}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 400}
  edge: {shape: straight}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    lidar: off
    edge: truth
    process: PROCESS
"""


@dataclass
class Victim:
    """A scenario to be run into a folder. length_s, held_s: of an undisturbed run, all and with the folder"""

    file: Path
    folder: Path
    length_s: float = 0.0
    held_s: float = 0.0
    digest: str = ""

    def start(self) -> "subprocess.Popen[str]":
        """Start a run."""
        command = [
            sys.executable,
            "-m",
            "swath.commands.main",
            "run",
            str(self.file),
            "--out",
            str(self.folder),
        ]
        return subprocess.Popen(
            [*command, "--quiet"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )

    def run(self) -> None:
        """An undisturbed run; the first one is what the others have to equal."""
        began = time.monotonic()
        process = self.start()
        held = self.wait_until_held(process)
        said = process.communicate()[1]
        ended = time.monotonic()
        assert process.returncode == 0, said
        summary = json.loads((self.folder / "summary.json").read_text())
        assert self.digest in ("", summary["digest"])
        self.digest, self.length_s, self.held_s = summary["digest"], ended - began, ended - held

    def wait_until_held(self, process: "subprocess.Popen[str]") -> float:
        """Wait until the run has its folder, or is over; the time."""
        before = self.mark()
        while process.poll() is None and self.mark() == before:
            time.sleep(0.002)
        return time.monotonic()

    def mark(self) -> Any:
        """Something that changes when a run takes the folder."""
        try:
            return (self.folder / LOCK).stat().st_mtime_ns
        except FileNotFoundError:
            return None

    def kill(self, number: signal.Signals, rng: random.Random, *, is_held: bool) -> str:
        """Start a run, stop it at a random moment, check what it left; returns how that is called."""
        process = self.start()
        if is_held:
            self.wait_until_held(process)
        time.sleep(rng.uniform(0.0, self.held_s if is_held else self.length_s))
        process.send_signal(number)
        said = process.communicate(timeout=60)[1]
        return check(self, number, process.returncode, said)


def check(victim: Victim, number: signal.Signals, code: int, said: str) -> str:
    """What a run left that was sent a signal, in words. AssertionError where something lies."""
    about = f"{number.name}, exit code {code}, {said!r}"
    assert code in (0, -number, STOPPED.get(number)), about
    known = {*RUN_FILES, LOCK, *(f"{name}.part" for name in RUN_FILES)}
    assert not victim.folder.exists() or {f.name for f in victim.folder.iterdir()} <= known, about
    file, report = victim.folder / "summary.json", victim.folder / "report.html"
    assert file.exists() or (not report.exists() and code != 0 and "recorded" not in said), about
    if not file.exists():
        return "no summary"
    summary = json.loads(file.read_text())
    check_files(victim.folder)
    if summary["incomplete"]:
        assert not report.exists(), about
        assert code != 0, about
        return "incomplete"
    assert summary["digest"] == victim.digest, about
    if report.exists():
        assert report.read_text().rstrip().endswith("</html>"), about
        return "complete"
    assert code != 0, about
    return "complete, no report"


def check_files(folder: Path) -> None:
    """All files beside a summary can be read to their ends."""
    from pyarrow.parquet import read_table

    from swath.record.read.files import open_log

    load_scenario(folder)
    assert read_table(folder / "tracks.parquet").num_columns > 10
    log = open_log(folder)
    list(log.messages(log.topics()))


def make_victim(folder: Path, *, has_fmu: bool) -> Victim:
    """A scenario, with its undisturbed run."""
    file = folder / f"{'fmu' if has_fmu else 'plain'}.yaml"
    process = "constant"
    if has_fmu:
        from swath.link.fmi.export import export_fmu
        from swath.scenario.scenario import parse_scenario

        made = parse_scenario(SCENARIO.replace("PROCESS", "{level: delay_line}"))
        export_fmu(made, ["process"], folder / "part.fmu")
        process = "{level: fmu, file: part.fmu}"
    file.write_text(SCENARIO.replace("PROCESS", process))
    victim = Victim(file, folder / file.stem)
    victim.run()
    return victim


def study(folder: Path, count: int, seed: int, *, has_fmu: bool) -> dict[str, Counter[str]]:
    """Stop `count` runs with each signal; how often they left what."""
    victim, rng = make_victim(folder, has_fmu=has_fmu), random.Random(seed)
    found: dict[str, Counter[str]] = {}
    for number in SIGNALS:
        found[number.name] = Counter(victim.kill(number, rng, is_held=bool(k % 2)) for k in range(count))
        victim.run()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="runs to stop, for each signal (default 40)")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    kinds = ("complete", "complete, no report", "incomplete", "no summary")
    print(f"| run | signal | {' | '.join(kinds)} |\n|---|---|{'---|' * len(kinds)}", flush=True)
    for has_fmu in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            found = study(Path(folder), args.count, args.seed, has_fmu=has_fmu)
        for name, counts in found.items():
            row = " | ".join(str(counts[kind]) for kind in kinds)
            print(f"| {'with an FMU' if has_fmu else 'plain'} | {name} | {row} |", flush=True)


if __name__ == "__main__":
    main()
