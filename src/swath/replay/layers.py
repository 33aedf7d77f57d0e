"""What lies in a page, layer by layer: the field, the machines, and what was recorded of them.

When each cell of an area was cut is found from the tracks: between two rows of the tracks the knife sweeps a
polygon (`machine.sweep`); a cell in it was passed at the time that its distances from the knife before and
after give. Cells are coarser than the field's.

Terrain and stand are those of the field's generators, plants those of its tile prototypes: nothing is taken
from memory that a run has changed.

Shown is what of the field lies about the ways of all machines, tile by tile.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from heapq import merge
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.field import Field
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, STANDING, Organ, PlantLibrary, Shape
from swath.machine.body.body import corners_of
from swath.machine.sweep import Sweeps
from swath.record.charts import Columns, columns_of, path_of, shown_charts
from swath.replay.machines import STATE, cutting_height, describe, thinned
from swath.replay.scans import MOST_POINTS, Recorded, pack_echoes, stations, swath_width
from swath.runtime.world import Machine, World
from swath.signals import F64

MARGIN = 12.0  # shown beside every way [m]
MOST_TILES = 250_000  # of the rectangle about all ways
MOST_CELLS = 4_000_000
MOST_SIDE = 4096  # longest texture that every graphics card takes


@dataclass(frozen=True)
class Area:
    """A rectangle of tiles in the stand frame.

    tile: side T [m]
    first: index of the lower left tile (x, y)
    shape: tiles (ny, nx)
    shown: (ny, nx), tiles near a way
    cells: cut cells along a tile
    until_s: ways up to there are inside
    """

    tile: float
    first: tuple[int, int]
    shape: tuple[int, int]
    shown: NDArray[np.bool_]
    cells: int
    until_s: float

    @property
    def cell(self) -> float:
        """Side of a cut cell [m]."""
        return self.tile / self.cells


def area_about(tile: float, times: F64, points: F64) -> Area:
    """The area about points (n, 2) [m] of the stand frame, passed at times (n,) [s], in order of time.

    A run that covers more than MOST_TILES is shown up to where it leaves what can be shown.
    """
    index = np.floor(points / tile).astype(int)
    reach = int(np.ceil(MARGIN / tile))
    count = _fitting(index, reach)
    index = index[:count]
    low, high = index.min(axis=0) - reach, index.max(axis=0) + reach + 1
    nx, ny = (int(n) for n in high - low)
    cells = 16
    while cells > 2 and (nx * ny * cells**2 > MOST_CELLS or max(nx, ny) * cells > MOST_SIDE):
        cells //= 2
    until = float("inf") if count == len(times) else float(times[count - 1])
    shown = _near(index - low, (ny, nx), reach)
    return Area(tile, (int(low[0]), int(low[1])), (ny, nx), shown, cells, until)


def _fitting(index: NDArray[np.int64], reach: int) -> int:
    """How many points, from the first on, lie in a rectangle that is not too large."""
    low = np.minimum.accumulate(index, axis=0) - reach
    high = np.maximum.accumulate(index, axis=0) + reach + 1
    sides = high - low
    fits = (sides.prod(axis=1) <= MOST_TILES) & (sides.max(axis=1) * 2 <= MOST_SIDE)
    return max(1, int(np.count_nonzero(fits)))


def _near(index: NDArray[np.int64], shape: tuple[int, int], reach: int) -> NDArray[np.bool_]:
    """Tiles within a square of `reach` tiles about any of some tiles."""
    marks = np.zeros(shape, np.int32)
    marks[index[:, 1], index[:, 0]] = 1
    for axis in (0, 1):
        grown = np.zeros_like(marks)
        for shift in range(-reach, reach + 1):
            grown |= np.roll(marks, shift, axis=axis)  # the rectangle has a border as wide as the reach
        marks = grown
    return marks.astype(bool)


MOST_PIECES = 52_000  # of all prototypes that are sent
MAIN = (Organ.STEM, Organ.EAR, Organ.BRANCH, Organ.POD, Organ.COB)  # drawn from afar too
UNIT = 1.0 / 2000.0  # of positions [m]
THIN = 1.0 / 10000.0  # of radii and half widths [m]


@dataclass(frozen=True)
class Plants:
    """Pieces of plants, prototype after prototype, each with `per` rows (unused ones have organ 0).

    Of a prototype first the stems and ears by the rank of their plant, so that its first n rows are a thinner
    stand, then leaves and the rest.
    ends: (k, per, 6) int16 in UNIT: both ends; width: (k, per, 3) int16 in THIN: half width of ribbons and
    triangles, radius in the first place and zeros for capsules
    organ: (k, per) uint8, 128 added to triangles, 64 to capsules; stem: (k, per) uint16
    feet: (k, most, 3) uint16 per stem: x, y in UNIT, rank in 1/65535
    mains: stems and ears of each prototype; left_out: share of the pieces that are not sent
    """

    ends: NDArray[np.int16]
    width: NDArray[np.int16]
    organ: NDArray[np.uint8]
    stem: NDArray[np.uint16]
    feet: NDArray[np.uint16]
    mains: list[int]
    left_out: float

    @property
    def count(self) -> int:
        """Prototypes."""
        return len(self.mains)

    @property
    def notes(self) -> list[str]:
        """What a reader should know of it."""
        share = 100.0 * self.left_out
        return [f"{share:.0f} % of the pieces of plants are left out"] if share > 0.0 else []


def plants_of(library: PlantLibrary) -> Plants:
    """As many prototypes as fit into MOST_PIECES; of one that alone does not fit, an even choice."""
    chosen = _chosen(library)
    while len(chosen) > 1 and sum(len(c) for c, _ in chosen) > MOST_PIECES:
        chosen = chosen[: len(chosen) // 2]
    total = sum(len(c) for c, _ in chosen)
    if total > MOST_PIECES:
        rows, mains = chosen[0]
        keep = np.unique(np.linspace(0, len(rows) - 1, MOST_PIECES).astype(int))
        chosen = [(rows[keep], int(np.searchsorted(keep, mains)))]
    sent = sum(len(c) for c, _ in chosen)
    per = max(1, *(len(c) for c, _ in chosen)) if chosen else 1
    first = library.stem_start
    most = max(1, int(np.diff(first).max(initial=1)))
    plants = Plants(
        np.zeros((len(chosen), per, 6), np.int16),
        np.zeros((len(chosen), per, 3), np.int16),
        np.zeros((len(chosen), per), np.uint8),
        np.zeros((len(chosen), per), np.uint16),
        np.zeros((len(chosen), most, 3), np.uint16),
        [mains for _, mains in chosen],
        1.0 - sent / max(total, 1),
    )
    for k, (rows, _) in enumerate(chosen):
        _fill(plants, k, library, rows)
    return plants


def _chosen(library: PlantLibrary) -> list[tuple[NDArray[np.int64], int]]:
    """Rows of each prototype's own pieces in their order, and how many of them are stems and ears."""
    foot = library.base.astype(float)
    own = np.all((foot >= 0.0) & (foot < library.tile_size), axis=1)
    tile = np.searchsorted(library.stem_start, library.owner, side="right") - 1
    main = np.isin(library.organ, MAIN)
    rank = library.stem_rank[library.owner]
    rows = np.flatnonzero(own)
    rows = rows[np.lexsort((rows, rank[rows], ~main[rows], tile[rows]))]
    starts = np.searchsorted(tile[rows], np.arange(library.tile_count + 1))
    parts = [rows[a:b] for a, b in pairwise(starts.tolist())]
    return [(part, int(main[part].sum())) for part in parts]


def _fill(plants: Plants, k: int, library: PlantLibrary, rows: NDArray[np.int64]) -> None:
    n = len(rows)
    ends = np.concatenate([library.a[rows], library.b[rows]], axis=1)
    plants.ends[k, :n] = _int16(ends / UNIT)
    capsule = library.shape[rows] == Shape.CAPSULE
    width = np.where(capsule[:, None], 0.0, library.width[rows])
    width[capsule, 0] = library.radius[rows][capsule]
    plants.width[k, :n] = _int16(width / THIN)
    kind = 64 * capsule + 128 * (library.shape[rows] == Shape.TRIANGLE)
    plants.organ[k, :n] = library.organ[rows] + kind
    first, last = int(library.stem_start[k]), int(library.stem_start[k + 1])
    plants.stem[k, :n] = np.clip(library.owner[rows] - first, 0, 65535)
    feet = library.stem_xy[first:last] / UNIT
    plants.feet[k, : last - first, :2] = np.clip(np.rint(feet), 0, 65535)
    plants.feet[k, : last - first, 2] = np.rint(65535 * np.clip(library.stem_rank[first:last], 0.0, 1.0))


def _int16(values: NDArray[np.floating]) -> NDArray[np.int16]:
    return np.asarray(np.clip(np.rint(values), -32767, 32767), dtype=np.int16)


FAR_STEP, FAR_REACH = 4.0, 150.0  # grid of the country around the area, and how far it goes [m]
FAR_NODES = 150  # along its longer side, at most
LEAN_UNIT = 1.0 / 100.0  # of the lean of a tile's stand
MOST_TOGETHER = 64  # tiles, or points of an edge, that are looked up at once
FLAGS = 16  # 16: mirrored in x, 32: mirrored in y, beside the number of a prototype


@dataclass(frozen=True)
class Ground:
    """heights: (ny + 1, nx + 1) at tile corners [m]; stand: (ny, nx, 5) uint8: scale, lean x, lean y, density
    share, prototype with flags; codes: (ny * cells, nx * cells) at the start, as in `field.memory_layout`
    scale_max: the scale that 255 stands for.
    """

    heights: F64
    stand: NDArray[np.uint8]
    codes: NDArray[np.uint8]
    scale_max: float


def ground_of(field: Field, area: Area, prototypes: int) -> Ground:
    """Of an area, with the first `prototypes` of the field's tile prototypes in place of all."""
    (x0, y0), (ny, nx), tile = area.first, area.shape, area.tile
    u: F64 = (np.arange(nx + 1, dtype=np.float64) + x0) * tile
    v: F64 = (np.arange(ny + 1, dtype=np.float64) + y0) * tile
    heights = field.terrain.lattice(u, v, field.stand_yaw)
    tx, ty = np.meshgrid(np.arange(nx) + x0, np.arange(ny) + y0)
    x, y = field.maker.to_world((tx + 0.5) * tile, (ty + 0.5) * tile)
    stand = field.maker.stand_at(x, y)
    scale_max = max(float(stand[..., 0].max()), 1e-3)
    number = field.maker.prototypes(tx, ty)
    flags = FLAGS * ((number & MIRROR_X) > 0) + 2 * FLAGS * ((number & MIRROR_Y) > 0)
    share = np.where(area.shown, stand[..., 3], 0.0)
    values = [
        255.0 * stand[..., 0] / scale_max,
        128.0 + stand[..., 1] / LEAN_UNIT,
        128.0 + stand[..., 2] / LEAN_UNIT,
        255.0 * share,
        (number & (MIRROR_X - 1)) % prototypes + flags,
    ]
    bytes_ = np.clip(np.rint(np.stack(values, axis=-1)), 0, 255).astype(np.uint8)
    return Ground(np.asarray(heights, dtype=float), bytes_, _codes(field, area, x, y), scale_max)


def _codes(field: Field, area: Area, x: F64, y: F64) -> NDArray[np.uint8]:
    """Codes of the cells at the start; 0 where nothing is shown. x, y: world middles of the tiles [m]."""
    n, maker = area.cells, field.maker
    tiles = np.where(area.shown, maker.codes_within(x, y, area.tile * np.sqrt(0.5) + 1e-6), 0)
    cells = np.repeat(np.repeat(tiles, n, axis=0), n, axis=1)
    mixed = np.argwhere(tiles < 0)
    for first in range(0, len(mixed), MOST_TOGETHER):
        row, column = (a[:, None] * n + np.arange(n) for a in mixed[first : first + MOST_TOGETHER].T)
        u = area.first[0] * area.tile + (column + 0.5) * area.cell
        v = area.first[1] * area.tile + (row + 0.5) * area.cell
        at = maker.to_world(u[:, None, :], v[:, :, None])
        cells[row[:, :, None], column[:, None, :]] = maker.codes_at(*at)
    return cells.astype(np.uint8)


def far_ground(field: Field, area: Area) -> tuple[dict[str, Any], F64, NDArray[np.uint8]]:
    """The country around: where its grid lies (stand frame [m]), heights, and how far inside the crop its
    nodes lie: 128 at the edge, 255 three steps inside, 0 as far outside: a page finds the edge between them.
    """
    (x0, y0), (ny, nx), tile = area.first, area.shape, area.tile
    begin = np.array([x0 * tile - FAR_REACH, y0 * tile - FAR_REACH])
    sides = np.array([nx, ny]) * tile + 2 * FAR_REACH
    step = max(FAR_STEP, float(sides.max()) / FAR_NODES)
    u, v = (begin[k] + step * np.arange(int(np.ceil(sides[k] / step)) + 1) for k in (0, 1))
    heights = np.asarray(field.terrain.lattice(u, v, field.stand_yaw), dtype=float)
    x, y = field.maker.to_world(*np.meshgrid(u, v))
    inside = np.min([edge.shape.signed_distance(x, y) for edge in field.edges.values()], axis=0) / step
    is_crop = (field.maker.codes_at(x, y) == STANDING) & field.covers(x, y)
    inside = np.where(is_crop, np.maximum(inside, 0.0), np.where(inside < 0.0, inside, -0.5))
    code = np.clip(np.rint(128.0 + 127.0 / 3.0 * inside), 0, 255).astype(np.uint8)
    grid = {"x": float(begin[0]), "y": float(begin[1]), "step": step, "nx": len(u), "ny": len(v)}
    return grid, heights, code


STEP = 0.4  # between knife positions [m]; within one the time is interpolated
NEVER = 65535


@dataclass(frozen=True)
class KnifeWay:
    """times (n,) [s]; ends (n, 2, 2): left and right end in the stand frame [m]; heights (n,): cut [m]."""

    times: F64
    ends: F64
    heights: F64

    def thinned(self) -> "KnifeWay":
        """Rows at least STEP apart, and the last one."""
        keep, last = [0], self.ends[0]
        for i in range(1, len(self.times)):
            if np.hypot(*(self.ends[i] - last).T).max() >= STEP or i == len(self.times) - 1:
                keep.append(i)
                last = self.ends[i]
        return KnifeWay(self.times[keep], self.ends[keep], self.heights[keep])


@dataclass(frozen=True)
class CutTimes:
    """when: (rows, columns) uint16 in units of `unit` [s], 0 = cut before the start, NEVER = it stands to the
    end; codes: what is left, or will be [cm].
    """

    when: NDArray[np.uint16]
    codes: NDArray[np.uint8]
    unit: float


def cut_times(area: Area, codes: NDArray[np.uint8], ways: list[KnifeWay], duration: float) -> CutTimes:
    """codes: of the cells at the start, as in `field.memory_layout`."""
    unit = max(0.02, duration / (NEVER - 10))
    is_crop = codes == STANDING
    when = np.where(is_crop, np.float32(NEVER), np.float32(0.0))
    left = codes.copy()
    sweeps = Sweeps(2, [-1.0])
    steps = merge(*(_steps(way.thinned(), area) for way in ways), key=lambda step: float(step[0][0]))
    for (begin, end), before, after, height in steps:
        for polygon, *_ in sweeps.between(before.tolist(), after.tolist()):
            found = _inside(np.array(polygon), when.shape)
            if found is None:
                continue
            rows, columns, inside = found
            part, code = when[rows, columns], left[rows, columns]
            taken = inside & is_crop[rows, columns] & (code > height)
            share = _share(before, after, rows, columns)
            time = np.maximum(np.rint((begin + share * (end - begin)) / unit), 1.0)
            part[taken] = np.minimum(part[taken], time[taken])
            code[taken] = height
    return CutTimes(when.astype(np.uint16), np.where(left == STANDING, 15, left).astype(np.uint8), unit)


def _steps(way: KnifeWay, area: Area) -> Iterator[tuple[tuple[float, float], F64, F64, int]]:
    """Times, knife before and after in cells, and height [cm] of every step."""
    cells = (way.ends / area.tile - np.array(area.first)) * area.cells
    heights = np.clip(np.rint(100.0 * way.heights), 0, STANDING - 1).astype(int)
    for i in range(len(way.times) - 1):
        if way.times[i] <= area.until_s:
            times = float(way.times[i]), float(way.times[i + 1])
            yield times, cells[i], cells[i + 1], int(heights[i + 1])


def _inside(polygon: F64, shape: tuple[int, ...]) -> tuple[slice, slice, NDArray[np.bool_]] | None:
    """The cells whose centres lie in a convex polygon, anticlockwise, in cell units; None without any."""
    low = np.maximum(np.floor(polygon.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, [shape[1], shape[0]])
    if (low >= high).any():
        return None
    x, y = np.arange(low[0], high[0]) + 0.5, (np.arange(low[1], high[1]) + 0.5)[:, None]
    inside = np.ones((high[1] - low[1], high[0] - low[0]), bool)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inside &= (bx - ax) * (y - ay) >= (by - ay) * (x - ax)
    return slice(low[1], high[1]), slice(low[0], high[0]), inside


def _share(before: F64, after: F64, rows: slice, columns: slice) -> F64:
    """How far on the way from the knife before to the knife after cells lie, 0 to 1."""
    x, y = np.arange(columns.start, columns.stop) + 0.5, (np.arange(rows.start, rows.stop) + 0.5)[:, None]
    away = [np.abs(_distance(line, x, y)) for line in (before, after)]
    total = away[0] + away[1]
    return np.asarray(away[0] / np.where(total > 0.0, total, 1.0))


def _distance(line: F64, x: F64, y: F64) -> F64:
    (ax, ay), (bx, by) = line
    length = max(float(np.hypot(bx - ax, by - ay)), 1e-9)
    return np.asarray(((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length)


HEIGHT_UNIT = 1e-3  # of terrain heights [m], where they fit into 16 bits
MOST_TRIANGLES = 12000  # of a body from a file, and of its header
EDGE_STEP = 0.5  # between points of the initial edge [m]
Values = dict[str, Any]
Arrays = dict[str, NDArray[Any]]


class Layers:
    """Collects values, arrays, and notes on what is left out. tracks: by machine, as in `collect.Driven`.

    origin: a world point [m] that places in the page count from, so that float32 is fine enough
    """

    def __init__(self, world: World, tracks: Mapping[str, Columns], origin: F64) -> None:
        self.world, self.tracks, self.origin = world, tracks, origin
        self.machines: dict[str, Machine] = {name: world.machines[name] for name in tracks}
        self.values: Values = {}
        self.arrays: Arrays = {}
        self.notes: list[str] = []

    def add_field(self, area: Area, duration: float) -> None:
        """Terrain, stand, when it was cut, plants, and the country around."""
        field, plants = self.world.field, plants_of(self.world.field.library)
        ground = ground_of(field, area, plants.count)
        ways = [self._knife(name) for name, machine in self.machines.items() if machine.cuts]
        cut = cut_times(area, ground.codes, ways, duration)
        grid, far_heights, far_codes = far_ground(field, area)
        self.notes += plants.notes
        self.arrays |= {
            "tiles": ground.stand,
            "shown": area.shown.astype(np.uint8),
            "cut_when": cut.when,
            "cut_code": cut.codes,
            "far_codes": far_codes,
            "plant_ends": plants.ends,
            "plant_width": plants.width,
            "plant_organ": plants.organ,
            "plant_stem": plants.stem,
            "plant_feet": plants.feet,
        }
        self.arrays["heights"], near = _heights(ground.heights)
        self.arrays["far_heights"], far = _heights(far_heights)
        self.values["area"] = {
            "tile": area.tile, "first": list(area.first), "nx": area.shape[1], "ny": area.shape[0],
            "cells": area.cells, "yaw": field.stand_yaw, "unit_s": cut.unit, **near,
            "scale_max": ground.scale_max,
        }  # fmt: skip
        self.values["far"] = {**grid, **far}
        self.values["plants"] = {
            "mains": plants.mains, "per": plants.ends.shape[1], "most": plants.feet.shape[1],
            "height": field.library.height_max, "rows": field.library.row_spacing,
        }  # fmt: skip

    def _knife(self, name: str) -> KnifeWay:
        columns, machine = self.tracks[name], self.machines[name]
        ends = []
        for side in ("left", "right"):
            path = path_of(columns, *machine.sheet.header_end(side))
            ends.append(np.stack(self.world.field.to_stand(path[:, 0], path[:, 1]), axis=1))
        return KnifeWay(columns["t_s"], np.stack(ends, axis=1), cutting_height(machine, columns))

    def add_machines(self, ahead: Mapping[str, Columns] | None = None) -> None:
        """Geometry, charts, columns and edge of every machine.

        ahead: of a run that goes on, the way that each machine will go, for its edge
        """
        described = []
        for index, (name, machine) in enumerate(self.machines.items()):
            own = thinned(self.tracks[name])
            charts = shown_charts(own, cuts=machine.cuts, is_live=ahead is not None)
            names = list(dict.fromkeys([n for n in (*STATE, *columns_of(charts)) if n in own]))
            placed = dict(own)
            for column, axis in (("x_m", 0), ("y_m", 1), ("trailer_x_m", 0), ("trailer_y_m", 1)):
                if column in own:
                    placed[column] = own[column] - self.origin[axis]
            self.arrays[f"track_{index}"] = np.stack([placed[n] for n in names]).astype(np.float32)
            edge = self._edge(machine, own if ahead is None else ahead[name]) - self.origin
            self.arrays[f"edge_{index}"] = edge.astype(np.float32)
            described.append({**describe(machine), "columns": names, "charts": charts})
            self._add_body(machine, index, described[-1])
        self.values["machines"] = described

    def _add_body(self, machine: Machine, index: int, about: Values) -> None:
        """Triangles of a body from a file: what is fixed, and the header with its axes."""
        if machine.body is None:
            return
        about["header_axes"] = list(machine.header_kinematics.axes)
        for name, solids in (("body", machine.body.fixed), ("header", machine.body.header)):
            corners = corners_of(solids)
            every = max(1, -(-len(corners) // MOST_TRIANGLES))
            if every > 1:
                self.notes.append(f"{machine.name}: of its {name} one triangle in {every} is drawn")
            self.arrays[f"own_{name}_{index}"] = corners[::every].astype(np.float32)

    def _edge(self, machine: Machine, columns: Columns) -> F64:
        """The initial edge beside the way, (n, 3) [m]; none for a machine that does not cut."""
        if not machine.cuts:
            return np.zeros((0, 3))
        path = path_of(columns, *machine.sheet.header_end(machine.edge_side))
        way = machine.edge.project(path[:, 0], path[:, 1])[0]
        points = machine.edge.point_at(np.arange(float(way.min()) - 8.0, float(way.max()) + 25.0, EDGE_STEP))
        points = points[np.asarray(self.world.field.covers(points[:, 0], points[:, 1]), dtype=bool)]
        parts = np.array_split(points, len(points) // MOST_TOGETHER + 1)  # not all pages of the field at once
        return np.concatenate([np.column_stack([p, self.world.field.ground_height(*p.T)]) for p in parts])

    def add_recorded(self, found: Recorded | None) -> None:
        """Scans and straw. found: None where nothing was recorded."""
        self.values |= {"scanners": [], "straw": []}
        if found is None:
            self.notes.append("nothing was recorded: scans and straw are missing")
            return
        names = list(self.machines)
        for index, scanner in enumerate(found.scanners):
            packed = pack_echoes(scanner, MOST_POINTS // len(found.scanners), self.origin)
            if packed.shown < packed.recorded:
                slot = f"{scanner.machine}.{scanner.slot}"
                self.notes.append(f"{packed.shown} of {packed.recorded} scans of {slot} are shown")
            self.arrays |= {f"scan_{what}_{index}": array for what, array in packed.arrays().items()}
            about = {"machine": names.index(scanner.machine), "slot": scanner.slot, "unit_m": packed.unit_m}
            self.values["scanners"].append(about)
        known = {(s.machine, s.slot) for s in found.scanners}
        for name, machine in self.machines.items():
            for slot in machine.slots_of("lidar"):
                if (name, slot) not in known:
                    self.notes.append(f"{name}.{slot}: where its echoes lay in the world is not recorded")
            if name in found.straw:
                self._add_straw(name, found.straw[name])

    def _add_straw(self, name: str, straw: F64) -> None:
        width, is_spread = swath_width(self.machines[name])
        laid = stations(self.tracks[name], straw, width, self.world.field.straw_density)
        if is_spread:
            self.notes.append(f"{name}: chopped straw is not drawn")
        elif laid[:, 1].any():
            listed = self.values["straw"]
            self.arrays[f"straw_{len(listed)}"] = laid.astype(np.float32)
            listed.append({"machine": list(self.machines).index(name), "width": width})


def _heights(heights: F64) -> tuple[NDArray[np.uint16], Values]:
    """Heights as whole numbers of a unit above the lowest."""
    low, unit = float(heights.min()), max(HEIGHT_UNIT, float(np.ptp(heights)) / 65000.0)
    return np.rint((heights - low) / unit).astype(np.uint16), {"low": low, "unit_m": unit}
