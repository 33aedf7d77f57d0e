"""Where echoes lie in the local frame of the grid that is being made."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.rays.height_grid import NODE_CELLS, NODES, TILE, lattice_height
from swath.signals import F64
from swath.tools.height_map.poses import PoseTrack
from swath.tools.height_map.source import Echoes, Source

TILES_MAX = 1 << 20  # the nodes of so many take some 700 MB
BATCH = 1 << 15  # echoes that are worked on at once


class Frame:
    """Local frame of the grid: x along the way, its corner below everything within reach.

    tiles: (ty, tx); width, length: cells along x, y; z0: world height of local z = 0 [m]
    """

    def __init__(self, track: PoseTrack, cell: float, reach: float) -> None:
        self.yaw, self.cell, self.z0 = track.heading, cell, 0.0
        self._c, self._s = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        path = track.position[:, :2] @ np.array([[self._c, -self._s], [self._s, self._c]])
        low = path.min(axis=0) - reach
        count = np.ceil((np.ptp(path, axis=0) + 2 * reach) / (TILE * cell))
        if not np.prod(count) <= TILES_MAX:
            raise InputError("poses", None, "expected a path within one region, or larger cells (--cell-m)")
        self.tiles = int(count[1]), int(count[0])
        self.origin = np.array([self._c * low[0] - self._s * low[1], self._s * low[0] + self._c * low[1]])
        self.width, self.length = self.tiles[1] * TILE, self.tiles[0] * TILE

    def lay(self, height: Callable[[F64, F64], F64]) -> F64:
        """Heights [m] of the ground at the nodes, over `z0`, which they set. height: at world points x, y."""
        base = height(*self.nodes())
        self.z0 = float(np.floor(base.min()))
        return np.asarray(base - self.z0)

    @property
    def node(self) -> float:
        """Spacing of the ground lattice [m]."""
        return self.cell * NODE_CELLS

    def to_local(self, points: F64) -> F64:
        """World points (n, 3) in the local frame."""
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        local = [self._c * x + self._s * y, self._c * y - self._s * x, points[:, 2] - self.z0]
        return np.stack(local, axis=1)

    def to_world(self, u: F64, v: F64) -> tuple[F64, F64]:
        """World x, y of local ones."""
        return self.origin[0] + self._c * u - self._s * v, self.origin[1] + self._s * u + self._c * v

    def nodes(self) -> tuple[F64, F64]:
        """World x, y of the lattice nodes, (ny, nx) each."""
        along = np.arange(self.tiles[1] * NODES + 1) * self.node
        return self.to_world(*np.meshgrid(along, np.arange(self.tiles[0] * NODES + 1) * self.node))


@dataclass(frozen=True)
class Placed:
    """Echoes in the local frame [m], those with a pose. points: (n, 3); height: above the lattice (n,).

    sensor: where each was seen from (n, 3), None when that is not known
    """

    points: F64
    height: F64
    sensor: F64 | None
    intensity: F64
    unknown_count: int


def placed(source: Source, echoes: Echoes, frame: Frame, lattice: F64) -> Placed:
    """Echoes at the place that the poses give them."""
    place, rotation, known = source.track.at(echoes.time)
    mounting = echoes.mounting or source.mounting
    if source.frame_is_world:
        points, sensor, known = echoes.points, None, np.ones(len(echoes.points), bool)
    else:
        points = place + np.einsum("nij,nj->ni", rotation, mounting.apply(echoes.points))
        sensor = frame.to_local((place + rotation @ mounting.position)[known])
    local = frame.to_local(points[known])
    height = local[:, 2] - lattice_height(lattice, frame.node, local[:, 0], local[:, 1])
    unknown = int(np.count_nonzero(~known))
    return Placed(local, height, sensor, echoes.intensity[known], unknown)


def left_above(source: Source, echoes: Echoes, frame: Frame, lattice: F64, top: float) -> Placed:
    """Beams without echo that got above everything, `top` over the ground [m], within the range known to be.

    Their ends are placed where they left the crop. Beams without echo that point at the ground are left out:
    nobody knows what became of them.
    """
    place, rotation, known = source.track.at(echoes.silent_time)
    mounting = echoes.mounting or source.mounting
    start = place + rotation @ mounting.position
    end = place + np.einsum("nij,nj->ni", rotation, mounting.apply(echoes.silent))
    rise = end[:, 2] - start[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (frame.z0 + float(lattice.max()) + top - start[:, 2]) / rise
    good = known & (rise > 0.0) & (part > 0.0) & (part <= 1.0)
    start, end = start[good], end[good]
    end = start + part[good, None] * (end - start)
    none = np.full(len(end), np.nan)
    return Placed(frame.to_local(end), none, frame.to_local(start), none, 0)


def batches(source: Source) -> Iterator[Echoes]:
    """All echoes of a source, several scans of a scanner at once."""
    waiting: dict[int, list[Echoes]] = {}
    for echoes in source.sweeps():
        held = waiting.setdefault(id(echoes.mounting), [])
        held.append(echoes)
        if sum(len(e.time) + len(e.silent) for e in held) >= BATCH:
            yield _joined(held)
            held.clear()
    yield from (_joined(held) for held in waiting.values() if held)


def _joined(held: list[Echoes]) -> Echoes:
    names = ("time", "points", "intensity", "silent", "silent_time")
    whole: dict[str, Any] = {name: np.concatenate([getattr(e, name) for e in held]) for name in names}
    whole |= {name: sum(getattr(e, name) for e in held) for name in ("silent_count", "scan_count")}
    return Echoes(**whole, mounting=held[0].mounting)
