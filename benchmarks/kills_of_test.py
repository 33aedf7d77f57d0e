"""A function test whose worker is killed at random moments: no finished run is lost, no byte changes.

    nice python -m benchmarks.kills_of_test --count 100

Each process takes up the plan where the one before it was killed (SIGKILL) and is killed after a random time.
At the end the plan is finished and compared with one that was never disturbed. Results are made within 5 ms;
with --driven they are runs of 2 m.
"""

import argparse
import os
import random
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swath.runtime.kept import KeptFields
from swath.tools.function_test import session
from swath.tools.function_test.journal import finished
from swath.tools.function_test.one_run import no_result
from swath.tools.function_test.plan import Plan, PlannedRun
from swath.tools.function_test.session import begin, open_session

CASE = """
format: swath test case 1
objective: drives
source: made
scenario: straight
set: {run.distance_m: 2, run.record: none, combine.lidar: {level: empirical, step_deg: 2}}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [6, 7, 8, 9, 10]}
seeds: SEEDS
expect: {distance_m: {min: 2}}
"""


def forked(work: Callable[[], object]) -> int:
    """Do something in a fork of this process; its process id."""
    pid = os.fork()
    if pid == 0:
        try:
            work()
        finally:
            os._exit(0)
    return pid


def made(run: PlannedRun, fields: KeptFields) -> dict[str, Any]:
    """A result that depends on the run alone, with as many numbers as one has."""
    time.sleep(0.005)
    metrics = {f"metric_{n}": int(run.id[:8], 16) / (n + 1) for n in range(50)}
    return {**no_result(run, ""), "verdict": "pass", "metrics": metrics, "digest": run.id}


def do_all(folder: Path) -> None:
    open_session(folder).do_share(1, 1, lambda result: None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--life", type=float, default=0.5, help="longest time until a kill [s]")
    parser.add_argument("--driven", action="store_true", help="runs, as --runs 60 --life 6 suits them")
    args = parser.parse_args()
    rng = random.Random(1)
    if not args.driven:
        session.do_run = made
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        (root / "drives.yaml").write_text(CASE.replace("SEEDS", str(args.runs // 5)), encoding="utf-8")
        plan = Plan(str(root / "drives.yaml"))
        disturbed, whole = root / "disturbed", root / "whole"
        begin(disturbed, plan)
        begin(whole, plan)
        kills, torn, before = 0, 0, set[str]()
        while kills < args.count:
            pid = forked(lambda: do_all(disturbed))
            time.sleep(rng.uniform(0.0, args.life))
            ended, _ = os.waitpid(pid, os.WNOHANG)
            if ended == 0:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                kills += 1
            now = finished(disturbed / "journal")
            assert before <= now, "a finished run is lost"
            lines = b"".join(path.read_bytes() for path in (disturbed / "journal").glob("*.jsonl"))
            torn += bool(lines) and not lines.endswith(b"\n")
            before = now
            if len(now) == args.runs:
                break  # nothing is left to be killed in
        os.waitpid(forked(lambda: do_all(disturbed)), 0)
        os.waitpid(forked(lambda: do_all(whole)), 0)
        tables = [open_session(folder).table().read_bytes() for folder in (disturbed, whole)]
        done = sum(path.read_bytes().count(b"\n") for path in (disturbed / "journal").glob("*.jsonl"))
        print(f"{kills} kills, {torn} left a torn line; {args.runs} runs, {done} lines in the journal")
        print(f"the same bytes as undisturbed: {tables[0] == tables[1]}")


if __name__ == "__main__":
    main()
