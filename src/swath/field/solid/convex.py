"""Distance between two convex shapes, each known by its support function alone (GJK).

Gilbert, Johnson and Keerthi 1988, doi:10.1109/56.2083: the point of the difference of the shapes that is
nearest to the origin is approached by simplices of its support points. Written in plain numbers: for the few
pairs that are near each other this is quicker than arrays.
"""

from dataclasses import dataclass
from math import fsum, hypot, sqrt
from typing import Protocol

Vector = tuple[float, float, float]
TOLERANCE = 1e-4  # of a distance [m]
ROUNDS = 100
TOUCHING = 1e-9  # shapes nearer than this overlap [m]


class Convex(Protocol):
    """A convex core, and a margin [m] that rounds it off: a capsule is a line with its radius as margin."""

    @property
    def centre(self) -> Vector:
        """A point inside, (3,) [m]."""

    @property
    def margin(self) -> float:
        """Radius that rounds the core off [m]."""

    def support(self, d: Vector) -> Vector:
        """The point of the core that is farthest in direction d, of any length."""
        ...


@dataclass(frozen=True)
class Box:
    """All points centre + sum of s_i sides_i with |s_i| <= 1: three sides a box, one a line, none a point."""

    centre: Vector
    sides: tuple[Vector, ...]
    margin: float = 0.0

    def support(self, d: Vector) -> Vector:
        """A corner."""
        x, y, z = self.centre
        for a, b, c in self.sides:
            if a * d[0] + b * d[1] + c * d[2] > 0.0:
                x, y, z = x + a, y + b, z + c
            else:
                x, y, z = x - a, y - b, z - c
        return x, y, z


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid with its three half axes as vectors."""

    centre: Vector
    sides: tuple[Vector, Vector, Vector]
    margin: float = 0.0

    def support(self, d: Vector) -> Vector:
        """The point whose normal is d."""
        x, y, z = self.centre
        along = [_dot(side, d) for side in self.sides]
        size = sqrt(fsum(v * v for v in along)) or 1.0
        for (a, b, c), v in zip(self.sides, along, strict=True):
            x, y, z = x + a * v / size, y + b * v / size, z + c * v / size
        return x, y, z


@dataclass(frozen=True)
class Triangle:
    """A triangle of a mesh."""

    corners: tuple[Vector, Vector, Vector]
    margin: float = 0.0

    @property
    def centre(self) -> Vector:
        """The middle of its corners."""
        a, b, c = self.corners
        return (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0

    def support(self, d: Vector) -> Vector:
        """A corner."""
        return max(self.corners, key=lambda corner: _dot(corner, d))


def distance(a: Convex, b: Convex, limit: float = float("inf")) -> tuple[float, Vector]:
    """Distance of two shapes [m], 0 where they overlap, and the point of a that is nearest to b.

    limit: for a pair that is farther apart than this [m], any number above it may be returned
    """
    margin = a.margin + b.margin
    v = _minus(a.centre, b.centre)
    simplex: list[tuple[Vector, Vector, Vector]] = []  # points of the difference, of a and of b
    weights = [1.0]
    for _ in range(ROUNDS):
        back = (-v[0], -v[1], -v[2])
        on_a, on_b = a.support(back), b.support(v)
        w = _minus(on_a, on_b)
        size = hypot(*v)
        below = _dot(v, w) / size if size > 0.0 else 0.0  # a lower bound of the cores' distance
        if below - margin > limit or (simplex and (size - below <= TOLERANCE or size < TOUCHING)):
            break
        simplex, weights = _nearest([*simplex, (w, on_a, on_b)])
        v = _blend([s[0] for s in simplex], weights)
        if len(simplex) == 4:
            break
    if not simplex:
        return below - margin, a.centre
    point = _blend([s[1] for s in simplex], weights)
    gap = (0.0 if len(simplex) == 4 else hypot(*v)) - margin
    return (gap if gap > TOUCHING else 0.0), point


def _nearest(
    simplex: list[tuple[Vector, Vector, Vector]],
) -> tuple[list[tuple[Vector, Vector, Vector]], list[float]]:
    """The smallest part of a simplex with its point nearest to the origin, and the weights of that point."""
    points = [s[0] for s in simplex]
    count = len(points)
    if count == 1:
        weights = [1.0]
    elif count == 2:
        weights = _on_line(points[0], points[1])
    elif count == 3:
        weights = _on_triangle(*points)
    else:
        weights = _in_tetrahedron(points)
    kept = [i for i in range(count) if weights[i] > 0.0]
    return [simplex[i] for i in kept], [weights[i] for i in kept]


def _on_line(a: Vector, b: Vector) -> list[float]:
    ab = _minus(b, a)
    size = _dot(ab, ab)
    t = min(max(-_dot(a, ab) / size, 0.0), 1.0) if size > 0.0 else 0.0
    return [1.0 - t, t]


def _on_triangle(a: Vector, b: Vector, c: Vector) -> list[float]:
    """Weights of the point of a triangle that is nearest to the origin."""
    ab, ac = _minus(b, a), _minus(c, a)
    normal = _cross(ab, ac)
    size = _dot(normal, normal)
    if size > 1e-24 * max(_dot(ab, ab), _dot(ac, ac)) ** 2:
        wb = -_dot(_cross(a, ac), normal) / size
        wc = -_dot(_cross(ab, a), normal) / size
        if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
            return [1.0 - wb - wc, wb, wc]
    best, found = float("inf"), [1.0, 0.0, 0.0]
    for i, j, points in ((0, 1, (a, b)), (0, 2, (a, c)), (1, 2, (b, c))):
        ends = _on_line(*points)
        near = _blend(points, ends)
        if (far := _dot(near, near)) < best:
            best, found = far, [0.0, 0.0, 0.0]
            found[i], found[j] = ends
    return found


def _in_tetrahedron(p: list[Vector]) -> list[float]:
    """Weights of the point of a tetrahedron that is nearest to the origin, all > 0 where that is inside."""
    volume = _volume(p[0], p[1], p[2], p[3])
    zero = (0.0, 0.0, 0.0)
    size = max(hypot(*_minus(q, p[0])) for q in p[1:])
    if abs(volume) > 1e-14 * size**3:
        inside = [
            _volume(zero, p[1], p[2], p[3]) / volume,
            _volume(p[0], zero, p[2], p[3]) / volume,
            _volume(p[0], p[1], zero, p[3]) / volume,
            _volume(p[0], p[1], p[2], zero) / volume,
        ]
        if min(inside) > 0.0:
            return inside
    best, found = float("inf"), [1.0, 0.0, 0.0, 0.0]
    for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        points = [p[i] for i in face]
        weights = _on_triangle(*points)
        near = _blend(points, weights)
        if (far := _dot(near, near)) < best:
            best, found = far, [0.0, 0.0, 0.0, 0.0]
            for i, weight in zip(face, weights, strict=True):
                found[i] = weight
    return found


def _volume(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    return _dot(_minus(b, a), _cross(_minus(c, a), _minus(d, a)))


def _blend(points: list[Vector] | tuple[Vector, ...], weights: list[float]) -> Vector:
    x = y = z = 0.0
    for (a, b, c), weight in zip(points, weights, strict=True):
        x, y, z = x + weight * a, y + weight * b, z + weight * c
    return x, y, z


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
