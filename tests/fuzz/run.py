"""Damage files for a while: every case is valid, or a short error, within its time and memory.

    python -m tests.fuzz.run --minutes 60            # of every kind for as long
    python -m tests.fuzz.run --kinds geotiff,isoxml --cases 500
    python -m tests.fuzz.run --kinds geotiff --only 17   # one case again, with its traceback

First whole files of each kind are read, which has to pass.
Cases run in a worker process with a limit on its memory; one that hangs or dies is replaced. A case is told
by its kind and number; the same two give the same bytes. Exit code 1 where a case failed.
"""

import argparse
import json
import os
import random
import resource
import select
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from tests.fuzz.inside import INSIDE, SPOTS, damaged
from tests.fuzz.kinds import KINDS, REFUSED, repacked
from tests.fuzz.mutate import mutated

MEMORY_GB, MOST_MIB, LONGEST = 6, 2048, 300  # of addresses; of memory that is used; of a message
CASE_S, STUCK_S = 60.0, 600.0  # of a case: processor time, and by the clock of one that waits for something
BINARY = {".tif", ".gz", ".zip", ".npz", ".mcap", ".bag", ".db3", ".glb", ".fmu", ".ssp", ".bin", ".parquet",
          ".kmz", ".mf4", ".blf", ".las", ".laz", ".jpg", ".png", ".save"}  # fmt: skip
PACKED = {".zip", ".npz", ".fmu", ".ssp", ".kmz"}
WHOLE = -1  # number of the case that is not damaged


class Seeds:
    """Whole files by kind, made once. Each read of a whole file has to pass."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def of(self, kind: str) -> Path:
        """The folder with the files of a kind."""
        folder = self.folder / kind
        if not folder.is_dir():
            folder.mkdir()
            KINDS[kind].make(folder)
        return folder


def damage(seed: Path, work: Path, kind: str, number: int) -> str:
    """Put the files of a seed, one of them damaged, into a folder; says which. number: WHOLE = none"""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(seed, work)
    if number == WHOLE:
        return "whole"
    rng = random.Random(f"{kind} {number}")
    file = rng.choice(sorted(p for p in work.rglob("*") if p.is_file()))
    data = file.read_bytes()
    change = partial(mutated, rng=rng, text=file.suffix not in BINARY)
    by_format = random.Random(f"numbers of {kind} {number}")
    if file.suffix in (*SPOTS, *INSIDE) and by_format.random() < 0.6:
        file.write_bytes(damaged(data, by_format, file.suffix, partial(mutated, rng=by_format, text=False)))
    elif file.suffix in PACKED and rng.random() < 0.7:
        file.write_bytes(repacked(data, change, rng.choice))
    else:
        file.write_bytes(change(data))
    return file.name


def verdict(kind: str, work: Path) -> tuple[str, str]:
    """(valid, refused or what went wrong; more about it) of reading a folder."""
    from swath.core.errors import SwathError
    from swath.scenario.section_reader import ScenarioError

    try:
        KINDS[kind].read(work)
    except SwathError as error:
        others = error.others if isinstance(error, ScenarioError) else ()
        texts = [str(e) for e in (error, *others)]
        long = [t for t in texts if len(t) > LONGEST or not t.isprintable()]
        return ("long message", long[0][:2000]) if long else ("refused", texts[0])
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)
        own = [f"{Path(f.filename).name}:{f.lineno}" for f in place if "swath" in f.filename]
        return f"{type(error).__name__} at {own[-1] if own else '?'}", f"{str(error)[:300]} {own[-4:]}"
    return "valid", ""


def worker(folder: Path) -> None:
    """Read `kind number` lines, answer each with a line of JSON."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_GB << 30, MEMORY_GB << 30))
    warnings.simplefilter("ignore")
    seeds, answer = Seeds(folder), os.fdopen(os.dup(1), "w")
    sys.stdout = sys.stderr
    out = folder / "printed"
    os.dup2(os.open(out, os.O_WRONLY | os.O_CREAT | os.O_APPEND), 1)
    printed = out.open("rb")
    for line in sys.stdin:
        kind, number = line.split()
        work = folder / "work"
        _peak_mib()
        file = damage(seeds.of(kind), work, kind, int(number))
        begin = time.process_time()
        said, more = verdict(kind, work)
        spent = time.process_time() - begin
        peak = _peak_mib()
        if said in ("valid", "refused") and peak > MOST_MIB:
            said, more = f"{peak} MiB", said
        if text := printed.read():  # by a library: the user's own output would hold it
            said, more = "printed", text[:300].decode(errors="replace")
        print(json.dumps([said, more, file, spent, peak]), file=answer, flush=True)


def _peak_mib() -> int:
    """Most memory of this process since the last call [MiB]."""
    status = Path("/proc/self/status").read_text().splitlines()
    Path("/proc/self/clear_refs").write_text("5")
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) >> 10


class Worker:
    """The worker process, begun again when it hangs or dies."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.process = folder, self._begin(folder)

    def _begin(self, folder: Path) -> Any:
        command = [sys.executable, "-m", "tests.fuzz.run", "--worker", str(folder)]
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )

    def ask(self, kind: str, number: int) -> list[Any]:
        """The answer to a case."""
        self.process.stdin.write(f"{kind} {number}\n")
        self.process.stdin.flush()
        begin, since = time.monotonic(), self._processor_s()
        while not select.select([self.process.stdout], [], [], 5.0)[0]:
            used, waited = self._processor_s() - since, time.monotonic() - begin
            if used > CASE_S or waited > STUCK_S:
                self.close()
                self.process = self._begin(self.folder)
                return [f"hang: {used:.0f} s of {waited:.0f} s used", "", "", used, 0]
        line = self.process.stdout.readline()
        if not line:
            code = self.process.wait()
            self.process = self._begin(self.folder)
            return [f"died with {code}", "", "", 0.0, 0]
        return list(json.loads(line))

    def _processor_s(self) -> float:
        """Processor time that the process has used [s]; a busy machine makes no hang of a slow case."""
        ticks = Path("/proc", str(self.process.pid), "stat").read_text().rpartition(")")[2].split()
        return (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


def run(kinds: list[str], first: int, cases: int, seconds: float) -> tuple[Counter[str], list[str]]:
    """Damage files, of every kind for as long; counts of what came out, and a line about each failure."""
    counts: Counter[str] = Counter()
    failures: list[str] = []
    spent_in: Counter[str] = Counter()
    done: Counter[str] = Counter()
    slowest, peak, end = 0.0, 0, time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        asked = Worker(Path(folder))
        try:
            for kind in kinds:
                said, more, *_ = asked.ask(kind, WHOLE)
                if said != "valid" and not (said == "refused" and kind in REFUSED):
                    counts["failed"] += 1
                    failures.append(f"{kind} whole: {said} {more}")
                    print(failures[-1], flush=True)
            while (left := [k for k in kinds if done[k] < cases]) and time.monotonic() < end:
                kind = min(left, key=lambda k: spent_in[k])
                number = first + done[kind]
                done[kind] += 1
                said, more, file, spent, now = asked.ask(kind, number)
                spent_in[kind] += round(1000 * spent) + 20
                slowest, peak = max(slowest, spent), max(peak, now)
                counts[said if said in ("valid", "refused") else "failed"] += 1
                if said not in ("valid", "refused"):
                    failures.append(f"{kind} {number} {file}: {said} {more}")
                    print(failures[-1], flush=True)
        finally:
            asked.close()
    counts["seconds of the slowest"], counts["MiB at most"] = round(slowest), peak
    print("cases:", ", ".join(f"{kind} {count}" for kind, count in done.most_common()))
    return counts, failures


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--cases", type=int, default=10**9, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--only", type=int, help="this case of the kinds, with its traceback")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    kinds = args.kinds.split(",")
    if args.worker is not None:
        worker(args.worker)
        return 0
    if args.only is not None:
        with tempfile.TemporaryDirectory() as folder:
            for kind in kinds:
                print(kind, damage(Seeds(Path(folder)).of(kind), Path(folder, "work"), kind, args.only))
                KINDS[kind].read(Path(folder, "work"))
        return 0
    counts, failures = run(kinds, args.first, args.cases, 60.0 * args.minutes)
    print(", ".join(f"{name} {count}" for name, count in sorted(counts.items())))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
