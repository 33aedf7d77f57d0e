"""tracks.parquet: one row per moment and machine, at a fixed rate, with units in the column metadata.

A row at t holds, of every signal, the newest sample published up to the end of the tick at t.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.schedule import NS
from swath.record.messages import RecordedMachine
from swath.signals import (
    CropEdge,
    CropFlow,
    EngineState,
    Fix,
    HeaderState,
    Inertial,
    MachineLoad,
    MachineState,
    Odometry,
    Signal,
    SpeedCommand,
    SteerCommand,
    SteerState,
)

Latest = Mapping[type[Signal], Any]
NAN = float("nan")


@dataclass(frozen=True)
class Column:
    """A column. value: called with the newest sample of every type; unit as in the file; what it says."""

    name: str
    unit: str
    meaning: str
    value: Callable[[Latest], float]


def _of(kind: type[Signal], field: str) -> Callable[[Latest], float]:
    def value(latest: Latest) -> float:
        sample = latest.get(kind)
        return NAN if sample is None else float(getattr(sample, field))

    return value


def _pose(index: int) -> Callable[[Latest], float]:
    def value(latest: Latest) -> float:
        state: MachineState = latest[MachineState]
        return float(state.pose.position[index] if index < 3 else state.pose.euler()[index - 3])

    return value


def _knife_height(latest: Latest) -> float:
    sample: HeaderState | None = latest.get(HeaderState)
    return NAN if sample is None else float(sample.heights.mean())


def _seconds(kind: type[Signal]) -> Callable[[Latest], float]:
    return lambda latest: latest[kind].t / NS if kind in latest else NAN


COLUMNS = (
    Column("t_s", "s", "simulated time", _seconds(MachineState)),
    Column("x_m", "m", "east of the fixed axle's centre", _pose(0)),
    Column("y_m", "m", "north of it", _pose(1)),
    Column("z_m", "m", "height of it", _pose(2)),
    Column("roll_rad", "rad", "> 0 left side up", _pose(3)),
    Column("pitch_rad", "rad", "> 0 nose down", _pose(4)),
    Column("yaw_rad", "rad", "from east, > 0 left", _pose(5)),
    Column("speed_m_s", "m/s", "true forward speed", _of(MachineState, "speed")),
    Column("lateral_speed_m_s", "m/s", "true leftward speed", _of(MachineState, "lateral_speed")),
    Column("yaw_rate_rad_s", "rad/s", "true yaw rate", _of(MachineState, "yaw_rate")),
    Column("distance_m", "m", "travelled", _of(MachineState, "distance")),
    Column("steer_rad", "rad", "steered axle, > 0 turns left", _of(SteerState, "angle")),
    Column("command_curvature_1_m", "1/m", "wanted curvature, > 0 left", _of(SteerCommand, "curvature")),
    Column("engaged", "-", "1 while the automatic steers", _of(SteerCommand, "is_engaged")),
    Column("command_speed_m_s", "m/s", "wanted speed", _of(SpeedCommand, "speed")),
    Column("odometry_speed_m_s", "m/s", "measured speed", _of(Odometry, "speed")),
    Column("odometry_yaw_rate_rad_s", "rad/s", "measured yaw rate", _of(Odometry, "yaw_rate")),
    Column("edge_t_s", "s", "time the newest detected edge is valid for", _seconds(CropEdge)),
    Column("edge_offset_m", "m", "detected edge at edge_reference_m, > 0 left", _of(CropEdge, "offset")),
    Column("edge_heading_rad", "rad", "detected edge, > 0 bears left", _of(CropEdge, "heading")),
    Column("edge_reference_m", "m", "where ahead of the axle it holds", _of(CropEdge, "reference_x")),
    Column("edge_confidence", "-", "0 = no edge", _of(CropEdge, "confidence")),
    Column("header_fill", "-", "cut width / header width", _of(CropFlow, "header_fill")),
    Column("knife_height_m", "m", "mean height of the knife above the ground", _knife_height),
    Column("header_lift_rad", "rad", "> 0 raised", _of(HeaderState, "lift")),
    Column("header_tilt_rad", "rad", "against the machine, > 0 left side up", _of(HeaderState, "tilt")),
    Column("tank_grain_kg", "kg", "grain in the tank", _of(MachineLoad, "tank_grain")),
    Column("lost_grain_kg", "kg", "grain lost", _of(MachineLoad, "lost_grain")),
    Column("grain_flow_kg_s", "kg/s", "into the tank", _of(MachineLoad, "grain_flow")),
    Column("feeder_flow_kg_s", "kg/s", "grain and straw into the feeder", _of(MachineLoad, "feeder_flow")),
    Column("loss_share", "-", "grain lost, of the crop that leaves now", _of(MachineLoad, "loss_share")),
    Column("tank_level", "-", "filled share of the tank", _of(MachineLoad, "tank_level")),
    Column("engine_speed_rad_s", "rad/s", "engine speed", _of(EngineState, "speed")),
    Column("engine_load", "-", "torque asked / largest torque", _of(EngineState, "load")),
    Column("fuel_kg_s", "kg/s", "fuel burnt", _of(EngineState, "fuel")),
)

# Only of a machine that has the slot.
SENSOR_COLUMNS = {
    "gnss": (
        Column("fix_t_s", "s", "time the newest fix was measured", _seconds(Fix)),
        Column("fix_x_m", "m", "antenna as measured, east", _of(Fix, "x")),
        Column("fix_y_m", "m", "antenna as measured, north", _of(Fix, "y")),
        Column("fix_z_m", "m", "antenna as measured, height", _of(Fix, "z")),
        Column("fix_speed_m_s", "m/s", "measured speed over ground", _of(Fix, "speed")),
        Column("fix_quality", "-", "0 none, 1 single, 2 dgps, 3 float, 4 fix", _of(Fix, "quality")),
    ),
    "imu": tuple(
        Column(f"imu_{kind}_{axis}_{unit}", said, f"measured, {axis} axis", _of(Inertial, f"{kind}_{axis}"))
        for kind, unit, said in (("rate", "rad_s", "rad/s"), ("force", "m_s2", "m/s2"))
        for axis in "xyz"
    ),
}


def header_end_columns(machine: RecordedMachine) -> tuple[Column, Column]:
    """World position of the header end that follows the edge."""
    x, y = machine.geometry.header_end(machine.edge_side)

    def at(axis: int) -> Callable[[Latest], float]:
        return lambda latest: float(latest[MachineState].pose.apply([x, y, 0.0])[axis])

    side = machine.edge_side
    return (
        Column("header_end_x_m", "m", f"east of the header's {side} end", at(0)),
        Column("header_end_y_m", "m", f"north of the header's {side} end", at(1)),
    )


class Tracks:
    """Collects the rows of one machine.

    extra: further columns, e.g. what a referee knows; their `value` gets the newest samples too
    """

    def __init__(self, machine: RecordedMachine, period: int, extra: tuple[Column, ...] = ()) -> None:
        self.machine = machine
        sensors = [c for slot in machine.slots for c in SENSOR_COLUMNS.get(slot, ())]
        self.columns = (*COLUMNS, *header_end_columns(machine), *sensors, *extra)
        self._rows: list[list[float]] = []
        self._latest: dict[type[Signal], Any] = {}
        self._period, self._due, self._is_open = period, 0, False

    def take(self, t: int, signal: Signal) -> None:
        """Note a sample published at t [ns]."""
        if isinstance(signal, MachineState):
            self._finish_row()
            if t >= self._due:
                self._is_open = True
                self._due = (t // self._period + 1) * self._period
        self._latest[type(signal)] = signal

    def arrays(self) -> dict[str, np.ndarray]:
        """Columns so far, shape (row_count,) each."""
        self._finish_row()
        table = np.array(self._rows, dtype=float).reshape(-1, len(self.columns))
        return {c.name: table[:, i].copy() for i, c in enumerate(self.columns)}

    def _finish_row(self) -> None:
        if self._is_open and MachineState in self._latest:
            self._rows.append([c.value(self._latest) for c in self.columns])
            self._is_open = False


def write_tracks(path: Path, tracks: list[Tracks]) -> None:
    """Write the table of all machines in one go; a half-written file is never left behind."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    parts = [t.arrays() for t in tracks]
    columns: dict[str, Column] = {c.name: c for t in tracks for c in t.columns}
    names = [np.full(len(p["t_s"]), t.machine.name, dtype=object) for t, p in zip(tracks, parts, strict=True)]
    fields = [pa.field("machine", pa.string(), metadata={"unit": "-", "meaning": "name in the scenario"})]
    data: list[Any] = [pa.array(np.concatenate(names) if names else [], pa.string())]
    for name, column in columns.items():
        filled = [p.get(name, np.full(len(p["t_s"]), np.nan)) for p in parts]
        note = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(name, pa.float64(), metadata=note))
        data.append(pa.array(np.concatenate(filled)))
    about = {"format": "swath tracks 1", "units": json.dumps({n: c.unit for n, c in columns.items()})}
    part = path.with_suffix(".parquet.part")
    pq.write_table(pa.table(data, schema=pa.schema(fields, metadata=about)), part, compression="zstd")
    part.replace(path)


def read_tracks(path: Path) -> dict[str, np.ndarray]:
    """Columns of a tracks.parquet as arrays, `machine` as strings."""
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    return {name: table.column(name).to_numpy() for name in table.column_names}


def column_names() -> list[str]:
    """Names of all columns that tracks may have beside those of evaluators."""
    sensors = [c.name for columns in SENSOR_COLUMNS.values() for c in columns]
    return [*(c.name for c in COLUMNS), "header_end_x_m", "header_end_y_m", *sensors]
