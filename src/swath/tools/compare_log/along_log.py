"""Runs a machine's process and powertrain along a recorded log: its speed, its crop, its slope."""

from dataclasses import dataclass, replace
from math import atan, cos, sin
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.field import Field
from swath.field.site_setup import SiteSetup
from swath.field_io.machine_log import MachineLog
from swath.judge.evaluators.drivetrain import DIESEL
from swath.machine.drivetrain_sheet import Drivetrain, drivetrain_of
from swath.machine.machine_sheet import MachineSheet
from swath.scenario.slots import REGISTRY
from swath.signals import CropFlow, MachineLoad, MachineState

Array = NDArray[np.float64]
TANK = 0.5  # of the tank is full all the time: logs do not say when it was emptied


@dataclass(frozen=True)
class Drive:
    """How a log is driven along.

    process, engine: levels; straw: per grain, by mass; whole_crop: the logged flow is all of the crop, as in
    a forage harvester, none of it grain
    load_over: what the measured load is a share of: the torque that the engine could give at its present
    speed (`present`), or the largest that it can give at any (`largest`)
    friction: measured load of an engine that gives no torque; flow_floor: logged flow without crop [kg/s]
    """

    process: str = "threshing"
    engine: str = "ideal"
    straw: float = 0.65
    whole_crop: bool = False
    load_over: Literal["present", "largest"] = "present"
    friction: float = 0.0
    flow_floor: float = 0.0


class _Ground:
    """Takes the straw and forgets it: a log has no field."""

    def deposit_straw(self, polygon: Any, mass: float, /, *, heading: float | None = None) -> None:
        """Nothing to do."""


def run_process(machine: MachineSheet, log: MachineLog, drive: Drive) -> list[MachineLoad]:
    """Where the crop is, at every record. The crop of a record went in evenly since the one before."""
    level = REGISTRY.get("process", drive.process)
    has_outlet = "straw" in level.params.__dataclass_fields__
    params = level.params(straw="chop") if has_outlet else level.params()
    loads: list[MachineLoad] = []
    grain = 0.0 if drive.whole_crop else 1.0
    straw = 1.0 if drive.whole_crop else drive.straw
    process = level.component(params, _site(machine))
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
) -> dict[str, Array]:
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
            engine = level.component(level.params(), _site(own))
            engine.reset(Stream(0, "log"))
        load = replace(loads[i], t=t + dt, tank_grain=grain)
        e = engine.step(t, dt, {"state": _state(t + dt, speed, grade), "load": load})["engine"]
        rows[i] = e.load, e.speed, e.power, e.fuel
    share, turning, power, fuel = rows.T
    if drive.load_over == "largest":
        share = power / turning / _largest_torque(drivetrain)
    share = drive.friction + (1.0 - drive.friction) * share
    return {"engine_load": share, "engine_speed": turning, "fuel": fuel / (1e3 * DIESEL)}


def _largest_torque(drivetrain: Drivetrain) -> float:
    e = drivetrain.engine
    return (1.0 + e.torque_rise) * e.rated_power / e.rated_speed


def _width(log: MachineLog, machine: int, default: float) -> float:
    widths = log.width[(log.machine == machine) & np.isfinite(log.width)]
    return float(np.median(widths)) if len(widths) else default


def _site(machine: MachineSheet) -> SiteSetup:
    return SiteSetup(cast(Field, _Ground()), machine, Pose.identity(), "left", 1.0)


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
