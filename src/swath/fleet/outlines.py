"""Outlines with few points, the same however a file lists them.

They are looked at from the truck towards the middle of the field, with pipes on the left. There points are
left out that lie within a tolerance of the lines between those that stay, those that bend it least first;
then all sides are moved out or in alike until the area is what it was. So neither the point that a ring
begins with, nor its direction, nor points on its sides, nor the order of rings, nor how the field lies on the
map changes anything.
"""

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.fleet.files import JobFile

Array = NDArray[np.float64]
TOLERANCE = 0.3  # m, about what an outline driven with a receiver is off
STRAIGHT = 1e-3  # m off the line between its neighbours, within which a point says nothing
GRAIN = 1e-4  # m, that places in a frame are rounded to, so that turning a field changes no decision
ROUNDS = 3  # of moving sides until the area is what it was
LEAST_M2 = 1.0  # of an outline


@dataclass(frozen=True)
class Frame:
    """From the map to the field: origin [m], direction of the x axis [rad]; side: -1 where the y axis of the
    map is turned round before, so that pipes on the right are on the left.
    """

    x: float
    y: float
    direction: float
    side: float = 1.0

    def to_field(self, points: Any) -> Array:
        """Points (n, 2) of the map in the field's frame, rounded."""
        c, s = math.cos(self.direction), math.sin(self.direction)
        d = np.asarray(points, float) * (1.0, self.side) - (self.x, self.y)
        return (
            np.round(np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]]) / GRAIN) * GRAIN
        )

    def to_map(self, points: Any) -> Array:
        """Points (n, 2) of the frame on the map."""
        c, s = math.cos(self.direction), math.sin(self.direction)
        p = np.asarray(points, float)
        y = self.y + s * p[:, 0] + c * p[:, 1]
        return np.column_stack([self.x + c * p[:, 0] - s * p[:, 1], self.side * y])


@dataclass(frozen=True)
class Outlines:
    """frame: of the field; parts, holes: polygons of shapely in it, holes whole where they reach over the
    edge; notes: on what is left out.
    """

    frame: Frame
    parts: tuple[Any, ...]
    holes: tuple[Any, ...]
    notes: tuple[str, ...] = ()


def outlines_of(shapely: Any, job: JobFile) -> Outlines:
    """The outlines of a job. InputError for one that crosses itself or is smaller than 1 m2."""
    field, side = job.field, -1.0 if job.is_mirrored else 1.0
    rings = [_checked(shapely, r, "field.boundary_m") for r in (field.boundary_m, *field.parts_m)]
    parts = shapely.union_all(rings)
    ponds = [_checked(shapely, r, "field.holes_m") for r in field.holes_m]
    truck = np.array([job.truck.x_m, side * job.truck.y_m])
    middle = shapely.get_coordinates(shapely.centroid(parts))[0] * (1.0, side)
    view = Frame(float(truck[0]), float(truck[1]), math.atan2(*(middle - truck)[::-1]), side)
    outer, inner = (_drawn(shapely, a, view) for a in (parts, shapely.union_all(ponds)))
    frame = _frame_of(job, view, [ring for ring, *_ in outer])

    def begun(ring: Array) -> Array:
        """In the field's frame, from the corner on that is nearest to its origin."""
        there = frame.to_field(view.to_map(ring))
        return np.roll(there, -min(range(len(there)), key=lambda i: (np.hypot(*there[i]), *there[i])), axis=0)

    made = [tuple(shapely.Polygon(begun(p[0]), [begun(h) for h in p[1:]]) for p in a) for a in (outer, inner)]
    before = len([point for r in (field.boundary_m, *field.parts_m, *field.holes_m) for point in r])
    after = len([point for polygon in (*outer, *inner) for ring in polygon for point in ring])
    notes = []
    if 2 * after < before:
        said = f"shape: outlines are drawn with {after} of {before} points, within {TOLERANCE} m"
        notes.append(f"{said}, their area as it was")
    off = [i + 1 for i, pond in enumerate(ponds) if not shapely.intersects(pond, parts)]
    if off:
        notes.append(f"outline: holes {off} of {len(ponds)} are outside of the field: closed ground there")
    return Outlines(frame, made[0], made[1], tuple(notes))


def _checked(shapely: Any, ring: Any, key: str) -> Any:
    polygon = shapely.Polygon(ring)
    if not polygon.is_valid:
        raise InputError(key, f"{len(ring)} points", "expected an outline that does not cross itself")
    if polygon.area < LEAST_M2:
        degrees = max(np.hypot(*np.transpose(ring))) < 400.0 and polygon.area < 0.1
        expected = f"expected an outline in metres of at least {num(LEAST_M2)} m2"
        raise InputError(
            key, f"{num(polygon.area)} m2", expected + (", are these degrees?" if degrees else "")
        )
    return polygon


def _drawn(shapely: Any, area: Any, view: Frame) -> list[list[Array]]:
    """Polygons of an area as seen from a frame, each its outline and its holes, in an order of their own."""
    polygons = [
        [_simpler(shapely, view.to_field(shapely.get_coordinates(r))) for r in (p.exterior, *p.interiors)]
        for p in shapely.get_parts(area)
        if not p.is_empty
    ]
    return sorted(([p[0], *sorted(p[1:], key=_first)] for p in polygons), key=lambda p: _first(p[0]))


def _first(ring: Array) -> tuple[float, ...]:
    return tuple(ring[0].tolist())


def _frame_of(job: JobFile, view: Frame, rings: list[Array]) -> Frame:
    """The longest side of all outlines is the x axis, the field to its left; of sides as long as that but for
    the tolerance the one that is nearest to the truck, of those the first as seen from there. A direction of
    the plan is that of the x axis.
    """
    starts = np.concatenate(rings)
    sides = np.concatenate([np.roll(r, -1, axis=0) for r in rings]) - starts
    length, middle = np.hypot(*sides.T), starts + 0.5 * sides
    far = np.where(length > length.max() - TOLERANCE, np.hypot(*middle.T), np.inf)
    near = np.flatnonzero(far < far.min() + TOLERANCE)
    best = min(near.tolist(), key=lambda i: (middle[i, 1], middle[i, 0]))
    ((x, y),) = view.to_map(starts[[best]])
    direction = math.remainder(view.direction + math.atan2(*sides[best, ::-1]), 2.0 * math.pi)
    if job.plan.direction_deg is not None:
        direction = view.side * math.radians(job.plan.direction_deg)
    return Frame(float(x), float(view.side * y), direction, view.side)


def _simpler(shapely: Any, ring: Array) -> Array:
    """A ring anticlockwise, with few points, of the same area."""
    ring = _within(_anticlockwise(ring), STRAIGHT)
    before, corners = shapely.Polygon(ring), _within(ring, TOLERANCE)
    corners = np.roll(corners, -np.lexsort(corners.T[::-1])[0], axis=0)
    after = shapely.Polygon(corners)
    for _ in range(ROUNDS):
        if abs(after.area - before.area) > 1e-6 * before.area:
            wider = (before.area - after.area) / after.length
            after = after.buffer(wider, join_style="mitre", mitre_limit=20.0)
    if not after.is_valid or after.geom_type != "Polygon" or after.is_empty:
        return ring
    moved = np.round(_anticlockwise(shapely.get_coordinates(after.exterior)[:-1]) / GRAIN) * GRAIN
    return np.roll(moved, -np.lexsort(moved.T[::-1])[0], axis=0)


def _within(ring: Array, most: float) -> Array:
    """A ring without points, as long as all that are left out are within a distance of its sides [m]."""
    points, n = ring.tolist(), len(ring)
    before, after = [n - 1, *range(n - 1)], [*range(1, n), 0]
    seen, left = [0] * n, n

    def queued(i: int) -> tuple[float, float, float, int, int]:
        a, b = before[i], after[i]
        between = points[a + 1 : b] if a < b else points[a + 1 :] + points[:b]
        return _off(between, points[a], points[b]), *points[i], i, seen[i]

    heap = [queued(i) for i in range(n)]
    heapq.heapify(heap)
    while heap and left > 3:
        off, *_, i, number = heapq.heappop(heap)
        if off > most:
            break
        if number != seen[i]:
            continue
        a, b = before[i], after[i]
        after[a], before[b], seen[i], left = b, a, -1, left - 1
        for j in (a, b):
            seen[j] += 1
            heapq.heappush(heap, queued(j))
    return ring[[i for i in range(n) if seen[i] >= 0]]


def _off(points: list[list[float]], a: list[float], b: list[float]) -> float:
    """The most that points are off the line from a to b [m]."""
    (x, y), u, v = a, b[0] - a[0], b[1] - a[1]
    square, most = max(u * u + v * v, GRAIN**2), 0.0
    for p, q in points:
        share = min(max(((p - x) * u + (q - y) * v) / square, 0.0), 1.0)
        most = max(most, math.hypot(p - x - share * u, q - y - share * v))
    return most


def _anticlockwise(points: Array) -> Array:
    x, y = (points - points[0]).T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return points if area > 0.0 else points[::-1]
