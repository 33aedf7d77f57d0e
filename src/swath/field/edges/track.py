"""Geometry of the crop edge: a track of straight lines and arcs with crop on one side.

Beyond its two ends the track goes straight on for ever, so that it parts the world; one that ends where it
starts is closed and has an inside and an outside. s [m] runs along the track from its start; offsets are > 0
on the crop side in `signed_distance` and > 0 to the left in `project`.

`Way` is that of a thing that moves: straight from point to point, at one speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import atan2, hypot, inf, pi, tan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.errors import InputError
from swath.core.frames import wrap_angle

Array = NDArray[np.float64]
MANY = 512  # points, from which on it pays to ask first which pieces are near
FEW = 12  # pieces: for more of them, many points are parted


class Way:
    """points: world (n, 2) [m], n >= 2, neighbours apart; speed [m/s]; returns: to and fro, for ever."""

    def __init__(self, points: Any, speed: float, *, returns: bool = False) -> None:
        self.points: Array = np.asarray(points, dtype=float)
        self.speed, self.returns = speed, returns
        steps = np.diff(self.points, axis=0)
        self.at: Array = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])

    @property
    def length(self) -> float:
        """Distance from the first point to the last [m]."""
        return float(self.at[-1])

    def after(self, seconds: float) -> tuple[float, float, float, float]:
        """x, y [m], heading [rad] and speed [m/s] so long after it set off; before, it stands."""
        gone = max(seconds, 0.0) * self.speed
        comes_back = self.returns and gone % (2.0 * self.length) > self.length
        if self.returns:
            gone %= 2.0 * self.length
            gone = 2.0 * self.length - gone if comes_back else gone
        leg = int(np.clip(np.searchsorted(self.at, gone, side="right") - 1, 0, len(self.at) - 2))
        (ax, ay), (bx, by) = self.points[leg].tolist(), self.points[leg + 1].tolist()
        share = min((gone - float(self.at[leg])) / hypot(bx - ax, by - ay), 1.0)
        back = -1.0 if comes_back else 1.0
        moves = seconds >= 0.0 and (self.returns or gone < self.length)
        heading = atan2(back * (by - ay), back * (bx - ax))
        return ax + share * (bx - ax), ay + share * (by - ay), heading, self.speed if moves else 0.0


@dataclass(frozen=True)
class Piece:
    """A line (curvature 0) or an arc.

    x, y: start [m]; heading there [rad]; length [m]; curvature [1/m], > 0 bends left
    s: of its start
    turn_in, turn_out: headings [rad] that decide the side of what lies nearest to its start and to its end:
        half way between this piece's heading and its neighbour's
    """

    x: float
    y: float
    heading: float
    length: float
    curvature: float = 0.0
    s: float = 0.0
    turn_in: float = 0.0
    turn_out: float = 0.0

    def at(self, t: Any) -> tuple[Array, Array, Array]:
        """x, y [m] and heading [rad] a way t [m] into the piece (or before and after it)."""
        t = np.asarray(t, dtype=float)
        heading = self.heading + self.curvature * t
        if self.curvature == 0.0:
            return self.x + t * np.cos(self.heading), self.y + t * np.sin(self.heading), heading
        r = 1.0 / self.curvature
        x = self.x + r * (np.sin(heading) - np.sin(self.heading))
        y = self.y - r * (np.cos(heading) - np.cos(self.heading))
        return x, y, heading

    def project(self, x: Array, y: Array) -> tuple[Array, Array]:
        """(way into the piece, offset > 0 left) [m] of the nearest point of the piece."""
        t, offset = self._unbounded(x, y)
        for outside, (ex, ey, c, s) in zip((t < 0.0, t > self.length), self._ends, strict=True):
            if outside.any():
                dx, dy = x - ex, y - ey
                side = np.where(c * dy - s * dx < 0.0, -1.0, 1.0)
                offset = np.where(outside, side * np.hypot(dx, dy), offset)
        return t.clip(0.0, self.length), offset

    @cached_property
    def _turn(self) -> tuple[Any, Any]:
        return np.cos(self.heading), np.sin(self.heading)

    @cached_property
    def _ends(self) -> list[tuple[Any, ...]]:
        """x, y, cosine and sine of the turn of its start and end."""
        ends = (0.0, self.turn_in), (self.length, self.turn_out)
        return [(*self.at(t)[:2], np.cos(turn), np.sin(turn)) for t, turn in ends]

    def _unbounded(self, x: Array, y: Array) -> tuple[Array, Array]:
        dx, dy = x - self.x, y - self.y
        c, s = self._turn
        if self.curvature == 0.0:
            return dx * c + dy * s, dy * c - dx * s
        r = 1.0 / self.curvature
        cx, cy = dx + r * s, dy - r * c  # from the centre of the arc
        middle = 0.5 * self.length * self.curvature
        turned = portable.arctan2(cy, cx) - portable.arctan2(-r * c, r * s)
        angle = middle + wrap_angle(turned - middle)
        return angle * r, np.sign(r) * (abs(r) - np.hypot(cx, cy))


class EdgeShape:
    """The nominal edge. crop_side: `left` or `right` of the track as it is driven.

    is_closed: it ends where it starts; s then runs from 0 to the length, and on round and round
    """

    def __init__(self, pieces: Sequence[Piece], crop_side: str) -> None:
        if not pieces:
            raise InputError("field.edge", None, "expected a track of at least one piece")
        if crop_side not in ("left", "right"):
            raise InputError("field.edge.crop_side", crop_side, "expected left or right")
        self.crop_side = crop_side
        self.is_closed = _is_closed(pieces)
        self.pieces = _linked(pieces, is_closed=self.is_closed)
        self.length: float = self.pieces[-1].s + self.pieces[-1].length
        self._starts = np.array([p.s for p in self.pieces])
        self._sides = self.pieces if self.is_closed else _extended(self.pieces, self.length)
        self._ends = [] if self.is_closed else [self._sides[0], self._sides[-1]]
        self._middles = np.array([[float(v) for v in p.at(0.5 * p.length)[:2]] for p in self.pieces])
        self._halves = np.array([0.5 * p.length for p in self.pieces])

    def signed_distance(self, x: Any, y: Any) -> Array:
        """Distance to the edge [m], > 0 on the crop side, in the shape of x and y broadcast."""
        offset = self.project(x, y)[1]
        return offset if self.crop_side == "left" else -offset

    def project(self, x: Any, y: Any) -> tuple[Array, Array]:
        """(s, offset > 0 left) [m] of the nearest point of the edge; s < 0 or > length beyond the ends."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        if x.shape != y.shape:
            x, y = np.broadcast_arrays(x, y)
        s, best = np.zeros(x.shape), np.full(x.shape, inf)
        near = self._near(x, y)
        if len(near) > FEW and x.size >= MANY and (first := _first_half(x, y)).sum() < x.size:
            for part in (first, ~first):
                s[part], best[part] = self.project(x[part], y[part])
            return s, best
        for piece in near:
            t, offset = piece.project(x, y)
            closer = np.abs(offset) < np.abs(best)
            np.copyto(best, offset, where=closer)
            np.copyto(s, piece.s + t, where=closer)
        return s, best

    def point_at(self, s: Any) -> Array:
        """World point [m] at s [m], shape (..., 2)."""
        x, y, _ = self._at(s)
        return np.stack([x, y], axis=-1)

    def heading_at(self, s: Any) -> Array:
        """Direction of the track [rad] at s [m], in (-pi, pi]."""
        return np.asarray(wrap_angle(self._at(s)[2]))

    def _index(self, s: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self._starts, s, side="right") - 1, 0, len(self.pieces) - 1)

    def _at(self, s: Any) -> tuple[Array, Array, Array]:
        s = np.asarray(s, dtype=float)
        s = s % self.length if self.is_closed else s
        inside = np.clip(s, 0.0, self.length)
        index = self._index(inside)
        x, y, heading = np.empty(s.shape), np.empty(s.shape), np.empty(s.shape)
        for i in np.unique(index):
            mine = index == i
            x[mine], y[mine], heading[mine] = self.pieces[i].at(inside[mine] - self.pieces[i].s)
        beyond = s - inside
        return x + beyond * np.cos(heading), y + beyond * np.sin(heading), heading

    def _near(self, x: Array, y: Array) -> list[Piece]:
        """The pieces that can be nearest to any of the points: a piece is at least as near to the points'
        middle as its own middle is, and at most half its length nearer; of many points those that are as near
        as the nearest to their middle, but for the points' reach on both sides.
        """
        if (x.size < MANY and len(self._sides) <= 4) or x.size == 0:
            return self._sides
        cx, cy = 0.5 * (x.min() + x.max()), 0.5 * (y.min() + y.max())
        reach = float(np.hypot(x.max() - cx, y.max() - cy))
        middle = np.hypot(self._middles[:, 0] - cx, self._middles[:, 1] - cy)
        ends = [abs(float(p.project(cx, cy)[1])) for p in self._ends]
        limit = min([*ends, float(middle.min())]) + 2.0 * reach + 1e-9
        near = [self.pieces[i] for i in np.flatnonzero(middle - self._halves <= limit)]
        if not self.is_closed:
            lead, tail = (side if end <= limit else None for side, end in zip(self._ends, ends, strict=True))
            near = [p for p in (lead, *near, tail) if p is not None]
        if x.size < MANY or len(near) < 2:
            return near
        away = [abs(float(p.project(cx, cy)[1])) for p in near]
        return [p for p, d in zip(near, away, strict=True) if d <= min(away) + 2.0 * reach + 1e-9]


def _first_half(x: Array, y: Array) -> NDArray[np.bool_]:
    """Which points lie in the first half of the rectangle around them, parted across its longer side."""
    across = max((x, y), key=np.ptp)
    first: NDArray[np.bool_] = across <= 0.5 * (across.min() + across.max())
    return first


def straight(x: float, y: float, heading: float, length: float) -> list[Piece]:
    """A straight track from (x, y) [m] along heading [rad]."""
    return [Piece(x, y, heading, length)]


def curve(
    x: float, y: float, heading: float, *, run_in: float, radius: float, angle: float, run_out: float
) -> list[Piece]:
    """Straight, arc, straight. Lengths and radius [m]; angle [rad], > 0 bends left."""
    pieces = [Piece(x, y, heading, run_in)] if run_in > 0.0 else []
    px, py = x + run_in * np.cos(heading), y + run_in * np.sin(heading)
    arc = Piece(float(px), float(py), heading, radius * abs(angle), np.sign(angle) / radius)
    pieces.append(arc)
    if run_out > 0.0:
        ex, ey, end = arc.at(arc.length)
        pieces.append(Piece(float(ex), float(ey), float(end), run_out))
    return pieces


def polyline(points: Any, corner_radius: float = 0.0, *, key: str = "field.edge.points_m") -> list[Piece]:
    """Lines between points (n, 2) [m]; corners rounded to the radius, or less where the lines are short."""
    p = _checked(points, key)
    step = np.diff(p, axis=0)
    length, heading = np.hypot(step[:, 0], step[:, 1]), portable.arctan2(step[:, 1], step[:, 0])
    turn = np.asarray(wrap_angle(np.diff(heading)))
    if np.any(np.abs(turn) > pi - 1e-3):
        raise InputError(key, None, "expected a track that does not turn back on itself")
    half = np.minimum(length[:-1], length[1:]) / 2.0
    trim = np.minimum(corner_radius * portable.tan(np.abs(turn) / 2.0), half)
    trim = np.concatenate([[0.0], trim, [0.0]])
    pieces: list[Piece] = []
    for i in range(len(length)):
        c, s = np.cos(heading[i]), np.sin(heading[i])
        run = float(length[i] - trim[i] - trim[i + 1])
        start = p[i] + trim[i] * np.array([c, s])
        if run > 1e-9:
            pieces.append(Piece(float(start[0]), float(start[1]), float(heading[i]), run))
        if trim[i + 1] > 1e-9:
            radius = trim[i + 1] / tan(abs(turn[i]) / 2.0)
            at = p[i + 1] - trim[i + 1] * np.array([c, s])
            k = float(np.sign(turn[i]) / radius)
            pieces.append(
                Piece(float(at[0]), float(at[1]), float(heading[i]), float(radius * abs(turn[i])), k)
            )
    return pieces


def shifted_left(points: Any, distance: float, *, key: str = "field.edge.points_m") -> Array:
    """Points (n, 2) [m] moved to the left of their line, along the mean of the normals before and after."""
    p = _checked(points, key)
    step = np.diff(p, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=-1) / np.hypot(step[:, 0], step[:, 1])[:, None]
    before, after = np.concatenate([normal[:1], normal]), np.concatenate([normal, normal[-1:]])
    both = before + after
    return np.asarray(p + distance * 2.0 * both / np.maximum(np.sum(both**2, axis=1), 1e-3)[:, None])


def _checked(points: Any, key: str) -> Array:
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 2 or not np.isfinite(p).all():
        raise InputError(key, points, "expected a list of finite [x, y]")
    p = p[np.concatenate([[True], np.hypot(*np.diff(p, axis=0).T) > 1e-6])]
    if len(p) < 2:
        raise InputError(key, None, "expected at least two different points")
    return np.asarray(p)


def _is_closed(pieces: Sequence[Piece]) -> bool:
    """Whether a track ends where it starts."""
    x, y, _ = pieces[-1].at(pieces[-1].length)
    return len(pieces) > 1 and bool(np.hypot(x - pieces[0].x, y - pieces[0].y) < 1e-6)


def _linked(pieces: Sequence[Piece], *, is_closed: bool) -> list[Piece]:
    """Pieces with their s and with the headings that decide sides at joints."""
    ends = [p.heading + p.curvature * p.length for p in pieces]
    linked, s = [], 0.0
    for i, p in enumerate(pieces):
        before = ends[i - 1] if i > 0 or is_closed else p.heading
        after = pieces[(i + 1) % len(pieces)].heading if i + 1 < len(pieces) or is_closed else ends[i]
        turn_in = p.heading - 0.5 * float(wrap_angle(p.heading - before))
        turn_out = ends[i] + 0.5 * float(wrap_angle(after - ends[i]))
        linked.append(Piece(p.x, p.y, p.heading, p.length, p.curvature, s, turn_in, turn_out))
        s += p.length
    return linked


def _extended(pieces: list[Piece], length: float, far: float = 1e6) -> list[Piece]:
    """The pieces between the two straight lines that continue them, each `far` [m] long."""
    first, last = pieces[0], pieces[-1]
    c, s = np.cos(first.heading), np.sin(first.heading)
    h = first.heading
    lead = Piece(float(first.x - far * c), float(first.y - far * s), h, far, 0.0, -far, h, h)
    x, y, end = last.at(last.length)
    tail = Piece(float(x), float(y), float(end), far, 0.0, length, float(end), float(end))
    return [lead, *pieces, tail]
