"""How often the intervals of `swath compare log` hold the truth of drawn steering logs, by key.

    python -m benchmarks.steering_fit --first 100 --count 40 [--others] [--motion]

Logs of tests/tools/drawn_steering.py; --others: the kinds that were left out while the fit was made.
--motion: with yaw rates; only understeer has a truth there, the tyre lag of the draw is not the model's.
"""

import argparse
import tempfile
from pathlib import Path

from tests.tools.drawn_steering import drawn

from swath.tools.compare_log.steering_fit import compare_steering


def main() -> None:
    """Print each draw, then how many numbers were held and how many were not shown, by key."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--others", action="store_true")
    parser.add_argument("--motion", action="store_true")
    args = parser.parse_args()
    held: dict[str, list[bool]] = {}
    silent: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.count):
            made = drawn(seed, others=args.others, motion=args.motion)
            done = compare_steering("lexion-700-class", made.write(Path(folder) / "log.csv"))
            texts = []
            for f in (f for part in done.parts for f in part.fitted if f.key in made.truth):
                truth = made.truth[f.key]
                if not f.is_seen:
                    silent[f.key] = silent.get(f.key, 0) + 1
                    texts.append(f"{f.key.split('.')[1]} {truth:.3f} not shown")
                    continue
                held.setdefault(f.key, []).append(f.low <= truth <= f.high)
                texts.append(
                    f"{f.key.split('.')[1]} {truth:.3f} {f.value:.3f} ({f.low:.3f}..{f.high:.3f})"
                    f"{'' if held[f.key][-1] else ' MISSED'}"
                )
            print(seed, *made.axes.values(), "|", "; ".join(texts), flush=True)
    for key, each in held.items():
        print(f"{key}: {sum(each)} of {len(each)} held, {silent.get(key, 0)} not shown")


if __name__ == "__main__":
    main()
