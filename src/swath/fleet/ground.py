"""The ground of a field: outlines, holes, what may be driven on around, what is cut when.

All is in a frame of the field itself (outlines.py), so that nothing depends on how it lies on the map.
"""

import math
from dataclasses import dataclass
from dataclasses import field as made
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError
from swath.core.number_text import num
from swath.fleet.files import SQUARE, JobFile
from swath.fleet.machines import Body, Place
from swath.fleet.outlines import outlines_of
from swath.kernels import filled, launch

Array = NDArray[np.float64]
CELL = 0.5  # m, of the grid of free ground
CLOSED, BARE, STANDING = -2.0, -1.0, 1e18  # of a cell, as in search.cpp
ROWS = 128  # of cells that are looked at together
EDGE = 2.0  # m, up to which the distance to closed ground is kept
AT_ONCE = 8  # strips that are cut, whose cells are looked at anew together
SQUARE_M_PER_HA_T = 0.1  # t/ha in kg/m2
LEAST_M = 4.0  # between truck and field
LONGEST_M, MOST_M2 = 10_000.0, 1e7  # of all ground in its frame: its cells take less than half a gigabyte


@dataclass(frozen=True)
class Params:
    """yard_m: radius of open ground at the truck and where the way to it leaves the field; road_m: half
    width of that way and of others; truck_m: from the middle of a cart to that of the truck beside it.
    Estimates from yards seen.
    """

    yard_m: float = 45.0
    road_m: float = 10.0
    truck_m: float = 4.5


PARAMS = Params()


def shapely_here() -> Any:
    """The module shapely, of the extra `geo`."""
    with Extra("geo", "plans of fields"):
        import shapely
    return shapely


@dataclass
class Grid:
    """Free ground in cells, shape (n, m).

    west, south: of the first [m]; cell [m]
    edge: of the middle of each, the distance to closed ground, < 0 in it [m], 9 beyond 2 m
    free_from: the time from which no crop stands there [s], -1 for ground without crop, -2 for closed ground,
        1e18 for crop that stays
    changed: rows and columns in which crop was cut, in order
    """

    west: float
    south: float
    cell: float
    edge: NDArray[np.float32]
    free_from: NDArray[np.float32]
    changed: list[tuple[slice, slice]] = made(default_factory=list)


class Ground:
    """The ground of a job; outlines are shapely, in the field's frame.

    field: crop at the start
    open: ground that may be driven on, with crop or without
    around: the outlines and the strip around them
    rough: `open` and a little over its edge
    remaining: crop that no pass has been given
    dock: where a cart's box stands to empty, the truck to its left
    gate: where the path to the truck leaves the field [m]; out: direction of that path there [rad]
    truck: the truck's outline
    grid: which ground is free when
    notes: on the outlines
    """

    def __init__(self, job: JobFile, truck: Body) -> None:
        shapely = shapely_here()
        made = outlines_of(shapely, job)
        self.frame, self.notes, parts = made.frame, [*made.notes], made.parts
        truck = truck.mirrored() if job.is_mirrored else truck
        self.holes = holes = shapely.union_all(made.holes)
        self.field = shapely.difference(shapely.union_all(parts), holes)
        if self.field.is_empty:
            raise InputError("field.holes_m", None, "expected holes that leave some of the field")
        self.remaining = self.field
        place = self.frame.to_field([(job.truck.x_m, job.truck.y_m)])[0]
        at_gate = job.truck.gate_m and self.frame.to_field([job.truck.gate_m])[0]
        self.gate, self.out, self.dock = _at_truck(shapely, self.field, place, at_gate, job)
        self.truck_place = self.dock.ahead(0.0, PARAMS.truck_m)
        self.truck = shapely.polygons(truck.outlines(np.array([self.truck_place]))[0, 0])
        around = shapely.union_all(parts).buffer(job.field.around_m, join_style="mitre", mitre_limit=2.0)
        self.around = around
        self.open = shapely.difference(
            shapely.union_all([around, *self._yards(shapely, place, job)]),
            shapely.union_all([holes, self.truck]),
        )
        self._check_ways(shapely, parts, job)
        west, south, east, north = self.open.bounds
        _check_size(east - west, north - south)
        self.west, self.south = math.floor(west) - 2.0, math.floor(south) - 2.0
        self.shape: tuple[int, int] = int((east - self.west) / CELL) + 5, int((north - self.south) / CELL) + 5
        self.grid = self._raster(shapely)
        self.rough = self.open.buffer(0.5 * CELL)  # the gap around bodies, and rounding
        shapely.prepare([self.open, self.rough])
        self._mean = SQUARE_M_PER_HA_T * job.field.yield_t_ha
        self._yields = _yields_of(job)
        self._crop: dict[Any, tuple[int, Array]] = {}  # of strips asked for: cuts until then, areas

    @property
    def truck_m(self) -> float:
        """Distance from the field to the truck [m]."""
        return math.dist(self.gate, self.dock[:2])

    def _check_ways(self, shapely: Any, parts: tuple[Any, ...], job: JobFile) -> None:
        """InputError for a part of the field, or a way, to which no open ground leads from the gate."""
        together = shapely.get_parts(self.open)
        home = min(together, key=lambda area: area.distance(shapely.Point(self.gate)))
        apart = [p for p in parts if not home.intersects(p)]
        if apart:
            gap = min(home.distance(p) for p in apart)
            expected = f"expected ground that joins all parts of the field, one is {num(gap)} m off"
            raise InputError("field.around_m", job.field.around_m, expected)
        for number, way in enumerate(job.field.ways_m):
            if not home.intersects(shapely.LineString(self.frame.to_field(way))):
                expected = "expected a way that touches the field, its gate, the truck or another way"
                raise InputError(f"field.ways_m[{number}]", [tuple(p) for p in way], expected)

    def _yards(self, shapely: Any, place: Array, job: JobFile) -> list[Any]:
        """Ground at truck and gate, ways, and one straight between both where these do not join them."""
        yards = [shapely.Point(p).buffer(PARAMS.yard_m) for p in (place, self.gate)]
        lines = [shapely.LineString(self.frame.to_field(way)) for way in job.field.ways_m]
        ways = [line.buffer(PARAMS.road_m) for line in lines]
        together = shapely.get_parts(shapely.union_all([*yards, *ways]))
        if ways and any(shapely.intersects(part, yards).all() for part in together):
            return [*yards, *ways]
        if ways:
            self.notes.append(
                "derived: no way of field.ways_m leads from the gate to the truck: a straight one is taken"
            )
        road = shapely.LineString([self.gate, place]) if math.dist(self.gate, place) > 1.0 else None
        return [*yards, *ways] if road is None else [*yards, *ways, road.buffer(PARAMS.road_m)]

    def _raster(self, shapely: Any) -> Grid:
        at_x, at_y = (
            low + CELL * (np.arange(n) + 0.5)
            for low, n in zip((self.west, self.south), self.shape, strict=True)
        )
        line = shapely.boundary(self.open)
        shapely.prepare([self.open, self.field, line, near := line.buffer(EDGE)])
        free, edge = np.full(self.shape, CLOSED, np.float32), np.full(self.shape, -9.0, np.float32)
        for i in range(0, len(at_x), ROWS):
            rows = slice(i, i + ROWS)
            x, y = np.meshgrid(at_x[rows], at_y, indexing="ij")
            is_open, is_near = (shapely.contains_xy(area, x, y) for area in (self.open, near))
            free[rows][is_open], edge[rows][is_open] = BARE, 9.0
            free[rows][shapely.contains_xy(self.field, x, y)] = STANDING
            away = shapely.distance(line, shapely.points(x[is_near], y[is_near]))
            edge[rows][is_near] = np.where(is_open[is_near], away, -away)
        return Grid(self.west, self.south, CELL, edge, free)

    def cut(self, strips: Any, times: Array) -> Array:
        """Cut strips, polygons (n,), each at a time [s]: their crop leaves `remaining`, its areas [m2],
        (n,).
        """
        shapely = shapely_here()
        whole = shapely.union_all(strips)
        areas = self.crop_in(strips)
        before = self.remaining.area
        self.remaining = shapely.difference(self.remaining, whole)
        gone = before - self.remaining.area
        wide = shapely.buffer(strips, 0.25 * CELL, join_style="mitre")
        self._cells(wide, times)
        for n in range(0, len(wide), AT_ONCE):
            self.grid.changed.append(window_of(wide[n : n + AT_ONCE], self.grid, self.shape))
        total = float(areas.sum())
        return areas * (gone / total) if total > 0.0 else areas

    def crop_in(self, strips: Any) -> Array:
        """Crop of `remaining` in strips, polygons (n,) [m2]."""
        shapely = shapely_here()
        near = shapely.intersection(self.remaining, shapely.union_all(strips))
        return np.asarray(shapely.area(shapely.intersection(near, strips)))

    def density(self, strips: Any) -> Array:
        """Grain in strips, polygons (n,), as it is about their middles [kg/m2], (n,)."""
        if self._yields is None:
            return np.full(len(strips), self._mean)
        shapely, (corner, share) = shapely_here(), self._yields
        middles = self.frame.to_map(shapely.get_coordinates(shapely.centroid(strips)))
        i, j = np.clip((middles - corner) / SQUARE, 0.0, np.array(share.shape) - 1.0).astype(int).T
        return np.asarray(self._mean * share[i, j])

    def crop_on(self, key: Any, strips: Any) -> Array:
        """The same for strips that a key stands for, looked up unless crop about them was cut since."""
        seen, areas = self._crop.get(key, (-1, np.zeros(0)))
        own = window_of(strips, self.grid, self.shape)
        if seen < 0 or any(_meet(own, cut) for cut in self.grid.changed[seen:]):
            areas = self.crop_in(strips)
        self._crop[key] = len(self.grid.changed), areas
        return areas

    def is_free(self, areas: Any, time: float) -> NDArray[np.bool_]:
        """Whether polygons (n,) lie on open ground where no crop stands at a time [s]."""
        shapely = shapely_here()
        return np.asarray(shapely.contains(self.open, areas)) & (self._cells(areas) <= np.float32(time))

    def _cells(self, areas: Any, cut: Array | None = None, until: float = math.inf) -> Array:
        """The time from which no crop stands in any cell whose middle is in a convex polygon, (n,) [s]; cut:
        when the crop of each is cut [s]; until: cells that are free later are left out [s].
        """
        from swath.fleet import ground_kernel

        shapely = shapely_here()
        rings = shapely.get_exterior_ring(areas)
        ends = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(rings))]).astype(np.int32)
        out = np.full(len(areas), BARE) if cut is None else np.asarray(cut, float)
        latest = np.float32(until)  # as the grid has times
        numbers = np.array([*self.shape, CELL, self.west, self.south, len(areas), cut is not None, latest])
        points = shapely.get_coordinates(rings).ravel()
        cells = self.grid.free_from.ravel()
        crop = filled(ground_kernel.Crop, numbers=numbers, points=points, starts=ends, cells=cells, times=out)
        launch(ground_kernel.crop_cells, crop)
        return out

    def cut_by(self, areas: Any, time: float) -> list[float]:
        """From when on no crop stands in rows of convex polygons (n, m) [s], but for what is cut after a
        time; 0 where none stood.
        """
        found = self._cells(areas.ravel(), until=time).reshape(areas.shape)
        latest: list[float] = np.maximum(found.max(axis=1), 0.0).tolist()
        return latest


def _yields_of(job: JobFile) -> tuple[Array, Array] | None:
    """South-west corner on the map [m], and yields of squares over their mean, 1 where none is known."""
    if not job.yields:
        return None
    rows = np.array(job.yields)
    corner = rows[:, :2].min(axis=0) - 0.5 * SQUARE
    cells = ((rows[:, :2] - corner) / SQUARE).astype(int)
    share = np.ones(cells.max(axis=0) + 1)
    share[tuple(cells.T)] = rows[:, 2] / rows[:, 2].mean()
    return corner, share


def window_of(areas: Any, grid: Grid, shape: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of cells about polygons."""
    low_x, low_y, high_x, high_y = shapely_here().total_bounds(areas)
    i, j = (
        slice(max(int((low - at) / grid.cell) - 1, 0), min(int((high - at) / grid.cell) + 2, n))
        for low, high, at, n in ((low_x, high_x, grid.west, shape[0]), (low_y, high_y, grid.south, shape[1]))
    )
    return i, j


def _meet(one: tuple[slice, slice], two: tuple[slice, slice]) -> bool:
    return all(a.start < b.stop and b.start < a.stop for a, b in zip(one, two, strict=True))


def cells_of(area: Any, grid: Grid, shape: tuple[int, int]) -> tuple[slice, slice, NDArray[np.bool_]]:
    """Cells about a polygon: their rows and columns, and whose middles are in it."""
    i, j = window_of(area, grid, shape)
    x = grid.west + grid.cell * (np.arange(i.start, i.stop) + 0.5)
    y = grid.south + grid.cell * (np.arange(j.start, j.stop) + 0.5)
    return i, j, shapely_here().contains_xy(area, *np.meshgrid(x, y, indexing="ij"))


def run_of(body: Body, place: Place, ahead: float, gap: float = 0.3) -> Any:
    """The ground of a body from a place to one straight ahead [m], < 0 behind it, wider by a gap."""
    shapely = shapely_here()
    outlines = body.outlines(np.array([place, place.ahead(ahead)]), gap)
    return shapely.convex_hull(shapely.multipoints(outlines.reshape(-1, 2)))


def fits(area: Any, body: Body, place: Place) -> bool:
    """Whether a body at a place is in an area, half a metre off its edge."""
    shapely = shapely_here()
    return bool(shapely.contains(area, shapely.polygons(body.outlines(np.array([place]), 0.5)[0])).all())


def _check_size(length: float, width: float) -> None:
    longest, area = max(length, width), length * width
    if longest > LONGEST_M or area > MOST_M2:
        most = f"{num(LONGEST_M / 1000.0)} km and {num(MOST_M2 / 1e4)} ha"
        expected = f"expected field and truck in a rectangle of at most {most}"
        raise InputError("field", f"{num(longest / 1000.0)} km, {num(area / 1e4)} ha", expected)


def _at_truck(
    shapely: Any, field: Any, place: Array, outside: Array | None, job: JobFile
) -> tuple[tuple[float, float], float, Place]:
    """Gate and direction of the way to the truck there, and the place of a cart's box beside the truck.

    place: of the truck; outside: a place at the gate, None for the gate nearest to the truck
    """
    if field.distance(shapely.Point(place)) < LEAST_M:
        value = f"{num(job.truck.x_m)}, {num(job.truck.y_m)}"
        expected = f"expected a place at least {num(LEAST_M)} m outside of the field"
        raise InputError("truck", value, expected)
    at = place if outside is None else outside
    nearest, _ = shapely.get_coordinates(shapely.shortest_line(field, shapely.Point(at))).tolist()
    far = 2.0 * PARAMS.yard_m
    if outside is not None and not 1.0 <= math.dist(nearest, outside) <= far:
        assert job.truck.gate_m is not None
        value = ", ".join(map(num, job.truck.gate_m))
        raise InputError("truck.gate_m", value, f"expected a place 1 to {num(far)} m outside of the field")
    (u, v), (x, y) = (place - nearest).tolist(), (at - nearest).tolist()
    heading = math.atan2(v, u) - 0.5 * math.pi  # the truck on the far side, to the left
    out = heading + 0.5 * math.pi if outside is None else math.atan2(y, x)
    dock = Place(float(place[0]), float(place[1]), heading, heading)
    return (float(nearest[0]), float(nearest[1])), out, dock
