"""Many runs: every combination of some parameters and seeds, on all cores, to be stopped and gone on with.

    python examples/many_runs.py            # writes runs/many/table.csv and table.png

Every combination has a folder of its own. One whose summary.json is whole is not run again: after Ctrl-C or
a crash the same command goes on where it stopped. Change SCENARIO, SETS and SEEDS to your question.
"""

import csv
import itertools
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

SCENARIO = "straight"
SETS = {
    "combine.speed.speed_kmh": [5, 7, 9],
    "field.stand.stems_per_m2": [300, 600],
    "run.distance_m": [40],
}
SEEDS = [1, 2]
METRICS = ["edge_rmse_m", "lateral_rms_m", "lateral_p95_m", "header_use"]
OUT = Path("runs/many")


def run_one(folder: Path, sets: dict[str, float], seed: int) -> dict[str, float]:
    done = folder / "summary.json"
    if done.is_file():
        summary = json.loads(done.read_text(encoding="utf-8"))
        if not summary["incomplete"]:
            return summary
    import swath  # in the worker: every process has an engine of its own

    # no report, and of the recording only the standard messages: half the time of a short run
    return swath.run(
        SCENARIO, folder, sets={**sets, "run.record": "standard"}, seed=seed, report=False
    ).summary


def cases() -> list[tuple[Path, dict[str, float], int]]:
    found = []
    for values in itertools.product(*SETS.values()):
        sets = dict(zip(SETS, values, strict=True))
        name = "_".join(f"{key.rpartition('.')[2]}-{value:g}" for key, value in sets.items())
        found += [(OUT / f"{name}_seed-{seed}", sets, seed) for seed in SEEDS]
    return found


def main() -> None:
    os.environ.setdefault("SWATH_THREADS", "1")  # one core a run, as many runs as cores
    todo, rows = cases(), []
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(run_one, *case): case for case in todo}
        for count, job in enumerate(as_completed(jobs), 1):
            folder, sets, seed = jobs[job]
            summary = job.result()
            rows.append({**sets, "seed": seed} | {m: summary[m] for m in METRICS})
            print(f"{count}/{len(todo)}  {folder.name}", file=sys.stderr)
    rows.sort(key=lambda row: [row[key] for key in (*SETS, "seed")])
    with (OUT / "table.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    draw(rows)
    print(OUT / "table.csv", OUT / "table.png", sep="\n")


def draw(rows: list[dict[str, float]]) -> None:
    """How well it steered over the first key, a colour per value of the second, a point per run."""
    from matplotlib.figure import Figure

    x, by = list(SETS)[:2]
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for value in SETS[by]:
        own = [row for row in rows if row[by] == value and row["lateral_rms_m"] is not None]
        places = [row[x] for row in own]
        axes.plot(
            places,
            [100 * row["lateral_rms_m"] for row in own],
            "o",
            label=f"{by.rpartition('.')[2]} {value:g}",
        )
    axes.set(xlabel=x, ylabel="lateral error, RMS [cm]", ylim=(0, None), title=SCENARIO)
    axes.legend()
    figure.savefig(OUT / "table.png", dpi=120)


if __name__ == "__main__":
    main()
