"""What each example is there to show: how far the limit that shows it moves without it, over seeds.

    nice python -m benchmarks.specialities [NAME ...] [--seeds 3] [--keep]

Examples are the bundled scenarios, and those that tutorials have the reader save. A limit of theirs with a
`speciality` names the changes that take it away and `by`, how far its value moves then at least. Of every
seed both are driven, over `run_m`. `by` has to be 3 standard deviations over the seeds of the value as
shipped, and no more than what any seed moved. --keep writes the values to specialities.json, from which
tests/whole/test_specialities.py asks the same.
"""

import argparse
import json
import re
import statistics
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from swath.runtime.job import run_unrecorded
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario, parse_scenario, scenario_names
from swath.scenario.sections import Speciality

KEPT = Path(__file__).with_suffix(".json")
LEFT_OUT = {  # their FMU or network is built in the tutorial, which drives it
    "my-simulink-model/harvest", "my-network/net", "my-network/stereo",
}  # fmt: skip
TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
DEVIATIONS = 3.0  # of the value over seeds, that make a change of it one


class Shown(NamedTuple):
    """A limit that shows what an example is for: its place among the limits, and its speciality."""

    example: str
    number: int
    limit: str
    speciality: Speciality

    @property
    def key(self) -> str:
        """As the kept values name it."""
        return f"{self.example}: {self.limit} without {', '.join(self.speciality.without)}"


def of_tutorials() -> dict[str, str]:
    """Text of each scenario that a tutorial has the reader save, by `tutorial/name`."""
    found = {}
    for page in sorted(TUTORIALS.glob("*.md")):
        for text in re.findall(r"^```yaml\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
            if name := re.search(r"^format: swath scenario .*?^name: (\S+)$", text, re.M | re.S):
                found[f"{page.stem}/{name[1]}"] = text
    return {name: text for name, text in found.items() if name not in LEFT_OUT}


def examples() -> list[str]:
    """Names of all examples."""
    return [*scenario_names(), *of_tutorials()]


def read(example: str, *sets: str) -> Scenario:
    """The scenario of an example."""
    texts = of_tutorials() if "/" in example else {}
    return parse_scenario(texts[example], sets=sets) if texts else load_scenario(example, sets=sets)


def shown(example: str) -> Iterator[Shown]:
    """What an example is there to show."""
    for number, entry in enumerate(read(example).expect):
        if (own := entry.limit.speciality) is not None:
            yield Shown(example, number, f"{entry.subject}.{entry.name}", own)


@cache
def driven(example: str, run_m: float, seed: int, without: tuple[str, ...] = ()) -> list[dict[str, Any]]:
    """Entries of the limits after so many metres."""
    sets = layered([f"run.distance_m={run_m:g}", f"seed={seed}"], without)
    found: list[dict[str, Any]] = run_unrecorded(read(example, *sets))["expect"]
    return found


def values(one: Shown, seed: int = 1) -> tuple[float, float]:
    """Value of the limit as shipped, and without the speciality; nan where nothing was measured."""
    own = one.speciality
    both = (driven(one.example, own.run_m, seed, w) for w in ((), tuple(own.without)))
    as_shipped, without = (entries[one.number]["value"] for entries in both)
    return tuple(float("nan") if v is None else float(v) for v in (as_shipped, without))  # type: ignore[return-value]


def fault(one: Shown, with_it: list[float], without: list[float]) -> str:
    """What is wrong with `by`, "" where it is 3 deviations, and no more than what each seed moved."""
    spread = DEVIATIONS * statistics.stdev(with_it)
    moved = min(abs(a - b) for a, b in zip(with_it, without, strict=True))
    by = one.speciality.by
    return (
        "" if spread <= by <= moved else f"{one.key}: expected by in [{spread:.3g}, {moved:.3g}], is {by:g}"
    )


def main() -> int:
    """Print the table; 1 where a `by` is off."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--keep", action="store_true")
    args = parser.parse_args()
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.is_file() else {}
    known, faults = [one for name in examples() for one in shown(name)], []
    print("| example, limit, without | by | as shipped | spread | without | \n|---|---|---|---|---|")
    for one in known:
        if args.names and one.example not in args.names:
            continue
        pairs = [values(one, seed) for seed in range(1, args.seeds + 1)]
        a, b = ([round(v, 9) for v in side] for side in zip(*pairs, strict=True))
        kept[one.key] = {"with": a, "without": b}
        faults += [said] if (said := fault(one, a, b)) else []
        ends = (f"{min(side):.4g} to {max(side):.4g}" for side in (a, b))
        shipped, without = ends
        print(
            f"| {one.key} | {one.speciality.by:g} | {shipped} | {statistics.stdev(a):.3g} | {without} |",
            flush=True,
        )
        if args.keep:
            lines = (
                f"{json.dumps(one.key)}: {json.dumps(kept[one.key])}" for one in known if one.key in kept
            )
            KEPT.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(*faults, sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
