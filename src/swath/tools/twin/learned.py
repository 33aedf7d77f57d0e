"""What numbers say of unknowns, learned from a bank of simulations, with intervals that hold.

One Gaussian process for each unknown (Rasmussen and Williams 2006, ISBN 0-262-18253-X, section 2.2) over the
principal components of the numbers, its covariance a Gaussian and a linear part; how many components, which
length and which noise are those that predict each run best from all others (equation 5.12), which costs no
further fit. Its own intervals rest on a model of the noise, so they are stretched by the quantile of the
errors that it makes on runs that it did not see, over what it says of them (conformal prediction by leaving
one out: Vovk et al. 2005, doi:10.1007/b106715; Barber et al. 2021, doi:10.1214/20-AOS1965). Unknowns lie
evenly in 0..1, so an interval as wide as that says nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from swath.signals import F64, Mask

COMPONENTS, LENGTHS, NOISES = (15, 30, 60, 90), (0.7, 1.0, 1.5, 2.5), (0.003, 0.01, 0.03, 0.1, 0.3)  # tried
LINEAR = 0.3  # of the covariance; chosen
PRESENT = 0.95  # of the runs have a number that counts
FARTHEST = 6.0  # standard deviations at which numbers are cut off: outliers must not rule the components
LEVEL = 0.95  # of the intervals
TOLD = 0.75  # width of an interval over that of the prior above which an unknown is not known; chosen
STRAY = 0.01  # chance that scans of the bank lie so far from all others
CENTRAL = 0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)  # of the prior


@dataclass(frozen=True)
class Answer:
    """What is known of the unknowns, as shares of their ranges, all (d,).

    low, high: of the interval of 95 %; of what is not known that of the prior
    sd: standard deviation that goes with it
    alike: correlation of the errors, (d, d)
    is_stray: whether the scans look like none of the bank; then nothing is known
    """

    mean: F64
    low: F64
    high: F64
    sd: F64
    alike: F64
    is_known: Mask
    is_stray: bool

    def widened(self, factor: float) -> "Answer":
        """The same with intervals that are wider by a factor."""
        low, high = (
            np.clip(self.mean + factor * (end - self.mean), 0.0, 1.0) for end in (self.low, self.high)
        )
        is_known = self.is_known & _is_told(low, high)
        return replace(
            self,
            mean=np.where(is_known, self.mean, 0.5),
            low=np.where(is_known, low, CENTRAL[0]),
            high=np.where(is_known, high, CENTRAL[1]),
            sd=factor * self.sd,
            is_known=is_known,
        )

    def apart(self, other: "Answer") -> F64:
        """How far another answer is from this, in standard deviations of both, (d,), nan = not known."""
        far = (other.mean - self.mean) / np.hypot(self.sd, other.sd)
        return np.where(self.is_known & other.is_known, far, np.nan)

    def draws(self, count: int, rng: np.random.Generator) -> F64:
        """Values that are as likely as this says, (count, d)."""
        normal = rng.multivariate_normal(np.zeros(len(self.mean)), self.alike, count, method="eigh")
        even = rng.random((count, len(self.mean)))
        return np.where(self.is_known, np.clip(self.mean + self.sd * normal, 0.0, 1.0), even)


@dataclass(frozen=True)
class _Space:
    """Numbers as principal components, half whitened. usable: numbers that count."""

    usable: Mask
    mean: F64
    sd: F64
    axes: F64
    scale: F64

    @classmethod
    def of(cls, numbers: F64, wanted: Mask) -> "_Space":
        usable = wanted & (np.isfinite(numbers).mean(axis=0) >= PRESENT)
        mean, sd = np.nanmean(numbers[:, usable], axis=0), np.nanstd(numbers[:, usable], axis=0)
        usable[np.flatnonzero(usable)[sd < 1e-9]] = False
        mean, sd = mean[sd >= 1e-9], sd[sd >= 1e-9]
        plain = standard(numbers[:, usable], mean, sd)
        _, size, axes = np.linalg.svd(plain, full_matrices=False)
        return cls(usable, mean, sd, axes, np.sqrt(np.maximum(size, 1e-6) / sqrt(len(numbers))))

    def at(self, numbers: F64, components: int) -> F64:
        """Places (n, components)."""
        plain = standard(numbers[:, self.usable], self.mean, self.sd)
        return plain @ self.axes[:components].T / self.scale[:components]


def standard(numbers: F64, mean: F64, sd: F64) -> F64:
    """Numbers in deviations from their mean, cut off, 0 where they are not there."""
    return np.clip(np.nan_to_num((numbers - mean) / sd), -FARTHEST, FARTHEST)


def _covariance(a: F64, b: F64, length: float) -> F64:
    across = a @ b.T
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * across
    return np.asarray(np.exp(-np.maximum(square, 0.0) / (2.0 * length**2)) + LINEAR * across)


def _places(space: _Space, numbers: F64, components: int, more: F64) -> tuple[F64, F64]:
    """Places of the runs and of other numbers, at a mean distance of 1 from their middle."""
    own, other = space.at(numbers, components), space.at(more, components)
    size = sqrt(float((own**2).sum(axis=1).mean()))
    return own / size, other / size


def learn(shares: F64, numbers: F64) -> F64:
    """Components, length and noise, (d, 3), that predict each unknown best.

    shares: of the runs (n, d); numbers: (n, m), nan = not there
    """
    space = _Space.of(numbers, np.ones(numbers.shape[1], bool))
    values = shares - shares.mean(axis=0)
    best, found = np.full(shares.shape[1], np.inf), np.zeros((shares.shape[1], 3))
    for components in dict.fromkeys(min(c, len(space.axes)) for c in COMPONENTS):
        own, _ = _places(space, numbers, components, numbers[:1])
        for length in LENGTHS:
            size, axes = np.linalg.eigh(_covariance(own, own, length))
            along = axes.T @ values
            for noise in NOISES:
                inverse = 1.0 / (np.maximum(size, 0.0) + noise)
                left = axes @ (inverse[:, None] * along) / (axes**2 @ inverse)[:, None]
                cost = (left**2).mean(axis=0)
                better = cost < best
                best[better], found[better] = cost[better], (components, length, noise)
    return found


def ask(shares: F64, numbers: F64, tuned: F64, seen: F64) -> Answer:
    """What scans say. seen: their numbers (m,), nan = not there; tuned: as `learn` gives it."""
    count, unknowns = shares.shape
    space = _Space.of(numbers, np.isfinite(seen))
    middle = shares.mean(axis=0)
    mean, sd, errors, quantile = (np.zeros(s) for s in (unknowns, unknowns, (count, unknowns), unknowns))
    for kind in np.unique(tuned, axis=0):
        which = np.flatnonzero((tuned == kind).all(axis=1))
        components, length, noise = min(int(kind[0]), len(space.axes)), float(kind[1]), float(kind[2])
        own, here = _places(space, numbers, components, seen[None])
        inverse = np.linalg.inv(_covariance(own, own, length) + noise * np.eye(count))
        weights = inverse @ (shares[:, which] - middle[which])
        across = _covariance(here, own, length)[0]
        own_variance = 1.0 + LINEAR * float((here**2).sum()) + noise
        mean[which] = across @ weights + middle[which]
        sd[which] = sqrt(max(own_variance - float(across @ inverse @ across), noise))
        errors[:, which] = weights / np.sqrt(np.diag(inverse))[:, None]  # over the deviation that is told
    rank = min(1.0, LEVEL * (1.0 + 1.0 / count))
    quantile = np.quantile(np.abs(errors), rank, axis=0)
    low, high = (np.clip(mean + sign * quantile * sd, 0.0, 1.0) for sign in (-1.0, 1.0))
    is_stray = _is_stray(space, numbers, seen)
    is_known = _is_told(low, high) & (not is_stray)
    low, high = np.where(is_known, low, CENTRAL[0]), np.where(is_known, high, CENTRAL[1])
    return Answer(
        np.where(is_known, np.clip(mean, 0.0, 1.0), 0.5), low, high, sd * errors.std(axis=0),
        np.corrcoef(errors.T), is_known, is_stray,
    )  # fmt: skip


def _is_told(low: F64, high: F64) -> Mask:
    """Whether intervals say something."""
    return np.asarray(high - low < TOLD * (CENTRAL[1] - CENTRAL[0]), bool)


def answer_in(data: Mapping[str, Any]) -> Answer:
    """An answer that was written as plain data."""
    arrays = {name: np.array(value) for name, value in data.items() if name != "is_stray"}
    made = Answer(**arrays, is_stray=bool(data["is_stray"]))
    count = len(made.mean)
    if made.alike.shape != (count, count) or any(len(a) != count for a in arrays.values()):
        raise ValueError("other numbers of unknowns")
    return made


def _is_stray(space: _Space, numbers: F64, seen: F64) -> bool:
    """Whether numbers lie further from the nearest run than all but STRAY of the runs do."""
    own, here = _places(space, numbers, min(COMPONENTS[1], len(space.axes)), seen[None])
    square = (own**2).sum(axis=1)
    apart = square[:, None] + square - 2.0 * own @ own.T
    np.fill_diagonal(apart, np.inf)
    usual = np.quantile(apart.min(axis=1), 1.0 - STRAY)
    return bool(((own - here) ** 2).sum(axis=1).min() > usual)
