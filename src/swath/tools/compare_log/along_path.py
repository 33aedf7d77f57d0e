"""Runs a machine's steering and motion along a recorded log: its commands, its steering angle, its speed."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, cos, sin
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.field import Field
from swath.field.site_setup import SiteSetup
from swath.field_io.steer_log import SteerLog
from swath.machine.machine_sheet import MachineSheet
from swath.scenario.slots import REGISTRY
from swath.signals import SpeedCommand, SteerCommand, SteerState

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SETTLE = 3.0  # s: a stretch starts with wheels straight and tyres without slip, as the machine did not
WINDOW = 10.0  # s: positions are compared over such times, place and heading at their start left free
COARSEST = 0.05  # s between the steps of the motion


@dataclass(frozen=True)
class PathAlong:
    """Where the machine went on level ground: yaw_rate [rad/s], x, y of its fixed axle [m], yaw [rad]."""

    yaw_rate: Array
    x: Array
    y: Array
    yaw: Array


class _Level:
    """Flat ground; the machine's straw and grain are none."""

    def footprint(self, points: Any, *, groups: int) -> Any:
        """Ground height under groups of points: 0."""
        return SimpleNamespace(means=lambda x, y, yaw: [0.0] * groups)


def run_steering(machine: MachineSheet, log: SteerLog) -> Array:
    """Angle of the steered axle [rad] at every record, shape (n,), by the level `actuator`.

    A command holds from its record to the next one.
    """
    level = REGISTRY.get("steering", "actuator")
    steering = level.component(level.params(), _site(machine))
    clock = np.round(log.time * NS).astype(np.int64).tolist()
    command, starts = log.command.tolist(), log.starts.tolist()
    angle = np.empty(len(log))
    for i, begins in enumerate(starts):
        if begins:
            steering.reset(Stream(0, "log"))
            zero, before, angle[i] = clock[i], 0, 0.0
        else:
            t, given = clock[i] - zero, SteerCommand(before, command[i - 1], True)
            angle[i] = steering.step(before, t - before, {"command": given})["steering"].angle
            before = t
    return angle


def run_motion(machine: MachineSheet, log: SteerLog, angle: Array) -> PathAlong:
    """What the level `single_track` makes of a steering angle [rad], shape (n,), at the logged speed.

    Between records angle and speed go in straight lines.
    """
    level = REGISTRY.get("motion", "single_track")
    prompt = replace(machine.dynamics, speed_lag=0.01, accel=10.0, decel=10.0, max_speed=30.0)
    alone = replace(machine, dynamics=prompt, trailer=None, hitch=None)
    motion: Any = None
    clock, starts = np.round(log.time * NS).astype(np.int64).tolist(), log.starts.tolist()
    angles, speeds = angle.tolist(), log.speed.tolist()
    rows = np.zeros((len(log), 4))
    for i, begins in enumerate(starts):
        if begins:
            params = level.params(start_speed_kmh=3.6 * min(max(speeds[i], 0.0), 11.0))
            motion = level.component(params, _site(alone))
            state, zero, t = motion.reset(Stream(0, "log"))["state"], clock[i], 0
        else:
            end = clock[i] - zero
            count = max(1, round((end - t) / NS / COARSEST))
            edges = [t + (end - t) * k // count for k in range(count + 1)]
            for k, (a, b) in enumerate(pairwise(edges)):
                middle, last = (k + 0.5) / count, (k + 1) / count
                wheel = angles[i - 1] + middle * (angles[i] - angles[i - 1])
                speed = speeds[i - 1] + last * (speeds[i] - speeds[i - 1])
                given = {"steering": SteerState(a, wheel, 0.0), "speed": SpeedCommand(a, speed)}
                state = motion.step(a, b - a, given)["state"]
            t = end
        x, y, _ = state.pose.position
        rows[i] = state.yaw_rate, x, y, state.pose.euler()[2]
    return PathAlong(*rows.T)


def settled(log: SteerLog) -> Mask:
    """Records that count, shape (n,): SETTLE and more behind the start of their stretch."""
    start = np.maximum.accumulate(np.where(log.starts, log.time, -np.inf))
    return np.asarray(log.time - start >= SETTLE)


def windows(log: SteerLog) -> NDArray[np.int64]:
    """Number of the window over which positions are compared, shape (n,), -1 = not compared.

    Windows lie within one stretch and one block.
    """
    counts = settled(log) & np.isfinite(log.place).all(axis=1)
    first = np.r_[True, log.starts[1:] | (log.block[1:] != log.block[:-1])]
    start = np.maximum.accumulate(np.where(first, log.time, -np.inf))
    key = np.stack([np.cumsum(first), (log.time - start) // WINDOW], axis=1)[counts]
    number = np.full(len(log), -1, np.int64)
    if len(key):
        _, inverse, size = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        inverse = inverse.reshape(-1)
        number[counts] = np.where(size[inverse] >= 10, inverse, -1)
    return number


def off_the_track(path: PathAlong, log: SteerLog, window: NDArray[np.int64], antenna: Any) -> Array:
    """Simulated minus measured position of the antenna [m] in each window, shape (n, 2); 0 outside of them.

    Each window is moved and turned onto what was measured, by least squares (Umeyama 1991,
    doi:10.1109/34.88573, in the plane, without scale): neither place nor heading is known at its start.
    antenna: ahead of the fixed axle and leftward of it [m].
    """
    ahead, left = antenna
    c, s = np.cos(path.yaw), np.sin(path.yaw)
    made = np.stack([path.x + ahead * c - left * s, path.y + ahead * s + left * c], axis=1)
    error = np.zeros((len(log), 2))
    for rows in _rows_of(window):
        p, q = made[rows], log.place[rows]
        p, middle = p - p.mean(axis=0), q.mean(axis=0)
        q = q - middle
        turn = atan2(float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()), float((p * q).sum()))
        rotation = np.array([[cos(turn), -sin(turn)], [sin(turn), cos(turn)]])
        error[rows] = p @ rotation.T - q
    return error


def _rows_of(window: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    order = np.argsort(window, kind="stable")
    order = order[window[order] >= 0]
    return np.split(order, np.flatnonzero(np.diff(window[order])) + 1) if len(order) else []


def _site(machine: MachineSheet) -> SiteSetup:
    return SiteSetup(cast(Field, _Level()), machine, Pose.identity(), "left", 0.01)
