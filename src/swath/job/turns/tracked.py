"""A planned turn as a machine with its steering drives it, in closed loop."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.job.drive import MARGIN, DrivenMachine, Follower
from swath.job.path import Path
from swath.job.turns import TurnLimits, limits_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of

Array = NDArray[np.float64]
STEP = 0.05  # s


@dataclass(frozen=True)
class DrivenTurn:
    """time [s], points (n, 2) [m] of the fixed axle, heading [rad], all of the same length."""

    time: Array
    points: Array
    heading: Array


def turn_limits(sheet: MachineSheet, radius: float, speed: float) -> TurnLimits:
    """Limits of a machine that turns at a radius [m] and a speed [m/s]."""
    return limits_of(sheet.wheelbase, radius, dynamics_of(sheet).steer_rate, speed)


def drive(sheet: MachineSheet, path: Path, radius: float, speed: float) -> DrivenTurn:
    """A path driven from its start at a constant speed [m/s]."""
    machine = DrivenMachine(sheet, path.start, STEP)
    machine.speed = speed
    follower = Follower(path, MARGIN / radius)
    rows = [(0.0, *machine.pose)]
    for i in range(int(4.0 * path.length / speed / STEP) + 100):
        machine.step(follower.curvature(machine), speed)
        rows.append(((i + 1) * STEP, *machine.pose))
        if follower.is_done:
            break
    table = np.array(rows)
    return DrivenTurn(table[:, 0], table[:, 1:3], table[:, 3])
