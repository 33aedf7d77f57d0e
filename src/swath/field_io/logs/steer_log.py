"""How a machine was steered and where it went: logs with a steering angle and a yaw rate or positions.

Any log that `swath field import` reads (CSV, zipped point shapefile); columns by their usual names or a map.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.field_io.logs.clock import usable
from swath.field_io.logs.columns import Column, ColumnMap, guess, read_map, require
from swath.field_io.logs.log import si_values, si_values_within
from swath.field_io.logs.table import Table, read_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LIMITS = {"speed": (-3.0, 20.0), "steer_angle": (-80.0, 80.0), "steer_command": (-80.0, 80.0),
          "command_curvature": (-1.0, 1.0), "yaw_rate": (-2.0, 2.0)}  # fmt: skip
"""m/s, deg, deg, 1/m, rad/s. A value outside is missing."""
NEEDED = {
    **{key: ((key,),) for key in ("time", "speed", "steer_angle")},
    "yaw_rate, positions or steer_command": (
        ("yaw_rate",), ("lat", "lon"), ("easting", "northing"), ("steer_command",), ("command_curvature",),
    ),
}  # fmt: skip
SLOWEST_LOG = 0.25  # s between records: dead times and lags are tenths of a second
LEAST_SPEED = 0.3  # m/s: a machine at rest ends a stretch
LONGEST_STEP = 3.5  # usual steps of the log, at least half a second; a longer pause ends a stretch
WGS84_AXIS, WGS84_E2 = 6378137.0, 0.00669437999014  # m; squared eccentricity


@dataclass(frozen=True)
class SteerLog:
    """Records in the order of time; arrays have one entry per record, shape (n,), nan = not logged.

    time [s]; starts: does not follow the record before; block: number of its pass, or of its part of one
    speed [m/s]; command: wanted curvature of the path [1/m]; angle: measured, of the steered axle as one
    wheel [rad]; yaw_rate [rad/s], all > 0 left; place: of the antenna in a plane [m], shape (n, 2)
    measured: which of angle, yaw_rate, place the log has; period: usual time between records [s]
    """

    time: Array
    starts: Mask
    block: NDArray[np.int64]
    speed: Array
    command: Array
    angle: Array
    yaw_rate: Array
    place: Array
    measured: tuple[str, ...]
    period: float
    notes: tuple[str, ...]
    column_map: ColumnMap

    def __len__(self) -> int:
        return len(self.time)

    @property
    def has_command(self) -> bool:
        """Whether the log holds what was wanted of the steering."""
        return bool(np.isfinite(self.command).any())


def is_steer_log(path: Path, columns: Path | None = None) -> bool:
    """Whether a log has a steering angle and nothing of the engine."""
    path = Path(path)
    found = _find(read_table(path), path, columns).columns
    return "steer_angle" in found and not {"engine_load", "engine_speed", "fuel"} & found.keys()


def read_steer_log(
    path: Path, columns: Path | None = None, *, wheelbase: float = 4.0, longest_block: float = 20.0
) -> SteerLog:
    """Read time, speed, steering angle, and what the log has of command, yaw rate and positions.

    columns: map file (see swath.field_io.logs.columns); wheelbase [m]: makes wanted angles curvatures
    longest_block [s]: passes that last longer are cut into parts of that length
    Raises InputError when the file is no log, lacks one of them, or has less than four records per second.
    """
    path = Path(path)
    table = read_table(path)
    found = _find(table, path, columns)
    require(found.columns, list(table.columns), path, NEEDED)
    values = {key: si_values_within(table, found, key, LIMITS) for key in LIMITS}
    place = _place(table, found)
    time, note = usable(si_values(table, found, "time"))
    if time is None:
        raise InputError("log.time", None, f"expected a clock: {note}", file=path)
    command = np.where(
        np.isfinite(values["command_curvature"]), values["command_curvature"],
        np.tan(values["steer_command"] * DEG) / wheelbase,
    )  # fmt: skip
    engaged = si_values(table, found, "engaged")
    measured = [
        k for k, v in (("yaw_rate", values["yaw_rate"]), ("place", place[:, 0])) if np.isfinite(v).any()
    ]
    needed = np.isfinite(time) & np.isfinite(values["speed"]) & np.isfinite(values["steer_angle"])
    moving = needed & (values["speed"] > LEAST_SPEED) & ~(engaged == 0.0)
    if "command_curvature" in found.columns or "steer_command" in found.columns:
        moving &= np.isfinite(command)
    order = np.flatnonzero(moving)[np.argsort(time[moving], kind="stable")]
    if len(order) < 20:
        raise InputError(
            "log", len(order), "expected at least 20 records of a machine that drives", file=path
        )
    label = np.array(table.texts(found.columns["pass"].column)) if "pass" in found.columns else None
    log = SteerLog(
        time[order] - time[order[0]], np.zeros(len(order), bool), np.zeros(len(order), np.int64),
        values["speed"][order], command[order], values["steer_angle"][order] * DEG, values["yaw_rate"][order],
        place[order], ("angle", *measured), 0.0, (*table.notes, *([note] if note else [])), found,
    )  # fmt: skip
    return _in_blocks(log, None if label is None else label[order], longest_block, path)


def _in_blocks(log: SteerLog, label: Any, longest: float, path: Path) -> SteerLog:
    """Stretches without a pause, and passes, cut where they are long."""
    step = np.diff(log.time)
    period = float(np.median(step[step > 0.0])) if (step > 0.0).any() else 0.0
    if not 0.0 < period <= SLOWEST_LOG + 1e-9:
        expected = "expected at least four records per second: dead times and lags are tenths of a second"
        raise InputError("log.period_s", round(period, 3), expected, file=path)
    broken = (step <= 0.0) | (step > max(LONGEST_STEP * period, 0.5))
    if label is not None:
        broken |= label[1:] != label[:-1]
    starts = np.r_[True, broken]
    first = np.flatnonzero(starts)
    block, count = np.zeros(len(log), np.int64), 0
    for a, b in zip(first, [*first[1:], len(log)], strict=True):
        span = log.time[b - 1] - log.time[a]
        parts = max(1, round(span / longest))
        block[a:b] = count + np.minimum((log.time[a:b] - log.time[a]) * (parts / max(span, 1e-9)), parts - 1)
        count += parts
    return replace(log, starts=starts, block=block, period=period)


def _find(table: Table, path: Path, columns: Path | None) -> ColumnMap:
    header = list(table.columns)
    given, dropped, said = ({}, set(), {}) if columns is None else read_map(columns, header)
    taken = {c.column for c in given.values()}
    found = guess([name for name in header if name not in taken], path).columns
    bare = {name.lower().removesuffix("_m").removesuffix(" [m]"): name for name in header}
    if not {"lat", "easting"} & {*found, *given} and {"x", "y"} <= bare.keys():
        found |= {"easting": Column(bare["x"], "m"), "northing": Column(bare["y"], "m")}
    kept = {k: c for k, c in {**found, **given}.items() if k not in dropped}
    return ColumnMap(kept, "usual names", said.get("crs", ""), said.get("axes", ""), header=tuple(header))


def _place(table: Table, found: ColumnMap) -> Array:
    """Positions in a plane [m], shape (n, 2): as logged, or east and north of the first one."""
    if {"easting", "northing"} <= found.columns.keys():
        return np.stack([si_values(table, found, k) for k in ("easting", "northing")], axis=1)
    if not {"lat", "lon"} <= found.columns.keys():
        return np.full((len(table.row_number), 2), np.nan)
    lat, lon = (si_values(table, found, k) * DEG for k in ("lat", "lon"))
    known = np.isfinite(lat) & np.isfinite(lon)
    if not known.any():
        return np.full((len(lat), 2), np.nan)
    lat0, lon0 = float(lat[known][0]), float(lon[known][0])
    flat = 1.0 - WGS84_E2 * np.sin(lat0) ** 2
    north = WGS84_AXIS * (1.0 - WGS84_E2) / flat**1.5  # radii of curvature of the ellipsoid
    east = WGS84_AXIS / np.sqrt(flat) * np.cos(lat0)
    return np.stack([(lon - lon0) * east, (lat - lat0) * north], axis=1)
