"""How echoes of a scan hang together: what a twin is not learned from, and is checked by.

Quantiles of distances say how far a crop is, not what it is made of. Here are numbers of how like echoes
beside each other and scans after each other are, in distance and in brightness, how their steps are
distributed, how often one lies before or behind both its neighbours, how beams without an echo gather.
Brightness counts against that of the whole recording, so its unit does not matter where it is proportional
to what was received. Each number is the mean of those of a few sectors.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.signals import F32, F64, Mask

SECTORS = 6  # of the azimuth
FEWEST = 30  # echoes of a number
LAGS = ((0, 1), (0, 2), (0, 4), (1, 0), (2, 0), (1, 1))  # scans and beams from echo to echo
LEAST, LEAST_RANK = 1e-4, 1e-3  # in logarithms of distance and of all else: finer ones are the resolution
BEFORE, SOME = 0.1, 0.02  # in logarithms: an echo before or behind its neighbours, clearly and at all; chosen
FARTHEST = 3.0  # quantiles of 90 % at which distances are cut off: single ones must not rule
TAILS = (0.02, 0.1, 0.25, 0.75, 0.9, 0.98)
COUNT = 48
NAMES = tuple(f"scan_structure_{n:02d}" for n in range(COUNT))


def structure_of(ahead: F64, bright: F32) -> F64:
    """The numbers (COUNT,); nan = too few echoes, or no brightness.

    ahead: distances ahead [m]; bright: scans (scans, lines, beams), nan = no echo
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead, light = np.log(ahead), np.log(bright.astype(np.float64))
    light = np.where(np.isfinite(light), light, np.nan)
    if np.isfinite(light).any():
        light -= np.nanmedian(light)
    parts = np.array_split(np.arange(ahead.shape[2]), SECTORS)
    return _mean(np.stack([_sector(ahead[..., beams], light[..., beams]) for beams in parts]))


def _sector(ahead: F64, light: F64) -> F64:
    """The numbers of a sector. ahead, light: logarithms (scans, lines, beams), nan = none."""
    far, dim = ahead - _median(ahead, 0), light - _median(light, 0)  # beside the median of the beam
    most = FARTHEST * quantiles(np.abs(far), (0.9,))[0]
    off = np.clip(far, -most, most) if np.isfinite(most) else far
    step, turn = np.diff(ahead, axis=2), np.diff(light, axis=2)
    alike = [_alike(*_pair(values, lag)) for values in (off, dim) for lag in LAGS]
    alike += [_alike(step[..., 1:], step[..., :-1]), _alike(dim, off)]
    alike += [_alike(np.abs(turn), _log(np.abs(step), LEAST_RANK))]
    whole, whole_dim = (_median(values, 2) for values in (far, dim))
    wander = [_log(_spread(v), LEAST_RANK) for v in (whole, np.diff(whole, axis=0), whole_dim)]
    lights = [*quantiles(light, (0.05, 0.25, 0.5, 0.75, 0.95)), *quantiles(dim, TAILS)]
    return np.array([*alike, *_of_steps(far, step), *_of_neighbours(ahead, light), *wander, *lights])


def _of_steps(far: F64, step: F64) -> list[float]:
    """Tails and skewness of the steps between beams, and tails of distances beside their median."""
    small, little, middle, large = quantiles(np.abs(step), (0.02, 0.05, 0.5, 0.95))
    bend = quantiles(np.abs(np.diff(step, axis=2)), (0.5,))[0]
    tails = [_log(v, LEAST) - _log(middle, LEAST) for v in (small, little, large, bend)]
    low, below, above, high = quantiles(step, (0.1, 0.25, 0.75, 0.9))
    skew = [(b + a) / (b - a + LEAST) for a, b in ((low, high), (below, above))]
    least, less, half, more, most = quantiles(far, (0.02, 0.1, 0.5, 0.9, 0.98))
    pairs = (half - least, half - less), (most - half, more - half)
    return [*tails, *skew, *(_log(a, LEAST_RANK) - _log(b, LEAST_RANK) for a, b in pairs)]


def _of_neighbours(ahead: F64, light: F64) -> list[float]:
    """Single echoes before or behind both neighbours, silent beams, and steps of the brightness."""
    one, first, last = ahead[..., 1:-1], ahead[..., :-2], ahead[..., 2:]
    before, behind = np.fmin(first, last) - one, one - np.fmax(first, last)
    lone = [_share(v > BEFORE, np.isfinite(before)) for v in (before, behind)]
    silent = ~np.isfinite(ahead)
    gathered = [float(np.sqrt(np.logical_and(*_pair(silent, lag)).mean())) for lag in ((0, 1), (1, 0))]
    over = light[..., 1:-1] - 0.5 * (light[..., 2:] + light[..., :-2])
    step, turn = np.abs(np.diff(ahead, axis=2)), np.abs(np.diff(light, axis=2))
    is_fine = step < quantiles(step, (0.5,))[0]
    parts = (turn, (0.5, 0.9)), (turn[is_fine], (0.5,)), (turn[~is_fine], (0.5,)), (np.abs(over), (0.5,))
    turns = [_log(v, LEAST_RANK) for values, shares in parts for v in quantiles(values, shares)]
    edges = [quantiles(over[v > SOME], (0.5,))[0] for v in (before, behind)]
    return [*lone, *gathered, *turns, *edges]


def _median(values: F64, axis: int) -> F64:
    """As `np.nanmedian` with that axis kept, and nan of nothing."""
    ordered, count = np.sort(values, axis=axis), np.isfinite(values).sum(axis=axis, keepdims=True)
    places = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[axis] - 1)
    low, high = (np.take_along_axis(ordered, place, axis) for place in places)
    return np.asarray(0.5 * (low + high), np.float64)


def _pair(values: F64 | Mask, lag: tuple[int, int]) -> tuple[Any, Any]:
    """Values so many scans and beams from each other."""
    (scans, beams), (count, _, width) = lag, values.shape
    return values[scans:, :, beams:], values[: count - scans, :, : width - beams]


def _alike(a: F64, b: F64) -> float:
    """Correlation of what is known of both."""
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < FEWEST or min(a[known].std(), b[known].std()) < 1e-9:
        return float("nan")
    return float(np.corrcoef(a[known], b[known])[0, 1])


def quantiles(values: F64, shares: Sequence[float], fewest: int = FEWEST) -> F64:
    """Quantiles of what is known, nan of fewer."""
    known = values[np.isfinite(values)]
    return np.quantile(known, shares) if len(known) >= fewest else np.full(len(shares), np.nan)


def _log(value: Any, least: float) -> Any:
    return np.log(value + least)


def _share(which: Mask, counted: Mask) -> float:
    """Square root of a share: as even for seldom things as for others."""
    return float(np.sqrt(which[counted].mean())) if counted.sum() >= FEWEST else float("nan")


def _spread(values: F64) -> float:
    known = values[np.isfinite(values)]
    return float(known.std()) if len(known) > 5 else float("nan")


def _mean(values: F64) -> F64:
    """Mean of what is known, along the first axis."""
    known = np.isfinite(values)
    count = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    return np.asarray(np.where(known, values, 0.0).sum(axis=0) / count, np.float64)
