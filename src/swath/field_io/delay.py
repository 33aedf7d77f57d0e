"""How late the logged grain flow is: the time from the knife to the sensor, less what the monitor took off.

Neighbouring passes driven in opposite directions see the same soil. A flow that is late by d shifts the
yield of one pass forwards and of the other backwards, so the two agree best at the right d. Where the yield
changes over short ways a fine band shows it best, else a coarser one; how well shows when parts are left out.
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
LEAST_FLOW = 0.2  # of the median flow: below, the header is not full
LEAST_AGREEMENT = 0.15  # correlation of neighbouring passes; below, the peak is chance
BANDS = (
    (5, 41),
    (9, 81),
    (15, 161),
)  # records: the yield is smoothed over the first, freed of trends over the second
CLEARER = 0.5  # of the standard error of a finer band: a coarser one with less counts instead
PARTS = 40  # of the pairs, of which one each is left out for the standard error


@dataclass(frozen=True)
class Delay:
    """Delay of a machine's flow [s]; agreement: correlation of opposite neighbour passes with it.

    error: standard error of the delay [s], nan = not known
    """

    machine: str
    seconds: float
    method: str
    agreement: float
    pair_count: int
    error: float = float("nan")


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
            delays.append(Delay(name, found[0], method, found[1], int(own.sum()), found[2]))
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
    cutting = (log.speed > 0.8) & (log.flow > LEAST_FLOW * np.median(log.flow)) & (log.width > 0.9 * width)
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


def _best(log: Log, first: NDArray[np.int64], second: NDArray[np.int64]) -> tuple[float, float, float] | None:
    """(delay [s], correlation, standard error [s]) where the passes agree best; None when too few or no clear
    peak.
    """
    best: tuple[float, float, float] | None = None
    if len(first) < FEWEST_PAIRS:
        return best
    for short, long in BANDS:
        products = _products(log, first, second, short, long)
        found = _peak(products.sum(axis=2), short)
        if found is None:
            continue
        parts = [_peak(products.sum(axis=2) - part, short) for part in np.moveaxis(products, 2, 0)]
        others = np.array([found[0] if part is None else part[0] for part in parts])
        error = float(np.sqrt((len(parts) - 1) / len(parts) * ((others - others.mean()) ** 2).sum()))
        if best is None or error < CLEARER * best[2]:
            best = (round(found[0], 2), found[1], round(error, 2))
    return best


def _peak(products: Array, short: int) -> tuple[float, float] | None:
    """(delay [s], correlation) of products, shape (tries, 3); None without a clear peak."""
    both, a, b = products.T
    agreement = np.where((a > 1e-9) & (b > 1e-9), both / np.sqrt(np.maximum(a * b, 1e-18)), -1.0)
    peak = int(agreement.argmax())
    reach = max(short // 3, 1)
    if peak in (0, len(agreement) - 1) or not agreement[peak] >= LEAST_AGREEMENT:
        return None
    near = np.arange(max(peak - reach, 0), min(peak + reach + 1, len(agreement)))
    curve, slope, _ = np.polyfit(near - peak, agreement[near], 2)
    offset = -0.5 * slope / curve if curve < 0.0 else 0.0
    return EARLIEST + peak + float(np.clip(offset, -0.5 * reach, 0.5 * reach)), float(agreement[peak])


def _products(log: Log, first: NDArray[np.int64], second: NDArray[np.int64], short: int, long: int) -> Array:
    """Sums of both yields' product and of their squares, shape (tries, 3, PARTS of the pairs)."""
    part = np.arange(len(first)) * PARTS // len(first)
    area_rate = np.maximum(log.speed, 0.5) * np.maximum(log.width, 1.0)
    least = LEAST_FLOW * float(np.median(log.flow[log.flow > 0.0])) if (log.flow > 0.0).any() else 0.0
    made = []
    for seconds in np.arange(EARLIEST, LATEST + 0.5, 1.0):
        flow = _flow_later(log, float(seconds))
        known = flow > least  # before the grain arrives there is none to agree
        value = np.where(known, np.log(np.clip(np.where(known, flow, 1.0) / area_rate, 0.01, 5.0)), 0.0)
        local = _smooth(value, known, short) - _smooth(value, known, long)
        local = np.clip(np.where(known, local, np.nan), -0.5, 0.5)
        a, b = local[first], local[second]
        both = np.isfinite(a) & np.isfinite(b)
        a, b = np.where(both, a, 0.0), np.where(both, b, 0.0)
        if both.sum() < FEWEST_PAIRS:
            a, b = np.zeros_like(a), np.zeros_like(b)
        made.append([np.bincount(part, product, minlength=PARTS) for product in (a * b, a * a, b * b)])
    return np.array(made)


def _smooth(value: Array, known: NDArray[np.bool_], count: int) -> Array:
    """Lines through the known values within `count` records around each, at it: their mean in the middle, not
    drawn to one side at an end.
    """
    offset = np.arange(count, dtype=float) - count // 2  # sums of whole numbers: exact, and quicker as floats
    kernels = (offset**0, -offset, offset**2)
    n, first, second = (np.convolve(known.astype(float), kernel, "same") for kernel in kernels)
    total, moment = (np.convolve(value, kernel, "same") for kernel in (offset**0, -offset))
    spread = n * second - first**2
    line = (second * total - first * moment) / np.where(spread > 0.0, spread, 1.0)
    return np.asarray(np.where(spread > 0.0, line, total / np.maximum(n, 1.0)))
