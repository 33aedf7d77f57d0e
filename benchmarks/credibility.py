"""How many runs of the catalogue leave the range in which a level was checked, and by what.

    nice python -m benchmarks.credibility [--distance 10] [CASE ...]

The first run of every case over its first metres. 20 runs outside: tests/runtime/test_credibility.py.
"""

import argparse
from dataclasses import replace

from swath.core.errors import SwathError
from swath.runtime.credibility import outside_of, why_outside
from swath.runtime.job import run_unrecorded
from swath.scenario.overrides import layered
from swath.tools.function_test.case import find_cases
from swath.tools.function_test.one_run import scenario_of
from swath.tools.function_test.plan import Plan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--distance", type=float, default=10.0, metavar="M")
    args = parser.parse_args()
    flagged = count = 0
    for name in args.cases or [case.name for case in find_cases("catalogue")]:
        run = next(Plan(name).runs())
        short = replace(run, sets=layered(run.sets, [f"run.distance_m={args.distance:g}"]))
        try:
            found = outside_of(run_unrecorded(scenario_of(short)))
        except SwathError as error:
            print(f"{name}: {error}", flush=True)
            continue
        count += 1
        flagged += bool(found)
        said = "; ".join(f"{slot} {why_outside(told)}" for slot, told in found.items()) or "inside"
        print(f"{name} {dict(run.point)}: {said}", flush=True)
    print(f"{flagged} of {count} runs flagged")


if __name__ == "__main__":
    main()
