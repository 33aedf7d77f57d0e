"""Whether a key that is said to be used by nothing changes the digest, and one that is not, does not.

    python -m benchmarks.felt [--cases] [--drawn 14] [--seed 1] [--only NAME ...] [--every 1]

Rows are the keys that the bundled scenarios set and all keys of `field.weather` in some of them; with
`--cases` those that the bundled test cases set; with `--drawn` so many keys of slots, faults, parts,
machines, `run` and `realtime` of each scenario, and of some with the user's own parts, off their defaults.
Prints the rows of keys that are said to be unused, and of those that no part is said to leave out though the
digest stays, then counts, by what has the key.
"""

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.felt import WITH_WEATHER, Looked, drawn_rows, rows_of, weather_rows

from swath.core.errors import SwathError
from swath.core.foreign_code import allow_code
from swath.scenario.scenario import scenario_names
from swath.tools.function_test.case import find_cases

WORDS = {
    (True, True): "FALSE: said to be unused, but felt",
    (True, False): "said to be unused, and not felt",
    (False, True): "felt",
    (False, False): "read, but not felt in the first metres",
}
FARMS = Path(__file__).parents[1] / "examples"
OWN = {  # scenarios with parts of the user's own
    "own edge": ("straight", (f"combine.edge={FARMS}/my_edge_detector.py:MyEdgeDetector",)),
    "own steering": ("bend", (f"combine.steer={FARMS}/my_steering_law.py:MySteeringLaw",)),
    "own fill": ("unload-on-the-go", (f"cart.cooperate={FARMS}/my_fill_strategy.py:TwoSpots",)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", action="store_true")
    parser.add_argument("--drawn", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    bases = {name: (name, ()) for name in scenario_names()}
    if args.cases:
        bases = {
            case.name: (case.scenario, tuple(f"{k}={json.dumps(v)}" for k, v in case.file.set.items()))
            for case in find_cases("catalogue")
        }
    if args.drawn:
        bases |= OWN
    begin, counts = time.process_time(), Counter[tuple[str, str]]()
    for title, (name, sets) in bases.items():
        if args.only and title not in args.only:
            continue
        try:
            rows = drawn_rows(name, sets, seed=args.seed, count=args.drawn)
            rows = rows or list(rows_of(name, sets))
        except SwathError as error:
            print(f"{title}: {error}")
            continue
        look(title, rows[:: args.every], counts)
    for name, sets in () if args.cases or args.drawn or args.only else WITH_WEATHER:
        look(" ".join((name, *sets)), list(weather_rows(name, sets))[:: args.every], counts)
    print("", *(f"{count:5} {group:9} {said}" for (group, said), count in sorted(counts.items())), sep="\n")
    print(f"{time.process_time() - begin:.0f} CPU-s")


def look(title: str, rows: list, counts: Counter[tuple[str, str]]) -> None:
    looked = Looked()
    for row in rows:
        try:
            found = looked.look(row)
        except SwathError as error:
            said = "not without it"
            print(f"{title}: {row.key}: {said}: {str(error)[:100]}", flush=True)
        else:
            said = WORDS[found.is_told, found.is_felt]
            if found.is_told or not found.is_felt:
                own = row.sets[-1:] if row.others == ("",) else row.others
                print(f"{title}: {row.key}: {said} ({', '.join(own)})", flush=True)
        counts[row.group, said] += 1


if __name__ == "__main__":
    with allow_code(None):
        main()
