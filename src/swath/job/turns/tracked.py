"""A turn as a machine with its steering drives it, in closed loop: onto the next pass, or along a plan."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.job.drive import MARGIN, DrivenMachine, Follower
from swath.job.path import Path, Pose
from swath.job.turns import TurnLimits, limits_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of

Array = NDArray[np.float64]
STEP = 0.05  # s
RUN = 30.0  # m straight before and after
MOST = 200.0  # s
PREVIEW = (4.0, 2.0)  # m, s: the greater of the two; these are the defaults of `steer: preview`
APPROACH = math.radians(12.0)


@dataclass(frozen=True)
class DrivenTurn:
    """time [s], points (n, 2) [m] of the fixed axle, heading [rad], all of the same length."""

    time: Array
    points: Array
    heading: Array

    def antenna(self, ahead: float) -> Array:
        """Track of a point `ahead` of the fixed axle [m], shifted back by as much, (n, 2)."""
        offset = np.stack([np.cos(self.heading) - 1.0, np.sin(self.heading)], axis=1)
        return self.points + ahead * offset

    def records(self, period: float, phase: float, ahead: float) -> tuple[Array, Array]:
        """Time [s] and antenna (n, 2) [m] as a log with a record each `period` [s] has them."""
        time = np.arange(phase, self.time[-1], period)
        track = self.antenna(ahead)
        x, y = np.interp(time, self.time, track[:, 0]), np.interp(time, self.time, track[:, 1])
        return time, np.stack([x, y], axis=1)


def turn_limits(sheet: MachineSheet, radius: float, speed: float) -> TurnLimits:
    """Limits of a machine that turns at a radius [m] and a speed [m/s]."""
    return limits_of(sheet.wheelbase, radius, dynamics_of(sheet).steer_rate, speed)


def u_turn(sheet: MachineSheet, shift: float, radius: float, speed: float) -> DrivenTurn:
    """From a pass along x onto the next, `shift` to the left [m]: steered round at a radius [m] until the
    guidance takes the machine on the next pass, at a constant speed [m/s].
    """
    machine = DrivenMachine(sheet, Pose(-RUN, 0.0, 0.0), STEP)
    machine.speed = speed
    rows = [(0.0, *machine.pose)]
    for i in range(int(MOST / STEP)):
        is_turning = machine.x >= 0.0 or machine.heading > 0.5
        machine.step(onto_line(machine, shift, radius) if is_turning else 0.0, speed)
        rows.append(((i + 1) * STEP, *machine.pose))
        if machine.heading > 2.0 and machine.x < -RUN:
            break
    table = np.array(rows)
    return DrivenTurn(table[:, 0], table[:, 1:3], table[:, 3])


def onto_line(machine: DrivenMachine, shift: float, radius: float) -> float:
    """Curvature [1/m] towards the pass at y = shift in direction -x: the law of `steer: preview` with its
    default parameters, held within that of the radius [m].

    The knife is aimed at the point of the pass the preview distance ahead, at the approach angle at most,
    from where the machine will be when the steering answers.
    """
    ahead = machine.sheet.knife_x
    way = machine.speed * machine.delay
    bend = machine.curvature * way
    heading = machine.heading + bend
    y = machine.y + way * math.sin(machine.heading + 0.5 * bend) + ahead * math.sin(heading)
    preview = max(PREVIEW[0], PREVIEW[1] * machine.speed)
    approach = min(max(math.atan((shift - y) / preview), -APPROACH), APPROACH)
    direction = math.pi - approach - heading
    wanted = math.tan(min(max(direction, -1.2), 1.2)) / ahead
    return min(max(wanted, -1.0 / radius), 1.0 / radius)


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
