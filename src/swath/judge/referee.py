"""The referee: watches a machine with the truth of the field at hand, and judges it.

Signs: lateral and edge errors are > 0 towards the standing crop, < 0 towards the cut ground.
"""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from swath.core.frames import Pose, wrap_angle
from swath.judge.drivetrain import WorksWatch
from swath.judge.header import HeaderWatch
from swath.judge.metrics import SETTLING_M, balance_error, edge_metrics, lateral_metrics
from swath.record.messages import RecordedMachine
from swath.record.tracks import Column, Latest
from swath.signals import F64, CropEdge, CropFlow, MachineLoad, MachineState, Signal

SEARCH_M = 15.0  # how far to either side of the header end the initial edge is looked for
HALF_M = 1.5  # the true edge is looked for this far to either side of the initial edge
OUTSIDE_M = 1.0  # uncut crop counts this far beyond the initial edge, where teeth may stand
NODE_M = 0.5  # length of the strips in which uncut crop is counted
PATH_M = 0.02  # spacing of the stored path


class Edge(Protocol):
    """The initial edge as a curve."""

    def signed_distance(self, x: Any, y: Any) -> Any: ...


class Truth(Protocol):
    """What the referee asks of a field."""

    @property
    def nominal_edge(self) -> Edge: ...
    def edge_offset(self, start_xy: Any, end_xy: Any) -> float: ...
    def standing_area(self, polygon: Any) -> float: ...
    def recount(self) -> Any: ...


@dataclass(frozen=True)
class Series:
    """The course of a run, for pictures; arrays of equal length per group.

    Path group: t [s], distance [m], x, y of the header end in the world [m], lateral error [m].
    Edge group: edge_t [s], edge_distance [m], edge_true and edge_detected: y in the machine frame [m], nan =
    none; edge_error [m], > 0 towards the crop; found: an edge was reported
    """

    t: F64
    distance: F64
    x: F64
    y: F64
    lateral: F64
    edge_t: F64
    edge_distance: F64
    edge_true: F64
    edge_detected: F64
    edge_error: F64
    found: np.ndarray


class Referee:
    """Observer of a graph for one machine; call it with (slot, t, outputs).

    field: the truth (see `Truth`); machine: its name, data sheet and edge side
    overlap: how far the header end is meant to be out over the cut ground [m]
    """

    def __init__(self, field: Truth, machine: RecordedMachine, *, overlap: float) -> None:
        self.field, self.machine, self.overlap = field, machine, overlap
        self.side = 1.0 if machine.edge_side == "left" else -1.0  # +y or -y is the cut side
        self._end = np.array([*machine.geometry.header_end(machine.edge_side), 0.0])
        self._poses: list[MachineState] = []
        self._waiting: list[CropEdge] = []
        self._path: list[tuple[float, float, float, float]] = []
        self._edges: list[tuple[float, float, float, float, bool]] = []
        self._flow = {"grain": 0.0, "straw": 0.0, "area": 0.0}
        self._in_transit = {"grain": 0.0, "straw": 0.0}
        self._fill = [0.0, 0.0]
        self._load: MachineLoad | None = None
        self._drivetrain, self._header = WorksWatch(), HeaderWatch()
        self.true_offset, self.distance = float("nan"), 0.0

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        if slot.partition(".")[0] != self.machine.name:
            return
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._see_state(signal)
            elif isinstance(signal, CropEdge):
                self._waiting.append(signal)
            elif isinstance(signal, CropFlow):
                self._see_flow(signal)
            elif isinstance(signal, MachineLoad):
                self._load = signal
                self._in_transit = {"grain": 0.0, "straw": 0.0}
            self._drivetrain.see(signal, self.distance)
            self._header.see(signal, self.distance)
        self._judge_edges()

    def columns(self) -> tuple[Column, ...]:
        """Columns for the tracks. The referee must be called before the recorder."""

        def lateral(latest: Latest) -> float:
            return float(self.lateral_error(latest[MachineState].pose))

        return (
            Column("edge_true_m", "m", "true edge at edge_reference_m, > 0 left", lambda _: self.true_offset),
            Column("lateral_error_m", "m", "header end, > 0 towards the standing crop", lateral),
        )

    def lateral_error(self, pose: Pose) -> float:
        """Distance of the header end from where it should be, beside the initial edge [m]."""
        x, y, _ = pose.apply(self._end)
        return float(self.field.nominal_edge.signed_distance(x, y)) + self.overlap

    def find_edge(self, pose: Pose, reference_x: float) -> float:
        """y of the true edge at x = reference_x in the machine frame [m], nan = there is none.

        A segment across the initial edge is laid through the field, HALF_M to either side of it, and the
        field says where along it bare or cut ground turns into standing crop.
        """
        y = self._end[1] + np.linspace(-SEARCH_M, SEARCH_M, 121)
        points = pose.apply(np.stack([np.full_like(y, reference_x), y, np.zeros_like(y)], axis=1))
        depth = np.asarray(self.field.nominal_edge.signed_distance(points[:, 0], points[:, 1]), dtype=float)
        crossing = np.nonzero((depth[:-1] > 0) != (depth[1:] > 0))[0]
        if len(crossing) == 0:
            return float("nan")
        k = crossing[np.argmin(np.abs(y[crossing] - self._end[1]))]
        middle = y[k] - depth[k] * (y[k + 1] - y[k]) / (depth[k + 1] - depth[k])
        cut_end, crop_end = middle + self.side * HALF_M, middle - self.side * HALF_M
        ends = pose.apply([[reference_x, cut_end, 0.0], [reference_x, crop_end, 0.0]])[:, :2]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = self.field.edge_offset(ends[0], ends[1]) / length
        return float(cut_end + along * (crop_end - cut_end))

    def series(self) -> Series:
        """The course of the run so far."""
        t, distance, x, y = np.array(self._path, dtype=float).reshape(-1, 4).T
        lateral = self._signed_distance(x, y) + self.overlap
        edge_t, at, true, seen, found = np.array(self._edges, dtype=float).reshape(-1, 5).T
        error = -self.side * (seen - true)
        return Series(t, distance, x, y, lateral, edge_t, at, true, seen, error, found > 0)

    def metrics(self) -> dict[str, float]:
        """Everything that can be said from watching; nan where there was nothing to judge."""
        s = self.series()
        return {
            **edge_metrics(s.edge_error, np.isfinite(s.edge_true), s.found),
            **lateral_metrics(s.distance, s.lateral),
            "header_use": self._fill[0] / self._fill[1] if self._fill[1] > 0 else float("nan"),
            "uncut_area_m2": self.uncut_area(),
            "area_cut_m2": self._flow["area"],
            "grain_cut_kg": self._flow["grain"],
            "mass_balance_error": mass_balance_error(self.field, [self]),
            **self._drivetrain.metrics(),
            **self._header.metrics(),
            "distance_m": self.distance,
        }

    def uncut_area(self) -> float:
        """Standing crop on the cut side of the header end's path [m2].

        Up to OUTSIDE_M beyond the initial edge.
        """
        _, distance, x, y = np.array(self._path, dtype=float).reshape(-1, 4).T
        if len(distance) < 2 or distance[-1] - distance[0] < NODE_M:
            return 0.0
        at = np.append(np.arange(distance[0], distance[-1], NODE_M), distance[-1])
        px, py = np.interp(at, distance, x), np.interp(at, distance, y)
        depth = np.maximum(self._signed_distance(px, py), 0.0) + OUTSIDE_M
        heading = np.arctan2(np.gradient(py), np.gradient(px))
        outer_x = px - self.side * np.sin(heading) * depth
        outer_y = py + self.side * np.cos(heading) * depth
        inner, outer = np.stack([px, py], axis=1), np.stack([outer_x, outer_y], axis=1)
        area = 0.0
        for i in range(len(at) - 1):
            area += self.field.standing_area(np.array([inner[i], inner[i + 1], outer[i + 1]]))
            area += self.field.standing_area(np.array([inner[i], outer[i + 1], outer[i]]))
        return area

    def accounted(self) -> tuple[float, float]:
        """Grain and straw [kg] cut by this machine that its parts and the ground behind it hold."""
        grain = self._in_transit["grain"] + self._header.lost_grain
        straw = self._in_transit["straw"]
        if (load := self._load) is not None:
            grain += load.tank_grain + load.lost_grain + load.held_grain
            straw += load.dropped_straw + load.held_straw
        return grain, straw

    def _see_state(self, state: MachineState) -> None:
        self._poses.append(state)
        if len(self._poses) > 512:
            del self._poses[:256]
        self.distance = state.distance
        if not self._path or state.distance - self._path[-1][1] >= PATH_M:
            x, y, _ = state.pose.apply(self._end)
            self._path.append((state.t * 1e-9, state.distance, float(x), float(y)))

    def _see_flow(self, flow: CropFlow) -> None:
        for name in self._flow:
            self._flow[name] += getattr(flow, name)
        for name in self._in_transit:
            self._in_transit[name] += getattr(flow, name)
        if self.distance >= SETTLING_M:
            self._fill[0] += flow.header_fill * flow.dt
            self._fill[1] += flow.dt

    def _judge_edges(self) -> None:
        """Judge the edges whose time the truth has reached."""
        while self._waiting and self._poses and self._waiting[0].t <= self._poses[-1].t:
            edge = self._waiting.pop(0)
            pose, distance = self._at(edge.t)
            self.true_offset = self.find_edge(pose, edge.reference_x)
            seen = edge.offset if edge.is_found else float("nan")
            self._edges.append((edge.t * 1e-9, distance, self.true_offset, seen, edge.is_found))

    def _at(self, t: int) -> tuple[Pose, float]:
        """True pose and distance at t [ns]; position and angles are interpolated between samples."""
        after = min(bisect_left(self._poses, t, key=lambda s: s.t), len(self._poses) - 1)
        b = self._poses[after]
        if b.t == t or after == 0:
            return b.pose, b.distance
        a = self._poses[after - 1]
        share = (t - a.t) / (b.t - a.t)
        start, end = np.array(a.pose.euler()), np.array(b.pose.euler())
        roll, pitch, yaw = start + share * wrap_angle(end - start)
        position = a.pose.position + share * (b.pose.position - a.pose.position)
        return Pose.from_euler(position, roll, pitch, yaw), a.distance + share * (b.distance - a.distance)

    def _signed_distance(self, x: F64, y: F64) -> F64:
        return np.asarray(self.field.nominal_edge.signed_distance(x, y), dtype=float)


def mass_balance_error(field: Truth, referees: Sequence[Referee]) -> float:
    """The worse of grain and straw: what the field misses against what its machines account for, relative."""
    missing = field.recount()
    held = [r.accounted() for r in referees]
    grain = balance_error(float(missing.grain), sum(h[0] for h in held))
    return max(grain, balance_error(float(missing.straw), sum(h[1] for h in held)))
