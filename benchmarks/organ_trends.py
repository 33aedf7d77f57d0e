"""How often losses, quality and power of the organs go with a setting as manuals say, over drawn points.

    python benchmarks/organ_trends.py [COUNT]

A row per setting, a column per quality: the share of the points at which the trend holds, and its sign.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from tests.machine.organ_trends import QUALITIES, TRENDS, judged


def main(count: int = 100) -> float:
    """Print the table; the least share."""
    found = [judged(np.random.default_rng(seed)) for seed in range(count)]
    print(f"{'':10s}" + "".join(f"{q:>13s}" for q in QUALITIES))
    shares = {key: float(np.mean([each[key] for each in found])) for key in found[0]}
    for name, (signs, _) in TRENDS.items():
        row = [f"{shares[name, q]:8.2f} ({s})" for q, s in zip(QUALITIES, signs, strict=True)]
        print(f"{name:10s}" + "".join(f"{text:>13s}" for text in row))
    print(f"least {min(shares.values()):.2f} over {count} points, mean {np.mean(list(shares.values())):.4f}")
    return min(shares.values())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
