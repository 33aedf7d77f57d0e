"""Checks an FMU in a child process: reads it, steps it, saves and restores its state."""

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import islice
from math import isfinite
from pathlib import Path

from swath.core.errors import SwathError
from swath.core.foreign_code import need_allowed
from swath.link.fmi.calls import FmuError
from swath.link.fmi.child_process import ChildProcess
from swath.link.fmi.description import Description, Variable, read_fmu
from swath.link.fmi.ssp import SUFFIXES, read_system

Row = tuple[str, str, str]  # what was looked at, result (ok, note or bad), what was found
SHOWN_FAULTS = 20
NOT_SAVED = "cannot be saved, nor can a run with it"


def check_fmu(
    file: Path, *, step_s: float = 0.1, duration_s: float = 1.0, timeout_s: float = 10.0
) -> list[Row]:
    """Run an FMU with its inputs at their start values; of a system, one component after the other.

    One row for each thing looked at; it can fill a slot when none is `bad`. InputError for a file that is
    none at all, or may not run.
    """
    need_allowed("file", file)
    if file.suffix.lower() not in SUFFIXES:
        return _check(read_fmu(file), step_s, duration_s, timeout_s)
    return [
        (f"{path}: {what}", result, text)
        for path, fmu in read_system(file).components.items()
        for what, result, text in _check(fmu, step_s, duration_s, timeout_s)
    ]


def _check(fmu: Description, step_s: float, duration_s: float, timeout_s: float) -> list[Row]:
    rows: list[Row] = [("description", "ok", f"FMI {fmu.version}, {fmu.tool or 'unknown tool'}")]
    rows += [("standard", "note", fault) for fault in fmu.faults[:SHOWN_FAULTS]]
    if len(fmu.faults) > SHOWN_FAULTS:
        rows.append(("standard", "note", f"and {len(fmu.faults) - SHOWN_FAULTS} more"))
    rows += _units(fmu)
    if fmu.needs_tool:
        rows.append(("tool", "note", "it says that it needs the tool that exported it"))
    if fmu.one_per_process:
        rows.append(("process", "note", "one instance per process: it gets its own"))
    if fmu.library is None:
        has = ", ".join(fmu.platforms) or "none"
        rows.append(("binary", "bad", f"none for this system; it has: {has}"))
        return rows
    rows.append(("binary", "ok", fmu.library))
    trial = _Trial(fmu, step_s, round(duration_s / step_s), timeout_s)
    with closing(trial.unit):
        return [*rows, *trial.rows()]


def usable(fmu: Description, causality: str) -> list[Variable]:
    """Variables of this causality that are numbers."""
    return [v for v in fmu.of(causality) if v.is_number]


def _units(fmu: Description) -> list[Row]:
    both = [*usable(fmu, "input"), *usable(fmu, "output")]
    strange = sorted({v.unit_name for v in both if v.unit is None and v.unit_name is not None})
    without = [v.name for v in both if v.unit_name is None and v.kind == "real"]
    rows = [("units", "note", f"not defined: {name}; write it under `units`") for name in strange]
    if without:
        rows.append(("units", "note", f"{len(without)} of {len(both)} variables have none: taken as SI"))
    return rows or [("units", "ok", f"of all {len(both)} inputs and outputs")]


class _Trial:
    """Starts, steps, saves, goes back and starts again; stops at the first thing that is bad."""

    def __init__(self, fmu: Description, step_s: float, count: int, timeout_s: float) -> None:
        self.fmu, self.step_s, self.count = fmu, step_s, max(count, 1)
        self.inputs, self.outputs = usable(fmu, "input"), usable(fmu, "output")
        self.numbers = [x for v in self.inputs for x in v.numbers()]
        self.unit = ChildProcess(fmu, "check", self.inputs, self.outputs, timeout_s)

    def rows(self) -> Iterator[Row]:
        """One row for each thing tried."""
        trials = (("start", self._start), ("steps", self._steps), ("state", self._state))
        for what, trial in (*trials, ("again", self._again)):
            try:
                yield (what, *trial())
            except SwathError as error:
                yield what, "bad", str(error)
                return

    def _start(self) -> tuple[str, str]:
        self.first = self.unit.start({})
        self._look(self.first, 0.0)
        return "ok", f"{len(self.inputs)} inputs, {len(self.outputs)} outputs"

    def _steps(self) -> tuple[str, str]:
        started = time.perf_counter()
        for k in range(self.count):
            try:
                values = self.unit.step(k * self.step_s, self.step_s, self.numbers)
            except FmuError as error:
                raise FmuError(f"at t = {k * self.step_s:g} s: {error}") from error
            self._look(values, (k + 1) * self.step_s)
        cost = (time.perf_counter() - started) / self.count * 1e6
        return "ok", f"{self.count} of {self.step_s:g} s, {cost:.0f} us each, in its own process"

    def _state(self) -> tuple[str, str]:
        if not self.fmu.saves_state:
            return "note", NOT_SAVED
        try:
            return "ok", self._saved()
        except FmuError as error:
            return "note", f"{NOT_SAVED}, though it says so: {error}"

    def _saved(self) -> str:
        t = self.count * self.step_s
        how = "as bytes" if self.fmu.serializes else "in memory only"
        state = self.unit.save()
        ahead = self.unit.step(t, self.step_s, self.numbers)
        self.unit.load(state)
        if self.unit.step(t, self.step_s, self.numbers) != ahead:
            raise FmuError(f"saved {how}, but going back gives other outputs")
        return f"saved {how}, going back gives the same outputs"

    def _again(self) -> tuple[str, str]:
        said = set(self.unit.notes)
        is_same = self.unit.start({}) == self.first
        if new := [note for note in self.unit.notes if note not in said]:
            return "note", "; ".join(new)
        return ("ok", "same outputs as at first") if is_same else ("note", "other outputs than at first")

    def _look(self, values: Sequence[float], t: float) -> None:
        left = iter(values)
        for variable in self.outputs:
            if not all(map(isfinite, islice(left, variable.size))):
                raise FmuError(f"{variable.name} is not a finite number at t = {t:g} s")
