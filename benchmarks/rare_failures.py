"""Whether the interval of `swath test estimate` holds a known probability, and how wide it is.

    python -m benchmarks.rare_failures --repeats 400 --budget 2000

Limits in closed form stand in for runs, each broken with probability 1e-4: a half space of normal variables,
the sum of uniform ones, corners, regions on several sides, and shapes with which the method was not built.
Plain runs beside it: their expected half width is 1.96 / sqrt(runs * probability).
"""

import argparse
import time
from collections.abc import Callable
from math import factorial, sqrt

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import chi2

from swath.signals import F64
from swath.tools.function_test.estimate.estimate import SEARCHING
from swath.tools.function_test.estimate.rare import (
    ESS_LEAST,
    OVERLOOKED_MOST,
    Hunt,
    Rate,
    log_exposure,
    rate_of,
)

RARE = 1e-4
Margin = Callable[[F64], F64]


def half_space(d: int) -> Margin:
    """Normal variables: their sum is large."""
    return lambda z: (-ndtri(RARE) - z.sum(axis=1) / sqrt(d)) / -ndtri(RARE)


def simplex(d: int) -> Margin:
    """Uniform variables: their sum is large."""
    side = (RARE * factorial(d)) ** (1.0 / d)
    return lambda z: 2.0 * (d - side - ndtr(z).sum(axis=1)) / (d - side)


def corner(d: int) -> Margin:
    """Uniform variables: all are large."""
    return lambda z: 1.0 - RARE ** (1.0 / d) - ndtr(z).min(axis=1)


def two_sides(d: int) -> Margin:
    """A normal variable is large, or small, four times as seldom."""
    first, second = -ndtri(0.8 * RARE), -ndtri(0.2 * RARE)
    return lambda z: np.minimum(first - z[:, 0], second + z[:, 0]) / first


def corners(d: int) -> Margin:
    """Uniform variables: each is large or small, in any of the 2^d combinations."""
    side = 0.5 * RARE ** (1.0 / d)
    return lambda z: 2.0 * (np.max(0.5 - np.abs(ndtr(z) - 0.5), axis=1) - side)


def sides(d: int) -> Margin:
    """One of several normal variables is large or small."""
    far = -ndtri(0.5 * (1.0 - (1.0 - RARE) ** (1.0 / d)))
    return lambda z: (far - np.abs(z).max(axis=1)) / far


def ring(d: int) -> Margin:
    """Normal variables lie far out, in any direction."""
    far = sqrt(chi2.isf(RARE, d))
    return lambda z: (far - np.linalg.norm(z, axis=1)) / far


def valley(d: int) -> Margin:
    """A normal variable lies beyond a parabola of another one, open or shut in two arms."""
    at, share = np.polynomial.hermite_e.hermegauss(80)
    share = share / share.sum()
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if share @ ndtr(0.4 * at**2 - middle) < RARE else (middle, high)
    return lambda z: (low - 0.4 * z[:, 0] ** 2 - z[:, 1]) / low


def islands(d: int) -> Margin:
    """Three uniform variables in one of three cubes, of 0.5, 0.35 and 0.15 of the probability."""
    middles = np.array([[0.9, 0.85, 0.1], [0.1, 0.2, 0.8], [0.3, 0.9, 0.75]])[:, :d]
    half = 0.5 * (RARE * np.array([0.5, 0.35, 0.15])) ** (1.0 / d)
    return lambda z: 2.0 * np.min(np.abs(ndtr(z)[:, None, :] - middles).max(axis=2) - half, axis=1)


BUILT_WITH: dict[str, tuple[Callable[[int], Margin], int]] = {
    "half space, 2": (half_space, 2),
    "half space, 6": (half_space, 6),
    "sum of uniform, 2": (simplex, 2),
    "sum of uniform, 6": (simplex, 6),
    "corner, 2": (corner, 2),
    "two regions, 2": (two_sides, 2),
    "four corners, 2": (corners, 2),
    "six sides, 3": (sides, 3),
}
OTHERS: dict[str, tuple[Callable[[int], Margin], int]] = {
    "ring, 2": (ring, 2),
    "valley, 2": (valley, 2),
    "eight corners, 3": (corners, 3),
    "three islands, 3": (islands, 3),
}
SHAPES = {**BUILT_WITH, **OTHERS}


def estimated(margin: Margin, d: int, budget: int, seed: int) -> Rate:
    """One estimate with so many evaluations."""
    before = int(SEARCHING * budget)
    hunt = Hunt(d, before)
    while hunt.left:
        places = hunt.next(np.random.default_rng([seed, hunt.left]))
        hunt.tell(places, np.clip(margin(places), -1.0, 1.0))
    rng = np.random.default_rng([seed, 0])
    density = hunt.last()
    places = density.draw(rng, budget - before)
    weights = np.exp(log_exposure(places) - density.log_density(places))
    return rate_of(weights, margin(places) < 0.0, hunt.overlooked(places))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=400)
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--shape", action="append", choices=list(SHAPES), default=[])
    args = parser.parse_args()
    print(f"plain runs, {args.budget}: half width {100 * 1.96 / sqrt(args.budget * RARE):.0f} %")
    for name in args.shape or SHAPES:
        make, d = SHAPES[name]
        start = time.process_time()
        found = [estimated(make(d), d, args.budget, seed) for seed in range(args.repeats)]
        shown = [rate for rate in found if rate.ess >= ESS_LEAST and rate.overlooked <= OVERLOOKED_MOST]
        mean = np.mean([rate.value for rate in found]) / RARE
        width = np.median([rate.half_width for rate in shown] or [np.inf])
        inside = sum(rate.low <= RARE <= rate.high for rate in shown)
        print(
            f"{name}: {inside} of {len(shown)} intervals hold it "
            f"({100 * inside / max(1, len(shown)):.1f} %), {len(found) - len(shown)} refused, "
            f"mean {mean:.3f}, half width {100 * width:.0f} %, "
            f"{1e3 * (time.process_time() - start) / len(found):.0f} ms each",
            flush=True,
        )


if __name__ == "__main__":
    main()
