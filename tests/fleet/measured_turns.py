"""The 44 measured headland turns, and the same figures of turns in closed loop and of planned ones."""

import csv
import gzip
import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
import pytest

from swath.control.turns import clothoid, limits_of
from swath.control.turns.dubins import Place as Pose
from swath.control.turns.dubins import shortest
from swath.fleet.machines import PARAMS, Drive, Place, body_of
from swath.fleet.ways import driven, joined, rolled, straight, times_along
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import dynamics_of, load_machine
from tests import shared_data
from tests.fleet.turn_figures import TurnFigures, measure

DATA = shared_data.DATA / "headland_turns_msu2014"
PERIOD = 0.864  # s, of the records
ANTENNA = 1.9  # m ahead of the fixed axle, the front of the cab; the log does not say where
measured_or_skip = pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured turns: SWATH_DATA")
SHEET = load_machine("lexion-700")
KEYS = ("duration", "path", "depth", "excursion")
RUN = 30.0  # m straight before and after
STEP = 0.05  # s
MOST = 200.0  # s
PREVIEW = (4.0, 2.0)  # m, s: the greater of the two; these are the defaults of `steer: preview`
APPROACH = math.radians(12.0)


@dataclass(frozen=True)
class Turn:
    """One measured turn: its row of the summary, its track from 30 m before to 40 m behind."""

    row: dict
    time: np.ndarray
    points: np.ndarray

    @property
    def figures(self):
        """As stated in the summary."""
        r = self.row
        return TurnFigures(*(float(r[k]) for k in ("t_s", "path_m", "depth_m", "ymax_m")))


def rolling_turns():
    """The 40 turns that do not stop."""
    with (DATA / "headland_turns_summary_msu2014.csv").open() as stream:
        rows = [r for r in csv.DictReader(stream) if r["kind"] == "rolling"]
    with gzip.open(DATA / "headland_turns_tracks_msu2014.csv.gz", "rt") as stream:
        tracks = np.genfromtxt(stream, delimiter=",", names=True)
    found = []
    for row in rows:
        t = tracks[tracks["turn"] == int(row["turn"])]
        found.append(Turn(row, t["t_s"], np.stack([t["x_m"], t["y_m"]], axis=1)))
    return found


def medians(figures):
    return {k: float(np.median([getattr(f, k) for f in figures])) for k in KEYS}


def antenna_of(x, y, heading, ahead):
    """Track of a point `ahead` of the fixed axle [m], shifted back by as much, (n, 2)."""
    return np.column_stack([x + ahead * (np.cos(heading) - 1.0), y + ahead * np.sin(heading)])


def in_closed_loop(shift, radius, speed, antenna=ANTENNA):
    """Times and antenna of a machine at a constant speed [m/s] whose steering has dead time, lag and rate.

    From a pass along x onto the next, `shift` to the left [m], at a radius [m] until the law of
    `steer: preview` takes it on the next pass.
    """
    dynamics, base, ahead = dynamics_of(SHEET), SHEET.wheelbase, SHEET.knife_x
    late, rate = round(dynamics.steer_dead_time / STEP), dynamics.steer_rate
    servo = SpeedLoop(replace(dynamics, speed_lag=dynamics.steer_lag, accel=rate, decel=rate, max_speed=9.0))
    queue = deque([0.0] * late)
    preview = max(PREVIEW[0], PREVIEW[1] * speed)
    x, y, heading, angle = -RUN, 0.0, 0.0, 0.0
    rows = [(x, y, heading)]
    while len(rows) * STEP < MOST and not (heading > 2.0 and x < -RUN):
        wanted = 0.0
        if x >= 0.0 or heading > 0.5:
            way = speed * (late * STEP + dynamics.steer_lag)
            bend = math.tan(angle) / base * way
            knife = y + way * math.sin(heading + 0.5 * bend) + ahead * math.sin(heading + bend)
            aim = math.pi - min(max(math.atan((shift - knife) / preview), -APPROACH), APPROACH)
            off = min(max(aim - heading - bend, -1.2), 1.2)
            wanted = min(max(math.tan(off) / ahead, -1.0 / radius), 1.0 / radius)
        queue.append(min(max(math.atan(base * wanted), -SHEET.max_steer), SHEET.max_steer))
        angle, _ = servo.advance(angle, queue.popleft(), STEP)
        turn = speed * STEP * math.tan(angle) / base
        x += speed * STEP * math.cos(heading + 0.5 * turn)
        y += speed * STEP * math.sin(heading + 0.5 * turn)
        heading += turn
        rows.append((x, y, heading))
    return np.arange(len(rows)) * STEP, antenna_of(*np.array(rows).T, antenna)


def with_clothoids(shift, radius, speed, antenna=ANTENNA):
    """The same along `control.turns.clothoid`."""
    limits = limits_of(SHEET.wheelbase, radius, dynamics_of(SHEET).steer_rate, speed)
    pieces = [(0.0, RUN)]
    for length, first, last in clothoid.plan(Pose(0, 0, 0), Pose(0, shift, math.pi), limits):
        count = max(1, math.ceil(length / 0.25))
        middles = (np.arange(count) + 0.5) / count
        pieces += [(float(first + m * (last - first)), length / count) for m in middles]
    track = driven(Place(-RUN, 0.0, 0.0, 0.0), [*pieces, (0.0, RUN + 10.0)], body_of(SHEET))
    return track.distance / speed, antenna_of(*track.places.T[:3], antenna)


def rolled_through(shift, radius, speed, antenna=ANTENNA):
    """The same along `fleet.ways.rolled`, in the times that a fleet drives it."""
    dynamics, body = dynamics_of(SHEET), body_of(SHEET)
    steering = PARAMS.steered * dynamics.steer_rate / abs(SHEET.wheelbase)
    drive = Drive(radius, speed, speed, 0.0, dynamics.accel, PARAMS.shift_s, steering)
    start, goal = Place(0.0, 0.0, 0.0, 0.0), Place(0.0, shift, math.pi, math.pi)
    before = straight(Place(-RUN, 0.0, 0.0, 0.0), RUN, body)
    after = straight(goal, RUN + 10.0, body)
    track = joined([before, rolled(start, goal, drive, body), after])
    return times_along(track, drive), antenna_of(*track.places.T[:3], antenna)


def driven_by(made, turn, antenna=ANTENNA):
    """(figures, radius [m]) of a measured turn made anew, mean over eight moments of the first record. From
    the measured one come its shift, mean speed and sideways excursion, of which the radius is read off: its
    time, path and depth do not enter. made: one of those above
    """
    shift, speed = float(turn.row["shift_m"]), float(turn.row["vmean_m_s"])
    low, high = 5.5, 8.0
    for _ in range(9):
        radius = 0.5 * (low + high)
        time, points = made(shift, radius, speed, antenna)
        is_wider = points[:, 1].max() > turn.figures.excursion
        low, high = (low, radius) if is_wider else (radius, high)
    found = []
    for i in range(8):
        at = np.arange(i * PERIOD / 8, time[-1], PERIOD)
        found.append(measure(at, np.column_stack([np.interp(at, time, p) for p in points.T])))
    return TurnFigures(*(float(np.mean([getattr(f, k) for f in found])) for k in KEYS)), radius


def dubins_length(shift, radius):
    return math.fsum(size for _, size in shortest(Pose(0, 0, 0), Pose(0, shift, math.pi), radius))
