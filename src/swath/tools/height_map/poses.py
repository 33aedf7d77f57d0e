"""Where a measuring sensor was: a table of poses over time."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import rotation_matrices, wrap_angle
from swath.signals import F64, Mask

SLACK_S = 0.1  # a beam may be this much before the first or after the last pose [s]
LATEST_S = 1e12  # beyond every clock: 30,000 years


@dataclass(frozen=True)
class PoseTrack:
    """Poses of a machine, sorted by time. time [s], (m,); position (m, 3) [m]; angle (m, 3): roll, pitch, yaw
    [rad], without jumps.
    """

    time: F64
    position: F64
    angle: F64

    def at(self, time: F64) -> tuple[F64, F64, Mask]:
        """Positions (n, 3), rotations (n, 3, 3) at times, linear in between, and where the track knows.

        Up to SLACK_S beyond its ends it goes on at the speed of the SLACK_S before.
        """
        known = (time >= self.time[0] - SLACK_S) & (time <= self.time[-1] + SLACK_S)
        rows = np.hstack([self.position, self.angle])
        inside = np.clip(time, self.time[0], self.time[-1])
        pose = _between(inside, self.time, rows)
        for end, inward in ((self.time[0], SLACK_S), (self.time[-1], -SLACK_S)):
            near = float(np.clip(end + inward, self.time[0], self.time[-1]))
            at_end, before = _between(np.array([end, near]), self.time, rows)
            beyond = np.where(inside == end, time - inside, 0.0)
            pose += beyond[:, None] * (at_end - before) / (end - near)
        return pose[:, :3], rotation_matrices(*pose[:, 3:].T), known

    @property
    def heading(self) -> float:
        """The direction that most of the way was driven in, taken as an axis without a sense [rad]."""
        step = np.diff(self.position[:, :2], axis=0)
        length = np.hypot(*step.T)
        if length.sum() < 0.05:
            return float(self.angle[0, 2])
        doubled = 2.0 * np.arctan2(step[:, 1], step[:, 0])
        return 0.5 * float(np.arctan2((length * np.sin(doubled)).sum(), (length * np.cos(doubled)).sum()))

    @property
    def length(self) -> float:
        """Way that was driven [m]."""
        return float(np.hypot(*np.diff(self.position[:, :2], axis=0).T).sum())


def _between(at: F64, time: F64, rows: F64) -> F64:
    """Columns of rows (m, k) at times, (n, k)."""
    return np.stack([np.interp(at, time, column) for column in rows.T], axis=1)


def make_track(time: Any, position: Any, angle: Any) -> PoseTrack:
    """A track from rows in any order. InputError when fewer than two of them are usable."""
    time = np.asarray(time, dtype=float).reshape(-1)
    position = np.asarray(position, dtype=float).reshape(-1, 3)
    angle = np.asarray(angle, dtype=float).reshape(-1, 3)
    good = np.isfinite(time) & np.isfinite(position).all(axis=1) & np.isfinite(angle).all(axis=1)
    good &= (np.abs(position) < 1e7).all(axis=1) & (np.abs(time) < LATEST_S)
    index = np.flatnonzero(good)
    index = index[np.unique(time[index], return_index=True)[1]]
    if len(index) < 2:
        raise InputError("poses", len(index), "expected at least two finite poses at different times")
    turn = angle[index]
    turn = turn[0] + np.cumsum(np.vstack([np.zeros(3), wrap_angle(np.diff(turn, axis=0))]), axis=0)
    return PoseTrack(time[index], position[index], turn)
