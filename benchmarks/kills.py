"""Commands that write a folder, stopped at random moments and with faults of the disk: nothing is lost.

    nice python -m benchmarks.kills --count 200
    python -m benchmarks.kills --only dataset --seed 17 --count 5
    python -m benchmarks.kills --only tune --kinds SIGKILL --count 30

Each attempt is one fault, of a kind and at a moment that the seed says, spread over the length of the
command: a signal after a time, or one of benchmarks/faults.c at a count of what is written. After some, the
same command runs to its end, and the folder has to equal one that was never disturbed: in the files that two
undisturbed ones have in common, and the common values of their JSON. Until then, whatever has its name is
whole.
"""

import argparse
import ctypes
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.tools.fake_work import finished

from swath.core.files.output_folder import LOCK
from swath.core.files.whole_file import PART

SIGNALS = {"SIGKILL": -signal.SIGKILL, "SIGTERM": 143, "SIGINT": 130}
FAULTS = {"kill": -signal.SIGKILL, "torn": -signal.SIGKILL, "lost": -signal.SIGKILL, "full": 2, "short": 0}
STREAK = 3  # faults one after the other, before a run to the end
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
    process: constant
"""
CASE = """
format: swath test case 1
objective: drives
source: made
scenario: killed.yaml
set: {run.record: none}
vary:
  speed_kmh: {key: combine.motion.start_speed_kmh, at: [6, 7, 8], range: [5, 9]}
seeds: 3
expect: {distance_m: {min: 1}}
"""
CAMERA = "combine.camera={level: rays, reach_m: 14, mount: {at: axle, x_m: 2, z_m: 3, pitch_deg: 20}}"
LINES = {  # command line, and how it may end
    "run": (["run", "killed.yaml", "--quiet"], (0,)),
    "test run": (["test", "run", "case.yaml", "--workers", "1"], (3,)),
    "fleet run": (["fleet", "run", "small-field"], (0,)),
    "dataset": (["dataset", "straight", "--set", CAMERA, "--count", "4", "--per-scene", "2",
                 "--width-px", "64", "--height-px", "48", "--workers", "1"], (0,)),
    "test estimate": (["test", "estimate", "case.yaml", "--budget", "20", "--workers", "1"], (0, 3)),
    "tune": (["tune", "case.yaml", "--param", "field.stand.stems_per_m2=300..500", "--tries", "10",
              "--each", "1", "--proof", "10", "--workers", "1"], (0, 1, 3, 4)),
}  # fmt: skip


AGAIN = ("run", "fleet run")  # do all of it again in a folder that is whole


class Starter:
    """Starts commands as forks of a process that has imported everything, so that many can be stopped."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shim = folder / "faults.so"
        source = Path(__file__).with_name("faults.c")
        subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", str(shim), str(source), "-ldl"], check=True)
        command = [sys.executable, "-m", "benchmarks.kills", "--serve", str(folder)]
        path = os.pathsep.join([os.getcwd(), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, "LD_PRELOAD": str(shim), "PYTHONPATH": path}
        self._said, self._counter = folder / "said.txt", folder / "counter"
        self._process = subprocess.Popen(command, stdin=-1, stdout=-1, text=True, cwd=folder, env=environment)
        self._tell()

    def start(self, line: list[str], out: Path, kind: str = "count", at: int = 0, whom: str = "one") -> int:
        """Start `swath LINE --out OUT` with a fault; its process id."""
        assert self._process.stdin is not None
        self._counter.write_bytes(bytes(8))
        told = {"line": [*line, "--out", str(out)], "faults": f"{kind} {at} {whom} {self._counter} {out}"}
        print(json.dumps(told), file=self._process.stdin, flush=True)
        return int(self._tell())

    def wait(self) -> tuple[int, str]:
        """Wait for its end: exit code, < 0 for a signal, and what it said."""
        return int(self._tell()), self._said.read_text()

    @property
    def count(self) -> int:
        """Writes, names and removals of the last command and of what it started."""
        return int.from_bytes(self._counter.read_bytes(), sys.byteorder)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _tell(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()


def serve(folder: Path) -> None:
    """The process that forks: a command line in, its process id and its exit code out."""
    import matplotlib.pyplot
    import pyarrow.parquet

    import swath.fleet.report
    import swath.report.report
    import swath.runtime.job
    from swath.commands.main import main

    assert matplotlib.pyplot
    assert pyarrow.parquet
    assert swath.fleet.report
    assert swath.report.report
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    print("ready", flush=True)
    for line in sys.stdin:
        told = json.loads(line)
        pid = os.fork()
        if pid == 0:
            os.setsid()
            file, code = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 70
            os.dup2(file, 1)
            os.dup2(file, 2)
            os.environ["FAULTS_OF_WRITES"] = told["faults"]
            ctypes.CDLL(str(folder / "faults.so")).arm()
            try:
                code = main(told["line"])
            except KeyboardInterrupt:  # before or after swath had the signals
                code = SIGNALS["SIGINT"]
            finally:
                os._exit(code)
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


def contents(folder: Path) -> dict[str, Any]:
    """What lies in a folder: bytes by name, of JSON its values by name and key."""
    found: dict[str, Any] = {}
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = str(file.relative_to(folder))
        if file.suffix == ".json":
            found |= {f"{name} {key}": value for key, value in leaves(json.loads(file.read_bytes()), "")}
        else:
            found[name] = file.read_bytes()
    return found


def check_whole(folder: Path) -> None:
    """A file that has its name can be read to its end, whatever stopped the command."""
    from PIL import Image
    from pyarrow.parquet import read_table

    from swath.record.read.files import open_log

    for file in (p for p in folder.rglob("*") if p.is_file() and p.stat().st_size):
        if file.suffix == ".json":
            json.loads(file.read_bytes())
        elif file.suffix == ".jsonl":
            for line in file.read_bytes().split(b"\n")[:-1]:  # what is behind the last line is left out
                json.loads(line or b"{}")
        elif file.suffix == ".parquet":
            read_table(file)
        elif file.suffix in (".png", ".jpg"):
            with Image.open(file) as image:
                image.load()
        elif file.suffix == ".html":
            assert file.read_bytes().rstrip().endswith(b"</html>"), file
        elif file.suffix == ".mcap" and (folder / "summary.json").exists():
            log = open_log(file)
            list(log.messages(log.topics()))


def leaves(data: Any, key: str) -> Iterator[tuple[str, Any]]:
    """The values in plain data, by their keys."""
    inner: Mapping[Any, Any] = dict(enumerate(data)) if isinstance(data, list) else data
    if isinstance(data, dict | list):
        for each in inner:
            yield from leaves(inner[each], f"{key}.{each}")
    else:
        yield key, data


@dataclass
class Victim:
    """A command. count, length_s: of an undisturbed one, of what it writes and of its time."""

    name: str
    starter: Starter
    whole: dict[str, Any] = field(default_factory=dict)
    count: int = 0
    length_s: float = 0.0
    done: set[tuple[str, str]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.line, self.codes = LINES[self.name]
        self.out = self.starter.folder / self.name.replace(" ", "-")
        self.finish()
        first, names = contents(self.out), {str(p) for p in self.out.rglob("*")}
        shutil.rmtree(self.out)
        self.done.clear()
        began = time.monotonic()
        self.finish()
        self.length_s, self.count = time.monotonic() - began, self.starter.count
        second = contents(self.out)
        self.whole = {name: value for name, value in first.items() if second.get(name) == value}
        assert self.count > 5, "its writes are not seen"
        assert len(self.whole) > 3, names
        shutil.rmtree(self.out)
        self.done.clear()

    def finish(self) -> None:
        """Run it to its end: it goes on where it was, and what it makes is that of an undisturbed one."""
        self.starter.start(self.line, self.out)
        code, said = self.starter.wait()
        assert code in self.codes, (code, said, sorted(map(str, self.out.rglob("*"))))
        self.check()

    def check(self) -> None:
        """That the folder is as if nothing had happened."""
        found = contents(self.out)
        wrong = [name for name, value in self.whole.items() if found.get(name) != value]
        assert not wrong, wrong
        left = [n for n in found if n.endswith(PART) or n == LOCK]
        assert not left, left
        self._count_done()

    def disturb(self, kind: str, rng: random.Random, share: float) -> str:
        """One fault, at a share of its length; how the command ended. AssertionError where none should."""
        at, whom = 1 + int(share * self.count), rng.choice(["one", "all"])
        if kind in FAULTS:
            self.starter.start(self.line, self.out, kind, at, whom)
        else:
            pid = self.starter.start(self.line, self.out)
            time.sleep(share * self.length_s)
            with suppress(ProcessLookupError):
                os.kill(pid, getattr(signal, kind))
        code, said = self.starter.wait()
        assert code in (*self.codes, (SIGNALS | FAULTS)[kind]), (
            code,
            said,
            sorted(map(str, self.out.rglob("*"))),
        )
        assert "Traceback" not in said, said
        if kind == "full" and code == 2:
            assert "No space left" in said, said
            assert str(self.out) in said, said
        if code in self.codes:
            self.check()
            shutil.rmtree(self.out)  # else the next one has nothing to do
            self.done.clear()
            return "to its end"
        check_whole(self.out)
        self._count_done()
        return kind

    def _count_done(self) -> None:
        """What a journal held it still holds."""
        now = {(str(f), name) for f in sorted(self.out.rglob("journal")) for name in finished(f)}
        assert self.done <= now or (not now and self.done and (self.out / "results.parquet").exists())
        self.done = set(now)


def study(
    name: str, starter: Starter, count: int, seed: int, kinds: Sequence[str] = (*SIGNALS, *FAULTS)
) -> Iterator[tuple[int, str, str]]:
    """Disturb a command so often: number, kind, how it ended."""
    (starter.folder / "killed.yaml").write_text(SCENARIO)
    (starter.folder / "case.yaml").write_text(CASE)
    victim = Victim(name, starter)
    for number in range(count):
        rng = random.Random(f"{name} {seed} {number}")
        kind = kinds[(number + seed) % len(kinds)]
        try:
            yield number, kind, victim.disturb(kind, rng, (number + rng.random()) / count)
            if number % STREAK == STREAK - 1 or number == count - 1:
                victim.finish()
                if name not in AGAIN or rng.random() < 0.5:
                    shutil.rmtree(victim.out)
                    victim.done.clear()
        except AssertionError as error:
            raise AssertionError(f"{name}, seed {seed}, number {number}, {kind}: {error}") from error


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="faults of each command (default 40)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=LINES, help="only this command")
    parser.add_argument("--kinds", nargs="+", choices=[*SIGNALS, *FAULTS], default=[*SIGNALS, *FAULTS])
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve is not None:
        serve(args.serve)
        return
    print("| command | fault | stopped | to its end |\n|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as made:
        starter = Starter(Path(made).resolve())
        for name in LINES if args.only is None else (args.only,):
            counts: Counter[tuple[str, bool]] = Counter()
            for _, kind, ended in study(name, starter, args.count, args.seed, args.kinds):
                counts[kind, ended == kind] += 1
            for kind in args.kinds:
                print(f"| {name} | {kind} | {counts[kind, True]} | {counts[kind, False]} |", flush=True)
        starter.close()


if __name__ == "__main__":
    main()
