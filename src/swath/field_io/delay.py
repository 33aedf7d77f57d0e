"""How late the logged grain flow is: the time from the knife to the sensor, less what the monitor took off.

Neighbouring passes driven in opposite directions see the same soil. A flow that is late by d shifts the
yield of one pass forwards and of the other backwards, so the two agree best at the right d.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import MissingExtra
from swath.field_io.log import Log

Array = NDArray[np.float64]
DEFAULT_DELAY = 12.0  # s, cutterbar to yield sensor: 10-15 s, typical of combines; no single source
EARLIEST, LATEST = -10.0, 30.0  # s, range of the search
NEIGHBOUR = 1.35  # header widths to the next pass at most
FEWEST_PAIRS = 300
LEAST_AGREEMENT = 0.15  # correlation of neighbouring passes; below, the peak is chance
SHORT, LONG = 5, 41  # records: the yield is smoothed over SHORT and freed of trends over LONG


@dataclass(frozen=True)
class Delay:
    """Delay of a machine's flow [s]; agreement: correlation of opposite neighbour passes with it."""

    machine: str
    seconds: float
    method: str
    agreement: float
    pair_count: int


def estimate_delays(log: Log) -> list[Delay]:
    """The delay of each machine: from its own passes, else from all passes, else the default."""
    first, second = opposite_pairs(log)
    pooled = _best(log, first, second)
    delays = []
    for index, name in enumerate(log.machine_names):
        own = (log.machine[first] == index) & (log.machine[second] == index)
        found = _best(log, first[own], second[own])
        method = "agreement of its opposite neighbour passes"
        if found is None:
            found, method = pooled, "agreement of all opposite neighbour passes"
        if found is None:
            delays.append(
                Delay(name, DEFAULT_DELAY, "default: no agreement found", float("nan"), int(own.sum()))
            )
        else:
            delays.append(Delay(name, found[0], method, found[1], int(own.sum())))
    return delays


def shifted_flow(log: Log, delays: list[Delay]) -> Array:
    """Grain flow [kg/s] at the place it was cut, shape (n,), nan where the log ends before it arrived."""
    seconds = np.array([d.seconds for d in delays])[log.machine]
    return _flow_later(log, seconds)


def _flow_later(log: Log, seconds: Array | float) -> Array:
    gap = log.gap
    block = np.cumsum(gap) - 1
    span = float(log.time.max() - log.time.min()) + 1000.0
    clock = log.time - log.time.min() + block * span
    wanted = clock + seconds
    first = np.flatnonzero(gap)
    last = np.r_[first[1:], len(log)] - 1
    known = (wanted >= clock[first[block]] - 1e-6) & (wanted <= clock[last[block]] + 1e-6)
    return np.where(known, np.interp(wanted, clock, log.flow), np.nan)


def opposite_pairs(log: Log) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of records that lie side by side on neighbouring passes of opposite direction."""
    try:
        from scipy.spatial import cKDTree
    except ImportError as error:
        raise MissingExtra("geo", "cleaning a yield log") from error
    none = np.zeros(0, dtype=np.int64)
    width = float(np.median(log.width[log.width > 0.0])) if (log.width > 0.0).any() else 0.0
    forward = direction(log)
    cutting = (log.speed > 0.8) & (log.flow > 0.2 * np.median(log.flow)) & (log.width > 0.9 * width)
    index = np.flatnonzero(cutting & np.isfinite(forward[:, 0]))
    if len(index) < FEWEST_PAIRS or width <= 0.0:
        return none, none
    tree = cKDTree(log.position[index])
    count = min(60, len(index))
    distance, near = tree.query(log.position[index], k=count, distance_upper_bound=NEIGHBOUR * width)
    here, rank = np.nonzero(np.isfinite(distance) & (distance > 0.5 * width))
    i, j = index[here], index[near[here, rank]]
    offset = log.position[j] - log.position[i]
    beside = np.abs((offset * forward[i]).sum(axis=1)) < 1.5
    opposite = (forward[i] * forward[j]).sum(axis=1) < -0.95
    return i[beside & opposite], j[beside & opposite]


def direction(log: Log) -> Array:
    """Unit vector of travel from the records before and after, shape (n, 2), nan at the ends of a track."""
    p, block = log.position, np.cumsum(log.gap)
    step = np.full((len(log), 2), np.nan)
    if len(log) > 2:
        whole = block[2:] == block[:-2]
        step[1:-1][whole] = (p[2:] - p[:-2])[whole]
    length = np.hypot(step[:, 0], step[:, 1])
    unit: Array = step / np.where(length > 0.2, length, np.nan)[:, None]
    return unit


def _best(log: Log, first: NDArray[np.int64], second: NDArray[np.int64]) -> tuple[float, float] | None:
    """(delay [s], correlation) where the passes agree best; None when too few or no clear peak."""
    if len(first) < FEWEST_PAIRS:
        return None
    tries = np.arange(EARLIEST, LATEST + 0.5, 1.0)
    agreement = np.array([_agreement(log, float(d), first, second) for d in tries])
    peak = int(np.nanargmax(np.where(np.isfinite(agreement), agreement, -1.0)))
    if peak in (0, len(tries) - 1) or not agreement[peak] >= LEAST_AGREEMENT:
        return None
    low, top, high = agreement[peak - 1 : peak + 2]
    curve = low - 2.0 * top + high
    offset = 0.5 * (low - high) / curve if np.isfinite(curve) and curve < 0.0 else 0.0
    return round(float(tries[peak] + np.clip(offset, -0.5, 0.5)), 2), float(top)


def _agreement(log: Log, seconds: float, first: NDArray[np.int64], second: NDArray[np.int64]) -> float:
    flow = _flow_later(log, seconds)
    area_rate = np.maximum(log.speed, 0.5) * np.maximum(log.width, 1.0)
    known = np.isfinite(flow)
    value = np.where(known, np.log(np.clip(np.where(known, flow, 1.0) / area_rate, 0.01, 5.0)), 0.0)
    fine, coarse = _running_mean(value, known, SHORT), _running_mean(value, known, LONG)
    local = np.clip(np.where(known, fine - coarse, np.nan), -0.5, 0.5)
    a, b = local[first], local[second]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < FEWEST_PAIRS or a[both].std() < 1e-9 or b[both].std() < 1e-9:
        return float("nan")
    return float(np.corrcoef(a[both], b[both])[0, 1])


def _running_mean(value: Array, known: NDArray[np.bool_], count: int) -> Array:
    kernel = np.ones(count)
    mean: Array = np.convolve(value, kernel, "same") / np.maximum(np.convolve(known, kernel, "same"), 1.0)
    return mean
