"""The detected crop edge against the one that stands in the field."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose, wrap_angle
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.judge.statistics import mean, rms
from swath.record.tracks import Column
from swath.signals import F64, CropEdge, MachineState, Signal

GROUP = "Edge detection"
SEARCH_M = 15.0  # how far to either side of the header end the initial edge is looked for
HALF_M = 1.5  # the true edge is looked for this far to either side of the initial edge


@dataclass(frozen=True)
class EdgeSeries:
    """The course of a run, arrays of shape (n,): t [s], distance [m].

    true, detected: y in the machine frame at the detector's reference [m], nan = none; error: detected minus
    true [m], > 0 towards the crop; found: an edge was reported
    """

    t: F64
    distance: F64
    true: F64
    detected: F64
    error: F64
    found: NDArray[np.bool_]


class EdgeDetection:
    """Detected against true edge, at the place ahead that the detector reports for.

    true_offset: of the newest judged sample, y in the machine frame [m], nan = there is no true edge
    """

    OF_FIELD = False
    SIGNALS = (MachineState, CropEdge)
    COLUMNS = ("edge_true_m",)
    METRICS = (
        Metric("edge_rmse_m", "m", "detected against true edge, root mean square", GROUP,
               "lower", "edge error, RMS", "cm"),
        Metric("edge_bias_m", "m", "detected minus true edge, mean; > 0 towards the standing crop", GROUP,
               "", "edge error, mean", "cm"),
        Metric("detection_availability", "1", "share of edge samples with an edge, where a true edge exists",
               GROUP, "higher", "availability", "%", 1),
        Metric("false_edge_share", "1", "share of edge samples with an edge, where no true edge exists",
               GROUP, "lower", "edges reported where none is", "%", 1),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0  # +y or -y is the cut side
        self._end_y = setup.machine.geometry.header_end(setup.machine.edge_side)[1]
        self._states: list[MachineState] = []
        self._waiting: list[CropEdge] = []
        self._rows: list[tuple[float, float, float, float, bool]] = []
        self.true_offset = float("nan")

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Judge the edges whose time the truth has reached."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._states.append(signal)
                if len(self._states) > 512:
                    del self._states[:256]
            elif isinstance(signal, CropEdge):
                self._waiting.append(signal)
        while self._waiting and self._states and self._waiting[0].t <= self._states[-1].t:
            self._judge(self._waiting.pop(0))

    def metrics(self) -> dict[str, float]:
        """Of all edges; nothing of a machine without an edge detection."""
        if not self._rows and not self._waiting:
            return {}
        series = self.series()
        return edge_metrics(series.error, np.isfinite(series.true), series.found)

    def columns(self) -> tuple[Column, ...]:
        """The true edge, for the newest detected one."""
        meaning = "true edge at edge_reference_m, > 0 left"
        return (Column("edge_true_m", "m", meaning, lambda _: self.true_offset),)

    def series(self) -> EdgeSeries:
        """The course of the run so far."""
        t, at, true, seen, found = np.array(self._rows, dtype=float).reshape(-1, 5).T
        return EdgeSeries(t, at, true, seen, -self.side * (seen - true), found > 0)

    def find_edge(self, pose: Pose, reference_x: float) -> float:
        """y of the true edge at x = reference_x in the machine frame [m], nan = there is none.

        A segment across the initial edge is laid through the field, HALF_M to either side of it, and the
        field says where along it bare or cut ground turns into standing crop.
        """
        y = self._end_y + np.linspace(-SEARCH_M, SEARCH_M, 121)
        points = pose.apply(np.stack([np.full_like(y, reference_x), y, np.zeros_like(y)], axis=1))
        depth = np.asarray(self.setup.edge.signed_distance(points[:, 0], points[:, 1]), dtype=float)
        crossing = np.nonzero((depth[:-1] > 0) != (depth[1:] > 0))[0]
        if len(crossing) == 0:
            return float("nan")
        k = crossing[np.argmin(np.abs(y[crossing] - self._end_y))]
        middle = y[k] - depth[k] * (y[k + 1] - y[k]) / (depth[k + 1] - depth[k])
        cut_end, crop_end = middle + self.side * HALF_M, middle - self.side * HALF_M
        ends = pose.apply([[reference_x, cut_end, 0.0], [reference_x, crop_end, 0.0]])[:, :2]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = self.setup.field.edge_offset(ends[0], ends[1]) / length
        return float(cut_end + along * (crop_end - cut_end))

    def _judge(self, edge: CropEdge) -> None:
        pose, distance = self._at(edge.t)
        self.true_offset = self.find_edge(pose, edge.reference_x)
        seen = edge.offset if edge.is_found else float("nan")
        self._rows.append((edge.t * 1e-9, distance, self.true_offset, seen, edge.is_found))

    def _at(self, t: int) -> tuple[Pose, float]:
        """True pose and distance at t [ns]; position and angles are interpolated between samples."""
        after = min(bisect_left(self._states, t, key=lambda s: s.t), len(self._states) - 1)
        b = self._states[after]
        if b.t == t or after == 0:
            return b.pose, b.distance
        a = self._states[after - 1]
        share = (t - a.t) / (b.t - a.t)
        start, end = np.array(a.pose.euler()), np.array(b.pose.euler())
        roll, pitch, yaw = start + share * wrap_angle(end - start)
        position = a.pose.position + share * (b.pose.position - a.pose.position)
        return Pose.from_euler(position, roll, pitch, yaw), a.distance + share * (b.distance - a.distance)


def edge_metrics(error: F64, exists: NDArray[np.bool_], found: NDArray[np.bool_]) -> dict[str, float]:
    """Quality of an edge detection.

    error: detected minus true [m], > 0 towards the crop, nan where either is missing; exists: there was a
    true edge; found: an edge was reported; all of shape (n,)
    """
    good = error[np.isfinite(error) & exists & found]
    return {
        "edge_rmse_m": rms(good),
        "edge_bias_m": mean(good),
        "detection_availability": mean(found[exists].astype(float)),
        "false_edge_share": mean(found[~exists].astype(float)),
    }


LEVEL = Level(EdgeDetection, None, summary="the detected edge against the one that stands in the field")
