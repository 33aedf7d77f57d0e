"""How often the interval of `swath test compare` and `swath tune` holds the mean, over drawn differences.

    python -m benchmarks.decisions [--setups 300] [--seed 1] [--confidence 0.95]

Each set-up draws a family's numbers, and 32 to 256 pairs of it. Printed of each family: in how many set-ups
the interval holds the true mean, by four numbers of pairs, beside it Student's alone, and, of as many set-ups
in which the mean is worse, how many are called better. Bad runs are 10 % or more and 3 to 20
times as large as the rest, and the mean lies near 0, where that decides. LEFT_OUT was not looked at while the
interval was chosen.
"""

import argparse
from collections.abc import Callable, Mapping

import numpy as np

from swath.signals import F64
from swath.tools.function_test.judging.paired import difference, scipy_stats

Drawn = tuple[F64, float]  # differences, their true mean; below 0 is worse
Family = Callable[[np.random.Generator, int], Drawn]
COUNTS = (32, 64, 128, 256)


def _one_sided(rng: np.random.Generator, n: int) -> Drawn:
    """Better by 1 in most runs, worse in the others, or turned round."""
    share, size, sd, sign = rng.uniform(0.1, 0.3), rng.uniform(3, 20), rng.uniform(0, 1), rng.choice([-1, 1])
    d = np.where(rng.random(n) < share, -size, 1.0) + sd * rng.standard_normal(n)
    return sign * d, sign * (1.0 - share - share * size)


def _both_sided(rng: np.random.Generator, n: int) -> Drawn:
    share, size, mean = rng.uniform(0.1, 0.3), rng.uniform(3, 20), rng.normal(0, 0.5)
    return mean + np.where(rng.random(n) < share, size, 1.0) * rng.standard_normal(n), mean


def _lognormal(rng: np.random.Generator, n: int) -> Drawn:
    width, sign, mean = rng.uniform(0.3, 1.2), rng.choice([-1, 1]), rng.normal(0, 0.3)
    return mean + sign * (rng.lognormal(0, width, n) - np.exp(width**2 / 2)), mean


def _heavy_tails(rng: np.random.Generator, n: int) -> Drawn:
    mean = rng.normal(0, 0.3)
    return mean + rng.standard_t(3, n), mean


def _ties(rng: np.random.Generator, n: int) -> Drawn:
    values = 0.05 * rng.choice(np.arange(-3, 4), int(rng.integers(2, 5)), replace=False)
    shares = np.maximum(rng.dirichlet(np.full(len(values), 2.0)), 0.1)
    shares /= shares.sum()
    return rng.choice(values, n, p=shares), float(shares @ values)


def _shift(rng: np.random.Generator, n: int) -> Drawn:
    mean = rng.normal(0, 0.2)
    return mean + rng.uniform(0.1, 2) * rng.standard_normal(n), mean


def _with_the_baseline(rng: np.random.Generator, n: int) -> Drawn:
    """The difference grows with what the first version has, which is skewed."""
    slope, mean = rng.uniform(-0.5, 0.5), rng.normal(0, 0.1)
    return mean + slope * (rng.gamma(2, 1, n) - 2.0) + rng.normal(0, 0.2, n), mean


def _margins(rng: np.random.Generator, n: int) -> Drawn:
    """Differences of margins that end at -1: some runs go from their margin to there, or come from there."""
    a, b, size = *rng.uniform(0.1, 0.25, 2), rng.uniform(0.2, 0.9)
    at, mean = rng.random(n), (b - a) * (1.0 + size)
    return np.where(at < a, -1.0 - size, np.where(at < a + b, 1.0 + size, 0.0)), mean


def _harm_of_any_size(rng: np.random.Generator, n: int) -> Drawn:
    """Bad runs whose sizes have a heavy tail themselves (Pareto, 3)."""
    share, size = rng.uniform(0.1, 0.3), rng.uniform(2, 10)
    bad = rng.random(n) < share
    d = np.where(bad, -size * (1.0 + rng.pareto(3.0, n)), 1.0 + 0.3 * rng.standard_normal(n))
    return d, 1.0 - share - share * size * 1.5


def _unlike_cases(rng: np.random.Generator, n: int) -> Drawn:
    """Cases with means and spreads of their own."""
    count = int(rng.integers(3, 7))
    means, spreads = rng.standard_t(3, count), rng.lognormal(-1, 1, count)
    case = rng.integers(0, count, n)
    return means[case] + spreads[case] * rng.standard_normal(n), float(means.mean())


SEEN: Mapping[str, Family] = {
    "bad runs, one way": _one_sided, "bad runs, both ways": _both_sided, "lognormal": _lognormal,
    "Student's t, 3": _heavy_tails, "ties": _ties, "shift": _shift, "with the baseline": _with_the_baseline,
}  # fmt: skip
LEFT_OUT: Mapping[str, Family] = {
    "margins that end": _margins, "bad runs of any size": _harm_of_any_size, "unlike cases": _unlike_cases,
}  # fmt: skip


def held(
    family: Family, rng: np.random.Generator, count: int, setups: int, confidence: float
) -> tuple[int, int]:
    """In how many set-ups of `count` pairs the interval holds the mean, and Student's."""
    own = student = 0
    for _ in range(setups):
        d, mean = family(rng, count)
        found = difference(d.tolist(), confidence)
        own += found.low - 1e-9 <= mean <= found.high + 1e-9
        half = scipy_stats().t.ppf(0.5 + 0.5 * confidence, count - 1) * d.std(ddof=1) / np.sqrt(count)
        student += abs(d.mean() - mean) <= half + 1e-9
    return own, student


def called_better(family: Family, rng: np.random.Generator, setups: int, confidence: float) -> int:
    """Of so many set-ups with 32 to 256 pairs in which the mean is worse, how many are called better."""
    better = drawn = 0
    while drawn < setups:
        d, mean = family(rng, int(rng.integers(COUNTS[0], COUNTS[-1] + 1)))
        if mean < 0.0:
            drawn += 1
            better += difference(d.tolist(), confidence).low > 0.0
    return better


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--setups", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--confidence", type=float, default=0.95)
    args = parser.parse_args()
    for title, families in (("", SEEN), (", left out while it was chosen", LEFT_OUT)):
        print(
            f"family{title}: of {args.setups} held by {COUNTS} pairs (Student's alone); worse, called better"
        )
        for number, (name, family) in enumerate(families.items()):
            rng = np.random.default_rng([args.seed, len(families), number])
            rows = [held(family, rng, count, args.setups, args.confidence) for count in COUNTS]
            wrong = called_better(family, rng, args.setups, args.confidence)
            said = ", ".join(f"{own} ({student})" for own, student in rows)
            print(f"  {name:22s} {said}; {wrong} of {args.setups}", flush=True)


if __name__ == "__main__":
    main()
