"""All declared spans at both ends, and random ones together.

    python -m tests.spans.run                          # everything, about an hour
    python -m tests.spans.run --of inputs --times 20   # and so many together of each level
    python -m tests.spans.run --of keys,sheets --only speed --only radar

Prints what is a mistake of swath, and at the end how many were taken and refused. Exit code 1 where one was.
"""

import argparse
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

from swath.core.errors import SwathError
from tests.spans import inputs, keys, sheets
from tests.spans.moment import moment

LONGEST_S = 30  # of a case; one that takes longer is counted as slow

Case = tuple[str, Callable[[], str]]


class Slow(BaseException):
    """A case takes too long."""


def of_keys(folder: Path) -> Iterator[Case]:
    """Each key of scenarios at each end."""
    for key in keys.every_key():
        for value in key.ends().values():
            yield f"{key} = {value:g}", lambda key=key, value=value: moment(key.scenario(value), folder)


def of_sheets(folder: Path) -> Iterator[Case]:
    """Each number of data sheets at each limit."""
    for number in sheets.numbers():
        yield str(number), lambda number=number: moment(number.scenario(folder), folder)


def of_inputs(folder: Path, times: int) -> Iterator[Case]:
    """Each field of what flows into each level at each end, alone; then several at once."""
    for slot, level in inputs.levels():
        try:
            part = inputs.alone(slot, level, folder)
        except SwathError as error:
            print(f"left out  {slot}.{level}: {error}")
            continue
        spans, rng = inputs.spans(slot, level, part), Random(f"{slot} {level}")
        sets = [[span] for span in spans]
        sets += [rng.sample(spans, min(rng.randint(2, 6), len(spans))) for _ in range(times if spans else 1)]
        for chosen in sets:
            given: dict[tuple[str, str], dict[str, float]] = {}
            for span in chosen:
                given.setdefault(span.output, {})[span.field] = span.value
            seed = rng.randrange(1 << 30)
            yield (
                f"{slot}.{level}: {', '.join(map(str, chosen))}",
                (lambda part=part, given=given, seed=seed: inputs.drive(part, given, seed) or ""),
            )
        part.world.close()


def result_of(case: Callable[[], str]) -> tuple[str, str]:
    """taken, refused, slow or MISTAKE, and what was said."""

    def late(*_: object) -> None:
        raise Slow

    signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST_S)
    try:
        said = case()
        return ("refused" if said else "taken"), said
    except SwathError as error:
        return "refused", str(error)
    except Slow:
        return "slow", ""
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return "MISTAKE", f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"
    finally:
        signal.alarm(0)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--of", default="inputs,keys,sheets", help="which, with commas between")
    parser.add_argument("--times", type=int, default=20, help="of inputs: how often several at once")
    parser.add_argument("--only", action="append", default=[], help="those whose name has this in it")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    folder, counts = Path(tempfile.mkdtemp()), Counter[str]()
    keys.files(folder)
    sets = {"inputs": lambda: of_inputs(folder, args.times), "keys": lambda: of_keys(folder)}
    sets["sheets"] = lambda: of_sheets(folder)
    for name in args.of.split(","):
        for says, case in sets[name]():
            if args.only and not any(text in says for text in args.only):
                continue
            result, said = result_of(case)
            counts[f"{name} {result}"] += 1
            if result in ("MISTAKE", "slow"):
                print(f"{result}  {says}: {said}", flush=True)
    print(", ".join(f"{name}: {count}" for name, count in sorted(counts.items())))
    return int(any("MISTAKE" in name for name in counts))


if __name__ == "__main__":
    sys.exit(main())
