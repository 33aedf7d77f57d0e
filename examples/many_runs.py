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
from pathlib import Path
from typing import Any

import swath

SCENARIO = "straight"
SETS = {
    "combine.speed.speed_kmh": [5, 7, 9],
    "field.stand.stems_per_m2": [300, 600],
    "run.distance_m": [40],
}
SEEDS = [1, 2]
METRICS = ["edge_rmse_m", "lateral_rms_m", "lateral_p95_m", "header_use"]
OUT = Path("runs/many")


def entries() -> list[dict[str, Any]]:
    """An entry for `swath.batch` for every combination; of the recording only the standard messages."""
    found = []
    for values in itertools.product(*SETS.values()):
        sets = dict(zip(SETS, values, strict=True))
        name = "_".join(f"{key.rpartition('.')[2]}-{value:g}" for key, value in sets.items())
        sets["run.record"] = "standard"
        for seed in SEEDS:
            folder = OUT / f"{name}_seed-{seed}"
            found.append({"scenario": SCENARIO, "sets": sets, "seed": seed, "out": folder})
    return found


def summary_in(folder: Path) -> dict[str, Any] | None:
    """The summary of a run that is whole."""
    file = folder / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {"incomplete": True}
    return None if summary["incomplete"] else summary


def main() -> None:
    todo = [entry for entry in entries() if summary_in(entry["out"]) is None]
    for run in swath.batch(todo, processes=os.cpu_count() or 1):
        print(f"{run.index + 1}/{len(todo)}  {run.entry['out'].name}  {run.error or ''}", file=sys.stderr)
    rows = []
    for entry in entries():
        summary = summary_in(entry["out"]) or {}
        varied = {key: entry["sets"][key] for key in SETS}
        rows.append({**varied, "seed": entry["seed"], **{m: summary.get(m) for m in METRICS}})
    with (OUT / "table.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    draw(rows)
    print(OUT / "table.csv", OUT / "table.png", sep="\n")


def draw(rows: list[dict[str, Any]]) -> None:
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
