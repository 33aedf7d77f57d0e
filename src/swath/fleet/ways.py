"""Ways of machines over free ground: the shortest that a body with its turning radius can drive.

What is found is a `Track`: the places of the machine along it, samples at most 0.5 m apart.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.control.turns import TurnLimits, clothoid
from swath.control.turns.dubins import Place as Pose
from swath.core.portable import arctan2
from swath.fleet.ground import CELL, Grid, cells_of
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Body, Drive, Place, Rectangle
from swath.kernels import filled, launch, member_array

Array = NDArray[np.float64]
SAMPLE = 0.5  # m between the samples of a track, of which the search looks at every other one
ROOM = 60_000  # poses that are kept
SLOTS = 1 << 17  # for bins in which it keeps one pose of a heading, as in search.cpp
PATCH = 2.5  # m, radius of parts of a body that are looked up at once; no way depends on it
COARSE = 2.0  # m, cells of its heuristic, as in search.cpp, and the length of its arcs
TURNS = 8  # headings of its estimate, as in search.cpp, of which each is three of the search
DENSE = 0.9 * CELL  # m between points on the sides of a body
SEARCH, LANES, CHECK = 0, 1, 2  # what it is asked for, as in search.cpp
NOTHING = np.zeros(2)
POINT = Body((Rectangle(0.0, 0.0, 0.0, 0.0),))


@dataclass(frozen=True)
class Params:
    """poses: half of it are looked at, and more to a goal farther off, a twelfth of it once a way is found.

    creep_m_s: at which a bend that cannot be eased is driven
    ramp_m: over which bends grow and fade, a combine's steering at walking pace
    ease: weight of a bend that is changed against a metre of length
    ease_m: of a piece that counts so
    shrink: share of a piece that is left at least, sharper: by which a bend changes at most in a step of
        easing
    rolled: times of the least that a way can take, up to which a turn that is rolled through is taken without
        a search
    stray_m: that an eased way may be nearer to closed ground than the searched one
    near: radii, within which a turn is tried before a search
    line_deg: of a trailer that is in line at the end of a way, a third of it beside a header, where its end
        is off less than the lane is clear; of the search: shot_m: to the goal, within which each pose is
        joined to it, farther off each 16th
    later_s: ground that is free so much after the start counts in the estimate of what is left, which counts
        `weight` times
    off_m: more of it where no way with turns is known
    rough_m: by what it may be too far with turns
    bend_rad: of a trailer at the end of a bend, which comes in line on a straight
    poses_m: that are looked at for each metre to the goal. Estimates, those of the search such that drawn
        fields are planned fast.
    """

    poses: int = 3_000
    creep_m_s: float = 0.3
    ramp_m: float = 3.0
    ease: float = 0.1
    ease_m: float = 5.0
    shrink: float = 0.04
    sharper: float = 0.1
    rolled: float = 1.25
    stray_m: float = 0.1
    near: float = 10.0
    line_deg: float = 6.0
    shot_m: float = 25.0
    later_s: float = 1000.0
    weight: float = 1.5
    off_m: float = 300.0
    bend_rad: float = 0.7
    poses_m: float = 3.0
    rough_m: float = 12.0


PARAMS = Params()


@dataclass(frozen=True)
class Track:
    """places: x, y [m], heading, heading of the trailer [rad], shape (n, 4), unwrapped; distance [m]: driven
    up to each, (n,); ways: +1 forwards, -1 backwards, of each step, (n - 1,); bends [1/m] of each step.
    """

    places: Array
    distance: Array
    ways: Array
    bends: Array

    @property
    def length(self) -> float:
        """Driven [m]."""
        return float(self.distance[-1])

    @property
    def start(self) -> Place:
        """Place where the path begins."""
        return Place(*self.places[0].tolist())

    @property
    def end(self) -> Place:
        """Place where the path ends."""
        return Place(*self.places[-1].tolist())


def straight(start: Place, length: float, body: Body, spacing: float = SAMPLE) -> Track:
    """Straight on, forwards."""
    return driven(start, [(0.0, length)], body, spacing)


def driven(start: Place, pieces: Sequence[tuple[float, float]], body: Body, spacing: float = SAMPLE) -> Track:
    """Pieces (curvature [1/m], length [m], < 0 backwards), one after the other; a trailer is dragged."""
    bends, steps = [], []
    for bend, length in pieces:
        count = math.ceil(abs(length) / spacing - 1e-9)
        if count:
            bends += [bend] * count
            steps += [length / count] * count
    return _rolled(start, np.array(bends, float), np.array(steps, float), body)


def _rolled(start: Place, k: Array, d: Array, body: Body) -> Track:
    """Steps of curvatures [1/m] and lengths [m], < 0 backwards, one after the other."""
    heading = start.heading + np.concatenate([[0.0], np.cumsum(k * d)])
    chord = np.where(np.abs(k * d) < 1e-9, d, 2.0 * np.sin(0.5 * k * d) / np.where(k == 0.0, 1.0, k))
    middle = heading[:-1] + 0.5 * k * d
    x = start.x + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = start.y + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    trailer = _dragged(x, y, heading, start.trailer, body) if body.has_trailer else heading
    distance = np.concatenate([[0.0], np.cumsum(np.abs(d))])
    return Track(np.column_stack([x, y, heading, trailer]), distance, np.where(d < 0.0, -1.0, 1.0), k)


def abreast(track: Track, ahead: float, left: float, body: Body, first: int, last: int) -> Track:
    """The way of who keeps so far ahead and to the left [m] of a machine between samples of its way, which
    goes straight on behind its end; a trailer is in line at first.
    """
    begin = int(np.flatnonzero(track.ways[:first] < 0.0).max(initial=-1)) + 1
    s = track.distance[first : last + 1] + ahead
    x, y, heading = (np.interp(s, track.distance[begin:], column[begin:]) for column in track.places.T[:3])
    over = s - np.clip(s, track.distance[begin], track.length)
    x, y = (
        x + over * np.cos(heading) - left * np.sin(heading),
        y + over * np.sin(heading) + left * np.cos(heading),
    )
    step = np.maximum(np.hypot(np.diff(x), np.diff(y)), 1e-6)
    bends = np.round(np.diff(heading) / step, 9) + 0.0
    is_bent = body.has_trailer and bends.any()
    trailer = _dragged(x, y, heading, float(heading[0]), body) if is_bent else heading
    distance = np.concatenate([[0.0], np.cumsum(step)])
    return Track(np.column_stack([x, y, heading, trailer]), distance, np.ones(len(step)), bends)


def eased(start: Place, pieces: Sequence[tuple[float, float]], body: Body, ramp: float) -> Track | None:
    """The same with bends that grow and fade over a length [m], as steering takes time: each curvature is the
    mean over that length, up to where it stands; pieces are stretched a little so that it ends where they do.
    None where that is too much.
    """
    bends, lengths = np.array(merged(pieces)).T
    goal = _ends(start, bends, lengths)[-1]
    first = lengths.copy()
    for _ in range(12):
        k, d = _mean_bends(bends, lengths, ramp)
        heading: Array = start.heading + np.concatenate([[0.0], np.cumsum(k * d)])
        middle = heading[:-1] + 0.5 * k * d
        chord = d * np.sinc(0.5 * k * d / math.pi)
        off = goal - (
            start.x + (chord * np.cos(middle)).sum(), start.y + (chord * np.sin(middle)).sum(), heading[-1]
        )  # fmt: skip
        if np.abs(off).max() < 1e-6:
            return _rolled(start, k, d, body)
        ends = _ends(start, bends, lengths)
        mids = 0.5 * (ends[1:] + ends[:-1])
        way = np.sign(lengths)
        stretch = np.array([
            np.cos(ends[1:, 2]) * way - bends * way * (goal[1] - ends[1:, 1]),
            np.sin(ends[1:, 2]) * way + bends * way * (goal[0] - ends[1:, 0]),
            bends * way,
        ])  # fmt: skip
        bent = (
            lengths * bends * np.array([-(goal[1] - mids[:, 1]), goal[0] - mids[:, 0], np.ones(len(bends))])
        )
        both = np.concatenate([stretch, bent], axis=1)
        weight = np.concatenate([np.minimum(np.abs(first), PARAMS.ease_m), np.full(len(bends), PARAMS.ease)])
        a, b, c = np.einsum("in,jn->ij", both * weight, both)  # and its inverse by minors
        minors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        size = float((a * minors[0]).sum())
        if not abs(size) > 1e-9:
            return None
        change = weight * np.einsum("in,ki,k->n", both, minors, off) / size
        lengths = lengths + way * change[: len(bends)]
        bends = bends * (1.0 + change[len(bends) :])
        shrunk = (lengths * first < PARAMS.shrink * first**2).any()
        if shrunk or np.abs(change[len(bends) :]).max() > PARAMS.sharper:
            return None
    return None


def eased_where_clear(
    start: Place, pieces: Sequence[tuple[float, float]], body: Body, speed: float,
    is_clear: Callable[[Track, float], bool], later: float = 0.0,
) -> Track:  # fmt: skip
    """Pieces eased as one where that is clear; else in two parts that meet on the straight nearest to the
    middle; where there is none, over less, and at last not at all.

    is_clear: of a part, and how much later than the first it begins [s]; speed: [m/s], for that alone
    """
    inner = [
        i for i, (bend, length) in enumerate(pieces[1:-1], 1) if bend == 0.0 and abs(length) >= PARAMS.ramp_m
    ]
    for part in (1.0, 0.5, 0.25):
        made = eased(start, pieces, body, part * PARAMS.ramp_m)
        if made is not None and is_clear(made, later):
            return made
        if made is not None and inner:
            break
    if not inner:
        return driven(start, pieces, body)
    ends = np.cumsum([abs(length) for _, length in pieces])
    at = min(inner, key=lambda i: abs(ends[i] - 0.5 * ends[-1]))
    half = 0.0, 0.5 * pieces[at][1]
    first = eased_where_clear(start, [*pieces[:at], half], body, speed, is_clear, later)
    later += first.length / speed
    rest = eased_where_clear(first.end, [half, *pieces[at + 1 :]], body, speed, is_clear, later)
    return joined([first, rest])


def merged(pieces: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The same pieces, those alike that follow each other as one."""
    out: list[tuple[float, float]] = []
    for bend, length in pieces:
        if out and out[-1][0] == bend and out[-1][1] * length > 0.0:
            out[-1] = bend, out[-1][1] + length
        else:
            out.append((bend, length))
    return out


def _ends(start: Place, bends: Array, lengths: Array) -> Array:
    """x, y, heading at the ends of pieces, (n + 1, 3)."""
    heading = start.heading + np.concatenate([[0.0], np.cumsum(bends * lengths)])
    middle = heading[:-1] + 0.5 * bends * lengths
    chord = lengths * np.sinc(0.5 * bends * lengths / math.pi)
    x = start.x + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = start.y + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    return np.column_stack([x, y, heading])


def _mean_bends(bends: Array, lengths: Array, ramp: float) -> tuple[Array, Array]:
    """Curvatures and signed lengths of steps, curvatures as means over a length [m] along what is driven in
    one direction.
    """
    out_k, out_d = [], []
    turned = np.flatnonzero(np.diff(np.sign(lengths)) != 0.0) + 1
    for part in np.split(np.arange(len(bends)), turned):
        k, d = bends[part], np.abs(lengths[part])
        total = float(d.sum())
        half = 0.5 * min(ramp, total)
        knots = np.concatenate([[-half], np.cumsum(d)[:-1], [total + half]])
        span = np.diff(knots)
        angle = np.concatenate([[0.0], np.cumsum(k * span)])
        area = np.concatenate([[0.0], np.cumsum((angle[:-1] + 0.5 * k * span) * span)])
        at = np.linspace(0.0, total, max(1, math.ceil(total / SAMPLE - 1e-9)) + 1)

        def summed(
            s: Array, knots: Array = knots, k: Array = k, angle: Array = angle, area: Array = area
        ) -> Array:
            i = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(k) - 1)
            u = s - knots[i]
            return area[i] + (angle[i] + 0.5 * k[i] * u) * u

        mean = (summed(at + half) - summed(at - half)) / (2.0 * half)
        step = np.diff(at)
        out_k.append(np.round(np.diff(mean) / step, 12) + 0.0)
        out_d.append(step * np.sign(lengths[part[0]]))
    return np.concatenate(out_k), np.concatenate(out_d)


def _dragged(x: Array, y: Array, heading: Array, first: float, body: Body) -> Array:
    """Headings of a trailer whose axle stays on the line to the pin, (n,)."""
    pins = np.column_stack([x + body.hitch * np.cos(heading), y + body.hitch * np.sin(heading)]).tolist()
    far = body.drawbar
    tx, ty = pins[0][0] - far * math.cos(first), pins[0][1] - far * math.sin(first)
    along = []
    for u, v in pins[1:]:
        dx, dy = u - tx, v - ty
        share = far / math.sqrt(dx * dx + dy * dy)
        tx, ty = u - share * dx, v - share * dy
        along.append((dx, dy))
    dx, dy = np.array(along).reshape(-1, 2).T
    return np.unwrap(np.concatenate([[first], arctan2(dy, dx)]))


def behind(first: Track, then: Track, body: Body) -> Track:
    """Two tracks one after the other; the trailer comes to the second as it leaves the first."""
    if body.has_trailer:
        x, y, heading, _ = then.places.T
        trailer = _dragged(x, y, heading, float(first.places[-1, 3]), body)
        then = Track(np.column_stack([x, y, heading, trailer]), then.distance, then.ways, then.bends)
    return joined([first, then])


def joined(tracks: list[Track]) -> Track:
    """Tracks driven one after the other as one; each begins where the one before ends."""
    tracks = [t for t in tracks if len(t.places) > 1] or tracks[:1]
    places, distance = [tracks[0].places], [tracks[0].distance]
    for track in tracks[1:]:
        last = places[-1][-1]
        turns = np.round((last[2:] - track.places[0, 2:]) / (2.0 * math.pi)) * 2.0 * math.pi
        places.append(track.places[1:] + np.concatenate([[0.0, 0.0], turns]))
        distance.append(track.distance[1:] + distance[-1][-1])
    return Track(
        np.concatenate(places), np.concatenate(distance),
        np.concatenate([t.ways for t in tracks]), np.concatenate([t.bends for t in tracks]),
    )  # fmt: skip


def stops_along(track: Track, drive: Drive) -> dict[int, float]:
    """Samples of a track at which a machine stands, and how long [s]: until it is shifted from forwards to
    backwards, or steered where a bend changes faster than it is steered on the way.
    """
    over = 0.5 * (np.diff(track.distance)[1:] + np.diff(track.distance)[:-1])
    change = np.abs(np.diff(track.bends))
    turned = np.diff(track.ways) != 0.0
    steers = change / drive.steering
    at = np.flatnonzero(turned | (change * PARAMS.creep_m_s > drive.steering * over))
    spent = np.where(turned, np.maximum(drive.shift, steers), steers)
    return {int(i) + 1: float(spent[i]) for i in at}


def limits_along(track: Track, drive: Drive, top: float | None = None) -> Array:
    """Highest speed at each sample of a track [m/s], (n,): in bends that of the drive's tightest turn at its
    acceleration to the side, where a bend changes that of the steering, on reversing its own; 0 at the ends
    and where it stands. Not by how it speeds up.
    """
    fast = drive.straight if top is None else top
    bend = np.abs(track.bends) * drive.radius
    limit = np.minimum(drive.straight, drive.turning / np.sqrt(np.maximum(bend, 1e-9)))
    limit = np.minimum(np.where(track.ways < 0.0, drive.backwards or drive.turning, limit), fast)
    speed: Array = np.minimum(np.concatenate([[0.0], limit]), np.concatenate([limit, [0.0]]))
    over = 0.5 * (np.diff(track.distance)[1:] + np.diff(track.distance)[:-1])
    changed = np.maximum(np.abs(np.diff(track.bends)), 1e-9)
    speed[1:-1] = np.minimum(speed[1:-1], np.maximum(drive.steering * over / changed, PARAMS.creep_m_s))
    speed[list(stops_along(track, drive))] = 0.0
    return speed


def spent_along(track: Track, drive: Drive, first: Any, last: Any) -> Array:
    """Least time between samples of a track that is not driven from a stop [s], (n,)."""
    limit = limits_along(track, drive)
    limit[[0, -1]] = drive.straight
    slow = np.maximum(np.minimum(limit[:-1], limit[1:]), PARAMS.creep_m_s)
    times = np.concatenate([[0.0], np.cumsum(np.diff(track.distance) / slow)])
    return np.asarray(times[last] - times[first])


def times_along(track: Track, drive: Drive, top: float | None = None) -> Array:
    """Time [s] at each sample of a track driven from and to a stop, (n,).

    top: fastest [m/s], the drive's own by default. Speeds change by the drive's acceleration; where it
    stands, and at both ends, it is steered.
    """
    step = np.diff(track.distance)
    gain = 2.0 * drive.accel * step
    now = (limits_along(track, drive, top) ** 2).tolist()
    for i, g in enumerate(gain.tolist()):
        now[i + 1] = min(now[i + 1], now[i] + g)
    for i in range(len(now) - 2, -1, -1):
        now[i] = min(now[i], now[i + 1] + gain[i])
    speed = np.sqrt(np.array(now))
    spent = step / np.maximum(0.5 * (speed[:-1] + speed[1:]), 0.05)
    for i, time in stops_along(track, drive).items():
        spent[i] += time
    spent[0] += abs(track.bends[0]) / drive.steering
    spent[-1] += abs(track.bends[-1]) / drive.steering
    return np.concatenate([[0.0], np.cumsum(spent)])


def rolled(start: Place, goal: Place, drive: Drive, body: Body) -> Track:
    """The shortest way forwards that is rolled through: as sharp as is steered at the speed of a turn,
    without a stop; what stands there is not looked at.
    """
    if not math.isfinite(drive.steering):
        raise ValueError("expected a drive whose steering takes time")
    limits = TurnLimits(drive.radius, drive.steering / drive.turning)
    pieces = []
    for length, first, last in clothoid.plan(Pose(*start[:3]), Pose(*goal[:3]), limits):
        count = max(1, math.ceil(length / SAMPLE - 1e-9))
        pieces += [(first + (i + 0.5) / count * (last - first), length / count) for i in range(count)]
    return driven(start, [p for p in pieces if p[1] > 1e-9], body)


class Far:
    """Rough distances of all places to or from one, with eight headings and turns of their drive."""

    def __init__(
        self, lanes: NDArray[np.float32], grid: Grid, shape: tuple[int, ...], size: float, there: bool
    ) -> None:
        self.lanes, self.grid, self.there, self.shape, self.size = lanes, grid, there, shape, size

    def __call__(self, place: Place) -> float:
        """Of a place [m], infinite where no way is known."""
        i, j = (
            int((at - low) / self.size) for at, low in ((place.x, self.grid.west), (place.y, self.grid.south))
        )
        heading = place.heading + (math.pi if self.there else 0.0)
        n = (min(max(i, 0), self.shape[0] - 1) * self.shape[1] + min(max(j, 0), self.shape[1] - 1)) * TURNS
        h = math.floor(heading / (2.0 * math.pi / TURNS))
        known = [float(self.lanes[n + k % TURNS]) for k in (h, h + 1)]
        return min((d for d in known if 0.0 <= d < 1e17), default=math.inf)


class _Asked(NamedTuple):
    """A way that is looked for, see `Finder.find`; stand: outlines of all who stand."""

    body: Body
    drive: Drive
    start: Place
    goal: Place
    stand: tuple[Any, ...] = ()
    time: float = 0.0
    gap: float = 0.0
    in_line: float = 0.0
    most: int = PARAMS.poses


class Finder:
    """Searches ways on a grid of free ground; keeps what it has worked out of ground that did not change.

    lane: width of the narrowest ground that is cut between standing crop [m]
    """

    def __init__(self, grid: Grid, lane: float = 10.0) -> None:
        self.grid = grid
        self._lane = 3 if lane >= 9.0 else 2  # coarse cells of a cell of the estimate with headings
        shape, cell = grid.edge.shape, grid.cell
        self._coarse = tuple(-(-n // round(COARSE / cell)) for n in shape)
        self._rows = tuple(-(-n // self._lane) for n in self._coarse)
        cells = self._coarse[0] * self._coarse[1]
        self._found = np.zeros(4100)
        best = np.zeros(2 * SLOTS, np.float32)
        best[SLOTS:].view(np.int32)[:] = -1  # no slot has a bin
        self._lanes = np.zeros(TURNS * math.prod(self._rows), np.float32)
        self._taken = np.zeros(shape, np.uint8)
        self._reachable = np.full(self._coarse, 2e18, np.float32)
        self._bodies: dict[tuple[Body, float], tuple[Array, Array]] = {}
        self._bare, self._within = (np.full(shape, -9.0, np.float32) for _ in range(2))
        self._cells: dict[Any, tuple[slice, slice, NDArray[np.bool_]]] = {}
        self._near: list[Array] = []  # sides of who stands near
        self._seen = 0
        reach = PATCH / cell  # and what middle and points may be off those of their cells
        self._reach_cells = reach + math.sqrt(2.0)
        self._last_cut = 0.0  # s
        self._known: dict[Any, Track | None] = {}  # ways that were asked for since crop was cut
        self._reach(slice(0, shape[0]), slice(0, shape[1]))
        self.searches = 0  # made, not known from before
        from swath.fleet import ground_kernel

        heaps = [np.zeros(4 * ROOM, np.int32) for _ in range(2)]
        self._its = filled(
            ground_kernel.Search, ground=grid.free_from.ravel(), node_rows=np.zeros(11 * ROOM),
            heap_keys=np.zeros(4 * ROOM), heap_nodes=heaps[0], following=heaps[1], best_rows=best,
            distance=np.zeros(cells, np.float32), edge_rows=grid.edge.ravel(),
            reachable_from=self._reachable.ravel(), bare_rows=self._bare.ravel(),
            within_rows=self._within.ravel(), lane_rows=self._lanes, taken_cells=self._taken.ravel(),
            found=self._found,
        )  # fmt: skip

    def _refresh(self) -> None:
        """What has changed on the grid since the last search."""
        for i, j in self.grid.changed[self._seen :]:
            self._reach(i, j)
            more = math.ceil(self._reach_cells)
            rows, columns = (slice(max(s.start - more, 0), s.stop + more) for s in (i, j))
            self._bare[rows, columns] = -9.0
            free = self.grid.free_from[i, j]
            self._last_cut = max(self._last_cut, float(free.max(where=free < 1e17, initial=0.0)))
            self._known.clear()
        self._seen = len(self.grid.changed)

    def _reach(self, i: slice, j: slice) -> None:
        """From when an axle can be in coarse cells: in one of their cells, with all around it free."""
        ratio = round(COARSE / self.grid.cell)
        rows, columns = (
            slice(max(s.start // ratio - 1, 0), min((s.stop - 1) // ratio + 2, n))
            for s, n in zip((i, j), self._coarse, strict=True)
        )
        high, wide = (rows.stop - rows.start) * ratio, (columns.stop - columns.start) * ratio
        around = np.full((high + 2, wide + 2), 2e18, np.float32)
        r, c = rows.start * ratio - 1, columns.start * ratio - 1
        part = self.grid.free_from[max(r, 0) : r + high + 2, max(c, 0) : c + wide + 2]
        part = np.where(part < -1.5, np.float32(2e18), part)
        around[max(-r, 0) :, max(-c, 0) :][: part.shape[0], : part.shape[1]] = part
        for axis in (0, 1):
            k = around.shape[axis]
            a, b, d = (np.take(around, range(s, k - 2 + s), axis=axis) for s in range(3))
            around = np.maximum(np.maximum(a, b), d)
        blocks = around.reshape(rows.stop - rows.start, ratio, columns.stop - columns.start, ratio)
        self._reachable[rows, columns] = blocks.min(axis=(1, 3))

    def find(
        self, body: Body, drive: Drive, start: Place, goal: Place, *, stand: Sequence[Any] = (),
        near: Sequence[Any] = (), time: float = 0.0, gap: float = GAPS.search_m, in_line: float = 0.0,
        most: int = PARAMS.poses, came: Callable[[], Track | None] | None = None,
    ) -> Track | None:  # fmt: skip
        """The way that takes the shortest time from a place to another, None where there is none.

        stand: outlines of machines that stand, as polygons; near: convex ones that cells are too coarse for;
        time: of the start [s]; gap: kept all round the body [m]; in_line: the trailer ends in line within so
        much [deg], 0: as it comes; most: two for each pose that is looked at near the start; came: how it
        came to the start, along which it may go back if nothing else leads on
        """
        self._refresh()
        by = min(time, self._last_cut)  # later nothing changes
        asked = _Asked(body, drive, start, goal, (*stand, *near), by, gap, in_line, most)
        key = asked._replace(stand=(frozenset(stand), frozenset(near))), came is None
        if key in self._known:
            return self._known[key]
        self._near = [_sides(shape) for shape in near]
        windows = [self._window(shape) for shape in stand]
        for i, j, inside in windows:
            self._taken[i, j] |= inside
        try:
            way = self._found_way(asked)
            if way is None and came is not None and (track := came()) is not None:
                way = self._back_out(asked, track)
        finally:
            for i, j, _ in windows:
                self._taken[i, j] = 0
        self._known[key] = way
        return way

    def _window(self, shape: Any) -> tuple[slice, slice, NDArray[np.bool_]]:
        """Cells about a polygon, and which are in it."""
        known = self._cells.get(shape)
        if known is None:
            known = cells_of(shape, self.grid, self._taken.shape)  # type: ignore[arg-type]
            if len(self._cells) > 2000:
                self._cells.clear()
            self._cells[shape] = known
        return known

    def far_from(self, drive: Drive, goal: Place, time: float, *, there: bool) -> "Far":
        """How far it is about to a place, or from there, on ground that is free by a time [s]."""
        self._refresh()
        place = goal if not there else goal._replace(heading=goal.heading + math.pi)
        self._near = []
        self._launch(_Asked(POINT, drive, place, place, time=time), LANES)
        return Far(self._lanes.copy(), self.grid, self._rows, self._lane * COARSE, there)

    def _found_way(self, asked: _Asked) -> Track | None:
        turn, drive = self._turn(asked), asked.drive
        if turn is not None and times_along(turn, drive)[-1] < _least_time(asked.start, asked.goal, drive):
            return turn
        track = self._searched(asked)
        if track is None or turn is None:
            return track or turn
        return min(turn, track, key=lambda t: float(times_along(t, drive)[-1]))

    def _back_out(self, asked: _Asked, came: Track) -> Track | None:
        """Backwards as it came, all of it or no farther than a way needs but for the length of its body, and
        on from there. A pass may end between crop, and nearer to it and to closed ground than ways lead.
        """
        steps, own = (np.diff(came.distance) * came.ways)[::-1], asked.body.own
        long = max(r.front for r in own) - min(r.rear for r in own)
        far = np.concatenate([[0.0], np.cumsum(np.abs(steps))])

        def back_by(count: int) -> Track | None:
            back = _rolled(asked.start, came.bends[::-1][:count], -steps[:count], asked.body)
            way = self._found_way(asked._replace(start=back.end))
            return None if way is None else behind(back, way, asked.body)

        low, high = 0, len(steps)
        best = back_by(high) if high and asked.drive.backwards > 0.0 else None
        while best is not None and far[high] - far[low] > long:
            middle = int(np.searchsorted(far, 0.5 * (far[low] + far[high])))
            found = back_by(middle)
            best, low, high = (best, middle, high) if found is None else (found, low, middle)
        return best

    def _turn(self, asked: _Asked) -> Track | None:
        """A turn that is rolled through, where there is room for one."""
        body, drive, start, goal, *_ = asked
        far = math.dist(start[:2], goal[:2])
        if body.has_trailer or drive.steering == math.inf or far > PARAMS.near * drive.radius:
            return None
        turn = rolled(start, goal, drive, body)
        return turn if self._is_clear(turn, asked) else None

    def _searched(self, asked: _Asked) -> Track | None:
        body, drive, start, *_ = asked
        self._launch(asked, SEARCH)
        self.searches += 1
        count = int(self._found[0])
        if count < 1:
            return None
        rows = self._found[1 : 1 + 2 * count].reshape(-1, 2)[::-1]
        pieces = [(float(k), float(d)) for k, d in rows if abs(d) > 1e-6] or [(0.0, 1e-3)]
        if drive.steering == math.inf or all(bend == 0.0 for bend, _ in pieces):
            return driven(start, pieces, body)

        def is_clear(made: Track, later: float) -> bool:
            return self._is_clear(made, asked._replace(time=asked.time + later))

        return eased_where_clear(start, merged(pieces), body, drive.straight, is_clear)

    def _launch(self, asked: _Asked, mode: int, track: Array = NOTHING) -> None:
        """Run the kernel."""
        from swath.fleet import ground_kernel

        body, drive, start, goal, stand, time, gap, in_line, most = asked
        grid, p = self.grid, PARAMS
        points, patches = self._points(body, gap)
        pin = start.x + body.hitch * math.cos(start.heading), start.y + body.hitch * math.sin(start.heading)
        line = math.cos(math.radians(in_line)) if in_line > 0.0 else -2.0
        circles = np.array([s.bounds for s in stand]).reshape(-1, 4)
        middle, size = 0.5 * (circles[:, :2] + circles[:, 2:]), circles[:, 2:] - circles[:, :2]
        circles = np.column_stack([middle, 0.5 * np.hypot(*size.T) + 1.0])
        far = grid.cell * math.hypot(*self._taken.shape)  # no Dubins path is longer than this and its bends
        samples = math.ceil(far + 15.0 * drive.radius + 10.0 * body.drawbar)  # 1 m apart
        numbers = np.zeros(52 + circles.size)
        numbers[:52] = (
            start.x, start.y, math.cos(start.heading), math.sin(start.heading),
            pin[0] - body.drawbar * math.cos(start.trailer), pin[1] - body.drawbar * math.sin(start.trailer),
            goal.x, goal.y, math.cos(goal.heading), math.sin(goal.heading),
            drive.radius, drive.turning, drive.straight, drive.backwards or 1.0, drive.shift, time,
            grid.cell, grid.west, grid.south, body.has_trailer, body.hitch, body.drawbar,
            drive.backwards > 0.0, ROOM, most, line, mode,
            len(track), *self._taken.shape, COARSE, 3 * TURNS, p.stray_m, len(patches) // 7, p.shot_m,
            p.later_s, len(self._near), self._reach_cells, len(stand), self._lane, p.weight, p.bend_rad,
            p.poses_m, p.poses // 12, p.off_m, *_circle(body.own, gap), *_circle(body.towed, gap),
            4 * ROOM, p.rough_m, samples,
        )  # fmt: skip
        numbers[52:] = circles.ravel()
        sides = np.concatenate([np.concatenate([[len(n)], n.ravel()]) for n in self._near] or [NOTHING])
        changed = {"numbers": numbers, "near_sides": sides, "track_rows": track.ravel()}
        changed |= {"body": points, "patch_rows": patches, "sample_rows": np.empty(7 * samples)}
        for name, array in changed.items():
            setattr(self._its, name, member_array(ground_kernel.Search, name, array))
        launch(ground_kernel.find_way, self._its)

    def _points(self, body: Body, gap: float) -> tuple[Array, Array]:
        """Points on a body, and the patches that they are in, as search.cpp has them."""
        if (body, gap) not in self._bodies:
            points, patches = _patches(body.points(DENSE, gap), PATCH)
            self._bodies[body, gap] = points.ravel(), patches.ravel()
        return self._bodies[body, gap]

    def _is_clear(self, track: Track, asked: _Asked) -> bool:
        """Whether a body is on open ground, but for a little, and off who stands and crop, all along from
        where it begins.
        """
        when = asked.time + track.distance[1:] / asked.drive.straight
        self._launch(asked, CHECK, np.column_stack([track.places[1:], when]))
        return bool(self._found[0])


def _patches(points: Array, radius: float) -> tuple[Array, Array]:
    """Points of a body, sorted, (n, 2), and patches of them: x, y of the middle [m], whether on the trailer,
    whether raised, radius [m], numbers of the first point and the one behind the last, (patches, 7).
    """
    rows, order, count = [], [NOTHING.reshape(-1, 2)[:0]], 0
    for towed, raised in sorted({(t, r) for _, _, t, r in points.tolist()}):
        group = points[(points[:, 2] == towed) & (points[:, 3] == raised)][:, :2]
        low, span = group.min(axis=0), np.ptp(group, axis=0)
        parts = np.maximum(np.ceil(span / (math.sqrt(2.0) * radius)), 1.0)
        cells = np.minimum((group - low) * parts / np.maximum(span, 1e-9), parts - 1.0).astype(int)
        for cell in np.unique(cells, axis=0):
            patch = group[(cells == cell).all(axis=1)]
            middle = 0.5 * (patch.min(axis=0) + patch.max(axis=0))
            far = float(np.hypot(*(patch - middle).T).max())
            rows.append([*middle, towed, raised, far, count, count + len(patch)])
            order.append(patch)
            count += len(patch)
    return np.concatenate(order), np.array(rows).reshape(-1, 7)


def _least_time(start: Place, goal: Place, drive: Drive) -> float:
    """Of which no other way is much faster than one that takes as long [s]."""
    turned = math.remainder(goal.heading - start.heading, 2.0 * math.pi)
    least = max(math.dist(start[:2], goal[:2]) / drive.straight, abs(turned) * drive.radius / drive.turning)
    return PARAMS.rolled * least + 2.0 * drive.shift


def _sides(shape: Any) -> Array:
    """Outward normals of the sides of a convex polygon, and how far each is along them, (n, 3)."""
    points = np.array(shape.exterior.coords)
    d = np.diff(points, axis=0)
    area = float((points[:-1, 0] * points[1:, 1] - points[1:, 0] * points[:-1, 1]).sum())
    d = d[np.hypot(*d.T) > 1e-6] * math.copysign(1.0, area)
    at = points[:-1][np.hypot(*np.diff(points, axis=0).T) > 1e-6]
    normal = np.column_stack([d[:, 1], -d[:, 0]]) / np.hypot(*d.T)[:, None]
    return np.column_stack([normal, (normal * at).sum(axis=1)])


def _circle(parts: tuple[Rectangle, ...], gap: float) -> tuple[float, float]:
    """Middle on the axis and radius of the circle around rectangles, each wider by a gap [m]."""
    if not parts:
        return 0.0, 0.0
    middle = 0.5 * (min(r.rear for r in parts) + max(r.front for r in parts))
    far = max(
        math.hypot(max(abs(r.rear - middle), abs(r.front - middle)), max(r.left, -r.right)) for r in parts
    )
    return middle, far + 1.5 * gap
