"""Drawn jobs of whole fields: each planned and driven, then looked at by code that neither uses.

    python -m benchmarks.fleet 600 800 --hectares 0.6 2.5 --processes 2 --limit-s 300 --out out/fleet

Seeds FIRST to LAST, the last one left out. Each job runs in a process of its own, at most `--limit-s` of CPU.
What is done is kept in `rows.jsonl` of the folder: a stopped benchmark goes on. Prints a row for each job,
then what came of all, and each refusal with whether a look at the job by geometry alone confirms it.
`--table` prints what is there. `--set` changes a key of all jobs, as `fleet.dispatcher=my.py:Class`, and
`--against FOLDER` compares the hours with those of another folder, as of another dispatcher.
"""

import argparse
import json
import math
import multiprocessing as mp
import resource
import signal
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

HEAD = (
    "seed    ha comb cart holes parts t/ha | outcome    events  driven h  CPU s | contact s  left %  lost"
    "     out s | as driven: contact s  left %  lost"
)


def work(seed: int, hectares: tuple[float, float], limit: float, file: Path, sets: list[str]) -> None:
    """One job, in a process of its own; adds its row to a file."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 10))
    from tests.fleet.check import looked_at
    from tests.fleet.drawn import drawn_job
    from tests.fleet.refusals import confirmed

    from swath.core.errors import InputError
    from swath.core.foreign_code import allow_code
    from swath.fleet.driven import driven
    from swath.fleet.search import best_of
    from swath.fleet.worked import by_events

    job = drawn_job(seed, hectares)
    for change in sets:
        section, _, rest = change.partition(".")
        key, _, value = rest.partition("=")
        part = getattr(job, section)
        job = replace(job, **{section: replace(part, **{key: type(getattr(part, key) or "")(value)})})
    row = about(seed, job)
    try:
        with allow_code(None):
            _, made = best_of(job)
        row["cpu_s"] = time.process_time()
        events, bodies = by_events(made), driven(made)
        row |= {"outcome": "ended", "cpu_driven_s": time.process_time() - row["cpu_s"], "notes": made.notes}
        row |= {"ha": made.plan.area / 1e4, "events_s": events.ends, "driven_s": bodies.ends}
        for name, worked in (("planned", None), ("bodies", bodies)):
            found = asdict(looked_at(made, worked))
            found["contact"] = {", ".join(pair): s for pair, s in found["contact"].items()}
            row[name] = found
    except InputError as error:
        held, seen = confirmed(job, error.key, error.expected)
        row |= {"outcome": "refused", "said": str(error), "confirmed": held, "seen": seen}
    except Exception as error:  # what else goes wrong is a row, too
        row |= {"outcome": "failed", "said": f"{type(error).__name__}: {error}"}
    add(file, row | {"cpu_s": row.get("cpu_s", time.process_time())})


def about(seed: int, job: Any) -> dict[str, Any]:
    """What was drawn."""
    f = job.field
    return {
        "seed": seed, "combines": len(job.combines), "carts": len(job.carts), "holes": len(f.holes_m),
        "parts": 1 + len(f.parts_m), "t_ha": f.yield_t_ha, "ha": math.nan,
    }  # fmt: skip


def add(file: Path, row: dict[str, Any]) -> None:
    """One line more, in one write."""
    with file.open("ab", buffering=0) as stream:
        stream.write((json.dumps(row, default=float) + "\n").encode())


def rows_of(file: Path) -> dict[int, dict[str, Any]]:
    """What is done, by seed."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return {r["seed"]: r for r in map(json.loads, lines)}


def run(args: argparse.Namespace, file: Path) -> None:
    """All seeds that have no row, in several processes."""
    from tests.fleet.drawn import drawn_job

    spawn = mp.get_context("spawn")
    seeds = [s for s in range(args.first, args.last) if s not in rows_of(file)]
    at_work: dict[int, Any] = {}
    while seeds or at_work:
        while seeds and len(at_work) < args.processes:
            seed = seeds.pop(0)
            at_work[seed] = spawn.Process(
                target=work, args=(seed, tuple(args.hectares), args.limit_s, file, args.sets), daemon=True
            )
            at_work[seed].start()
        time.sleep(0.1)
        for seed, process in list(at_work.items()):
            if process.is_alive():
                continue
            del at_work[seed]
            if seed not in rows_of(file):  # it was stopped
                long = process.exitcode == -signal.SIGXCPU
                row = about(seed, drawn_job(seed, tuple(args.hectares)))
                row["said"] = (
                    f"more than {args.limit_s:g} CPU-s" if long else f"ended with {process.exitcode}"
                )
                add(file, row | {"outcome": "too long" if long else "failed", "cpu_s": args.limit_s})
            print(line(rows_of(file)[seed]), flush=True)


def line(r: dict[str, Any]) -> str:
    """A row as printed."""
    drawn = f"{r['seed']:4} {r['ha']:5.2f} {r['combines']:4} {r['carts']:4} {r['holes']:5} {r['parts']:5}"
    drawn += f" {r['t_ha']:4.1f}"
    if r["outcome"] != "ended":
        said = f"{r['said']}; {r['seen']}" if "seen" in r else r["said"]
        sure = {True: "CONFIRMED: ", False: "NOT CONFIRMED: ", None: ""}[r.get("confirmed")]
        return f"{drawn} | {r['outcome']:9} {r['cpu_s']:6.1f} CPU s: {sure}{said}"
    cpu = r["cpu_s"] + r["cpu_driven_s"]
    p, b = r["planned"], r["bodies"]
    hours = f"{r['events_s'] / 3600:7.3f} {r['driven_s'] / 3600:7.3f}   {cpu:6.1f}"
    looked = f"{touched(p):9.1f} {100 * p['left']:7.2f} {p['mass']:8.0e} {p['outside'] + p['hole']:5.0f}"
    as_driven = f"{touched(b):19.1f} {100 * b['left']:7.2f} {b['mass']:8.0e}"
    return f"{drawn} | ended     {hours} | {looked} | {as_driven}"


def touched(found: dict[str, Any]) -> float:
    """Seconds in which two bodies are over each other."""
    return math.fsum(found["contact"].values())


def summary(rows: list[dict[str, Any]]) -> None:
    """What came of all."""
    ended = [r for r in rows if r["outcome"] == "ended"]
    counts = {o: sum(r["outcome"] == o for r in rows) for o in ("ended", "refused", "too long", "failed")}
    print(f"{len(rows)} jobs: " + ", ".join(f"{n} {o}" for o, n in counts.items()))
    refused = [r for r in rows if r["outcome"] == "refused"]
    print(
        f"refusals that a look of its own confirms: {sum(r['confirmed'] for r in refused)} of {len(refused)}"
    )
    for key, name in (("planned", "as planned"), ("bodies", "as driven")):
        touch = [r["seed"] for r in ended if touched(r[key]) > 0.0]
        left = [r["seed"] for r in ended if r[key]["left"] >= 0.005]
        lost = [r["seed"] for r in ended if r[key]["mass"] >= 1e-9]
        out = [r["seed"] for r in ended if r[key]["outside"] + r[key]["hole"] > 0.0]
        print(
            f"{name}: contact in {touch}, 0.5 % left in {left}, grain lost in {lost}, off its ground in {out}"
        )
    if ended:
        off = sorted(100.0 * (r["driven_s"] / r["events_s"] - 1.0) for r in ended)
        print(f"driven over events: {off[0]:+.2f} to {off[-1]:+.2f} %, median {off[len(off) // 2]:+.2f} %")
        cpu = sorted(r["cpu_s"] + r["cpu_driven_s"] for r in ended)
        print(
            f"CPU s of a job: median {cpu[len(cpu) // 2]:.1f}, most {cpu[-1]:.1f}, all {math.fsum(cpu):.0f}"
        )


def against(rows: list[dict[str, Any]], others: dict[int, dict[str, Any]]) -> None:
    """Hours of jobs that end here and there, and whether both levels rank them alike."""
    both = [(r, others[r["seed"]]) for r in rows if r["outcome"] == "ended" and r["seed"] in others]
    both = [(r, o) for r, o in both if o["outcome"] == "ended"]
    if not both:
        print("no job ends in both")
        return
    for key in ("events_s", "driven_s"):
        off = sorted(100.0 * (r[key] / o[key] - 1.0) for r, o in both)
        faster = sum(x < 0.0 for x in off)
        middle = off[len(off) // 2]
        span = f"{off[0]:+.1f} to {off[-1]:+.1f} %, median {middle:+.1f} %"
        print(f"{key}: {span}, faster in {faster} of {len(off)}")
    alike, apart = 0, 0
    for r, o in both:
        levels = max(abs(x["driven_s"] / x["events_s"] - 1.0) for x in (r, o))
        if abs(r["events_s"] / o["events_s"] - 1.0) > levels:
            apart += 1
            alike += (r["events_s"] < o["events_s"]) == (r["driven_s"] < o["driven_s"])
    print(f"{apart} differ by more than the levels do; both levels rank {alike} of them alike")


def main() -> None:
    """See above."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--hectares", type=float, nargs=2, default=(0.6, 2.5), metavar=("LEAST", "MOST"))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--limit-s", type=float, default=300.0, help="CPU-s of a job")
    parser.add_argument("--out", type=Path, default=Path("out/fleet"))
    parser.add_argument("--set", dest="sets", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--against", type=Path, metavar="FOLDER")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    file = args.out / "rows.jsonl"
    print(HEAD)
    if args.table:
        for row in rows_of(file).values():
            print(line(row))
    else:
        run(args, file)
    rows = [r for s, r in sorted(rows_of(file).items()) if args.first <= s < args.last]
    summary(rows)
    if args.against is not None:
        against(rows, rows_of(args.against / "rows.jsonl"))


if __name__ == "__main__":
    main()
