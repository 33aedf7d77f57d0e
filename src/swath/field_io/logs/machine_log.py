"""What a machine did and what its engine said: any log that `swath field import` reads, with engine columns.

Unlike a yield log, no record is left out: a machine that is simulated along needs every second.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field_io.logs.clock import usable
from swath.field_io.logs.columns import ColumnMap, find_columns
from swath.field_io.logs.log import PLAUSIBLE, not_working, si_values, si_values_within
from swath.field_io.logs.records import declared_machines
from swath.field_io.logs.table import Table, read_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MEASURED = ("engine_load", "engine_speed", "fuel")
NEEDED = {
    "speed": (("speed",),),
    "grain_flow": (("grain_flow",),),
    " or ".join(MEASURED): tuple((key,) for key in MEASURED),
}
LIMITS = {"engine_load": (0.0, 2.0), "engine_speed": (0.0, 700.0), "fuel": (0.0, 5e-4), "speed": (0.0, 20.0),
          "grain_flow": (0.0, 300.0), "header_width": (0.5, 30.0), "elevation": PLAUSIBLE["elevation"],
          "time": (-1e11, 1e11)}  # fmt: skip
"""In SI units: share, rad/s, m3/s, m/s, kg/s, m, m, s. A value outside is missing."""
LONGEST_STEP = 5.0  # s, a longer pause breaks the log
GRADE_RECORDS, GRADE_WAY, STEEPEST = 5, 5.0, 0.25  # to either side; m; rise over way


@dataclass(frozen=True)
class MachineLog:
    """Records sorted by machine, then time; arrays have one entry per record, shape (n,).

    machine: index into machine_names; time [s]; duration [s] since the record before
    gap: does not follow the one before; speed [m/s]
    width: of the header [m], nan = not logged
    flow: crop as logged [kg/s], 0 where the header does not work
    grade: rise over way, 0 where no height is logged
    measured: of engine_load (share), engine_speed [rad/s], fuel [m3/s] those that the log has, nan = missing
    notes: what was assumed or could not be read
    """

    machine: NDArray[np.int64]
    time: Array
    duration: Array
    gap: Mask
    speed: Array
    width: Array
    flow: Array
    grade: Array
    measured: dict[str, Array]
    machine_names: tuple[str, ...]
    notes: tuple[str, ...]
    column_map: ColumnMap

    def __len__(self) -> int:
        return len(self.time)

    def keep(self, mask: Mask) -> "MachineLog":
        """The records of a mask, shape (n,); the first of each kept stretch follows none."""
        index = np.flatnonzero(mask)
        jump = np.diff(index, prepend=-2) != 1
        arrays: dict[str, Any] = {k: v[index] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        arrays["gap"] = arrays["gap"] | jump
        return replace(self, **arrays, measured={k: v[index] for k, v in self.measured.items()})


def read_machine_log(path: Path, columns: Path | None = None) -> MachineLog:
    """Read speed, crop flow and what the engine said.

    columns: map file (see swath.field_io.logs.columns). Raises InputError when the file is no log, or lacks
    speed, a crop flow, or every one of engine_load, engine_speed and fuel.
    """
    path = Path(path)
    table = read_table(path)
    found = find_columns(list(table.columns), path, columns, table.points is not None, needs=NEEDED)
    there = [key for key in MEASURED if key in found.columns]
    if len(table.row_number) < 2:
        raise InputError("log", len(table.row_number), "expected at least two whole rows", file=path)
    names, machine, notes = declared_machines(table, found)
    order, time, duration, gap = _clock(table, found, machine)
    keys = ("speed", "grain_flow", "header_width", "elevation", *there)
    values = {k: si_values_within(table, found, k, LIMITS)[order] for k in keys}
    flow = np.nan_to_num(values["grain_flow"])
    idle = not_working(table, found)
    if idle is not None:
        flow = np.where(idle[order], 0.0, flow)
    speed = np.nan_to_num(values["speed"])
    grade = _grade(values["elevation"], speed * duration, gap)
    measured = {k: values[k] for k in there}
    assumed = [c for k, c in found.columns.items() if k in keys and c.is_assumed and not c.of_format]
    notes += [f"{c.column}: unit taken as {c.unit}" for c in assumed]
    width = values["header_width"]
    return MachineLog(
        machine[order], time, duration, gap, speed, width, flow, grade, measured, names,
        (*table.notes, *notes), found,
    )  # fmt: skip


def _clock(
    table: Table, found: ColumnMap, machine: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array, Array, Mask]:
    """Order of the records by machine and time; then time, duration and gap in that order."""
    count = len(machine)
    clock, _ = usable(si_values_within(table, found, "time", LIMITS))
    logged = si_values(table, found, "duration")
    by_record = si_values(table, found, "record")
    key = by_record if np.isfinite(by_record).all() else np.arange(count, dtype=float)
    key = key if clock is None else clock
    order = np.lexsort((key, machine))
    other = np.diff(machine[order], prepend=-1) != 0
    if clock is not None:
        step = np.diff(clock[order], prepend=clock[order[:1]])
        gap = other | (step > LONGEST_STEP) | (step <= 0.0)
        time = clock[order] - clock.min()
        return order, time, np.where(gap, 1.0, step), gap
    step = np.clip(np.nan_to_num(logged[order], nan=1.0), 0.05, 1e5)
    gap = other | (step > LONGEST_STEP)
    return order, np.cumsum(step), np.where(gap, 1.0, step), gap


def _grade(height: Array, way: Array, gap: Mask) -> Array:
    """Rise over way across some records to either side, 0 where it is unknown or across a gap."""
    k = GRADE_RECORDS
    grade = np.zeros(len(height))
    if len(height) <= 2 * k:
        return grade
    travelled, block = np.cumsum(way), np.cumsum(gap)
    run, rise = travelled[2 * k :] - travelled[: -2 * k], height[2 * k :] - height[: -2 * k]
    is_known = (block[2 * k :] == block[: -2 * k]) & (run >= GRADE_WAY) & np.isfinite(rise)
    ratio = np.divide(rise, run, out=np.zeros_like(rise), where=is_known)
    grade[k:-k] = np.clip(ratio, -STEEPEST, STEEPEST)
    return grade
