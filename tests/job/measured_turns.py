"""The 44 measured headland turns, and the same figures of turns that are driven in closed loop."""

import csv
import gzip
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from swath.job.path import Pose
from swath.job.turns import dubins
from swath.job.turns.measure import TurnFigures, measure
from swath.job.turns.tracked import u_turn
from swath.machine.machine_sheet import load_machine

SHARED = Path(os.environ.get("SWATH_DATA", Path(__file__).parents[3] / "shared" / "data"))
DATA = SHARED / "headland_turns_msu2014"
PERIOD = 0.864  # s, of the records
ANTENNA = 1.9  # m ahead of the fixed axle, the front of the cab; the log does not say where
measured_or_skip = pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured turns: SWATH_DATA")
SHEET = load_machine("lexion-700")
KEYS = ("duration", "path", "depth", "excursion")


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


def driven(turn, antenna=ANTENNA):
    """(figures, radius [m]) of a measured turn driven in closed loop, mean over eight moments of the first
    record. From the measured one come its shift, mean speed and sideways excursion, of which the radius is
    read off: its time, path and depth do not enter.
    """
    shift, speed = float(turn.row["shift_m"]), float(turn.row["vmean_m_s"])
    low, high = 5.5, 8.0
    for _ in range(9):
        radius = 0.5 * (low + high)
        made = u_turn(SHEET, shift, radius, speed)
        is_wider = made.antenna(antenna)[:, 1].max() > turn.figures.excursion
        low, high = (low, radius) if is_wider else (radius, high)
    found = [measure(*made.records(PERIOD, i * PERIOD / 8, antenna)) for i in range(8)]
    return TurnFigures(*(float(np.mean([getattr(f, k) for f in found])) for k in KEYS)), radius


def dubins_length(shift, radius):
    return dubins.length(Pose(0, 0, 0), Pose(0, shift, np.pi), radius)
