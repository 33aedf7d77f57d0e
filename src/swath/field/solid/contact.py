"""Whether solids overlap, and how far they are apart.

Every box, capsule, ellipsoid and mesh lies in an oriented box. These boxes give lower bounds of the distances
of all pairs at once; only pairs whose bound is below the least distance found are looked at exactly. A mesh
is a surface of triangles, of which only those near the other body are looked at.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.core.portable import product
from swath.field.memory_layout import SolidMesh, Solids
from swath.field.solid.convex import Box, Convex, Ellipsoid, Triangle, Vector, distance

Array = NDArray[np.float64]
NEAR = 5.0  # a clearance below this is exact to 1 mm, a larger one may be a lower bound [m]
CHUNK = 32  # triangles of a mesh that are bounded together


@dataclass(frozen=True)
class Parts:
    """Solids, each in its oriented box: centre (n, 3) [m], axes (n, 3, 3) columns, half sizes (n, 3) [m].

    kind: `box`, `ellipsoid`, `capsule` (along its third axis) or `mesh`
    mesh: None for all others; both (n,)
    """

    centre: Array
    axes: Array
    half: Array
    kind: tuple[str, ...]
    mesh: tuple[SolidMesh | None, ...]

    def moved(self, pose: Pose) -> "Parts":
        """Parts of an inner frame in the outer frame of a pose."""
        return replace(self, centre=pose.apply(self.centre), axes=product(pose.rotation, self.axes))


@dataclass(frozen=True)
class _Piece:
    """One solid, or a triangle of one, and the box that it lies in."""

    centre: Array
    axes: Array
    half: Array
    shape: Convex | SolidMesh


@dataclass(frozen=True)
class Nearest:
    """The nearest pair of two lists of parts. distance [m], 0 = they overlap; first, second: their numbers.

    point: of the first one, in the world, nearest to the second [m].
    """

    distance: float
    first: int
    second: int
    point: Vector


def parts_of(solids: Solids) -> Parts:
    """The boxes, ellipsoids, capsules and meshes of solids, in this order."""
    a, b, radius = solids.capsule_a, solids.capsule_b, solids.capsule_radius
    half_capsule = np.stack([radius, radius, radius + 0.5 * np.linalg.norm(b - a, axis=1)], axis=1)
    half_mesh = [np.abs(m.corners).max(axis=(0, 1)) for m in solids.mesh_shape]
    half = [solids.box_half, solids.ellipsoid_half, half_capsule, np.array(half_mesh).reshape(-1, 3)]
    centre = [solids.box_centre, solids.ellipsoid_centre, 0.5 * (a + b), solids.mesh_centre]
    axes = [solids.box_axes, solids.ellipsoid_axes, frames_along(b - a), solids.mesh_axes]
    names = ("box", "ellipsoid", "capsule", "mesh")
    kind = tuple(name for name, some in zip(names, half, strict=True) for _ in range(len(some)))
    mesh = (*[None] * (len(kind) - len(half_mesh)), *solids.mesh_shape)
    return Parts(np.concatenate(centre), np.concatenate(axes), np.concatenate(half), kind, mesh)


def bounds(parts: Parts) -> tuple[Array, Array]:
    """Middle and half sizes (3,) of the box along the axes that holds all parts, zeros without any."""
    if not parts.kind:
        return np.zeros(3), np.zeros(3)
    reach = np.einsum("nij,nj->ni", np.abs(parts.axes), parts.half)
    low, high = (parts.centre - reach).min(axis=0), (parts.centre + reach).max(axis=0)
    return 0.5 * (low + high), 0.5 * (high - low)


def joined(parts: list[Parts]) -> Parts:
    """The parts of several bodies as one list."""
    if not parts:
        return parts_of(Solids())
    centre, axes, half = (np.concatenate([getattr(p, n) for p in parts]) for n in ("centre", "axes", "half"))
    kind, mesh = tuple(k for p in parts for k in p.kind), tuple(m for p in parts for m in p.mesh)
    return Parts(centre, axes, half, kind, mesh)


def nearest(a: Parts, b: Parts) -> Nearest | None:
    """The pair of parts of two bodies that is nearest; None where one of them has none.

    A distance above NEAR may be a lower bound.
    """
    if not a.kind or not b.kind:
        return None
    bound = lower_bounds(a, b)
    best: Nearest | None = None
    for k in np.argsort(bound, axis=None, kind="stable").tolist():
        i, j = divmod(k, len(b.kind))
        below = float(bound[i, j])
        if best is not None and below >= best.distance:
            break
        if below > NEAR:
            return Nearest(below, i, j, _vector(a.centre[i]))
        gap, point = _distance(_piece(a, i), _piece(b, j), np.inf if best is None else best.distance)
        if best is None or gap < best.distance:
            best = Nearest(gap, i, j, point)
    return best


def overlaps(a: Parts, b: Parts) -> list[Nearest]:
    """Every pair of parts that overlaps."""
    if not a.kind or not b.kind:
        return []
    found = []
    for i, j in np.argwhere(lower_bounds(a, b) <= 0.0).tolist():
        gap, point = _distance(_piece(a, i), _piece(b, j), 0.0)
        if gap <= 0.0:
            found.append(Nearest(0.0, i, j, point))
    return found


def lower_bounds(a: Parts, b: Parts) -> Array:
    """What the distance of each pair is at least [m], (n, m): of one's box against the box, along the axes of
    the other, around the other.
    """
    apart = b.centre - a.centre[:, None]
    turn = np.abs(np.einsum("nki,mkj->nmij", a.axes, b.axes))
    in_a = np.abs(np.einsum("nki,nmk->nmi", a.axes, apart)) - a.half[:, None]
    in_b = np.abs(np.einsum("mkj,nmk->nmj", b.axes, apart)) - b.half
    in_a -= np.einsum("nmij,mj->nmi", turn, b.half)
    in_b -= np.einsum("nmij,ni->nmj", turn, a.half)
    square = np.maximum((np.maximum(in_a, 0.0) ** 2).sum(-1), (np.maximum(in_b, 0.0) ** 2).sum(-1))
    return np.asarray(np.sqrt(square))


def _piece(parts: Parts, i: int) -> _Piece:
    centre, axes, half = parts.centre[i], parts.axes[i], parts.half[i]
    shape = parts.mesh[i] or _convex(parts.kind[i], centre, axes, half)
    return _Piece(centre, axes, half, shape)


def _convex(kind: str, centre: Array, axes: Array, half: Array) -> Convex:
    sides = [_vector(side) for side in (axes * half).T]
    if kind == "ellipsoid":
        return Ellipsoid(_vector(centre), (sides[0], sides[1], sides[2]))
    if kind == "capsule":
        radius = float(half[0])
        return Box(_vector(centre), (_vector(axes[:, 2] * (half[2] - radius)),), radius)
    return Box(_vector(centre), tuple(sides))


def _distance(a: _Piece, b: _Piece, limit: float) -> tuple[float, Vector]:
    """Distance as of `convex.distance`, also of meshes."""
    if isinstance(a.shape, SolidMesh):
        return _distance_of_mesh(a, a.shape, b, limit)
    if isinstance(b.shape, SolidMesh):
        return _distance_of_mesh(b, b.shape, a, limit)
    return distance(a.shape, b.shape, limit)


def _distance_of_mesh(a: _Piece, mesh: SolidMesh, b: _Piece, limit: float) -> tuple[float, Vector]:
    surface = _surface(mesh)
    best, point = max(limit, 1e-6), _vector(a.centre)
    chunks = _beyond_box(a, b, surface.chunk_centre) - surface.chunk_radius
    for chunk in np.argsort(chunks, kind="stable").tolist():
        if chunks[chunk] >= best:
            break
        rows = slice(chunk * CHUNK, (chunk + 1) * CHUNK)
        corners = surface.corners[rows]
        bound = _beyond_box(a, b, surface.centre[rows]) - surface.radius[rows]
        for k in np.argsort(bound, kind="stable").tolist():
            if bound[k] >= best:
                break
            gap, where = _distance(_triangle(product(corners[k], a.axes.T) + a.centre), b, best)
            if gap < best:
                best, point = gap, where
            if best <= 0.0:
                return 0.0, point
    return best, point


def _triangle(corners: Array) -> _Piece:
    low, high = corners.min(axis=0), corners.max(axis=0)
    shape = Triangle((_vector(corners[0]), _vector(corners[1]), _vector(corners[2])))
    return _Piece(0.5 * (low + high), np.eye(3), 0.5 * (high - low), shape)


def _beyond_box(a: _Piece, b: _Piece, points: Array) -> Array:
    """Distance of points of a's frame (n, 3) from the box around b [m]."""
    seen = product(product(points, a.axes.T) + a.centre - b.centre, b.axes)
    return np.asarray(np.linalg.norm(np.maximum(np.abs(seen) - b.half, 0.0), axis=1))


@dataclass(frozen=True)
class _Surface:
    """Triangles (n, 3, 3) [m], neighbours together; spheres around each and around every CHUNK of them."""

    corners: Array
    centre: Array
    radius: Array
    chunk_centre: Array
    chunk_radius: Array


@lru_cache(maxsize=64)
def _surface(mesh: SolidMesh) -> _Surface:
    corners = mesh.corners.astype(float)
    middle = corners.mean(axis=1)
    low, high = middle.min(axis=0), middle.max(axis=0)
    cell = (1023 * (middle - low) / np.maximum(high - low, 1e-9)).astype(np.int64)
    bits = (cell[:, :, None] >> np.arange(10)) & 1  # along a curve that fills space (Morton order)
    place = (bits << (3 * np.arange(10) + np.arange(3)[:, None])).sum(axis=(1, 2))
    corners = corners[np.argsort(place, kind="stable")]
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    starts = range(0, len(corners), CHUNK)
    chunks = [corners[i : i + CHUNK].reshape(-1, 3) for i in starts]
    middles = np.array([0.5 * (c.min(axis=0) + c.max(axis=0)) for c in chunks])
    around = np.array([np.linalg.norm(c - m, axis=1).max() for c, m in zip(chunks, middles, strict=True)])
    return _Surface(corners, centre, radius, middles, around)


def frames_along(direction: Array) -> Array:
    """Frames (n, 3, 3) whose third column has these directions (n, 3); any for length 0."""
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    z = np.where(size > 0.0, direction / np.maximum(size, 1e-300), [0.0, 0.0, 1.0])
    helper = np.where(np.abs(z[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
