"""Fits what an engine is loaded with and what it burns to a log of several machines, load and fuel together.

Generalised least squares on both series: what is left of them is correlated, since fuel follows the load much
closer than either follows the crop, and is weighted by its covariance (Zellner 1962, seemingly unrelated
regressions, doi:10.1080/01621459.1962.10480664). What the model says is close to linear in the numbers of a
data sheet, so that every other fit needed (one machine left out, resampled records) is solved from the normal
equations at the solution, summed by stretches of the log.

Load and fuel alone do not separate an engine's power from its efficiency. The slope of the fuel line
(`engine.fuel_g_kwh`; Willans: fuel is linear in the work, SAE Technical Paper 690182) is therefore given by
the data sheet, and the rated power follows from the fuel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import rounded, split_unit
from swath.documents.data_sheets import Sheet
from swath.field_io.logs.machine_log import MachineLog
from swath.machine.machine_sheet import read_machine
from swath.signals import F64, I64, Mask
from swath.tools.compare_log.compare import (
    SHOWN,
    Drive,
    Fitted,
    LogRunner,
    SeriesStatistics,
    compare_series,
    starts_of,
    stretches,
    usable,
)

KEYS = ("engine.rated_power_kw", "engine.fuel_idle_g_s", "power.auxiliary_kw", "power.drum_kj_per_kg")
ON = ("engine_load", "fuel")
STEPS = 4  # of Gauss and Newton
DIFFERENCE = 0.02  # of a number, for its derivative
LEAST = 0.02  # of its start that a number keeps
RESAMPLES = 2000  # of stretches, for the range of R2


@dataclass(frozen=True)
class FittedNumber(Fitted):
    """A number of the sheet. error: standard error by bootstrap over machines and stretches of each.

    left_out: its value without each of the machines
    """

    left_out: tuple[float, ...]


@dataclass(frozen=True)
class Prediction:
    """How one machine's load [%] and fuel [l/h] are met; mean_fuel: measured [l/h].

    load_r2_range: within which 95 % of the load's R2 lie when stretches of the log are drawn anew
    """

    machine: str
    load: SeriesStatistics
    fuel: SeriesStatistics
    mean_fuel: float
    load_r2_range: tuple[float, float]

    @property
    def fuel_bias_percent(self) -> float:
        """Mean fuel simulated over measured, minus 1 [%]."""
        return 100.0 * self.fuel.bias / self.mean_fuel


@dataclass(frozen=True)
class EngineFit:
    """sheet: with the fitted numbers; before, after: of the sheet as given and as fitted on all machines.

    left_out: of each machine by the numbers fitted on the others, `all` over the records of all machines
    """

    sheet: Sheet
    numbers: tuple[FittedNumber, ...]
    before: tuple[Prediction, ...]
    after: tuple[Prediction, ...]
    left_out: tuple[Prediction, ...]


def fit_engine(
    sheet: Sheet,
    log: MachineLog,
    drive: Drive,
    *,
    keys: Sequence[str] = KEYS,
    resamples: int = 1000,
    seed: int = 1,
    progress: Callable[[str], None] = lambda text: None,
) -> EngineFit:
    """Fit numbers of a machine's data sheet to all machines of a log, and to all but one in turn.

    Raises InputError for a log without engine load or fuel, of one machine, or a key that is not above 0.
    """
    for quantity in ON:
        if quantity not in log.measured:
            raise InputError("log", quantity, "expected a log with engine load and fuel")
    if len(log.machine_names) < 2:
        raise InputError("log", len(log.machine_names), "expected at least two machines, to leave one out")
    model = _Model(sheet, log, drive, keys)
    before = model.run(np.ones(len(keys)))
    ratio = np.ones(len(keys))
    for step in range(STEPS):
        progress(f"fitting, step {step + 1} of {STEPS}")
        sums = model.linearise(ratio)
        found = sums.solve(sums.machine >= 0, ratio)
        moved, ratio = float(np.abs(found - ratio).max()), found
        if moved < 1e-3:
            break
    names = range(len(log.machine_names))
    progress("leaving one machine out")
    others = [sums.solve(sums.machine != k, ratio) for k in names]
    predicted = _joined([model.run(r) for r in others], log)
    errors = sums.bootstrap(ratio, resamples, Stream(seed, "calibrate"))
    numbers = []
    for i, key in enumerate(keys):
        values = [rounded(model.start[i] * r[i], 4) for r in (ratio, *others)]
        error = rounded(model.start[i] * errors[i], 4)
        numbers.append(
            FittedNumber(key, model.start[i], values[0], error, split_unit(key)[1], tuple(values[1:]))
        )
    return EngineFit(
        sheet=sheet.changed({n.key: n.value for n in numbers}),
        numbers=tuple(numbers),
        before=predictions(log, before),
        after=predictions(log, model.run(ratio)),
        left_out=predictions(log, predicted),
    )


def predictions(log: MachineLog, simulated: dict[str, F64]) -> tuple[Prediction, ...]:
    """Predictions for every machine of the log, and for `all`. simulated: SI, shape (n,) each."""
    used = usable(log)
    masks = {f"machine {name}": used & (log.machine == k) for k, name in enumerate(log.machine_names)}
    made = []
    for name, mask in (masks | {"all": used}).items():
        load, fuel = (
            compare_series(log.measured[q] * SHOWN[q][1], simulated[q] * SHOWN[q][1], mask, log) for q in ON
        )
        mean_fuel = float(log.measured["fuel"][mask].mean() * SHOWN["fuel"][1])
        spread = r2_range(log, mask, log.measured["engine_load"], simulated["engine_load"])
        made.append(Prediction(name, load, fuel, mean_fuel, spread))
    return tuple(made)


def r2_range(log: MachineLog, mask: Mask, measured: F64, simulated: F64) -> tuple[float, float]:
    """95 % interval of R2 over a bootstrap of the log's stretches: how much hangs on those driven."""
    _, index = stretches(log, mask)
    real, left = measured[mask] - measured[mask].mean(), (simulated - measured)[mask]
    columns = (np.ones(len(real)), real, real**2, left**2)
    sums = np.stack([np.bincount(index, c) for c in columns], axis=1)
    drawn = Stream(0, "r2_range").at().integers(0, len(sums), (RESAMPLES, len(sums)))
    count, first, second, error = sums[drawn].sum(axis=1).T
    low, high = np.percentile(1.0 - error / np.maximum(second - first**2 / count, 1e-30), [2.5, 97.5])
    return float(low), float(high)


@dataclass(frozen=True)
class _Sums:
    """Normal equations by stretch: square (stretches, k, k), right (stretches, k), machine (stretches,)."""

    square: F64
    right: F64
    machine: I64
    at: F64

    def solve(self, rows: I64 | Mask, start: F64) -> F64:
        """The ratios that fit the stretches `rows` (mask or indices) best."""
        step = np.linalg.solve(self.square[rows].sum(axis=0), self.right[rows].sum(axis=0))
        return np.asarray(np.maximum(self.at + step, LEAST * np.ones_like(start)))

    def bootstrap(self, start: F64, count: int, stream: Stream) -> F64:
        """Standard deviation of the ratios over machines, and stretches of each, drawn with replacement."""
        rng = stream.at()
        own = [np.flatnonzero(self.machine == k) for k in np.unique(self.machine)]
        made = []
        for _ in range(count):
            drawn = [own[k] for k in rng.integers(0, len(own), len(own))]
            rows = np.concatenate([rng.choice(of, len(of)) for of in drawn])
            made.append(self.solve(rows, start))
        return np.asarray(np.std(made, axis=0))


class _Model:
    """The machine along the log, over the ratios of its numbers to those of the sheet."""

    def __init__(self, sheet: Sheet, log: MachineLog, drive: Drive, keys: Sequence[str]) -> None:
        self._sheet, self._log, self._keys = sheet, log, keys
        self._runner = LogRunner(log, drive)
        self.start = starts_of(sheet, keys)
        self._used = np.flatnonzero(usable(log))
        self._spread = {q: float(np.std(log.measured[q][self._used])) or 1.0 for q in ON}
        known, self._stretch = stretches(log, self._used)
        self._machine = known[:, 0].astype(np.int64)

    def run(self, ratio: F64) -> dict[str, F64]:
        """The simulated series, SI."""
        values = dict(zip(self._keys, (self.start * ratio).tolist(), strict=True))
        return self._runner.run(read_machine(self._sheet.changed(values)))

    def linearise(self, ratio: F64) -> _Sums:
        """Normal equations about `ratio`."""
        here = self._scaled(self.run(ratio))
        columns = []
        for i in range(len(ratio)):
            aside = ratio.copy()
            aside[i] += DIFFERENCE
            columns.append((self._scaled(self.run(aside)) - here) / DIFFERENCE)
        jacobian = np.stack(columns, axis=-1)
        left = self._scaled(self._log.measured) - here
        whiten = np.linalg.inv(np.linalg.cholesky(left @ left.T / left.shape[1]))
        jacobian, left = np.einsum("qp,pnk->qnk", whiten, jacobian), whiten @ left
        count, k = len(self._machine), len(ratio)
        square, right = np.zeros((count, k, k)), np.zeros((count, k))
        for rows, rest in zip(jacobian, left, strict=True):
            np.add.at(square, self._stretch, rows[:, :, None] * rows[:, None, :])
            np.add.at(right, self._stretch, rows * rest[:, None])
        return _Sums(square, right, self._machine, ratio)

    def _scaled(self, series: dict[str, F64]) -> F64:
        """Both series on the records that count, over their spread, shape (2, records)."""
        return np.stack([series[q][self._used] / self._spread[q] for q in ON])


def _joined(made: Sequence[dict[str, F64]], log: MachineLog) -> dict[str, F64]:
    """Each machine's records out of the run that was not fitted to it."""
    index = np.arange(len(log))
    return {q: np.stack([of[q] for of in made])[log.machine, index] for q in ON}
