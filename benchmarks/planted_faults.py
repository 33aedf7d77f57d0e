"""Mutation score of the catalogue: which of thirty planted faults which of its cases catch.

    nice python -m benchmarks.planted_faults --out DIR [--cases straight-clean bend] [--seeds 1] [--draw 1]
        [--faults gate-lost none-edge-noise-1mm]

The faults stand in planted_faults.yaml, written down before the first run. A case catches a fault when a run
that passes without it does not pass with it: the same point, seed, field and noise. `none-...` are changes
that are no faults: none shall be reported. Goes on where it was stopped; `--show` prints what is there.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from swath.tools.function_test.candidates import read_candidates
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import Session, begin, open_session
from swath.tools.function_test.stored_line import Result

FAULTS = Path(__file__).with_name("planted_faults.yaml")
CASES = (
    "straight-clean", "side-slope", "crop-ends", "bend", "gap", "low-density", "rough-ground", "lodged-in",
    "entry", "gap-long", "weeds", "wind", "bend-tight", "low-contrast", "timely", "edge-ends",
)  # fmt: skip
BASE = "without"


def caught(results: Sequence[Result]) -> dict[str, tuple[int, int]]:
    """Fault -> how many runs it turned from passing to failing, and how many runs there are to tell by."""
    passing = {
        (str(r["point"]), r["seed"]) for r in results if r["candidate"] == BASE and r["verdict"] == "pass"
    }
    told = [r for r in results if r["candidate"] != BASE and (str(r["point"]), r["seed"]) in passing]
    found: dict[str, tuple[int, int]] = {}
    for result in told:
        turned, count = found.get(result["candidate"], (0, 0))
        found[result["candidate"]] = turned + (result["verdict"] != "pass"), count + 1
    return found


def show(by_case: dict[str, dict[str, tuple[int, int]]], faults: Sequence[str]) -> None:
    print("| fault | " + " | ".join(by_case) + " |\n|" + "---|" * (len(by_case) + 1))
    for fault in faults:
        cells = [found.get(fault) for found in by_case.values()]
        print(f"| {fault} | " + " | ".join("-" if c is None else f"{c[0]} of {c[1]}" for c in cells) + " |")
    planted = [f for f in faults if not f.startswith("none-")]
    told = [f for f in planted if any(f in found for found in by_case.values())]
    hits = [f for f in planted if any(found.get(f, (0, 0))[0] for found in by_case.values())]
    false = [
        f for f in faults if f not in planted and any(found.get(f, (0, 0))[0] for found in by_case.values())
    ]
    print(f"\n{len(hits)} of {len(told)} planted faults are caught, of {len(planted)} in the list; "
          f"not: {', '.join(f for f in told if f not in hits) or 'none'}")  # fmt: skip
    none = [f for f in faults if f not in planted and any(f in found for found in by_case.values())]
    print(f"reported where nothing is planted: {', '.join(false) or 'none'} of {len(none)} that were tried")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", nargs="+", default=list(CASES))
    parser.add_argument("--faults", nargs="+", default=[], help="only these of the list")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--draw", type=int, default=0)
    parser.add_argument("--draw-seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--show", action="store_true")
    args = parser.parse_args()
    listed = read_candidates(FAULTS)
    if unknown := sorted(set(args.faults) - set(listed)):
        parser.error(f"not in {FAULTS.name}: {', '.join(unknown)}")
    candidates = {BASE: (), **{name: listed[name] for name in args.faults or listed}}
    by_case = {}
    for case in args.cases:
        folder = args.out / case
        session: Session
        if args.show and folder.is_dir():
            session = open_session(folder, same_code=False)
        elif not args.show:
            plan = Plan(
                case, candidates=candidates, seeds=args.seeds, drawn=args.draw, draw_seed=args.draw_seed
            )
            session = begin(folder, plan)
            session.do(
                args.workers, lambda result: print(result["case"], result["candidate"], result["verdict"])
            )
        else:
            continue
        by_case[case] = caught(session.results())
    show(by_case, [name for name in candidates if name != BASE])


if __name__ == "__main__":
    main()
