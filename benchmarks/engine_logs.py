"""Tables beyond what `swath compare log` writes: engine speed by load, means by flow.

    python -m benchmarks.engine_logs forage-harvester TASKDATA

compares as the page says for the forage harvester: every other stretch, the load over the largest torque.

    python -m benchmarks.engine_logs lexion-700 CSV --neighbours 30

correlates what the sheet leaves over of a machine's load with what it leaves over of the others within 30 m,
on the same field the same day: what the machines share is the crop's or the ground's, not theirs. CSV with
columns `machine`, `e_m`, `n_m`.

    python -m benchmarks.engine_logs lexion-700 CSV --regression

predicts each machine's load by lines through what the log holds, fitted on the others: what no model of these
quantities can be much better than. Moisture needs a column `moisture_pct`.
"""

import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.units import RPM
from swath.field_io.logs.machine_log import MachineLog, read_machine_log
from swath.field_io.logs.table import read_table
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import MachineSheet, load_machine
from swath.tools.compare_log.compare import Drive, LogRunner, compare_log, usable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LOAD_BINS = ((30, 50), (50, 65), (65, 75), (0, 75), (75, 85), (85, 92), (92, 97))  # percent
FEWEST = 20  # records in a bin
LAGS = range(-4, 11)  # of the flow, in records
CHOPPED = Drive("constant", "hydrostat", whole_crop=True, load_over="largest", friction=0.12, flow_floor=15.0)


def main(model: str, log: Path) -> None:
    """Print both tables on the stretches that nothing was fitted to."""
    made = compare_log(model, log, drive=CHOPPED, alternate=True)
    mask = made.parts["even stretches"]
    steady = steady_speed(load_machine(model), made.measured, CHOPPED)
    for row in by_load(made.measured, made.simulated, mask, steady):
        print("  ".join(f"{name} {value:.5g}" for name, value in row.items()))
    for row in by_flow(made.log, made.measured, made.simulated, mask):
        print("  ".join(f"{name} {value:.4g}" for name, value in row.items()))


def neighbours(model: str, path: Path, reach: float) -> None:
    """Print, for each machine, the correlation, and the share of its records that have neighbours."""
    log, table = read_machine_log(path), read_table(path)
    rows = np.stack([np.asarray(list(table.columns[k]), float) for k in ("machine", "e_m", "n_m")], axis=1)
    place = rows[np.lexsort((np.arange(len(log)), rows[:, 0]))][:, 1:]  # by machine, in the order of the file
    drive, used = Drive(), usable(log)
    simulated = LogRunner(log, drive).run(load_machine(model))["engine_load"]
    left = log.measured["engine_load"] - simulated
    for k, name in enumerate(log.machine_names):
        mine, others = used & (log.machine == k), used & (log.machine != k)
        mean = np.full(int(mine.sum()), np.nan)
        for i, at in enumerate(place[mine]):
            near = np.hypot(*(place[others] - at).T) < reach
            mean[i] = left[others][near].mean() if near.sum() > 3 else np.nan
        known = np.isfinite(mean)
        r = np.corrcoef(mean[known], left[mine][known])[0, 1]
        print(f"machine {name}: r {r:.2f} with the others within {reach:g} m, {known.mean():.0%} of records")


def regression(path: Path) -> None:
    """Print R2 of each machine's load, fitted on the others; in brackets fitted on itself."""
    log, table = read_machine_log(path), read_table(path)
    names = [str(v) for v in table.columns["machine"]]
    moisture = np.asarray(list(table.columns["moisture_pct"]), float)[np.argsort(names, kind="stable")]
    block, speed = np.cumsum(log.gap), log.speed

    def later(values: Array, records: int) -> Array:
        same = np.roll(block, records) == block
        return np.where(same, np.roll(values, records), values)

    flow = [later(np.nan_to_num(log.flow), k) for k in LAGS]
    hill = [later(np.nan_to_num(log.grade) * speed, k) for k in (-2, 0, 2, 4)]
    gain = [later(np.gradient(speed) * speed, k) for k in (-1, 0, 1, 2)]
    wet = np.where(np.isfinite(moisture), moisture, np.nanmean(moisture))
    sets = {
        "flow": [np.nan_to_num(log.flow)],
        "flow, 15 lags": flow,
        "and slope, acceleration, speed": [*flow, *hill, *gain, speed],
        "and moisture": [*flow, *hill, *gain, speed, wet],
    }
    used, load = usable(log), 100.0 * log.measured["engine_load"]
    for name, columns in sets.items():
        rows, cells = np.stack([np.ones(len(load)), *columns], axis=1), []
        for k in range(len(log.machine_names)):
            mine = used & (log.machine == k)
            real, found = load[mine], []
            for on in (used & ~mine, mine):
                line = np.linalg.lstsq(rows[on], load[on], rcond=None)[0]
                error = rows[mine] @ line - real
                found.append(1.0 - float((error**2).sum() / ((real - real.mean()) ** 2).sum()))
            cells.append("{:.2f} ({:.2f})".format(*found))
        print(f"{name}: {', '.join(cells)}")


def steady_speed(machine: MachineSheet, measured: Mapping[str, Array], drive: Drive) -> Array:
    """Speed [1/min] at which the sheet's engine settles at the measured load; nan where that says nothing."""
    load = measured.get("engine_load", np.zeros(0))
    if drive.load_over != "largest":
        return np.full(len(load), np.nan)
    e = drivetrain_of(machine).engine
    torque = (load / 100.0 - drive.friction) / (1.0 - drive.friction) * (1.0 + e.torque_rise)  # over rated
    governed = e.rated_speed * (1.0 + e.droop * (1.0 - np.maximum(torque, 0.0)))
    lugged = e.rated_speed - (torque - 1.0) / max(e.torque_rise, 1e-9) * (e.rated_speed - e.torque_speed)
    return np.asarray(np.where(torque <= 1.0, governed, np.maximum(lugged, e.torque_speed)) / RPM)


def by_load(
    measured: Mapping[str, Array], simulated: Mapping[str, Array], mask: Mask, steady: Array
) -> list[dict[str, float]]:
    """Mean engine speed [1/min] in bins of load: measured; simulated over its own load; and as the engine
    alone settles at the measured load.
    """
    if "engine_speed" not in measured or "engine_load" not in measured:
        return []
    rows = []
    for low, high in LOAD_BINS:
        row: dict[str, float] = {"from_percent": low, "to_percent": high}
        for name, of in (("measured", measured), ("simulated", simulated)):
            inside = mask & (of["engine_load"] >= low) & (of["engine_load"] < high)
            row[f"{name}_count"] = int(inside.sum())
            is_enough = inside.sum() >= FEWEST
            row[f"{name}_rpm"] = float(of["engine_speed"][inside].mean()) if is_enough else float("nan")
        inside = mask & (measured["engine_load"] >= low) & (measured["engine_load"] < high)
        row["settled_rpm"] = float(steady[inside].mean()) if inside.sum() >= FEWEST else float("nan")
        row["settled_error_percent"] = 100.0 * (row["settled_rpm"] / row["measured_rpm"] - 1.0)
        row["error_percent"] = 100.0 * (row["simulated_rpm"] / row["measured_rpm"] - 1.0)
        rows.append(row)
    return rows


def by_flow(
    log: MachineLog, measured: Mapping[str, Array], simulated: Mapping[str, Array], mask: Mask
) -> list[dict[str, float]]:
    """Means in ten bins of the crop flow [kg/s], as wide as each other."""
    flow = log.flow[mask]
    low, high = (float(v) for v in np.percentile(flow, [0.5, 99.5]))
    edges = np.linspace(low, high, 11)
    rows = []
    for a, b in pairwise(edges):
        inside = mask & (log.flow >= a) & (log.flow < b)
        if inside.sum() < FEWEST:
            continue
        row = {"flow_kg_s": float(log.flow[inside].mean()), "count": int(inside.sum())}
        for q in measured:
            row[f"{q}_measured"] = float(measured[q][inside].mean())
            row[f"{q}_simulated"] = float(simulated[q][inside].mean())
        rows.append(row)
    return rows


if __name__ == "__main__":
    if "--neighbours" in sys.argv:
        neighbours(sys.argv[1], Path(sys.argv[2]), float(sys.argv[4]))
    elif "--regression" in sys.argv:
        regression(Path(sys.argv[2]))
    else:
        main(sys.argv[1], Path(sys.argv[2]))
