"""Drawn whole fields: hours against simple rules, what must change nothing, what must not cost time.

    python -m benchmarks.fleet_jobs 0 20 --hectares 1 4 --against baseline same more --out out/fleet_jobs
    python -m benchmarks.fleet_jobs 300 312 --wide --hectares 1 100 --limit-s 600 --set fleet.plans=1

Seeds FIRST to LAST, the last one left out. `baseline`: hours, bound of cutting, CPU and memory beside
`fleet_baseline.py`; `same`: the job written down otherwise, `nearly`: with corners moved by millimetres;
`more`: with more of one thing. `--only` takes the changes that hold a word, `--limit-s` the CPU-s of each.
Each runs in a process of its own; what is done is kept in `rows.jsonl` of the folder, so a stopped benchmark
goes on, and `--table` prints what is there.
"""

import argparse
import json
import math
import multiprocessing as mp
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.fleet import add

LIMITS = {"same": 0.2, "nearly": 1.5, "more": 0.5}  # %, hours may be off so much
SHAPES = ("rectangle", "L", "U", "traced", "traced with a pond", "by a river", "with a pond")


def outline(rng: np.random.Generator, shape: str, area: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """Points (n, 2) of an outline of an area [m2], and its ponds."""
    import shapely

    long = rng.uniform(1.2, 2.4)
    x, y = long, 1.0
    if shape == "L":
        a, b = rng.uniform(0.35, 0.6, 2) * (x, y)
        ring = np.array([(0, 0), (x, 0), (x, b), (a, b), (a, y), (0, y)])
    elif shape == "U":
        a, c = rng.uniform(0.3, 0.38, 2) * x
        b = rng.uniform(0.35, 0.5)
        ring = np.array([(0, 0), (x, 0), (x, y), (x - c, y), (x - c, b), (a, b), (a, y), (0, y)])
    elif shape in ("rectangle", "with a pond"):
        ring = np.array([(0, 0), (x, 0), (x, y), (0, y)])
    elif shape == "by a river":
        along = np.linspace(x, 0.0, int(rng.integers(12, 60)))
        bends = sum(0.08 / k * np.sin(2 * math.pi * k * along / x + rng.uniform(0, 6)) for k in (1, 2, 3))
        ring = np.vstack([[(0, 0), (x, 0)], np.column_stack([along, y + bends])])
    else:
        angle = np.linspace(0.0, 2.0 * math.pi, int(rng.integers(20, 201)), endpoint=False)
        waves = sum(0.15 / k * np.sin(k * angle + rng.uniform(0, 6)) for k in (1, 2, 3))
        ring = np.column_stack([0.5 * long * np.cos(angle), 0.5 * np.sin(angle)]) * (1.0 + waves)[:, None]
    ring = ring * math.sqrt(area / shapely.Polygon(ring).area)
    ponds = []
    if "pond" in shape:
        inside = shapely.Polygon(ring).buffer(-45.0)
        for _ in range(0 if inside.is_empty else 100):
            place = rng.uniform(ring.min(axis=0), ring.max(axis=0))
            if inside.contains(shapely.Point(place)):
                angle = np.linspace(0.0, 2.0 * math.pi, int(rng.integers(5, 24)), endpoint=False)
                size = rng.uniform(8.0, 20.0, 2)
                ponds.append(place + size * np.column_stack([np.cos(angle), np.sin(angle)]))
                break
    return ring, ponds


def drawn(seed: int, hectares: tuple[float, float]) -> Any:
    """The job of a seed."""
    import shapely

    from swath.fleet.files import (
        CartSettings,
        CombineSettings,
        FieldSettings,
        JobFile,
        PlanSettings,
        TruckSettings,
    )

    rng = np.random.default_rng(7_000 + seed)
    shape = SHAPES[seed % len(SHAPES)]
    ring, ponds = outline(rng, shape, 1e4 * float(rng.uniform(*hectares)))
    field = shapely.Polygon(ring)
    edge, off = (
        field.exterior,
        float(rng.uniform(10.0, 60.0) if rng.random() < 0.6 else rng.uniform(200.0, 600.0)),
    )
    around = field.convex_hull.buffer(off).exterior
    truck = np.array(around.interpolate(float(rng.uniform(0.0, edge.length)) % around.length).coords[0])
    turn, move = rng.uniform(-math.pi, math.pi), rng.uniform(-2000.0, 2000.0, 2)

    def placed(points: np.ndarray) -> list[tuple[float, float]]:
        c, s = math.cos(turn), math.sin(turn)
        return [
            (float(c * x - s * y + move[0]), float(s * x + c * y + move[1])) for x, y in np.atleast_2d(points)
        ]

    ((x, y),) = placed(truck)
    width = float(rng.choice([7.5, 9.0, 10.5]))
    combines = {
        f"combine_{i + 1}": CombineSettings(header_width_m=width, speed_kmh=float(rng.uniform(5.0, 7.5)))
        for i in range(int(rng.integers(1, 5)))
    }
    carts = {f"cart_{i + 1}": CartSettings() for i in range(int(rng.integers(0, 5)))}
    grain = float(rng.uniform(5.0, 11.0))
    volume = float(rng.uniform(25.0, 40.0)) if rng.random() < 0.2 else None
    return JobFile(
        format="swath fleet 1", name=f"{shape} {seed}",
        field=FieldSettings(placed(ring), [placed(p) for p in ponds], yield_t_ha=grain),
        combines=combines, carts=carts, plan=PlanSettings(headland_rounds=int(rng.integers(1, 3))),
        truck=TruckSettings(x_m=x, y_m=y, volume_m3=volume, away_min=float(rng.uniform(10.0, 40.0))),
    )  # fmt: skip


def wide(seed: int, hectares: tuple[float, float]) -> Any:
    """The job of a seed with more axes: 1 to 6 combines, 0 to 3 carts, a truck near or 1.3 km off, a gate,
    tanks emptied on the headland.
    """
    import shapely

    from swath.fleet.files import CartSettings

    job, rng = drawn(seed, hectares), np.random.default_rng(90_000 + seed)
    (c, *_), combines, carts = job.combines.values(), int(rng.integers(1, 7)), int(rng.integers(0, 4))
    field = shapely.Polygon(job.field.boundary_m)
    off = float(rng.choice([20.0, 1300.0], p=[0.8, 0.2]))
    around, outer = field.convex_hull.buffer(off).exterior, field.buffer(8.0).exterior
    at = around.interpolate(float(rng.random()), normalized=True)
    gate = outer.interpolate(outer.project(at)) if rng.random() < 0.3 else None
    unload = "headland" if carts and rng.random() < 0.25 else "anywhere"
    return replace(
        job,
        combines={f"combine_{i + 1}": c for i in range(combines)},
        carts={f"cart_{i + 1}": CartSettings() for i in range(carts)},
        plan=replace(job.plan, unload=unload),
        truck=replace(job.truck, x_m=at.x, y_m=at.y, gate_m=(gate.x, gate.y) if gate else None),
    )


def changes(kinds: list[str], job: Any) -> Iterator[tuple[str, str, Callable[[Any], Any]]]:
    """Kind, name and function of all changes of a job, first the job as drawn."""
    from tests.fleet.changed import MORE, NEARLY, SAME

    yield "as drawn", "", lambda job: job
    for kind, own in (("same", SAME), ("nearly", NEARLY)):
        yield from ((kind, name, change) for name, change in own.items() if kind in kinds)
    if "more" in kinds:
        yield from (("more", name, change) for name, (change, has) in MORE.items() if has(job))


def work(job: Any, key: dict[str, Any], limit: float, file: Path) -> None:
    """One job, in a process of its own; adds its row to a file."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 10))
    from benchmarks.fleet_baseline import baseline_hours

    from swath.core.errors import InputError
    from swath.core.foreign_code import allow_code
    from swath.fleet.driven import driven
    from swath.fleet.search import best_of
    from swath.fleet.worked import by_events

    row = dict(key, hours=math.nan)
    try:
        with allow_code(None):
            _, made = best_of(job)
        row["cpu_s"] = time.process_time()
        row["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        worked = by_events(made)
        row |= {
            "hours": worked.ends / 3600.0,
            "efficiency": worked.efficiency,
            "hectares": made.plan.area / 1e4,
        }
        row |= {"left": made.plan.left / made.plan.area, "notes": made.notes, "bound": made.bound / 3600.0}
        row |= {"dropped": len(job.carts) - len(made.machines.carts)}
        row |= {"combines": len(job.combines), "carts": len(job.carts)}
        if key["kind"] == "as drawn":
            row["baseline"] = baseline_hours(job)
        if key["driven"]:
            bodies = driven(made)
            row |= {"driven": bodies.ends / 3600.0, "contact_s": math.fsum(bodies.contact.values())}
    except InputError as error:
        row["said"] = str(error)
    except Exception as error:  # what else goes wrong is a row, too
        row["said"] = f"{type(error).__name__}: {error}"
    add(file, row)


def key_of(row: dict[str, Any]) -> tuple[int, str, str]:
    return row["seed"], row["kind"], row["change"]


def rows_of(file: Path) -> list[dict[str, Any]]:
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return [*{key_of(r): r for r in map(json.loads, lines)}.values()]


def run(args: argparse.Namespace, file: Path) -> None:
    """All that has no row, one process after the other."""
    spawn = mp.get_context("spawn")
    for seed in range(args.first, args.last):
        job = (wide if args.wide else drawn)(seed, tuple(args.hectares))
        for change in args.sets:
            section, _, rest = change.partition(".")
            name, _, value = rest.partition("=")
            own = getattr(job, section)
            job = replace(job, **{section: replace(own, **{name: type(getattr(own, name))(value)})})
        for kind, name, change in changes(args.against, job):
            key = {"seed": seed, "kind": kind, "change": name, "job": job.name, "driven": args.driven}
            done = {key_of(r) for r in rows_of(file)}
            if key_of(key) in done or (name and not any(word in name for word in args.only)):
                continue
            process = spawn.Process(target=work, args=(change(job), key, args.limit_s, file))
            process.start()
            process.join()
            if key_of(key) not in {key_of(r) for r in rows_of(file)}:
                add(file, dict(key, hours=math.nan, said=f"more than {args.limit_s:g} CPU-s"))
            print(line(rows_of(file)[-1]), flush=True)


def line(r: dict[str, Any]) -> str:
    """A row as printed."""
    head = f"{r['seed']:4} {r['job']:22} {r['change'] or 'as drawn':22}"
    if "said" in r:
        return f"{head} {r['said']}"
    text = f"{head} {r['hectares']:6.2f} ha {r['combines']}+{r['carts']} {r['hours']:7.3f} h"
    text += f" (bound {r['bound']:.3f})"
    text += f" {100 * r['efficiency']:5.1f} % {r['cpu_s']:6.1f} CPU-s {r['megabytes']:5.0f} MB"
    if "baseline" in r:
        text += f", baseline {r['baseline']:.3f} h, {r['hours'] / r['baseline']:.2f}"
    return text + (
        f", driven {r['driven']:.3f} h, contact {r['contact_s']:.1f} s" if "contact_s" in r else ""
    )


def summary(rows: list[dict[str, Any]]) -> None:
    """What came of all."""
    first = {r["seed"]: r for r in rows if r["kind"] == "as drawn"}
    ended = [r for r in first.values() if "said" not in r]
    print(f"{len(first)} jobs, {len(ended)} end")
    if ended:
        ratio = [r["hours"] / r["baseline"] for r in ended]
        whole = math.fsum(r["hours"] for r in ended) / math.fsum(r["baseline"] for r in ended)
        print(f"hours over baseline: {whole:.3f} in sum, {min(ratio):.2f} to {max(ratio):.2f}")
        for name, unit in (("cpu_s", "CPU-s"), ("megabytes", "MB"), ("efficiency", "efficiency")):
            values = sorted(r[name] for r in ended)
            print(f"{unit}: {values[0]:.3g} to {values[-1]:.3g}, median {values[len(values) // 2]:.3g}")
        dropped = [r["seed"] for r in ended if r["dropped"] and r["hectares"] > 5.0]
        print(f"carts left out on more than 5 ha: seeds {dropped}")
    for kind, limit in LIMITS.items():
        for name in dict.fromkeys(r["change"] for r in rows if r["kind"] == kind):
            own = [r for r in rows if r["change"] == name and "said" not in first[r["seed"]]]
            failed = [r["seed"] for r in own if "said" in r]
            off = [100.0 * (r["hours"] / first[r["seed"]]["hours"] - 1.0) for r in own if "said" not in r]
            over = sum(x > limit or (kind != "more" and x < -limit) for x in off)
            span = f"{min(off):+.2f} to {max(off):+.2f} %" if off else "-"
            print(f"{kind}, {name}: {span}, {over} of {len(off)} beyond {limit} %; no end: {failed}")


def main() -> None:
    """See above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--hectares", type=float, nargs=2, default=(1.0, 4.0), metavar=("LEAST", "MOST"))
    parser.add_argument("--against", nargs="+", default=["baseline"], choices=("baseline", *LIMITS))
    parser.add_argument(
        "--only", nargs="+", default=[""], metavar="WORD", help="changes whose name holds one"
    )
    parser.add_argument("--wide", action="store_true", help="draw over more axes, see `wide`")
    parser.add_argument("--driven", action="store_true", help="bodies, too")
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--limit-s", type=float, default=300.0, help="CPU-s of each")
    parser.add_argument("--out", type=Path, default=Path("out/fleet_jobs"))
    parser.add_argument("--table", action="store_true", help="print what is there")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    file = args.out / "rows.jsonl"
    if not args.table:
        run(args, file)
    rows = [r for r in rows_of(file) if args.first <= r["seed"] < args.last]
    for row in rows if args.table else []:
        print(line(row))
    summary(rows)


if __name__ == "__main__":
    main()
