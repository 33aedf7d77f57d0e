"""What the report needs from a run beside its files: some whole scans, and the field's picture."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar

import numpy as np

from swath.core.blocks import Looker
from swath.core.frames import Pose
from swath.field.field import Field
from swath.field.memory_layout import PAGE_NODES, PAGE_TILES, Solids
from swath.judge.evaluator import is_among
from swath.record.message_factory import RecordedMachine
from swath.signals import F64, CropEdge, MachineState, Scan, ScanTruth, Signal

Ask = Callable[[], Any]
Item = TypeVar("Item")
SPACING_M = 2.0  # between kept scans at first; doubles whenever MOST are kept
MOST = 48
COLUMNS, BAND = 1400, 64  # of the raster of a map; rows of it that are looked up together


@dataclass(frozen=True)
class KeptScan:
    """A scan with what was true and what was detected at its time.

    slot: that scanned
    points: echoes as the sensor believes them, in the machine frame by the nominal mounting [m], (n, 3)
    hits: the same echoes as they really were, in the world [m], (n, 3), empty when there is no truth
    pose: true pose_world_machine
    edge: detected, None on a machine without edge detection
    edge_true: y at its reference_x [m], nan = none
    """

    slot: str
    t: int
    distance: float
    pose: Pose
    points: F64
    hits: F64
    edge: CropEdge | None
    edge_true: float


def spread_evenly(items: Sequence[Item], count: int) -> list[Item]:
    """So many of some items, spread evenly; one alone is the last."""
    places = np.linspace(len(items) - 1, 0, min(count, len(items)))
    return [items[i] for i in np.unique(np.round(places)).astype(int).tolist()]


@dataclass
class _Scanner:
    """What is kept of one scanner."""

    scan: Scan
    truth: ScanTruth | None = None
    newest: tuple[MachineState, Scan, ScanTruth | None, CropEdge | None] | None = None
    kept: list[KeptScan] = field(default_factory=list)
    spacing: float = SPACING_M


class Sampler:
    """Observer that is shown samples of some types alone. machine: whose; SEEN: these types."""

    machine: RecordedMachine
    SEEN: ClassVar[tuple[type[Signal], ...]]

    def lookers(self, slot: str, kinds: tuple[type[Signal], ...]) -> Sequence[Looker]:
        """Itself, where it wants samples of these types from a slot."""
        is_mine = slot.partition(".")[0] == self.machine.name and is_among(kinds, self.SEEN)
        return [Looker(self, self)] if is_mine else []  # type: ignore[arg-type]


class ScanSampler(Sampler):
    """Observer that keeps scans of every scanner of a machine at even distances, and always the newest.

    true_offset: gives y of the true edge for the newest detected one [m]; what it asks must be called before
    state: gives the newest `MachineState`, None before there is one
    """

    SEEN = (Scan, ScanTruth, CropEdge)

    def __init__(self, machine: RecordedMachine, true_offset: Ask, state: Ask) -> None:
        self.machine, self._true_offset, self._state = machine, true_offset, state
        self._has_edges = False
        self._scanners: dict[str, _Scanner] = {}

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        part = slot.partition(".")[2]
        for signal in outputs.values():
            if isinstance(signal, Scan):
                scanner = self._scanners.setdefault(part, _Scanner(signal))
                scanner.scan = signal
                if not self._has_edges:
                    self._see(part, scanner, None)
            elif isinstance(signal, ScanTruth) and part in self._scanners:
                self._scanners[part].truth = signal
            elif isinstance(signal, CropEdge):
                self._has_edges = True
                for own, scanner in self._scanners.items():
                    self._see(own, scanner, signal)

    @property
    def scanners(self) -> list[str]:
        """The slots that scanned."""
        return [slot for slot, scanner in self._scanners.items() if scanner.newest is not None]

    def pick(self, slot: str, count: int = 4) -> list[KeptScan]:
        """`count` scans of a slot, spread evenly over the run, the newest last."""
        scanner = self._scanners.get(slot)
        if scanner is None or scanner.newest is None:
            return []
        return spread_evenly([*scanner.kept, self._make(slot, scanner)], count)

    def _see(self, slot: str, scanner: _Scanner, edge: CropEdge | None) -> None:
        if (state := self._state()) is None:
            return
        scanner.newest = (state, scanner.scan, scanner.truth, edge)
        last = scanner.kept[-1].distance if scanner.kept else 0.0
        if state.distance - last >= scanner.spacing:
            scanner.kept.append(self._make(slot, scanner))
            if len(scanner.kept) > MOST:
                scanner.kept, scanner.spacing = scanner.kept[1::2], 2.0 * scanner.spacing

    def _make(self, slot: str, scanner: _Scanner) -> KeptScan:
        assert scanner.newest is not None
        state, scan, truth, edge = scanner.newest
        points = self.machine.mounting.get(slot, Pose.identity()).apply(scan.points().reshape(-1, 3))
        hits = np.zeros((0, 3)) if truth is None else truth.points.reshape(-1, 3)
        return KeptScan(
            slot,
            state.t,
            state.distance,
            state.pose,
            points[np.isfinite(points[:, 0])],
            hits[np.isfinite(hits[:, 0])] if len(hits) else hits,
            edge,
            self._true_offset(),
        )


@dataclass(frozen=True)
class FieldMap:
    """The field seen from above, turned so that the run goes from left to right.

    origin: world point of the picture's (0, 0) [m]
    turn: heading of the picture's x axis in the world [rad]
    extent: left, right, bottom, top [m] in picture coordinates
    standing: (ny, nx) bool, row 0 at the bottom
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


def make_map(ground: Field, path: F64, *, also: F64 | None = None, margin: float = 14.0) -> FieldMap:
    """Picture of the field around the path of the header's end, (n, 2) [m], from left to right.

    also: further points that must be on it, such as the paths of other ends, (m, 2) [m]
    margin: of field shown on every side [m]
    """
    chord = path[-1] - path[0]
    turn = float(np.arctan2(chord[1], chord[0])) if np.hypot(*chord) > 1.0 else 0.0
    frame = FieldMap(path[0].copy(), turn, (0.0, 0.0, 0.0, 0.0), np.zeros((0, 0)), None)
    placed = frame.place(path if also is None else np.concatenate([path, also]))
    low, high = placed.min(axis=0) - margin, placed.max(axis=0) + margin
    cell = max(0.05, (high[0] - low[0]) / COLUMNS)
    u, v = np.arange(low[0] + cell / 2, high[0], cell), np.arange(low[1] + cell / 2, high[1], cell)
    has_straw = hasattr(ground, "pages") and ground.pages.table.size > 0
    standing = np.zeros((len(v), len(u)), bool)
    depth = np.zeros(standing.shape) if has_straw else None
    for first in range(0, len(v), BAND):
        rows = slice(first, first + BAND)
        grid_u, grid_v = np.meshgrid(u, v[rows])
        x = frame.origin[0] + np.cos(turn) * grid_u - np.sin(turn) * grid_v
        y = frame.origin[1] + np.sin(turn) * grid_u + np.cos(turn) * grid_v
        standing[rows] = ground.standing(x, y)
        if depth is not None:
            depth[rows] = straw_depth(ground, x, y)
    return FieldMap(
        frame.origin,
        turn,
        (float(low[0]), float(low[0] + cell * len(u)), float(low[1]), float(low[1] + cell * len(v))),
        standing,
        depth,
    )


def straw_depth(ground: Any, x: F64, y: F64) -> F64:
    """Depth of straw [m] at the lattice node next to world points, 0 where no page is in memory."""
    pages, node = ground.pages, ground.library.tile_size * PAGE_TILES / PAGE_NODES
    u, v = (np.floor(a / node + 0.5).astype(int) for a in ground.to_stand(x, y))
    column, row = u // PAGE_NODES - pages.table_x, v // PAGE_NODES - pages.table_y
    inside = (column >= 0) & (column < pages.table.shape[1]) & (row >= 0) & (row < pages.table.shape[0])
    slot = np.where(inside, pages.table[np.where(inside, row, 0), np.where(inside, column, 0)], -1)
    depth = pages.straw[np.maximum(slot, 0), v % PAGE_NODES, u % PAGE_NODES]
    return np.where(slot >= 0, depth, 0.0).astype(float)


def circles_of(solids: Solids) -> list[tuple[float, float, float]]:
    """x, y, radius [m] of obstacles as a map shows them; a box by its longer horizontal half side."""
    centres = np.concatenate([solids.box_centre, 0.5 * (solids.capsule_a + solids.capsule_b),
                              solids.ellipsoid_centre, solids.mesh_centre])  # fmt: skip
    shapes = ((solids.box_axes, solids.box_half), (solids.ellipsoid_axes, solids.ellipsoid_half))
    flat, round_ = ([np.abs(a[:2] * h).max() for a, h in zip(*of, strict=True)] for of in shapes)
    nets = [
        float(np.hypot(*(mesh.corners.reshape(-1, 3) @ axes.T)[:, :2].T).max())
        for mesh, axes in zip(solids.mesh_shape, solids.mesh_axes, strict=True)
    ]
    radius = [*flat, *solids.capsule_radius, *round_, *nets]
    return [(float(c[0]), float(c[1]), float(r)) for c, r in zip(centres, radius, strict=True)]
