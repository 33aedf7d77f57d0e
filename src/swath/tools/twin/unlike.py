"""Whether scans look like those of a bank at all: a test of what it was not learned for.

Two distances, of runs and of a recording alike. How far the structure of scans lies from what their numbers
let expect, in the covariance of what is left of other runs (its estimate shrunk: Ledoit and Wolf 2004,
doi:10.1016/S0047-259X(03)00096-4): another plant, another model of the sensor. How far an unknown, by a plane
through numbers and structure, lies from the middle of its range, over the farthest of other runs: a value
that is in no run. Both by ridge regression. The larger one, over its usual largest value, counts, and how
many runs have a larger one when the rest judges them (conformal: Vovk et al. 2005, doi:10.1007/b106715).
"""

from dataclasses import dataclass

import numpy as np

from swath.signals import F64, Mask
from swath.tools.twin.learned import PRESENT, standard

RIDGE = 100.0  # of the regressions; of 30, 100, 300 all find as much
FOLDS = 8
USUAL, FARTHEST = 0.95, 0.995  # quantiles over the runs: of both distances, and of each unknown
SHOWN = 0.1  # deviation of what is said of an unknown, as share of its range, from which on it counts; chosen


@dataclass(frozen=True)
class Unlike:
    """share: of the runs, the scans counted with them, that are at least as unlike the others; over: how
    unlike the scans are, over what 95 % of the runs are at most.
    """

    share: float
    over: float


def unlike(shares: F64, looks: F64, structure: F64, seen: F64, seen_structure: F64) -> Unlike:
    """How unlike a bank scans are.

    shares: of the runs (n, d); looks (n, m), structure (n, k): their numbers, nan = not there; seen (m,),
    seen_structure (k,): those of the scans
    """
    known = (_known(looks, seen), _known(structure, seen_structure))
    looks, structure = looks[:, known[0]], structure[:, known[1]]
    count = len(shares)
    runs = np.zeros((count, 1 + shares.shape[1]))
    for fold in range(FOLDS):
        one = np.arange(count) % FOLDS == fold
        runs[one] = _distances(shares[~one], looks[~one], structure[~one], looks[one], structure[one])
    last = _distances(shares, looks, structure, seen[None, known[0]], seen_structure[None, known[1]])
    shown = np.flatnonzero(runs[:, 1:].std(axis=0) > SHOWN) + 1
    farthest = np.quantile(runs[:, shown], FARTHEST, axis=0)
    both = [
        np.stack([d[:, 0], (d[:, shown] / farthest).max(axis=1, initial=0.0)], axis=1) for d in (runs, last)
    ]
    usual = np.maximum(np.quantile(both[0], USUAL, axis=0), 1e-9)
    each, here = ((b / usual).max(axis=1) for b in both)
    share = (1 + np.count_nonzero(each >= here[0])) / (count + 1)
    return Unlike(float(share), float(here[0] / max(np.quantile(each, USUAL), 1e-9)))


def _known(runs: F64, seen: F64) -> Mask:
    """Numbers that are there and differ."""
    there = np.isfinite(seen) & (np.isfinite(runs).mean(axis=0) >= PRESENT)
    there[there] = np.nanstd(runs[:, there], axis=0) > 1e-9
    return np.asarray(there, bool)


def _distances(shares: F64, looks: F64, structure: F64, more: F64, more_structure: F64) -> F64:
    """Of other scans, (l, 1 + d): from the structure to be expected, and of unknowns from their middle."""
    looks, more = _alike(looks, more)
    structure, more_structure = _alike(structure, more_structure)
    slopes = _slopes(looks, structure)
    held = np.einsum("ij,ji->i", looks, _slopes(looks, np.eye(len(looks))))  # leverage
    left = (structure - looks @ slopes) / (1.0 - held)[:, None]
    off = more_structure - more @ slopes - left.mean(axis=0)
    far = np.sqrt(np.maximum((off * np.linalg.solve(_covariance(left), off.T).T).sum(axis=1), 0.0))
    every, other = np.hstack([looks, structure]), np.hstack([more, more_structure])
    said = np.abs(other @ _slopes(every, shares - shares.mean(axis=0)))
    return np.column_stack([far, said])


def _alike(runs: F64, more: F64) -> tuple[F64, F64]:
    """Both in deviations of the runs."""
    mean, sd = np.nanmean(runs, axis=0), np.maximum(np.nanstd(runs, axis=0), 1e-9)
    return standard(runs, mean, sd), standard(more, mean, sd)


def _slopes(plain: F64, values: F64) -> F64:
    """Of a ridge regression of values (n, k) on numbers (n, m), (m, k)."""
    inner = plain.T @ plain + RIDGE * np.eye(plain.shape[1])
    return np.asarray(np.linalg.solve(inner, plain.T @ values), np.float64)


def _covariance(values: F64) -> F64:
    """Covariance of values (n, k), shrunk towards a multiple of the identity as far as it is uncertain."""
    plain = values - values.mean(axis=0)
    count, width = plain.shape
    found = plain.T @ plain / count
    middle = float(np.trace(found)) / max(width, 1)
    apart = float(((found - middle * np.eye(width)) ** 2).sum())
    noise = (float(((plain**2).sum(axis=1) ** 2).mean()) - float((found**2).sum())) / count
    part = min(1.0, noise / apart) if apart > 0.0 else 1.0
    return np.asarray((1.0 - part) * found + (part * middle + 1e-12) * np.eye(width), np.float64)
