"""Ways of machines over free ground: the shortest that a body with its turning radius can drive.

What is found is a `Track`: the places of the machine along it, samples at most 0.5 m apart.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.fleet.bodies import Body, Drive, Place, Rectangle
from swath.kernels import start_warp

Array = NDArray[np.float64]
SAMPLE = 0.5  # m between the samples of a track, as in search.cpp
STEP = 2.0  # m of an arc of the search
HEADINGS = 24  # that the search tells apart
SLACK = 120.0  # s before a search, from which on what is free is remembered
STAND = 80  # polygons of machines that stand, at most
MOST = 16_000  # poses that it looks at
BIN = 1.5  # m, within which it keeps one pose of a heading, as in search.cpp
COARSE = 2.0  # m, cells of its heuristic, as in search.cpp
BODY_POINTS = 0.45  # m between points on the sides of a body
STRAIGHT = math.cos(math.radians(6.0))  # of a trailer behind its tractor at the end of a way


@dataclass(frozen=True)
class Track:
    """places: x, y [m], heading, heading of the trailer [rad], shape (n, 4), unwrapped; distance [m]: driven
    up to each, (n,); ways: +1 forwards, -1 backwards, of each step, (n - 1,); bends [1/m] of each step
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
        """Where it begins."""
        return Place(*self.places[0].tolist())

    @property
    def end(self) -> Place:
        """Where it ends."""
        return Place(*self.places[-1].tolist())


def straight(start: Place, length: float, body: Body, spacing: float = SAMPLE) -> Track:
    """Straight on, forwards."""
    return driven(start, [(0.0, length)], body, spacing)


def driven(start: Place, pieces: list[tuple[float, float]], body: Body, spacing: float = SAMPLE) -> Track:
    """Pieces (curvature [1/m], length [m], < 0 backwards), one after the other; a trailer is dragged."""
    bends, steps = [], []
    for bend, length in pieces:
        count = math.ceil(abs(length) / spacing - 1e-9)
        if count:
            bends += [bend] * count
            steps += [length / count] * count
    k, d = np.array(bends), np.array(steps)
    heading = start.heading + np.concatenate([[0.0], np.cumsum(k * d)])
    chord = np.where(np.abs(k * d) < 1e-9, d, 2.0 * np.sin(0.5 * k * d) / np.where(k == 0.0, 1.0, k))
    middle = heading[:-1] + 0.5 * k * d
    x = start.x + np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = start.y + np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    trailer = _dragged(x, y, heading, start.trailer, body) if body.has_trailer else heading
    distance = np.concatenate([[0.0], np.cumsum(np.abs(d))])
    return Track(np.column_stack([x, y, heading, trailer]), distance, np.where(d < 0.0, -1.0, 1.0), k)


def _dragged(x: Array, y: Array, heading: Array, first: float, body: Body) -> Array:
    """Headings of a trailer whose axle stays on the line to the pin, (n,)."""
    px, py = x + body.hitch * np.cos(heading), y + body.hitch * np.sin(heading)
    pins = np.column_stack([px, py]).tolist()
    tx, ty = px[0] - body.drawbar * math.cos(first), py[0] - body.drawbar * math.sin(first)
    out = [first]
    for u, v in pins[1:]:
        angle = math.atan2(v - ty, u - tx)
        tx, ty = u - body.drawbar * math.cos(angle), v - body.drawbar * math.sin(angle)
        out.append(angle)
    return np.unwrap(out)


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


def times_along(track: Track, drive: Drive, top: float | None = None) -> Array:
    """Time [s] at each sample of a track driven from and to a stop, (n,).

    top: fastest [m/s], the drive's own by default. Speeds are held in bends and on reversing, and change by
    the drive's acceleration; between forwards and backwards it stands for the drive's shift.
    """
    step = np.diff(track.distance)
    fast = drive.straight if top is None else top
    limit = np.where(
        track.ways < 0.0, drive.backwards or drive.turning, np.where(track.bends != 0.0, drive.turning, fast)
    )
    limit = np.minimum(limit, fast)
    turned = np.flatnonzero(np.diff(track.ways) != 0.0) + 1
    speed = np.minimum(np.concatenate([[0.0], limit]), np.concatenate([limit, [0.0]]))
    speed[turned] = 0.0
    square = speed**2
    for order in (range(1, len(square)), range(len(square) - 2, -1, -1)):
        back = -1 if order.step > 0 else 1
        for i in order:
            d = step[i - 1] if back < 0 else step[i]
            most = square[i + back] + 2.0 * drive.accel * d
            square[i] = min(square[i], most)
    speed = np.sqrt(square)
    mean = np.maximum(0.5 * (speed[:-1] + speed[1:]), 0.05)
    spent = step / mean
    spent[turned] += drive.shift
    return np.concatenate([[0.0], np.cumsum(spent)])


class Finder:
    """Searches ways on a grid of free ground; keeps the memory of its searches.

    west, south: of the first cell [m]; cell [m]; edge: of the middle of each cell, the distance to
    closed ground, < 0 in it [m], exact up to 2 m
    """

    def __init__(self, west: float, south: float, cell: float, edge: NDArray[np.float32]) -> None:
        shape = (edge.shape[0], edge.shape[1])
        self.edge = edge.ravel()
        self.west, self.south, self.cell, self.shape = west, south, cell, shape
        wide, high = int(shape[0] * cell / BIN) + 1, int(shape[1] * cell / BIN) + 1
        coarse = (math.ceil(shape[0] * cell / COARSE) + 1) * (math.ceil(shape[1] * cell / COARSE) + 1)
        self._numbers, self._found = np.zeros(40 + 3 * STAND), np.zeros(4100)
        self._nodes, self._best = np.zeros(10 * MOST), np.zeros(wide * high * HEADINGS, np.float32)
        room = max(4 * MOST, 10 * coarse)
        self._keys, self._heap = np.zeros(room), np.zeros(room, np.int32)
        self._room, self._room_ever = np.zeros((2, shape[0] * shape[1]), np.float32)
        self._known = (-1, 0.0)
        self._far = np.zeros(coarse, np.float32)
        self._bodies: dict[tuple[Body, float], Array] = {}
        self.searches = self.poses = 0

    def find(
        self, free_from: NDArray[np.float32], body: Body, drive: Drive, start: Place, goal: Place, *,
        version: int, stand: Sequence[Any] = (), time: float = 0.0, gap: float = 0.15, in_line: bool = False,
        most: int = MOST,
    ) -> Track | None:  # fmt: skip
        """The way that takes the shortest time from a place to another, None where there is none.

        free_from: of each cell, the time from which no crop stands there [s], -1 for ground without crop,
        -2 for closed ground, -3 where a machine stands, 1e18 for crop that stays; float32, `shape` version:
        of the grid, another one when crop was cut; stand: outlines of machines that stand, as polygons
        time: of the start [s]; gap: kept all round the body [m]; in_line: the trailer ends in line;
        most: poses that are looked at
        """
        wp = start_warp()
        from swath.fleet import search_kernel

        closed = free_from.copy() if stand else free_from
        for shape in stand:
            self._close(closed, shape)
        points = self._bodies.setdefault((body, gap), body.points(BODY_POINTS, gap))
        pin = start.x + body.hitch * math.cos(start.heading), start.y + body.hitch * math.sin(start.heading)
        self._numbers[:32] = (
            start.x, start.y, math.cos(start.heading), math.sin(start.heading),
            pin[0] - body.drawbar * math.cos(start.trailer), pin[1] - body.drawbar * math.sin(start.trailer),
            goal.x, goal.y, math.cos(goal.heading), math.sin(goal.heading),
            drive.radius, drive.turning, drive.straight, drive.backwards or 1.0, drive.shift, time,
            self.cell, self.west, self.south, body.has_trailer, body.hitch, body.drawbar or 1.0,
            drive.backwards > 0.0, min(most, MOST), 0.0, STRAIGHT if in_line else -2.0, 0.0,
            len(points), *self.shape, STEP, HEADINGS,
        )  # fmt: skip
        self._numbers[32:36] = (*_circle(body.own, gap), *_circle(body.towed, gap))
        is_known = version == self._known[0] and time >= self._known[1]
        self._known = self._known if is_known else (version, time - SLACK)
        self._numbers[37:40] = not is_known, len(stand), self._known[1]
        for i, shape in enumerate(stand):
            west, south, east, north = shape.bounds
            around = 0.5 * math.hypot(east - west, north - south)
            self._numbers[40 + 3 * i : 43 + 3 * i] = 0.5 * (west + east), 0.5 * (south + north), around + 1.0
        self._numbers[36] = min(min(r.left, -r.right, -r.rear, r.front) for r in body.own[:1])
        self._best.fill(1e18)
        arrays: list[Any] = [
            self._numbers,
            points.ravel(),
            closed.ravel(),
            self._nodes,
            self._keys,
            self._heap,
        ]
        arrays += [
            self._best,
            self._far,
            self.edge,
            free_from.ravel(),
            self._room_ever,
            self._room,
            self._found,
        ]
        inputs = [wp.array(a, dtype=getattr(wp, a.dtype.name), device="cpu", copy=False) for a in arrays]
        wp.launch(search_kernel.find_way, dim=1, inputs=inputs, device="cpu")
        self.searches += 1
        count = int(self._found[0])
        if count < 1:
            return None
        self.poses += int(self._found[2])
        rows = self._found[3 : 3 + 2 * count].reshape(-1, 2)[::-1]
        return driven(start, [(float(k), float(d)) for k, d in rows if abs(d) > 1e-6] or [(0.0, 1e-3)], body)

    def _close(self, free_from: NDArray[np.float32], shape: Any) -> None:
        """Close the cells of a polygon."""
        from swath.fleet.ground import TAKEN, cells_of

        i, j, inside = cells_of(shape, self.west, self.south, self.cell, self.shape)
        free_from[i, j][inside] = TAKEN


def _circle(parts: tuple[Rectangle, ...], gap: float) -> tuple[float, float]:
    """Middle on the axis and radius of the circle around rectangles, each wider by a gap [m]."""
    if not parts:
        return 0.0, 0.0
    middle = 0.5 * (min(r.rear for r in parts) + max(r.front for r in parts))
    far = max(
        math.hypot(max(abs(r.rear - middle), abs(r.front - middle)), max(r.left, -r.right)) for r in parts
    )
    return middle, far + 1.5 * gap
