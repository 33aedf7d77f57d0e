"""What readers make of inputs that are drawn with their truth known: right, told or refused truly, or not.

    python -m benchmarks.readers logs [--first 0] [--count 60] [--held-out] [--list]

Kinds are the modules `tests/readers/drawn_*.py`. Prints each draw that ends badly with its traits, its
truth, and what was said, then the counts of all and by unusual trait. `--held-out` draws only inputs with a
value that was kept for the judge, and prints which; `--list` prints the good ones, too.
"""

import argparse
import sys
import time
import warnings
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.readers.verdict import table, verdict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kind")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--list", action="store_true")
    args = parser.parse_args()
    module = import_module(f"tests.readers.drawn_{args.kind}")
    warnings.simplefilter("ignore")
    begin, verdicts = time.process_time(), []
    if args.held_out:
        print(
            *(f"held out, {axis}: {', '.join(map(str, v))}" for axis, v in module.HELD_OUT.items()), sep="\n"
        )
    for seed in range(args.first, args.first + args.count):
        verdicts.append(verdict(module.draw(seed, args.held_out), module.read))
        if args.list or not verdicts[-1].is_good:
            print(*verdicts[-1].lines(), sep="\n", flush=True)
    print("", *table(verdicts), "", f"{time.process_time() - begin:.0f} CPU-s", sep="\n")


if __name__ == "__main__":
    main()
