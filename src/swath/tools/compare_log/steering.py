"""Compares steering and motion of a machine with a log of its steering angle, and fits them to it."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.documents.data_sheets import Sheet
from swath.documents.hints import near_miss
from swath.field_io.steer_log import SteerLog, read_steer_log
from swath.machine.machine_sheet import open_machine, read_machine
from swath.tools.compare_log.steering_fit import MOTION, STEERING, USUAL, PartFit, fit_motion, fit_steering


@dataclass(frozen=True)
class SteeringComparison:
    """The result. parts: steering, motion, as far as the log tells them; sheet: with the fitted numbers."""

    model: str
    log_name: str
    log: SteerLog
    parts: tuple[PartFit, ...]
    notes: tuple[str, ...]
    sheet: Sheet

    def to_dict(self) -> dict[str, Any]:
        """All but the series, for JSON."""
        series = ("measured", "before", "after")
        parts = {p.name: {k: v for k, v in asdict(p).items() if k not in series} for p in self.parts}
        return {"model": self.model, "log": self.log_name, "parts": parts, "notes": list(self.notes),
                **self.log.column_map.told()}  # fmt: skip


def compare_steering(
    model: str,
    log: Path,
    *,
    fit: Sequence[str] = (),
    on: str | None = None,
    antenna: tuple[float, float] = (0.0, 0.0),
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> SteeringComparison:
    """Fit a machine's steering to commands and angles, its motion to angles and yaw rates or positions.

    model: name or path of a machine's data sheet; fit: keys of it, instead of the usual ones
    on: `yaw_rate` or `place`, what the motion is fitted to; None = yaw rates where the log has them
    antenna: of the positions, ahead of the fixed axle and leftward [m]. Raises InputError.
    """
    sheet = open_machine(model)
    machine = read_machine(sheet)
    read = read_steer_log(log, columns, wheelbase=machine.wheelbase)
    for key in fit:
        if key not in {**STEERING, **MOTION}:
            known = (*STEERING, *MOTION)
            raise InputError("fit", key, f"expected one of {', '.join(known)}{near_miss(key, known)}")
    if on is not None and on not in read.measured:
        raise InputError("on", on, f"expected one that the log has: {', '.join(read.measured[1:]) or 'none'}")
    asked = {
        name: [k for k in free if k in fit] if fit else list(USUAL[name])
        for name, free in (("steering", STEERING), ("motion", MOTION))
    }
    parts, notes = [], list(read.notes)
    if read.has_command and asked["steering"]:
        progress("fitting the steering")
        sheet, part = fit_steering(sheet, read, asked["steering"])
        parts.append(part)
        if read.period > 0.03:
            late = f"{500.0 * read.period:.0f}"
            notes.append(
                f"commands are logged every {1e3 * read.period:.0f} ms and taken to hold until the next: "
                f"where they change in between, the dead time comes out up to {late} ms too long or short"
            )
    elif asked["steering"]:
        notes.append("the log has no commands: dead time, lag and rate of the steering are as they were")
    quantity = on or next(iter(read.measured[1:]), None)
    if quantity is not None and asked["motion"]:
        progress("fitting the motion")
        sheet, part = fit_motion(sheet, read, asked["motion"], quantity, antenna)
        parts.append(part)
    elif asked["motion"]:
        notes.append("the log has no yaw rate and no positions: the motion is as it was")
    if not parts:
        raise InputError("fit", ", ".join(fit), "expected numbers that this log determines")
    notes += [
        f"{f.key}: this log does not show it, left as it was"
        for p in parts
        for f in p.fitted
        if not f.is_seen
    ]
    return SteeringComparison(
        str(sheet.value("name")), Path(log).name, read, tuple(parts), tuple(notes), sheet
    )
