"""Compares a machine model with a recorded log: fitted on one part of it, tested on the others.

Keys of the machine's data sheet are fitted by least squares to the measured series. The regression
load = a + b flow + c speed, without and with a lag, is computed for comparison.

Process and powertrain run along the log: its speed, its crop, its slope.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import atan, cos, sin
from pathlib import Path
from typing import Any, Literal

import numpy as np

from swath.core.errors import Extra, InputError
from swath.core.frames import Pose
from swath.core.number_text import num, percent_of
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import RPM, rounded, split_unit
from swath.documents.data_sheets import Sheet
from swath.field_io.logs.machine_log import MachineLog, read_machine_log
from swath.judge.evaluators.drivetrain import DIESEL
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import MachineSheet, open_machine, read_machine
from swath.scenario.slots import REGISTRY
from swath.signals import F64, I64, CropFlow, MachineLoad, MachineState, Mask
from swath.tools.compare_log.no_field import site_of

LEAST_SPEED = 0.5  # m/s
SETTLE = 15.0  # s behind a gap, before the crop has come through
LAGS = 15  # records to either side in which a lag is searched
STRAW = 0.65  # per grain, by mass, of a log that does not say
FEWEST = 20  # records to compare at all


@dataclass(frozen=True)
class SeriesStatistics:
    """Simulated against measured.

    count: records
    r2: 1 - squared error over variance, below 0 is worse than the mean
    rmse, bias: in the unit of the quantity, simulated minus measured
    r: correlation
    lag_s: by which the simulated series has to be delayed to fit best
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


def compare_series(measured: F64, simulated: F64, mask: Mask, log: MachineLog) -> SeriesStatistics:
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
    measured: F64, series: Mapping[str, F64], parts: Mapping[str, Mask], log: MachineLog
) -> dict[str, dict[str, SeriesStatistics]]:
    """Statistics by part and series."""
    return {
        p: {k: compare_series(measured, s, mask, log) for k, s in series.items()} for p, mask in parts.items()
    }


def best_lag(cause: F64, effect: F64, mask: Mask, log: MachineLog) -> tuple[float, float]:
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
    log: MachineLog, measured: Mapping[str, F64], mask: Mask
) -> tuple[dict[str, dict[str, F64]], dict[str, dict[str, list[float]]]]:
    """Series by quantity and name: regressions on flow and speed, fitted on the records of a mask."""
    series: dict[str, dict[str, F64]] = {}
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


def _correlation(a: F64, b: F64) -> float:
    if len(a) < FEWEST or a.std() < 1e-12 or b.std() < 1e-12:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def _since_gap(log: MachineLog) -> F64:
    """Time since the last gap [s]."""
    run = np.cumsum(np.where(log.gap, 0.0, log.duration))
    return np.asarray(run - np.maximum.accumulate(np.where(log.gap, run, 0.0)))


def _later(log: MachineLog, count: int) -> F64:
    """The flow so many records before, that of the first record of a stretch where there is none."""
    index = np.arange(len(log))
    first = np.maximum.accumulate(np.where(log.gap, index, 0))
    return np.asarray(log.flow[np.maximum(index - count, first)])


TANK = 0.5  # of the tank is full all the time: logs do not say when it was emptied


@dataclass(frozen=True)
class Drive:
    """How a log is driven along.

    process, engine: levels
    straw: per grain, by mass; None = STRAW, of a whole crop: none of it is grain, as in a forage harvester
    whole_crop: the logged flow is all of the crop
    load_over: what the measured load is a share of: the torque that the engine could give at its present
        speed (`present`), or the largest that it can give at any (`largest`)
    friction: measured load of an engine that gives no torque
    flow_floor: logged flow without crop [kg/s]
    """

    process: str = "threshing"
    engine: str = "ideal"
    straw: float | None = None
    whole_crop: bool = False
    load_over: Literal["present", "largest"] = "present"
    friction: float = 0.0
    flow_floor: float = 0.0


def run_process(machine: MachineSheet, log: MachineLog, drive: Drive) -> list[MachineLoad]:
    """Where the crop is, at every record. The crop of a record went in evenly since the one before."""
    level = REGISTRY.get("process", drive.process)
    has_outlet = "straw" in level.params.__dataclass_fields__
    params = level.params(straw="chop") if has_outlet else level.params()
    loads: list[MachineLoad] = []
    ratio = (np.inf if drive.whole_crop else STRAW) if drive.straw is None else drive.straw
    grain = 1.0 / (1.0 + ratio) if drive.whole_crop else 1.0
    straw = 1.0 - grain if drive.whole_crop else ratio
    process = level.component(params, site_of(machine, 1.0))
    for t, dt, flow, speed, grade, is_first in _records(log):
        if is_first:
            process.reset(Stream(0, "log"))
        h, flow = dt / NS, max(flow - drive.flow_floor, 0.0)
        cut = CropFlow(t + dt, grain * flow * h, straw * flow * h, 0.0, 0, 1.0, h)
        inputs = {"flow": (cut,), "state": _state(t + dt, speed, grade), "engine": None}
        loads.append(process.step(t, dt, inputs)["load"])
    return loads


def run_engine(
    machine: MachineSheet, log: MachineLog, drive: Drive, loads: list[MachineLoad]
) -> dict[str, F64]:
    """engine_load (share), engine_speed [rad/s], fuel [m3/s] along the log, shape (n,) each.

    loads: of `run_process`. Each machine of the log has its own header's width; process and engine start anew
    behind every gap.
    """
    level = REGISTRY.get("powertrain", drive.engine)
    drivetrain = drivetrain_of(machine)
    grain = TANK * drivetrain.tank
    rows = np.empty((len(log), 4))
    widths = [_width(log, k, machine.header_width) for k in range(len(log.machine_names))]
    engine: Any = None
    for i, (t, dt, _, speed, grade, is_first) in enumerate(_records(log)):
        if is_first:
            own = replace(machine, header_width=widths[log.machine[i]])
            engine = level.component(level.params(), site_of(own, 1.0))
            engine.reset(Stream(0, "log"))
        load = replace(loads[i], t=t + dt, tank_grain=grain)
        e = engine.step(t, dt, {"state": _state(t + dt, speed, grade), "load": load})["engine"]
        rows[i] = e.load, e.speed, e.power, e.fuel
    share, turning, power, fuel = rows.T
    if drive.load_over == "largest":
        of = drivetrain.engine
        share = power / turning / ((1.0 + of.torque_rise) * of.rated_power / of.rated_speed)
    share = drive.friction + (1.0 - drive.friction) * share
    return {"engine_load": share, "engine_speed": turning, "fuel": fuel / (1e3 * DIESEL)}


def _width(log: MachineLog, machine: int, default: float) -> float:
    widths = log.width[(log.machine == machine) & np.isfinite(log.width)]
    return float(np.median(widths)) if len(widths) else default


def _records(log: MachineLog) -> Any:
    """(t [ns], dt [ns], flow, speed, grade, is_first) of each record; t counts from the last gap."""
    if not len(log):
        raise InputError("log", 0, "expected records")
    t = 0
    rows = (log.duration, log.flow, log.speed, log.grade, log.gap)
    for duration, flow, speed, grade, gap in zip(*(r.tolist() for r in rows), strict=True):
        t = 0 if gap else t
        dt = round(duration * NS)
        yield t, dt, flow, speed, grade, gap
        t += dt


def _state(t: int, speed: float, grade: float) -> MachineState:
    """On the spot, so that no straw is laid, but pitched as the ground is."""
    if grade == 0.0:
        return MachineState(t, _LEVEL, speed, 0.0, 0.0, 0.0, 0.0)
    pitch = -atan(grade)
    c, s = cos(pitch), sin(pitch)
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return MachineState(t, Pose(_LEVEL.position, rotation), speed, 0.0, 0.0, 0.0, 0.0)


_LEVEL = Pose.identity()


SHOWN = {"engine_load": ("%", 100.0), "engine_speed": ("1/min", 1.0 / RPM), "fuel": ("l/h", 3.6e6)}
"""Measured quantity -> unit of all results, factor from SI."""
STRETCH = 300.0  # s: what is left of the load is no longer correlated with itself after that time
PAUSE = 60.0  # s, of a machine at rest: what lies between is a stretch of its own
DELAYS = ("transport.", "threshing.", "cleaning.")  # sections of the process
RANGE = (0.02, 20.0)  # of a fitted value over its start


@dataclass(frozen=True)
class Fitted:
    """A key of the sheet. error: standard error of the value by stretches of the log, nan = one alone."""

    key: str
    start: float
    value: float
    error: float
    unit: str


@dataclass(frozen=True)
class LogComparison:
    """The result. series: measured and simulated by quantity, in SHOWN units, shape (n,).

    parts: part -> records that are compared
    statistics: quantity -> part -> model and plain regressions
    """

    model: str
    log_name: str
    drive: Drive
    fitted_on: str
    fitted: tuple[Fitted, ...]
    log: MachineLog
    parts: dict[str, Mask]
    measured: dict[str, F64]
    simulated: dict[str, F64]
    plain: dict[str, dict[str, F64]]
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
            **self.log.column_map.summary(),
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
    names = f"first {percent_of(share)}", f"last {num(100 - 100 * share)} %"
    return {names[0]: first & used, names[1]: ~first & used}, first


class LogRunner:
    """Runs machines along one log; the process only anew when it changed."""

    def __init__(self, log: MachineLog, drive: Drive) -> None:
        self._log, self._drive = log, drive
        self._loads: list[tuple[Any, list[MachineLoad]]] = []

    def run(self, machine: MachineSheet) -> dict[str, F64]:
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
    with Extra("geo", "fitting a model"):
        from scipy.optimize import least_squares
    start = starts_of(sheet, keys)
    if mask.sum() < FEWEST:
        raise InputError("fit", int(mask.sum()), f"expected at least {FEWEST} records to fit on")
    part, inside = log.keep(span), mask[span]
    runner = LogRunner(part, drive)
    spread = {q: float(np.nanstd(part.measured[q][inside])) or 1.0 for q in on}

    def residuals(ratio: F64) -> F64:
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
    doubt = _standard_errors(found.jac, found.fun, np.tile(stretches(part, inside)[1], len(on))) * start
    units = [split_unit(key)[1] for key in keys]
    rows = zip(keys, start, start * found.x, doubt, units, strict=True)
    best = sheet.changed(dict(zip(keys, start * found.x, strict=True)))
    return best, tuple(
        Fitted(key, rounded(at, 5), rounded(to, 5), rounded(by, 5), unit) for key, at, to, by, unit in rows
    )


def stretches(log: MachineLog, mask: Mask | I64) -> tuple[F64, I64]:
    """Machine and number of each stretch, (k, 2), and which one some records belong to, (n,)."""
    at = np.stack([log.machine[mask], np.floor(log.time[mask] / STRETCH)], axis=1)
    known, index = np.unique(at, axis=0, return_inverse=True)
    return known, index.ravel()


def starts_of(sheet: Sheet, keys: Sequence[str]) -> F64:
    """The numbers of a sheet that a fit starts from. InputError for one that is not above 0."""
    start = np.array([sheet.number(key) for key in keys])
    if not (start > 0.0).all():
        raise InputError(keys[int(np.argmin(start))], float(start.min()), "expected a start above 0")
    return start


def _put(ratio: F64, where: Mask, values: F64) -> F64:
    made = ratio.copy()
    made[where] = values
    return made


def _standard_errors(jacobian: F64, residual: F64, stretch: I64) -> F64:
    """Standard errors by how far stretches of the log, each alike in itself, differ; nan of one stretch."""
    pull = np.stack([np.bincount(stretch, column * residual) for column in jacobian.T])
    inverse, count = np.linalg.pinv(jacobian.T @ jacobian), pull.shape[1]
    spread = np.sqrt(np.diag(inverse @ pull @ pull.T @ inverse))
    return np.asarray(spread * np.sqrt(count / (count - 1.0)) if count > 1 else np.full(len(spread), np.nan))
