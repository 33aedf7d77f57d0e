"""Which settings are tried, and which of them is best, whatever measures them.

The tree-structured Parzen estimator of optuna (Bergstra et al. 2011, Advances in Neural Information
Processing Systems 24; several aims: Ozaki et al. 2022, doi:10.1613/jair.1.13188) says what is tried. Measured
values are noisy, so the lowest of them is the luckiest, not the best: the last tries and the winner are where
a Gaussian process of all that was measured is lowest.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.errors import Extra
from swath.signals import F64
from swath.tools.function_test.search.boundary import CANDIDATES, Boundary, sobol_points
from swath.tools.function_test.search.gaussian_process import fit
from swath.tools.tune.parameters import Parameter, snapped

BATCH = 4  # settings that are tried at a time
LAST = 3  # tries where the process is lowest, one after the other
FEWEST, MOST = 10, 400  # tries
MANY = 0.8  # share of the tries that scales an aim: a few that go astray do not
NEAR = (0.1, 0.03, 0.01)  # shares of the ranges about the lowest point in which it is looked for again


@dataclass(frozen=True)
class Measured:
    """What a setting comes to. values: of the aims, lower is better, nan = not measured.

    slack: the smallest margin to a limit, < 0 where one is broken: then the mean of what is beyond
    """

    values: tuple[float, ...]
    slack: float


@dataclass(frozen=True)
class Tried:
    """A setting, as shares of the ranges (d,), and what it came to."""

    shares: F64
    measured: Measured


Measure = Callable[[F64], Sequence[Measured]]


def searched_by() -> Any:
    """The library that says what is tried. MissingExtra without it."""
    with Extra("tune", "swath tune"):
        import optuna
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def optimise(parameters: Sequence[Parameter], aims: int, tries: int, seed: int,
             measure: Measure) -> list[Tried]:  # fmt: skip
    """All settings that are tried, in order: the same for the same seed and measured values.

    Parameters
    ----------
    parameters : what is tuned.
    aims : how many values a setting is judged by.
    tries, seed : how many settings; of their draws.
    measure : measures some settings, shares (n, d).
    """
    optuna = searched_by()
    sampler = optuna.samplers.TPESampler(seed=seed)
    study = optuna.create_study(directions=["minimize"] * aims, sampler=sampler)
    kinds = {p.key: optuna.distributions.CategoricalDistribution(range(len(p.choices))) if p.choices
             else optuna.distributions.FloatDistribution(0.0, 1.0) for p in parameters}  # fmt: skip
    tried: list[Tried] = []
    while (left := tries - len(tried)) > LAST:
        trials = [study.ask(kinds) for _ in range(min(BATCH, left - LAST))]
        shares = snapped(parameters, np.array([
            [trial.params[p.key] / max(1, len(p.choices) - 1) for p in parameters] for trial in trials
        ]))  # fmt: skip
        for trial, at, found in zip(trials, shares, measure(shares), strict=True):
            tried.append(Tried(at, found))
            trial.set_constraint("limits", -found.slack)
            study.tell(trial, list(_whole(tried)[-1]))
    for _ in range(left):
        shares = lowest(parameters, tried)[None]
        tried += [Tried(shares[0], found) for found in measure(shares)]
    return tried


def _whole(tried: Sequence[Tried]) -> F64:
    """Values (n, aims); what was not measured is as bad as the worst that was."""
    values = np.array([t.measured.values for t in tried], dtype=float)
    worst = np.nanmax(np.where(np.isfinite(values), values, np.nan), axis=0, initial=-np.inf)
    return np.where(np.isfinite(values), values, np.where(np.isfinite(worst), worst, 0.0))


def as_one(tried: Sequence[Tried]) -> F64:
    """The aims as one value, (n,), -1 at its best and 1 where MANY are better; of several the worse one."""
    values, kept = _whole(tried), np.array([t.measured.slack >= 0.0 for t in tried])
    some = values[kept] if kept.any() else values
    low, high = some.min(axis=0), np.quantile(some, MANY, axis=0)
    shares = (values - low) / np.where(high > low, high - low, 1.0)
    return np.asarray(np.clip(2.0 * shares.max(axis=1) - 1.0, -1.0, 3.0))


def lowest(parameters: Sequence[Parameter], tried: Sequence[Tried]) -> F64:
    """The setting, (d,), that a Gaussian process of all tries expects to be best among those that keep the
    limits; where it expects none to keep them, the one nearest to that.
    """
    points = np.stack([t.shares for t in tried])
    aim = fit(points, as_one(tried))
    slack = fit(points, np.array([t.measured.slack for t in tried]))
    dimensions = len(parameters)
    best = np.full(dimensions, 0.5)
    for reach in (None, *NEAR):
        spread = sobol_points(CANDIDATES if reach is None else CANDIDATES // 8, dimensions)
        if reach is not None:
            spread = np.vstack([best, np.clip(best + reach * (2.0 * spread - 1.0), 0.0, 1.0)])
        else:
            spread = np.vstack([points, spread])
        at = snapped(parameters, spread)
        kept, value = slack.predict(at)[0], aim.predict(at)[0]
        if all(t.measured.slack >= 0.0 for t in tried):
            kept = np.zeros(len(at))
        best = at[int(np.argmin(np.where(kept >= 0.0, value, 1e3 - kept)))]
    return np.asarray(best)


def winner(tried: Sequence[Tried]) -> int:
    """Number of the best try: of those that keep all limits the one at which the process is lowest; where
    none does, the one that breaks them least.
    """
    slack = np.array([t.measured.slack for t in tried])
    if not (slack >= 0.0).any():
        return int(np.argmax(slack))
    points = np.stack([t.shares for t in tried])
    value = fit(points, as_one(tried)).predict(points)[0]
    return int(np.argmin(np.where(slack >= 0.0, value, np.inf)))


def front(tried: Sequence[Tried]) -> list[int]:
    """Numbers of the tries that keep all limits and that no other such one beats in every aim."""
    values = _whole(tried)
    kept = [n for n, t in enumerate(tried) if t.measured.slack >= 0.0]
    return [n for n in kept if not any(
        (values[m] <= values[n]).all() and (values[m] < values[n]).any() for m in kept)]  # fmt: skip


def what_matters(parameters: Sequence[Parameter], tried: Sequence[Tried]) -> list[tuple[str, float, float]]:
    """Of each parameter the share of the variance over the ranges, alone and with all that it acts with."""
    points, values = np.stack([t.shares for t in tried]), as_one(tried)
    return Boundary([p.key for p in parameters], points, np.clip(values, -1.0, 1.0)).sensitivities()
