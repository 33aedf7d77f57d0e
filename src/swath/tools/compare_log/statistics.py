"""Statistics of a simulated series against the measured one: fit, lag, and regressions for comparison."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field_io.machine_log import MachineLog

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LEAST_SPEED = 0.5  # m/s
SETTLE = 15.0  # s behind a gap, before the crop has come through
LAGS = 15  # records to either side in which a lag is searched
FEWEST = 20  # records to compare at all


@dataclass(frozen=True)
class SeriesStatistics:
    """Simulated against measured. count: records; r2: 1 - squared error over variance, below 0 is worse than
    the mean; rmse, bias: in the unit of the quantity, simulated minus measured; r: correlation; lag_s: by
    which the simulated series has to be delayed to fit best
    """

    count: int
    r2: float
    rmse: float
    bias: float
    r: float
    lag_s: float


def usable(log: MachineLog) -> Mask:
    """Records that count: crop in the machine, driving, every quantity measured, settled after a gap."""
    flow = log.flow[log.flow > 0.0]
    least = 0.1 * float(np.median(flow)) if len(flow) else 0.0
    since = _since_gap(log)
    good = (log.flow > least) & (log.speed > LEAST_SPEED) & (since > SETTLE)
    for values in log.measured.values():
        good &= np.isfinite(values)
    if good.sum() < FEWEST:
        raise InputError("log", int(good.sum()), f"expected at least {FEWEST} records at work in the log")
    return np.asarray(good)


def compare_series(measured: Array, simulated: Array, mask: Mask, log: MachineLog) -> SeriesStatistics:
    """Statistics of a series against the measured one on the records of a mask, shape (n,)."""
    real, made = measured[mask], simulated[mask]
    if len(real) < FEWEST:
        nan = float("nan")
        return SeriesStatistics(len(real), nan, nan, nan, nan, nan)
    error = made - real
    spread = float(((real - real.mean()) ** 2).sum())
    return SeriesStatistics(
        count=len(real),
        r2=1.0 - float((error**2).sum()) / spread if spread > 0.0 else float("nan"),
        rmse=float(np.sqrt((error**2).mean())),
        bias=float(error.mean()),
        r=_correlation(real, made),
        lag_s=best_lag(simulated, measured, mask, log)[0],
    )


def statistics_of(
    measured: Array, series: Mapping[str, Array], parts: Mapping[str, Mask], log: MachineLog
) -> dict[str, dict[str, SeriesStatistics]]:
    """part -> series -> statistics."""
    return {
        p: {k: compare_series(measured, s, mask, log) for k, s in series.items()} for p, mask in parts.items()
    }


def best_lag(cause: Array, effect: Array, mask: Mask, log: MachineLog) -> tuple[float, float]:
    """(s, r): by how much `effect` is later than `cause` where they correlate best, and how well they do.

    Cross-correlation over whole records within unbroken stretches, the peak refined by a parabola.
    """
    block = np.cumsum(log.gap)
    score = []
    count = len(log)
    for k in range(-LAGS, LAGS + 1):
        late, early = slice(max(k, 0), count + min(k, 0)), slice(max(-k, 0), count - max(k, 0))
        both = mask[late] & (block[late] == block[early])
        score.append(_correlation(cause[early][both], effect[late][both]))
    values = np.nan_to_num(np.array(score), nan=-1.0)
    peak = int(values.argmax())
    period = float(np.median(log.duration[~log.gap])) if (~log.gap).any() else 1.0
    offset = 0.0
    if 0 < peak < len(values) - 1:
        low, top, high = values[peak - 1 : peak + 2]
        curve = low - 2.0 * top + high
        offset = 0.5 * (low - high) / curve if curve < 0.0 else 0.0
    return float((peak - LAGS + offset) * period), float(values[peak])


def regressions(
    log: MachineLog, measured: Mapping[str, Array], mask: Mask
) -> tuple[dict[str, dict[str, Array]], dict[str, dict[str, list[float]]]]:
    """quantity -> name -> series of plain regressions on flow and speed, fitted on the records of a mask."""
    series: dict[str, dict[str, Array]] = {}
    coefficients: dict[str, dict[str, list[float]]] = {}
    for quantity, values in measured.items():
        lag, _ = best_lag(log.flow, values, mask, log)
        period = float(np.median(log.duration))
        series[quantity], coefficients[quantity] = {}, {}
        for name, shift in (("regression", 0), ("regression with lag", max(round(lag / period), 0))):
            terms = np.stack([np.ones(len(log)), _later(log, shift), log.speed], axis=1)
            found = np.linalg.lstsq(terms[mask], values[mask], rcond=None)[0]
            series[quantity][name] = terms @ found
            coefficients[quantity][name] = [*(float(c) for c in found), shift * period]
    return series, coefficients


def _correlation(a: Array, b: Array) -> float:
    if len(a) < FEWEST or a.std() < 1e-12 or b.std() < 1e-12:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def _since_gap(log: MachineLog) -> Array:
    """Time since the last gap [s]."""
    run = np.cumsum(np.where(log.gap, 0.0, log.duration))
    return np.asarray(run - np.maximum.accumulate(np.where(log.gap, run, 0.0)))


def _later(log: MachineLog, count: int) -> Array:
    """The flow so many records before, that of the first record of a stretch where there is none."""
    index = np.arange(len(log))
    first = np.maximum.accumulate(np.where(log.gap, index, 0))
    return np.asarray(log.flow[np.maximum(index - count, first)])
