"""What the report needs from a run beside its files: some whole scans, and the field's picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from swath.core.frames import Pose
from swath.field.memory_layout import PAGE_NODES, PAGE_TILES, Solids
from swath.judge.referee import Referee
from swath.record.messages import RecordedMachine
from swath.signals import F64, CropEdge, MachineState, Scan, ScanTruth, Signal

SPACING_M = 2.0  # between kept scans at first; doubles whenever MOST are kept
MOST = 48


@dataclass(frozen=True)
class KeptScan:
    """A scan with what was true and what was detected at its time.

    points: echoes as the sensor believes them, in the machine frame by the nominal mounting [m], (n, 3)
    hits: the same echoes as they really were, in the world [m], (n, 3), empty when there is no truth
    pose: true pose_world_machine; edge_true: y at the edge's reference_x [m], nan = none
    """

    t: int
    distance: float
    pose: Pose
    points: F64
    hits: F64
    edge: CropEdge
    edge_true: float


class ScanKeeper:
    """Observer that keeps scans at even distances along the run, and always the newest.

    referee: must be called before the keeper. scanner: the lidar slot of the machine
    """

    def __init__(self, machine: RecordedMachine, referee: Referee, *, scanner: str = "lidar") -> None:
        self.machine, self.referee = machine, referee
        self._slot = f"{machine.name}.{scanner}"
        self._mounting = machine.mounting.get(scanner, Pose.identity())
        self._state: MachineState | None = None
        self._scan: Scan | None = None
        self._truth: ScanTruth | None = None
        self._newest: tuple[MachineState, Scan, ScanTruth | None, CropEdge, float] | None = None
        self._kept: list[KeptScan] = []
        self._spacing = SPACING_M

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        for signal in outputs.values():
            if slot == self._slot and isinstance(signal, Scan):
                self._scan = signal
            elif slot == self._slot and isinstance(signal, ScanTruth):
                self._truth = signal
            elif slot.partition(".")[0] == self.machine.name:
                if isinstance(signal, MachineState):
                    self._state = signal
                elif isinstance(signal, CropEdge) and self._state is not None and self._scan is not None:
                    truth = self.referee.true_offset
                    self._newest = (self._state, self._scan, self._truth, signal, truth)
                    self._keep_if_due()

    def pick(self, count: int = 4) -> list[KeptScan]:
        """`count` scans, spread evenly over the run, the newest last."""
        if self._newest is None:
            return []
        scans = [*self._kept, self._make()]
        picked = np.unique(np.round(np.linspace(0, len(scans) - 1, min(count, len(scans)))).astype(int))
        return [scans[i] for i in picked]

    def _keep_if_due(self) -> None:
        last = self._kept[-1].distance if self._kept else 0.0
        if self._newest is not None and self._newest[0].distance - last >= self._spacing:
            self._kept.append(self._make())
            if len(self._kept) > MOST:
                self._kept, self._spacing = self._kept[1::2], 2.0 * self._spacing

    def _make(self) -> KeptScan:
        assert self._newest is not None
        state, scan, truth, edge, true_offset = self._newest
        points = self._mounting.apply(scan.points().reshape(-1, 3))
        hits = np.zeros((0, 3)) if truth is None else truth.points.reshape(-1, 3)
        return KeptScan(
            state.t,
            state.distance,
            state.pose,
            points[np.isfinite(points[:, 0])],
            hits[np.isfinite(hits[:, 0])] if len(hits) else hits,
            edge,
            true_offset,
        )


class Standing(Protocol):
    """What the map asks of a field."""

    def standing(self, x: Any, y: Any) -> Any: ...


@dataclass(frozen=True)
class FieldMap:
    """The field seen from above, turned so that the run goes from left to right.

    origin: world point of the picture's (0, 0) [m]; turn: heading of the picture's x axis in the world [rad]
    extent: left, right, bottom, top [m] in picture coordinates; standing: (ny, nx) bool, row 0 at the bottom
    straw: (ny, nx) depth [m], or None
    """

    origin: F64
    turn: float
    extent: tuple[float, float, float, float]
    standing: np.ndarray
    straw: np.ndarray | None

    def place(self, xy: Any) -> F64:
        """World points [m], (..., 2), in picture coordinates."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        moved = np.asarray(xy, dtype=float)[..., :2] - self.origin
        return np.asarray(moved @ np.array([[c, -s], [s, c]]))


def make_map(
    field: Standing, path: F64, *, also: F64 | None = None, margin: float = 14.0, columns: int = 1400
) -> FieldMap:
    """Picture of the field around the path of the header's end, (n, 2) [m], from left to right.

    also: further points that must be on it, such as the path of the other end, (m, 2) [m]
    margin: of field shown on every side [m]; columns: of the raster
    """
    chord = path[-1] - path[0]
    turn = float(np.arctan2(chord[1], chord[0])) if np.hypot(*chord) > 1.0 else 0.0
    frame = FieldMap(path[0].copy(), turn, (0.0, 0.0, 0.0, 0.0), np.zeros((0, 0)), None)
    placed = frame.place(path if also is None else np.concatenate([path, also]))
    low, high = placed.min(axis=0) - margin, placed.max(axis=0) + margin
    cell = max(0.05, (high[0] - low[0]) / columns)
    u, v = np.arange(low[0] + cell / 2, high[0], cell), np.arange(low[1] + cell / 2, high[1], cell)
    grid_u, grid_v = np.meshgrid(u, v)
    x = frame.origin[0] + np.cos(turn) * grid_u - np.sin(turn) * grid_v
    y = frame.origin[1] + np.sin(turn) * grid_u + np.cos(turn) * grid_v
    depth = straw_depth(field, x, y) if hasattr(field, "pages") else None
    return FieldMap(
        frame.origin,
        turn,
        (float(low[0]), float(low[0] + cell * len(u)), float(low[1]), float(low[1] + cell * len(v))),
        np.asarray(field.standing(x, y), dtype=bool),
        depth,
    )


def straw_depth(field: Any, x: F64, y: F64) -> F64:
    """Depth of straw [m] at the lattice node next to world points, 0 where no page is in memory."""
    pages, node = field.pages, field.library.tile_size * PAGE_TILES / PAGE_NODES
    u, v = (np.floor(a / node + 0.5).astype(int) for a in field.to_stand(x, y))
    column, row = u // PAGE_NODES - pages.table_x, v // PAGE_NODES - pages.table_y
    inside = (column >= 0) & (column < pages.table.shape[1]) & (row >= 0) & (row < pages.table.shape[0])
    slot = np.where(inside, pages.table[np.where(inside, row, 0), np.where(inside, column, 0)], -1)
    depth = pages.straw[np.maximum(slot, 0), v % PAGE_NODES, u % PAGE_NODES]
    return np.where(slot >= 0, depth, 0.0).astype(float)


def circles_of(solids: Solids) -> list[tuple[float, float, float]]:
    """x, y, radius [m] of obstacles as a map shows them; a box by its longer horizontal half side."""
    centres = np.concatenate([solids.box_centre, 0.5 * (solids.capsule_a + solids.capsule_b),
                              solids.ellipsoid_centre, solids.mesh_centre])  # fmt: skip
    flat = [
        np.abs(axes[:2] * half).max() for axes, half in zip(solids.box_axes, solids.box_half, strict=True)
    ]
    round_ = [
        np.abs(axes[:2] * half).max()
        for axes, half in zip(solids.ellipsoid_axes, solids.ellipsoid_half, strict=True)
    ]
    nets = [
        float(np.hypot(*(mesh.corners.reshape(-1, 3) @ axes.T)[:, :2].T).max())
        for mesh, axes in zip(solids.mesh_shape, solids.mesh_axes, strict=True)
    ]
    radius = [*flat, *solids.capsule_radius, *round_, *nets]
    return [(float(c[0]), float(c[1]), float(r)) for c, r in zip(centres, radius, strict=True)]
