"""Objects level `cluster`: what a laser scanner sees stand out of the crop, followed from scan to scan.

Crop is a surface with edges: its walls, corners and gaps run any way, but it is wide. So the ranges along
each line of a scan are closed over the width of the widest thing: that takes away what is narrower than this
and nearer than what lies on both its sides, and keeps every edge. How far an echo lies before the closed
line, in units of how deep the beams beside it get into the crop, is its evidence. It counts where the crop
before the echo does not explain it: where a canopy ends its top is ragged, but there is crop right before it,
about as high. What is wider counts where it is higher than crop can be, which is learned from what the knife
reaches. The evidence of a heap of echoes becomes its confidence. What is lower than the crop it is in is not
found: a fawn, a lying person.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, isfinite, sin, sqrt
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.control.objects.following import FREE, Following
from swath.control.objects.track import Heap, Track
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.frames import Pose
from swath.core.portable import median
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.signals import F64, CropEdge, Objects, Odometry, Scan, beam_directions
from swath.signals.setup import ControlSetup

Index = NDArray[np.int64]
SCALE = 1.5  # ranges up to this ratio are closed over one number of beams
SCALES = np.array([SCALE**k for k in range(-4, 14)])  # from which on each holds, the first nearer, too [m]
LEVEL_BEAM = 0.05  # a beam that goes down less counts as going down so much, per metre


@dataclass(frozen=True)
class Params:
    """Objects among the echoes of a scanner.

    The numbers from doubt_nat on are set on drawn cases (`benchmarks/objects_drawn.py`).

    reach_m: farthest object ahead of the knife
    side_m: farthest object beside the ends of the header
    widest_m: width beyond which a cluster is an object only where it is higher than the crop
    ragged_m: how much crop may be higher than the crop before it, about the spread of wheat's height
    path_m: distance through crop that few beams survive (2 to 12 % in wheat of 1.75 to 3.3 per metre)
    above_m: how much higher than the crop a wide cluster must be
    slope_percent: how much higher still for its distance, on ground that bends
    crop_m: height of the crop until the knife has met some
    crop_sd_m: standard deviation of that height
    stubble_m: height from which on what the knife meets is crop
    least_echoes: fewest echoes of a cluster
    confirm: number of scans that must show an object before it is reported
    keep_s: time for which an object is kept without being seen
    doubt_nat: evidence that clusters of crop have as often as objects have [nat]
    line_deg: beams whose elevations differ by less are of one line of the scan
    front_m: length along a line over which the nearest echo is the front of the crop; no body is narrower
    finest_m: depth into the crop that every scanner may find by its noise and the raggedness of a wall
    least_depths: how far an echo lies before its line where evidence begins, in depths to which the beams
        beside it get into the crop [1]
    most_depths: how far an echo lies before its line where the evidence of one echo ends, in the same depths
        [1]
    stems_m: echoes nearer to each other than this see the same stems
    cell_m: side of a cell; echoes in one cell, or with at most one empty cell between them, are one cluster
    body_m: half the width of a body: over it the evidence of a cluster is summed, and beyond it lies the
        surface before
    around_m: how far around a cluster the surface lies where none is known before it
    blind_mrad: an object whose top lies less than this above the lowest beam can get lost
    memory_s: time for which a height of the map counts; no machine drives half of the map in it
    first_cells: cells of the map that crop_m counts for, some 10 m of travel across a header
    lasting_cells: cells over which the height of the crop is a mean, some 500 m of travel
    """

    reach_m: Annotated[float, Gt(0), Le(100)] = 20.0
    side_m: Annotated[float, Ge(0), Le(50)] = 8.0
    widest_m: Annotated[float, Gt(0.5), Le(10)] = 1.6
    ragged_m: Annotated[float, Ge(0), Le(1)] = 0.1
    path_m: Annotated[float, Ge(0), Le(10)] = 1.2
    doubt_nat: Annotated[float, Gt(0), Le(100)] = 10.0
    above_m: Annotated[float, Gt(0), Le(3)] = 0.35
    slope_percent: Annotated[float, Ge(0), Le(20)] = 1.5
    crop_m: Annotated[float, Gt(0), Le(5)] = 1.0
    crop_sd_m: Annotated[float, Gt(0), Le(2)] = 0.4
    stubble_m: Annotated[float, Ge(0), Le(2)] = 0.4
    least_echoes: Annotated[int, Ge(1), Le(1000)] = 3
    confirm: Annotated[int, Ge(1), Le(20)] = 2
    keep_s: Annotated[float, Ge(0), Le(10)] = 1.0
    line_deg: Annotated[float, Gt(0), Le(5)] = 0.25
    front_m: Annotated[float, Gt(0), Le(2)] = 0.35
    finest_m: Annotated[float, Gt(0), Le(1)] = 0.1
    least_depths: Annotated[float, Gt(0), Le(20)] = 1.5
    most_depths: Annotated[float, Gt(0), Le(100)] = 5.0
    stems_m: Annotated[float, Gt(0), Le(1)] = 0.05
    cell_m: Annotated[float, Gt(0), Le(2)] = 0.25
    body_m: Annotated[float, Gt(0), Le(2)] = 0.4
    around_m: Annotated[float, Gt(0), Le(10)] = 1.5
    blind_mrad: Annotated[float, Ge(0), Le(500)] = 50.0
    memory_s: Annotated[float, Gt(0), Le(60)] = 10.0
    first_cells: Annotated[float, Ge(1), Le(1e5)] = 400.0
    lasting_cells: Annotated[float, Ge(1), Le(1e7)] = 20_000.0


class Cluster(Following):
    """Takes every scan; the sample holds at the end of the step."""

    kept = (*Following.kept, "_map", "_crop")

    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry, optional=True),
        Port("edge", CropEdge, optional=True),
    )
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(setup, "scan", params.side_m, params.confirm, params.keep_s, params.doubt_nat)
        self._p, self._lines = params, Lines(self._mounting, params)
        self._across = np.arange(self._strip[0] + params.side_m, self._strip[1] - params.side_m, MAP_CELL)
        self._map, self._crop = HeightMap(params.memory_s), CropHeight(params)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._map, self._crop = HeightMap(self._p.memory_s), CropHeight(self._p)
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects at t + dt."""
        now = t + dt
        speed, _ = self._go(inputs["odometry"], dt / NS)
        scan: Scan | None = inputs["scan"]
        if scan is not None and scan.t != self._seen:
            self._seen = scan.t
            self._learn(now / NS, inputs["edge"])
            ranges, points = self._image(scan, speed, (now - scan.t) / NS)
            heaps = self._heaps(now / NS, ranges, points)
            lowest = float(scan.elevation.min())
            self._tracks.update(now / NS, heaps, lambda track: self._is_under(track, lowest))
        return {"objects": self._sample(now)}

    def _is_under(self, track: Track, lowest: float) -> bool:
        """Whether a thing before the machine lies under the lowest beam, where the scanner is blind."""
        x, y = self._ahead(track)
        if x < self._knife:
            return False
        seen = self._mounting.inverse().apply(np.array([x, y, track.heap.top]))
        return (
            atan2(float(seen[2]), hypot(float(seen[0]), float(seen[1]))) < lowest + 1e-3 * self._p.blind_mrad
        )

    def _image(self, scan: Scan, speed: float, age: float) -> tuple[F64, F64]:
        """Farthest echo of each beam: ranges (lines, beams) and where it is now (lines, beams, 3) [m], seen
        from the machine that drove on since; nan = none.
        """
        order = self._lines.of(scan)
        farthest = np.fmax.reduce(scan.ranges, axis=1).astype(np.float64)[order]
        points = self._mounting.position + self._lines.ways * farthest[..., None]
        points[..., 0] += speed * (scan.beam_t[order] - age)
        return farthest, points

    def _learn(self, t: float, edge: CropEdge | None) -> None:
        """The height of the crop: what stood where the knife is now, and what the edge's finder says."""
        x, y = self._world(np.full(len(self._across), self._knife), self._across)
        tops = self._map.tops(t, x, y)
        self._crop.take(tops[tops > self._p.stubble_m])
        if edge is not None and edge.is_found and isfinite(edge.crop_height):
            self._crop.take(np.array([edge.crop_height]))

    def _world(self, x: F64, y: F64) -> tuple[F64, F64]:
        px, py, yaw = self._pose
        c, s = cos(yaw), sin(yaw)
        return px + c * x - s * y, py + s * x + c * y

    def _heaps(self, t: float, ranges: F64, points: F64) -> list[Heap]:
        """What stands out, in the frame of the dead reckoning."""
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        ahead = x - self._knife
        inside = (ahead > FREE) & (ahead < self._p.reach_m) & (y > self._strip[0]) & (y < self._strip[1])
        evidence = self._evidence(ranges, inside)
        wx, wy = self._world(x, y)
        rises, to_left = self._map.slope
        ground = rises * (wx - self._pose[0]) + to_left * (wy - self._pose[1])
        bound = self._crop.most + self._p.above_m + 0.01 * self._p.slope_percent * ahead
        is_high = inside & (z > bound + np.maximum(ground, 0.0))
        shown = (evidence > 0.0) | is_high
        surface = ~shown & (ahead > -1.0) & (ahead < MAP_AHEAD) & (np.abs(y) < MAP_ASIDE)
        self._map.take(t, wx[surface], wy[surface], z[surface])
        weight = np.minimum(ranges[shown] * self._lines.step / self._p.stems_m, 1.0)
        most = self._p.most_depths - self._p.least_depths
        seen = np.column_stack([points[shown], evidence[shown] * weight, most * weight * is_high[shown]])
        parts = heaps_of(seen, self._p.cell_m)
        return [heap for part in parts if (heap := self._heap(t, part)) is not None]

    def _evidence(self, ranges: F64, asked: NDArray[np.bool_]) -> F64:
        """How much the echoes asked for speak for a thing before the crop, in nat; 0 for all others."""
        before, depth = self._lines.standing_out(ranges, asked, self._p.widest_m)
        depths = np.clip(before / np.maximum(depth, self._p.finest_m), 0.0, self._p.most_depths)
        evidence = np.where(asked, depths - self._p.least_depths, 0.0)
        evidence[evidence < 0.0] = 0.0
        beside = np.zeros_like(evidence)
        beside[:, 1:] = evidence[:, :-1]
        beside[:, :-1] = np.maximum(beside[:, :-1], evidence[:, 1:])
        return np.where(beside > 0.0, evidence, 0.0)

    def _heap(self, t: float, echoes: F64) -> Heap | None:
        """Place of a heap of echoes (n, 5), evidence that it is narrow, and high; None where it is crop."""
        if len(echoes) < self._p.least_echoes or echoes[:, 3:].sum() < self._p.least_depths:
            return None
        eye = self._mounting.position
        steep = (eye[2] - echoes[:, 2]) / np.sqrt(((echoes[:, :3] - eye) ** 2).sum(axis=1))
        above = echoes[:, 2] - self._before(t, echoes)
        is_other = (above > self._p.ragged_m) | (above < -self._p.path_m * steep)
        evidence = np.maximum(echoes[:, 3] * is_other, echoes[:, 4])
        counted, evidence = echoes[evidence > 0.0], evidence[evidence > 0.0]
        if len(counted) < self._p.least_echoes:
            return None
        apart = np.abs(counted[:, None, :2] - counted[None, :, :2]).max(axis=2)
        total = float(((apart < self._p.body_m) * evidence).sum(axis=1).max())
        if total < self._p.least_depths:
            return None
        low, high = counted[:, :3].min(axis=0), counted[:, :3].max(axis=0)
        x, y = self._world(*(0.5 * (low[:2] + high[:2])))
        length, width = np.maximum(high[:2] - low[:2], self._p.cell_m).tolist()
        return Heap(float(x), float(y), length, width, float(high[2]), total)

    def _before(self, t: float, echoes: F64) -> float:
        """Height of the surface before a heap, seen from the scanner, as far as two lines can lie apart [m];
        where none is known that of what lies around it, else that of crop.
        """
        eye = self._mounting.position
        to = echoes[:, :2] - eye[:2]
        far = np.sqrt((to * to).sum(axis=1))
        ux, uy = (to.mean(axis=0) / far.mean()).tolist()
        down = max(float(eye[2] - echoes[:, 2].max()), 0.1)
        apart = min(max(1.2 * self._lines.apart * float(far.min()) ** 2 / down, 1.0), 3.0)
        clear, aside = self._p.body_m, self._p.body_m * np.array([-1.0, 0.0, 1.0])
        along = far.min() - np.arange(clear, clear + apart, 0.5 * MAP_CELL)[:, None]
        x, y = echoes[:, :2].mean(axis=0).tolist()
        tops = self._tops_at(t, x, y, eye[0] + ux * along - uy * aside, eye[1] + uy * along + ux * aside)
        if not np.isfinite(tops).any():
            tops = self._tops_at(t, x, y, *(np.array([[x], [y]]) + self._p.around_m * AROUND))
        return float(np.nanmax(tops)) if np.isfinite(tops).any() else self._crop.most

    def _tops_at(self, t: float, x: float, y: float, px: F64, py: F64) -> F64:
        """Tops of the places px, py, brought along the slope of the field to x, y."""
        wx, wy = self._world(px, py)
        here = self._world(np.array(x), np.array(y))
        rises, to_left = self._map.slope
        return self._map.tops(t, wx, wy) + rises * (here[0] - wx) + to_left * (here[1] - wy)


MAP_CELL, MAP_SIZE = 0.5, 96  # of the map of heights [m], and its cells each way
RUN, FEWEST = 4, 20  # cells over which the slope is taken, and pairs of them that show it
MAP_AHEAD, MAP_ASIDE = 40.0, 20.0  # what is farther from the knife would come round onto other cells [m]
AROUND = np.array([(cos(a), sin(a)) for a in np.arange(0.0, 6.2, 0.5)]).T  # directions around a place


class HeightMap(KeepsState):
    """Top of what stands on each cell of the ground, in the frame of the dead reckoning; it goes on round.

    memory: a height counts so long [s]
    slope: of its surfaces along x and y of that frame; most neighbours are of one surface, edges count little
    """

    kept = ("_top", "_seen", "slope")

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._top = np.full(MAP_SIZE * MAP_SIZE, np.nan)
        self._seen = np.full(MAP_SIZE * MAP_SIZE, -np.inf)
        self.slope = (0.0, 0.0)

    def take(self, t: float, x: F64, y: F64, z: F64) -> None:
        """Heights z [m] seen at t [s]: the highest in each cell."""
        top = np.full(MAP_SIZE * MAP_SIZE, -np.inf)
        np.maximum.at(top, _cell(x, y), z)
        is_new = top > -np.inf
        self._top[is_new], self._seen[is_new] = top[is_new], t
        grid = np.where(is_new, top, np.nan).reshape(MAP_SIZE, MAP_SIZE)
        self.slope = (_slope(grid), _slope(grid.T))

    def tops(self, t: float, x: F64, y: F64) -> F64:
        """Heights there [m], nan = not known."""
        cell = _cell(x, y)
        return np.where(t - self._seen[cell] > self._memory, np.nan, self._top[cell])


def _slope(grid: F64) -> float:
    """Median slope along the first axis between cells that lie RUN apart; 0 where few are known."""
    rise = grid - np.roll(grid, RUN, axis=0)
    rise = rise[np.isfinite(rise)]
    return median(rise) / (RUN * MAP_CELL) if len(rise) >= FEWEST else 0.0


def _cell(x: F64, y: F64) -> Index:
    i, j = (np.floor(v / MAP_CELL).astype(np.int64) % MAP_SIZE for v in (x, y))
    return np.asarray(i * MAP_SIZE + j)


class CropHeight(KeepsState):
    """Height of the crop: mean and spread of what was met, at first what the parameters say."""

    kept = ("_count", "_mean", "_square")

    def __init__(self, params: Params) -> None:
        self._lasting = params.lasting_cells
        self._count, self._mean = params.first_cells, params.crop_m
        self._square = params.crop_sd_m * params.crop_sd_m

    def take(self, tops: F64) -> None:
        """Heights that were met [m]."""
        for top in tops.tolist():
            self._count = min(self._count + 1.0, self._lasting)
            off, share = top - self._mean, 1.0 / self._count
            self._mean += share * off
            self._square += share * (off * off - self._square)

    @property
    def most(self) -> float:
        """Crop is hardly higher [m]."""
        return self._mean + 2.0 * sqrt(self._square)


class Lines:
    """The lines of a scan: beams of one elevation, by azimuth."""

    def __init__(self, mounting: Pose, params: Params) -> None:
        self._mounting, self._front, self._line = mounting, params.front_m, params.line_deg * DEG
        self._azimuth: Any = None
        self._elevation: Any = None

    def of(self, scan: Scan) -> Index:
        """Beams (lines, beams) of a scan.

        ways: their directions in the machine's frame (lines, beams, 3); down: how far each comes down per
        metre; step, apart: between two beams and two lines [rad]
        """
        if scan.azimuth is not self._azimuth or scan.elevation is not self._elevation:
            self._azimuth, self._elevation = scan.azimuth, scan.elevation
            line = np.round(scan.elevation / self._line)
            order = np.lexsort((scan.azimuth, line))
            order = order[np.isfinite(scan.azimuth[order])]
            starts = np.flatnonzero(np.diff(line[order], prepend=np.nan))
            rows = np.split(order, starts[1:])
            most = max(len(row) for row in rows)
            self._order = np.stack([np.pad(row, (0, most - len(row)), mode="edge") for row in rows])
            a, e = scan.azimuth[self._order], scan.elevation[self._order]
            self.ways = self._mounting.turn(beam_directions(a, e))
            self.down = np.maximum(-self.ways[..., 2], LEVEL_BEAM)
            gaps = np.diff(a, axis=1)
            heights = np.unique(line[order]) * self._line
            self.apart = median(np.diff(heights)) if len(heights) > 1 else 0.0
            self.step = median(gaps[gaps > 1e-6]) if (gaps > 1e-6).any() else 1.0
        return self._order

    def standing_out(self, ranges: F64, asked: NDArray[np.bool_], widest: float) -> tuple[F64, F64]:
        """How far the echoes asked for lie before their line, closed over `widest`, and how deep beams there
        get into what they meet [m].

        The lines are closed by how far the beams came down: by that a canopy is even at every azimuth, as is
        a wall across the way.
        """
        drops = ranges * self.down
        before, depth = np.zeros_like(ranges), np.ones_like(ranges)
        scale = np.zeros(ranges.shape, dtype=np.int64)
        scale[asked] = np.searchsorted(SCALES[1:], ranges[asked], side="right")
        for k in np.unique(scale[asked]).tolist():
            mine = asked & (scale == k)
            rows = np.flatnonzero(mine.any(axis=1))
            beam = self.step * SCALES[k] * SCALE**0.5
            narrow, wide = max(int(self._front / beam), 1), max(ceil(widest / beam), 3)
            closed = closing(drops[rows], narrow, wide) / self.down[rows]
            deeper = np.minimum(np.abs(ranges[rows] - closed), 1.0)
            reach = _mean_around(deeper, max(ceil(2.0 * widest / beam), 3))
            mine = mine[rows]
            before[rows] = np.where(mine, closed - ranges[rows], before[rows])
            depth[rows] = np.where(mine, reach, depth[rows])
        return before, depth


def closing(ranges: F64, narrow: int, wide: int) -> F64:
    """Fronts of the lines of an image, the nearest of `narrow` beams around each, closed over `wide`.

    A beam without an echo says nothing; beyond the ends of a line may be anything.
    """
    a = np.where(np.isnan(ranges), np.inf, ranges)
    left, right = (
        np.pad(a[:, :-1], ((0, 0), (1, 0)), mode="edge"),
        np.pad(a[:, 1:], ((0, 0), (0, 1)), mode="edge"),
    )
    middle = np.maximum(
        np.minimum(left, a), np.minimum(np.maximum(left, a), right)
    )  # of three: no single beam
    side = narrow // 2
    front = _over(
        np.pad(middle, ((0, 0), (side, side)), constant_values=np.inf), 2 * side + 1, np.minimum, np.inf
    )
    front = front[:, : a.shape[1]]
    known = np.where(np.isinf(front), 0.0, front)
    farthest = _over(np.pad(known, ((0, 0), (wide, wide))), wide + 1, np.maximum, 0.0)
    return _over(farthest, wide + 1, np.minimum, np.inf)[:, : a.shape[1]]


def _over(a: F64, count: int, least: Callable[..., F64], nothing: float) -> F64:
    """The extreme of `count` beams of a line from each one on."""
    done = 1
    while done < count:
        by = min(done, count - done)
        shifted = np.full_like(a, nothing)
        shifted[:, :-by] = a[:, by:]
        a = least(a, shifted)
        done += by
    return a


def _mean_around(a: F64, count: int) -> F64:
    """Mean of `count` beams to both sides of each, as far as they said something."""
    known = np.isfinite(a)
    sums = [
        np.cumsum(np.pad(v, ((0, 0), (count + 1, count))), axis=1)
        for v in (np.where(known, a, 0.0), 1.0 * known)
    ]
    total, n = (s[:, 2 * count + 1 :] - s[:, : -2 * count - 1] for s in sums)
    return np.asarray(total / np.maximum(n, 1.0))


def heaps_of(points: F64, cell: float) -> list[F64]:
    """Points (n, 2 or more) in heaps: those with at most one empty cell [m] of the ground between them."""
    if len(points) == 0:
        return []
    cells, owner = np.unique(np.floor(points[:, :2] / cell).astype(np.int64), axis=0, return_inverse=True)
    apart = np.abs(cells[:, None] - cells[None]).max(axis=2)
    label = np.arange(len(cells))
    while True:
        lowest = np.where(apart <= 2, label[None], len(cells)).min(axis=1)
        if (lowest == label).all():
            break
        label = lowest
    of_point = label[owner.ravel()]
    return [points[of_point == k] for k in np.unique(of_point)]


LEVEL = Level(
    Cluster,
    Params,
    summary="heaps of echoes that stand out of the crop in a laser scan, followed from scan to scan",
    cost="2 ms per scan",
    tolerance="place of a person within 0.3 m; nothing that is lower than the crop it is in",
)
