"""Compares a machine model with a recorded log: fitted on one part of it, tested on the others.

Keys of the machine's data sheet are fitted by least squares to the measured series. The regression
load = a + b flow + c speed, without and with a lag, is computed for comparison.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError, MissingExtra
from swath.core.units import RPM, split_unit
from swath.documents.data_sheets import Sheet
from swath.field_io.machine_log import MachineLog, read_machine_log
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import MachineSheet, open_machine, read_machine
from swath.signals import MachineLoad
from swath.tools.compare_log.along_log import (
    FEWEST,
    Array,
    Drive,
    Mask,
    SeriesStatistics,
    regressions,
    run_engine,
    run_process,
    statistics_of,
    usable,
)

SHOWN = {"engine_load": ("%", 100.0), "engine_speed": ("1/min", 1.0 / RPM), "fuel": ("l/h", 3.6e6)}
"""Measured quantity -> unit of all results, factor from SI."""
PAUSE = 60.0  # s, of a machine at rest: what lies between is a stretch of its own
DELAYS = ("transport.", "threshing.", "cleaning.")  # sections of the process
RANGE = (0.02, 20.0)  # of a fitted value over its start


@dataclass(frozen=True)
class Fitted:
    """A key of the sheet. error: standard error of the value from the curvature, independent errors taken."""

    key: str
    start: float
    value: float
    error: float
    unit: str


@dataclass(frozen=True)
class LogComparison:
    """The result. series: measured and simulated by quantity, in SHOWN units, shape (n,)

    parts: part -> records that are compared; statistics: quantity -> part -> model and plain regressions
    """

    model: str
    log_name: str
    drive: Drive
    fitted_on: str
    fitted: tuple[Fitted, ...]
    log: MachineLog
    parts: dict[str, Mask]
    measured: dict[str, Array]
    simulated: dict[str, Array]
    plain: dict[str, dict[str, Array]]
    coefficients: dict[str, dict[str, list[float]]]
    statistics: dict[str, dict[str, dict[str, SeriesStatistics]]]
    sheet: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """All but the series, for JSON."""
        return {
            "model": self.model,
            "log": self.log_name,
            "drive": asdict(self.drive),
            "fitted_on": self.fitted_on,
            "fitted": [asdict(f) for f in self.fitted],
            "records": {name: int(mask.sum()) for name, mask in self.parts.items()},
            "units": {q: SHOWN[q][0] for q in self.measured},
            "statistics": {
                q: {part: {k: asdict(f) for k, f in of.items()} for part, of in parts.items()}
                for q, parts in self.statistics.items()
            },
            "plain_coefficients": self.coefficients,
            "notes": list(self.log.notes),
        }


def compare_log(
    model: str,
    log: Path | MachineLog,
    *,
    drive: Drive | None = None,
    fit: Sequence[str] = (),
    on: Sequence[str] = ("engine_load",),
    machine: str | None = None,
    share: float = 0.5,
    alternate: bool = False,
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> LogComparison:
    """Run a machine model along a log and compare the two.

    model: name or path of a machine's data sheet; log: a file, or one that is read already
    fit: keys of the sheet to fit, to the quantities `on`; on the records of `machine` (a name of the log), or
    of every other stretch between pauses (`alternate`), or on the first `share` of all records
    columns: map file of the log. Raises InputError.
    """
    read = log if isinstance(log, MachineLog) else read_machine_log(log, columns)
    sheet = open_machine(model)
    chosen = drive or Drive()
    used = usable(read)
    parts, first = _parts(read, used, machine, share, alternate)
    for quantity in on:
        if quantity not in read.measured:
            raise InputError("on", quantity, f"expected one of {', '.join(read.measured)}")
    progress("fitting" if fit else "running")
    fitted: tuple[Fitted, ...] = ()
    if fit:
        sheet, fitted = _fit(sheet, read, first, used & first, chosen, fit, on)
    progress("running along the whole log")
    made = LogRunner(read, chosen).run(read_machine(sheet))
    scale = {q: SHOWN[q][1] for q in read.measured}
    measured = {q: v * scale[q] for q, v in read.measured.items()}
    simulated = {q: made[q] * scale[q] for q in measured}
    plain, coefficients = regressions(read, measured, next(iter(parts.values())))
    statistics = {
        q: statistics_of(measured[q], {"model": simulated[q], **plain[q]}, parts, read) for q in measured
    }
    return LogComparison(
        model=str(sheet.value("name")),
        log_name=str(getattr(log, "name", "log")),
        drive=chosen,
        fitted_on=next(iter(parts)) if fit else "",
        fitted=fitted,
        log=read,
        parts=parts,
        measured=measured,
        simulated=simulated,
        plain=plain,
        coefficients=coefficients,
        statistics=statistics,
        sheet=sheet.document.data,
    )


def _parts(
    log: MachineLog, used: Mask, machine: str | None, share: float, alternate: bool
) -> tuple[dict[str, Mask], Mask]:
    """Named parts of the compared records, the one to fit on first; and all records of that one."""
    if machine is not None:
        if machine not in log.machine_names:
            raise InputError("machine", machine, f"expected one of {', '.join(log.machine_names)}")
        first = np.asarray(log.machine == log.machine_names.index(machine))
        parts = {f"machine {machine}": first & used}
        others = [i for i, name in enumerate(log.machine_names) if name != machine]
        parts |= {f"machine {log.machine_names[i]}": (log.machine == i) & used for i in others}
        return parts, first
    if alternate:
        pause = log.gap & (np.diff(log.time, prepend=log.time[:1] - 2.0 * PAUSE) > PAUSE)
        first = np.asarray(np.cumsum(pause) % 2 == 1)
        return {"odd stretches": first & used, "even stretches": ~first & used}, first
    if not 0.05 <= share <= 0.95:
        raise InputError("share", share, "expected 0.05 to 0.95")
    first = np.arange(len(log)) < round(share * len(log))
    names = f"first {100 * share:.0f} %", f"last {100 - 100 * share:.0f} %"
    return {names[0]: first & used, names[1]: ~first & used}, first


class LogRunner:
    """Runs machines along one log; the process only anew when it changed."""

    def __init__(self, log: MachineLog, drive: Drive) -> None:
        self._log, self._drive = log, drive
        self._loads: list[tuple[Any, list[MachineLoad]]] = []

    def run(self, machine: MachineSheet) -> dict[str, Array]:
        """The simulated series, SI."""
        drivetrain = drivetrain_of(machine)
        key = (drivetrain.transport, drivetrain.threshing, drivetrain.cleaning)
        loads = next((made for known, made in self._loads if known == key), None)
        if loads is None:
            loads = run_process(machine, self._log, self._drive)
            self._loads = [*self._loads[-1:], (key, loads)]
        return run_engine(machine, self._log, self._drive, loads)


def _fit(
    sheet: Sheet,
    log: MachineLog,
    span: Mask,
    mask: Mask,
    drive: Drive,
    keys: Sequence[str],
    on: Sequence[str],
) -> tuple[Sheet, tuple[Fitted, ...]]:
    """Least squares over the sheet's keys; each quantity over its own spread.

    span: records to run along; mask: those of them that count
    """
    try:
        from scipy.optimize import least_squares
    except ImportError as error:
        raise MissingExtra("geo", "fitting a model") from error
    start = np.array([sheet.number(key) for key in keys])
    if not (start > 0.0).all():
        raise InputError(keys[int(np.argmin(start))], float(start.min()), "expected a start above 0")
    if mask.sum() < FEWEST:
        raise InputError("fit", int(mask.sum()), f"expected at least {FEWEST} records to fit on")
    part, inside = log.keep(span), mask[span]
    runner = LogRunner(part, drive)
    spread = {q: float(np.nanstd(part.measured[q][inside])) or 1.0 for q in on}

    def residuals(ratio: Array) -> Array:
        try:
            machine = read_machine(sheet.changed(dict(zip(keys, start * ratio, strict=True))))
        except InputError:  # beyond what a data sheet may say
            return np.full(len(on) * int(inside.sum()), 10.0)
        made = runner.run(machine)
        return np.concatenate([(made[q] - part.measured[q])[inside] / spread[q] for q in on])

    # powers first: while they are far off, delays would run away to make up for them
    steady = np.array([not key.startswith(DELAYS) for key in keys])
    ratio = np.ones(len(keys))
    limits = {"bounds": RANGE, "diff_step": 0.02, "xtol": 1e-4, "ftol": 1e-6}
    if steady.any() and not steady.all():
        ratio[steady] = least_squares(lambda x: residuals(_put(ratio, steady, x)), ratio[steady], **limits).x
    found = least_squares(residuals, ratio, **limits)
    doubt = _standard_errors(found.jac, found.fun) * start
    units = [split_unit(key)[1] for key in keys]
    rows = zip(keys, start, start * found.x, doubt, units, strict=True)
    best = sheet.changed(dict(zip(keys, start * found.x, strict=True)))
    return best, tuple(Fitted(*map(_plain, r)) for r in rows)


def _put(ratio: Array, where: Mask, values: Array) -> Array:
    made = ratio.copy()
    made[where] = values
    return made


def _plain(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float | np.floating) else value


def _standard_errors(jacobian: Array, residual: Array) -> Array:
    freedom = max(len(residual) - jacobian.shape[1], 1)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    return np.asarray(np.sqrt(np.diag(inverse) * float(residual @ residual) / freedom))
