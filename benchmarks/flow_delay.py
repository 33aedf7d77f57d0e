"""The flow delay of yield logs drawn at random, beside the true one.

    python benchmarks/flow_delay.py [--first 2000] [--number 200]

Prints a line for each machine whose delay is not known or off by more than 0.5 s, then the shares: of the
machines whose log goes through six turns, of those whose log ends at six turns, of both, and of the others.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.field.drawn_logs import draw

from swath.field_io.delay import estimate_delays
from swath.field_io.logs.log import read_log


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--first", type=int, default=2000)
    parser.add_argument("--number", type=int, default=200)
    args = parser.parse_args()
    errors = {"six turns in the log": [], "six ends of passes, no turns": [], "fewer": []}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.number):
            made = draw(seed)
            for delay in estimate_delays(read_log(made.write(Path(folder) / "log.csv"))):
                true = made.delays[delay.machine]
                kinds = list(errors)
                kind = kinds[2 if made.turns[delay.machine] < 6 else 0 if made.has_turns else 1]
                errors[kind].append(delay.seconds - true)
                if not abs(delay.seconds - true) <= 0.5:
                    print(
                        f"{seed} {delay.machine}: {true:.2f} s, {delay.seconds:.2f} s {delay.method}; {kind}"
                    )
    turns, ends, _ = errors.values()
    errors["six turns or ends"] = turns + ends
    for kind, found in errors.items():
        size = np.abs(found)
        print(f"{kind}: {len(size)} machines, within 0.5 s {np.mean(size <= 0.5):.0%}, not known "
              f"{np.mean(np.isnan(size)):.0%}, off by more than 2 s {int((size > 2.0).sum())}")  # fmt: skip


if __name__ == "__main__":
    main()
