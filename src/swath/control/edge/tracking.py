"""Edge points of several scans, moved with the machine, become one robust line with a confidence.

The track coasts over short gaps with a falling confidence, gives up after `lost_s`, and takes a new edge only
after it was seen for a while: longer when the new edge lies beside the one it remembers (a notch in the crop,
a tramline, another pass).
"""

from dataclasses import dataclass

import numpy as np

from swath.control.edge.height_step import Step
from swath.control.edge.line_fit import Line, LineFit, Prior, fit_line
from swath.core.component import KeepsState
from swath.signals import F64

X, U, VARIANCE, QUALITY, AGE, IS_USED, SLOPE, COLUMNS = range(8)
SCANS_PER_SAMPLE = 8.0  # successive scans see the same stems: edge points per independent sample
LEVER = 1.2  # m, by which the place of an edge point in its scan is unsure along the assumed heading


@dataclass(frozen=True)
class Memory:
    """How a track remembers. Times [s], lengths [m].

    window: of travel whose points are fitted; window_s: and their greatest age; gate: lateral distance within
    which a point belongs to the edge; lost_s: without a point until the edge counts as lost; acquire_s: of
    consistent points until an edge counts as found; jump_s: the same when it lies beside the remembered one;
    forget_s: until a lost edge is forgotten; min_share: of scans that must show the edge
    """

    window: float = 7.5
    window_s: float = 6.0
    gate: float = 0.35
    lost_s: float = 0.4
    acquire_s: float = 0.2
    jump_s: float = 1.5
    forget_s: float = 4.0
    min_share: float = 0.6


class EdgeTrack(KeepsState):
    """The edge over time, in the (x, u) frame of the machine now."""

    kept = ("_rows", "line", "is_found", "_unseen")

    def __init__(self, memory: Memory, prior: Prior, x0: float, fit: LineFit = fit_line) -> None:
        self._memory, self._prior, self._x0, self._fit_line = memory, prior, x0, fit
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._rows: F64 = np.zeros((0, COLUMNS))
        self.line: Line | None = None
        self.is_found = False
        self._unseen = 0.0

    def move(self, distance: float, turn: float, dt: float, crab: float = 0.0) -> None:
        """The machine drove `distance` [m], turned `turn` [rad] toward +u, within `dt` [s].

        crab: its direction of travel toward +u of its heading [rad]
        """
        rows, course = self._rows, 0.5 * turn + crab
        x, u = rows[:, X] - distance * np.cos(course), rows[:, U] - distance * np.sin(course)
        cos, sin = np.cos(turn), np.sin(turn)
        rows[:, X], rows[:, U] = cos * x + sin * u, cos * u - sin * x
        rows[:, AGE] += dt
        rows[:, SLOPE] -= turn
        front = float(np.nanmax(rows[:, X])) if np.isfinite(rows[:, X]).any() else 0.0
        fresh = (rows[:, AGE] <= self._memory.window_s) & ~(rows[:, X] < front - self._memory.window)
        self._rows = rows[fresh]
        self._unseen += dt
        if self.line is not None:
            line = self.line.moved(distance, turn)
            self.line = line._replace(offset=line.offset - distance * crab)
            if self._unseen > self._memory.forget_s:
                self.line, self.is_found = None, False

    def update(self, step: Step | None) -> None:
        """Take the edge point of a new scan, or that it showed none."""
        row = np.full((1, COLUMNS), np.nan)
        row[0, AGE], row[0, IS_USED] = 0.0, 0.0
        if step is not None:
            row[0, :AGE] = step.x, step.u, step.variance, step.quality
            row[0, SLOPE] = 0.0 if self.line is None else self.line.slope_at(step.x)
            if self.is_found and self.line is not None:
                row[0, IS_USED] = float(abs(step.u - float(self.line.at(step.x))) < self._memory.gate)
        self._rows = np.concatenate([self._rows, row])
        if row[0, IS_USED] > 0.0:
            self._unseen = 0.0
            self._fit()
        elif self.is_found and self._unseen > self._memory.lost_s:
            self.is_found = False
            self._rows[:, IS_USED] = 0.0
        if not self.is_found:
            self._acquire()

    def confidence(self) -> float:
        """0..1: the share of the last half second's scans that show the edge, times their quality."""
        if not self.is_found:
            return 0.0
        recent = self._rows[self._rows[:, AGE] <= 0.5]
        used = recent[recent[:, IS_USED] > 0.0]
        if len(used) == 0:
            return 0.0
        share = len(used) / len(recent)
        fading = max(0.0, 1.0 - self._unseen / (self._memory.lost_s + 1e-9))
        return float(np.clip(share * used[:, QUALITY].mean() * fading, 0.01, 1.0))

    def _fit(self) -> None:
        used = self._rows[self._rows[:, IS_USED] > 0.0]
        slope = 0.0 if self.line is None else self.line.slope_at(used[:, X])
        variance = SCANS_PER_SAMPLE * used[:, VARIANCE] + (LEVER * (used[:, SLOPE] - slope)) ** 2
        self.line, _ = self._fit_line(used[:, X], used[:, U], variance, self._x0, self._prior, self.line)

    def _acquire(self) -> None:
        memory = self._memory
        if self._try(memory.acquire_s, near=self.line):
            return
        self._try(memory.acquire_s if self.line is None else memory.jump_s, near=None)

    def _try(self, span: float, near: Line | None) -> bool:
        """Found when enough scans of the last `span` [s] agree on one line (close to `near` if given)."""
        memory = self._memory
        recent = (self._rows[:, AGE] <= span + 1e-6) & np.isfinite(self._rows[:, X])
        asked = int((self._rows[:, AGE] <= span + 1e-6).sum())
        if self._unseen < span - 1e-6 and near is None:
            return False
        if float(self._rows[:, AGE].max()) < span - 1e-6 or recent.sum() < max(3, memory.min_share * asked):
            return False
        points = self._rows[recent]
        line, weight = self._fit_line(
            points[:, X], points[:, U], points[:, VARIANCE], self._x0, self._prior, near
        )
        reference = line if near is None else near
        agrees = (weight > 0.0) & (np.abs(points[:, U] - reference.at(points[:, X])) < memory.gate)
        if agrees.sum() < max(3, memory.min_share * asked):
            return False
        self._rows[:, IS_USED] = 0.0
        self._rows[np.flatnonzero(recent)[agrees], IS_USED] = 1.0
        self.is_found, self._unseen = True, 0.0
        self.line = line
        self._fit()
        return True
