"""A function test of very many runs: time and memory of its plan, its report and going on with it.

    python -m benchmarks.campaign [--rows 10000 100000] [--candidates 1]

The results are made, not driven: what is measured is the tool. Prints the peak memory of each step, each in a
process of its own.
"""

import argparse
import json
import multiprocessing as mp
import resource
import tempfile
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from swath.runtime.kept import KeptFields
from swath.tools.function_test.command import finish
from swath.tools.function_test.one_run import no_result
from swath.tools.function_test.plan import Plan, PlannedRun
from swath.tools.function_test.pool import run_all
from swath.tools.function_test.session import begin, open_session

CASE = """
format: swath test case 1
objective: a plan of many rows
source: made
scenario: straight
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [4, 5, 6, 7, 8, 9, 10, 11, 12, 13]}
  stems: {key: field.stand.stems_per_m2, at: [200, 300, 400, 500, 600]}
seeds: SEEDS
expect: {lateral_p95_m: {max: 0.1}, edge_rmse_m: {max: 0.05}, distance_m: {min: 1}}
"""
ENGINE_RUNS = 1000
METRICS = [f"metric_{n}" for n in range(45)]  # beside those with a limit, as a run has


def plan(folder: Path) -> str:
    """Build the plan and look through it."""
    count = len(list(folder.glob("candidate-*")))
    candidates = {f"limit-{n}": (f"run.max_duration_s={100 + n}",) for n in range(count)}
    session = begin(folder / "out", Plan(str(folder / "many.yaml"), candidates=candidates))
    return f"{sum(1 for _ in session.left())} runs to do"


def fill(folder: Path) -> str:
    """Write made results of nine in ten rows."""
    session, count = open_session(folder / "out"), 0
    (folder / "out" / "journal").mkdir()
    journal = (folder / "out" / "journal" / "made.jsonl").open("wb")
    for run in session.left():
        if int(run.id, 16) % 10:
            p95 = 0.02 + 0.1 * (int(run.id[:6], 16) / 16**6)
            limits = {"lateral_p95_m": ({"max": 0.1}, p95), "edge_rmse_m": ({"max": 0.05}, 0.02),
                      "distance_m": ({"min": 1}, 1.0)}  # fmt: skip
            result: dict[str, Any] = {
                "id": run.id, "case": run.case, "candidate": run.candidate, "point": dict(run.point),
                "seed": run.seed, "verdict": "fail" if p95 > 0.1 else "pass", "reason": "",
                "metrics": {**dict.fromkeys(METRICS, p95), **{n: v for n, (_, v) in limits.items()}},
                "expect": [{"subject": "combine", "name": n, "limit": limit, "value": v,
                            "result": "fail" if n == "lateral_p95_m" and v > 0.1 else "pass"}
                           for n, (limit, v) in limits.items()],
                "incidents": [], "digest": run.id, "cpu_s": 1.0, "worker": "made",
            }  # fmt: skip
            journal.write(json.dumps(result).encode() + b"\n")
            count += 1
    journal.close()
    return f"{count} results"


def resume(folder: Path) -> str:
    """What is left of the plan."""
    return f"{sum(1 for _ in open_session(folder / 'out').left())} runs left"


def engine(folder: Path) -> str:
    """Runs that take no time, on two processes: what is left is the engine's."""
    runs = list(islice(open_session(folder / "out").plan.runs(), ENGINE_RUNS))

    def cpu() -> float:
        return sum(usage.ru_utime + usage.ru_stime for usage in
                   map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))  # fmt: skip

    spent = []
    for count in (2, len(runs)):  # what it takes to start two processes
        before = cpu()
        run_all(runs[:count], folder / f"engine-{count}", 2, lambda result: None, work=nothing)
        spent.append(cpu() - before)
    return f"{1000.0 * (spent[1] - spent[0]) / len(runs):.2f} ms of CPU a run, journal and hand-over"


def nothing(runs: Sequence[PlannedRun], fields: KeptFields) -> list[dict[str, Any]]:
    """Results as long as they are."""
    nothing = {"verdict": "pass", "metrics": dict.fromkeys(METRICS, 1.0 / 3.0)}
    return [{**no_result(run, ""), **nothing, "digest": run.id} for run in runs]


def report(folder: Path) -> str:
    """Table, page, JUnit file."""
    finish(folder / "out", open_session(folder / "out"), again=True)
    return ", ".join(f"{f.name} {f.stat().st_size / 1e6:.1f} MB" for f in sorted((folder / "out").iterdir())
                     if f.is_file())  # fmt: skip


def _measured(pipe: Any, step: Any, folder: Path) -> None:
    started = time.process_time()
    said = step(folder)
    pipe.send((said, time.process_time() - started,
               resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0))  # fmt: skip


def measure(rows: int, candidates: int) -> None:
    """Print what each step takes for a plan of so many rows."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = CASE.replace("SEEDS", str(max(1, rows // 50 // candidates)))
        (folder / "many.yaml").write_text(text, encoding="utf-8")
        for number in range(candidates):
            (folder / f"candidate-{number}").touch()
        for step in (plan, engine, fill, resume, report):
            ours, theirs = mp.get_context("spawn").Pipe()
            process = mp.get_context("spawn").Process(target=_measured, args=(theirs, step, folder))
            process.start()
            theirs.close()
            said, seconds, peak = ours.recv()
            process.join()
            print(f"{step.__name__:8} {seconds:7.1f} s of CPU, peak {peak:6.0f} MB: {said}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--candidates", type=int, default=1)
    args = parser.parse_args()
    for rows in args.rows:
        measure(rows, args.candidates)


if __name__ == "__main__":
    main()
