"""The plan of a field: its passes in the order in which they are worked, each with the ground that it
cuts.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.control.job.crossings import Crossing
from swath.control.job.passes import Pass
from swath.core.errors import InputError, MissingExtra
from swath.job.path import Piece, Pose

Array = NDArray[np.float64]
KINDS = ("headland", "land")
FREE_SHARE = 0.9  # of a pass's length whose left side is cut before a cart may drive there


@dataclass(frozen=True)
class PlannedPass:
    """One pass. line: the middle of the header, in driving direction (n, 2) [m]; area: that it cuts [m2].

    kind: headland or land; round_index: of a headland round, from the boundary; land: number of the land
    cart_beside: True where the ground on the left, under the pipe, is cut before
    is_corner: True where the pass before ends in its corner, and the machine reverses to get round
    """

    line: Array
    kind: str = "land"
    round_index: int = 0
    land: int = 0
    area: float = 0.0
    cart_beside: bool = True
    is_corner: bool = False

    @property
    def length(self) -> float:
        """Length [m]."""
        steps = np.diff(self.line, axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    @property
    def start(self) -> Pose:
        """Where it begins."""
        (x, y), (u, v) = self.line[0].tolist(), self.line[1].tolist()
        return Pose(x, y, math.atan2(v - y, u - x))

    @property
    def end(self) -> Pose:
        """Where it ends."""
        (x, y), (u, v) = self.line[-2].tolist(), self.line[-1].tolist()
        return Pose(u, v, math.atan2(v - y, u - x))

    def at(self, distance: float) -> Pose:
        """The pose at a distance from the start [m]."""
        steps = np.diff(self.line, axis=0)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        i = min(int(np.searchsorted(way, distance, side="right")) - 1, len(steps) - 1)
        i = max(i, 0)
        share = (distance - way[i]) / max(way[i + 1] - way[i], 1e-9)
        x, y = (self.line[i] + share * steps[i]).tolist()
        dx, dy = steps[i].tolist()
        return Pose(x, y, math.atan2(dy, dx))

    def reversed(self) -> "PlannedPass":
        """The same, driven the other way."""
        return replace(self, line=self.line[::-1].copy())


@dataclass(frozen=True)
class FieldPlan:
    """boundary: ring (n, 2) [m]; passes in the order of working; width: between passes [m], of the header
    less the overlap; headland: width of the ground that the rounds cut [m]; area: of the field [m2].
    """

    boundary: Array
    passes: tuple[PlannedPass, ...]
    width: float
    headland: float
    area: float
    holes: tuple[Array, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def area_left(self) -> float:
        """Ground that no pass cuts [m2]."""
        return self.area - math.fsum(p.area for p in self.passes)


class Shared(NamedTuple):
    """Passes shared out among combines before the job, in the order in which they are begun. by: number of
    the combine of each; turns: pieces of the way of its fixed axle behind a pass, by the number of the pass,
    to the next one of the same combine; told: the passes as machines with sensors are told them, in a job in
    which carts drive up to the truck as there; crossings: where ways of combines meet then
    """

    plan: FieldPlan
    by: Sequence[int]
    turns: Mapping[int, Sequence[Piece]]
    told: Sequence[Pass] = ()
    crossings: Sequence[Crossing] = ()


def with_ground(
    passes: list[PlannedPass],
    boundary: Array,
    width: float,
    *,
    holes: tuple[Array, ...] = (),
    pipe: float = 8.0,
) -> tuple[PlannedPass, ...]:
    """Passes with the area that each cuts as the first, and whether its left side is cut before.

    width: of the header [m]; pipe: how far left of the middle a cart drives [m]. Headland sides reach as far
    as the boundary at their ends.
    """
    shapely = shapely_here()
    left = shapely.Polygon(boundary, holes)
    cut: list[Any] = []
    tree: list[tuple[float, float, float, float]] = []
    done = []
    for p in passes:
        line = shapely.LineString(p.line)
        strip = line.buffer(0.5 * width, cap_style="flat", join_style="mitre", mitre_limit=2.0)
        west, south, east, north = strip.bounds
        near = [
            c for c, (w, s, e, n) in zip(cut, tree, strict=True)
            if w < east and e > west and s < north and n > south
        ]  # fmt: skip
        own = strip.intersection(left)
        before = shapely.union_all(near) if near else shapely.Polygon()
        own = own.difference(before)
        track = line.parallel_offset(pipe, "left", join_style=2)
        free = track.intersection(before).length if track.length > 0.0 and near else 0.0
        beside = free >= FREE_SHARE * min(track.length, p.length)
        cut.append(strip)
        tree.append(strip.bounds)
        done.append(replace(p, area=float(own.area), cart_beside=bool(beside)))
    return tuple(done)


LARGEST, LONGEST = 4e6, 10e3  # m2 and m, of a field that is planned whole: it takes about half a minute


def shapely_here() -> Any:
    """The package shapely. Raises MissingExtra."""
    try:
        import shapely
        import shapely.affinity
        import shapely.ops
    except ImportError as error:
        raise MissingExtra("geo", "plans of fields") from error
    return shapely


def checked_ring(points: Any, key: str = "field.boundary_m") -> Array:
    """A boundary as a ring (n, 2) [m], not closed, counter-clockwise. Raises InputError."""
    shapely = shapely_here()
    ring = np.asarray(points, dtype=float)
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.isfinite(ring).all():
        raise InputError(key, None, "expected at least three points [x, y]")
    polygon = shapely.Polygon(ring)
    if not polygon.is_valid or polygon.area < 100.0:
        expected = "expected a ring that does not cross itself, of 100 m2 at least"
        raise InputError(key, f"{polygon.area:.0f} m2", expected)
    longest = float(np.ptp(ring, axis=0).max())
    if polygon.area > LARGEST or longest > LONGEST:
        size = f"{polygon.area / 1e4:.0f} ha, {longest / 1000.0:.1f} km long"
        expected = f"expected at most {LARGEST / 1e4:.0f} ha and {LONGEST / 1000.0:.0f} km"
        raise InputError(key, size, expected)
    ring = np.asarray(shapely.geometry.polygon.orient(polygon).exterior.coords)[:-1]
    return np.asarray(ring, dtype=float)
