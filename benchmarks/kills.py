"""Runs stopped at random moments, all into one folder: nothing whole that is not, and the next run works.

    nice python -m benchmarks.kills --count 40

For SIGKILL, SIGTERM and SIGINT, without and with an FMU in the process (a part of swath, exported). Half of
the moments are spread over the whole life of the process, half over the time in which it has the folder.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.foreign_code import code_unread
from swath.core.output_folder import LOCK
from swath.runtime.folder import RUN_FILES
from swath.scenario.scenario import load_scenario

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
STOPPED = {signal.SIGTERM: 143, signal.SIGINT: 130}
SCENARIO = """
format: swath scenario 2
name: killed
seed: 3
run: {distance_m: 1, max_duration_s: 6}
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


class Starter:
    """Starts runs as forks of a process that has imported everything, so that many can be stopped."""

    def __init__(self, said: Path) -> None:
        command = [sys.executable, "-m", "benchmarks.kills", "--serve", str(said)]
        self._said, self._process = said, subprocess.Popen(command, stdin=-1, stdout=-1, text=True)
        self._tell()

    def start(self, *argv: str) -> int:
        """Start `swath ARGV`; its process id."""
        assert self._process.stdin is not None
        print(json.dumps(argv), file=self._process.stdin, flush=True)
        return int(self._tell())

    def wait(self) -> tuple[int, str]:
        """Wait for its end: exit code, < 0 for a signal, and what it said."""
        return int(self._tell()), self._said.read_text()

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _tell(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()


def serve(said: Path) -> None:
    """The process that forks: a command line in, its process id and its exit code out."""
    import matplotlib.pyplot
    import pyarrow.parquet

    import swath.report.report
    import swath.runtime.job
    from swath.commands.main import main

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    assert matplotlib.pyplot
    assert pyarrow.parquet
    assert swath.report.report
    print("ready", flush=True)
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            file, code = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 70
            os.dup2(file, 1)
            os.dup2(file, 2)
            try:
                code = main(json.loads(line))
            except KeyboardInterrupt:  # before or after swath had the signals
                code = STOPPED[signal.SIGINT]
            finally:
                os._exit(code)
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


@dataclass
class Victim:
    """A scenario to be run into a folder. length_s, held_s: of an undisturbed run, all and with the folder"""

    file: Path
    folder: Path
    starter: Starter
    length_s: float = 0.0
    held_s: float = 0.0
    digest: str = ""

    def start(self) -> int:
        """Start a run."""
        return self.starter.start("run", str(self.file), "--allow-code", "--out", str(self.folder), "--quiet")

    def run(self) -> None:
        """An undisturbed run; the first one is what the others have to equal."""
        began = time.monotonic()
        pid = self.start()
        held = self.wait_until_held(pid)
        code, said = self.starter.wait()
        ended = time.monotonic()
        assert code == 0, said
        summary = json.loads((self.folder / "summary.json").read_text())
        assert self.digest in ("", summary["digest"])
        self.digest, self.length_s, self.held_s = summary["digest"], ended - began, ended - held

    def wait_until_held(self, pid: int) -> float:
        """Wait until the run has its folder, or is over; the time."""
        before = self.mark()
        while self.mark() == before and Path(f"/proc/{pid}").exists():
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
        pid = self.start()
        if is_held:
            self.wait_until_held(pid)
        time.sleep(rng.uniform(0.0, self.held_s if is_held else self.length_s))
        with suppress(ProcessLookupError):
            os.kill(pid, number)
        return check(self, number, *self.starter.wait())


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

    with code_unread():
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
    victim = Victim(file, folder / file.stem, Starter(folder / "said.txt"))
    victim.run()
    return victim


def study(
    folder: Path, count: int, seed: int, signals: Sequence[signal.Signals] = SIGNALS, *, has_fmu: bool
) -> Iterator[tuple[str, Counter[str]]]:
    """Stop `count` runs with each signal; how often they left what."""
    victim, rng = make_victim(folder, has_fmu=has_fmu), random.Random(seed)
    try:
        for number in signals:
            yield number.name, Counter(victim.kill(number, rng, is_held=bool(k % 2)) for k in range(count))
            victim.run()
    finally:
        victim.starter.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="runs to stop, for each signal (default 40)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=("plain", "fmu"), help="only runs without, or with, an FMU")
    parser.add_argument("--signal", choices=[s.name for s in SIGNALS], help="only this one")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve is not None:
        serve(args.serve)
        return
    signals = [s for s in SIGNALS if args.signal in (None, s.name)]
    kinds = ("complete", "complete, no report", "incomplete", "no summary")
    print(f"| run | signal | {' | '.join(kinds)} |\n|---|---|{'---|' * len(kinds)}", flush=True)
    for name in ("plain", "fmu") if args.only is None else (args.only,):
        with tempfile.TemporaryDirectory() as folder:
            for sent, counts in study(Path(folder), args.count, args.seed, signals, has_fmu=name == "fmu"):
                row = " | ".join(str(counts[kind]) for kind in kinds)
                print(f"| {name} | {sent} | {row} |", flush=True)


if __name__ == "__main__":
    main()
