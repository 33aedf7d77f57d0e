"""See the package."""

import argparse
import math
import time

import benchmarks.fleet_graph as package
from benchmarks.fleet_baseline import baseline_hours
from benchmarks.fleet_graph.search import Found, best_of
from benchmarks.fleet_jobs import changes, drawn


def line(found: Found) -> str:
    """A job as printed."""
    text = f"{found.hours:7.3f} h, bound {found.bound:.3f}, {found.ended} of {found.plans} plans end"
    text += f", {found.circles} circles; CPU: graph {found.graph_s:.1f} s"
    text += f", a plan {1000.0 * found.plans_s / max(found.plans, 1):.0f} ms"
    if found.worked is not None and found.schedule is not None:
        area = math.fsum(a for *_, a in found.schedule.cut) / found.schedule.plan.area
        text += (
            f"; decoded {found.decoded:.3f} h, cut {100.0 * area:.2f} %, mass {found.worked.mass_error:.0e}"
        )
    if found.choices is not None:
        text += f"; uses {found.choices.combines}+{found.choices.carts}"
    return text


def main() -> None:
    """See the package."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fleet_graph", description=package.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--hectares", type=float, nargs=2, default=(1.0, 2.5), metavar=("LEAST", "MOST"))
    parser.add_argument("--plans", type=int, default=200)
    parser.add_argument("--against", nargs="*", default=[], choices=("same", "nearly", "more"))
    parser.add_argument("--only", nargs="+", default=[""], metavar="WORD")
    parser.add_argument("--driven", action="store_true", help="bodies, too: contact and hours")
    parser.add_argument("--swath", action="store_true", help="hours of swath's own planner, too")
    args = parser.parse_args()
    sums = {"graph": 0.0, "baseline": 0.0, "swath": 0.0}
    for seed in range(args.first, args.last):
        first = math.nan
        for kind, name, change in changes(args.against, drawn(seed, tuple(args.hectares))):
            if name and not any(word in name for word in args.only):
                continue
            job = change(drawn(seed, tuple(args.hectares)))
            head = f"{seed:3} {job.name:20} {len(job.combines)}+{len(job.carts)} {name or 'as drawn':20}"
            try:
                found = best_of(job, args.plans)
            except Exception as error:  # what has no graph is a row, too
                print(head, f"{type(error).__name__}: {error}"[:200], flush=True)
                continue
            text = line(found)
            if kind == "as drawn":
                first, base = found.hours, baseline_hours(job)
                text += f"; baseline {base:.3f} h, {found.hours / base:.2f}"
                if math.isfinite(found.hours):
                    sums["graph"] += found.hours
                    sums["baseline"] += base
                if not found.ended:
                    text += f" {found.why}"
            else:
                text += f"; {100.0 * (found.hours / first - 1.0):+.2f} %"
            if args.driven and found.schedule is not None:
                from swath.fleet.driven import driven

                bodies = driven(found.schedule)
                contact = math.fsum(bodies.contact.values())
                text += f"; driven {bodies.ends / 3600.0:.3f} h, contact {contact:.1f} s"
            if args.swath and kind == "as drawn":
                from swath.fleet.search import best_of as swath_best
                from swath.fleet.worked import by_events

                t = time.process_time()
                hours = by_events(swath_best(job)[1]).ends / 3600.0
                sums["swath"] += hours
                text += f"; swath {hours:.3f} h in {time.process_time() - t:.0f} CPU-s"
            print(head, text, flush=True)
    print("sums of jobs that end [h]:", ", ".join(f"{k} {v:.3f}" for k, v in sums.items() if v))


if __name__ == "__main__":
    main()
