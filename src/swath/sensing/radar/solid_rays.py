"""Rays from a radar against solids: where its waves meet a body first, plants left out."""

from dataclasses import dataclass
from math import hypot

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import product
from swath.field.memory_layout import Solids
from swath.field.site_setup import Body
from swath.signals import F64

COLUMNS, ROWS = (5, 40), (5, 10)  # rays at a body, least and most, across and by height
APART = 0.25  # of the rays at a wide body [m]
TINY = 1e-12


@dataclass(frozen=True)
class Facing:
    """What a radar meets of a body. points: world (n, 3), nothing nearer in the way.

    share: of the body's whole silhouette that one point stands for
    """

    body: Body
    points: F64
    share: float


def facing(bodies: list[Body], eye: F64, reach: float) -> list[Facing]:
    """The sides that bodies within reach [m] turn to an eye (3,), without what other bodies hide."""
    near = [(b, *_sphere(b, eye)) for b in bodies]
    near = [(b, ray, far, wide) for b, ray, far, wide in near if wide < far <= reach + wide]
    found = []
    for body, ray, far, wide in near:
        directions = aimed(body, eye)
        own = distances(body.solids, eye, directions)
        meets = np.isfinite(own)
        if not meets.any():
            continue
        directions, own = directions[meets], own[meets]
        free = np.ones(len(own), dtype=bool)
        for other, its_way, its_far, its_wide in near:
            if other is not body and its_far - its_wide < far + wide:
                apart = hypot(*(ray / far - its_way / its_far).tolist())
                if apart < 1.2 * (wide / far + its_wide / its_far):
                    free &= distances(other.solids, eye, directions) >= own
        found.append(Facing(body, eye + own[free, None] * directions[free], 1.0 / len(own)))
    return found


def distances(solids: Solids, eye: F64, directions: F64) -> F64:
    """To the nearest surface from an eye (3,) outside along unit directions (n, 3) [m], inf where none is."""
    nearest = np.full(len(directions), np.inf)
    for centre, axes, half in solids.boxes:
        nearest = np.minimum(nearest, _box(*_in_frame(centre, axes, eye, directions), half))
    for centre, axes, half in solids.ellipsoids:
        o, d = _in_frame(centre, axes, eye, directions)
        nearest = np.minimum(nearest, _ball(o / half, d / half, 1.0))
    if len(solids.capsule_radius):
        nearest = np.minimum(nearest, _capsules(eye, directions, solids))
    for shape, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        o, d = _in_frame(centre, axes, eye, directions)
        nearest = np.minimum(nearest, _triangles(o, d, np.asarray(shape.corners, dtype=np.float64)))
    return nearest


def _sphere(body: Body, eye: F64) -> tuple[F64, float, float]:
    """Way to a body's middle (3,), its length and the radius around the body [m]."""
    ray = body.pose.apply(body.middle) - eye
    return ray, hypot(*ray.tolist()), hypot(*body.half.tolist())


def aimed(body: Body, eye: F64, across: tuple[int, int] = COLUMNS, high_up: tuple[int, int] = ROWS) -> F64:
    """Unit directions (n, 3) over the silhouette of a body's box: least and most of columns and rows."""
    middle = body.pose.apply(body.middle)
    flat = (middle - eye)[:2]
    far = max(hypot(*flat.tolist()), 1e-6)
    aside = np.array([-flat[1], flat[0], 0.0]) / far
    wide = float(product(body.half, np.abs(product(body.pose.rotation.T, aside))))
    high = float(product(body.half, np.abs(body.pose.rotation[2])))
    columns = int(min(max(2.0 * wide / APART, across[0]), across[1]))
    rows = int(min(max(2.0 * high / APART, high_up[0]), high_up[1]))
    side = (2.0 * np.arange(columns) + 1.0 - columns) / columns * wide
    up = (2.0 * np.arange(rows) + 1.0 - rows) / rows * high
    at = middle + side[:, None, None] * aside + up[None, :, None] * np.array([0.0, 0.0, 1.0])
    rays = at.reshape(-1, 3) - eye
    return np.asarray(rays / np.sqrt((rays * rays).sum(axis=1))[:, None])


def _in_frame(centre: F64, axes: F64, eye: F64, directions: F64) -> tuple[F64, F64]:
    return product(axes.T, eye - centre), product(directions, axes)


def _box(o: F64, d: F64, half: F64) -> F64:
    d = np.where(np.abs(d) < TINY, TINY, d)
    near, far = (-half - o) / d, (half - o) / d
    enter, leave = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)


def _ball(o: F64, d: F64, radius: float) -> F64:
    """Directions of any length, distances in them."""
    a, b = (d * d).sum(axis=1), (d * o).sum(axis=1)
    under = b * b - a * (float((o * o).sum()) - radius * radius)
    t = (-b - np.sqrt(np.maximum(under, 0.0))) / a
    return np.where((under >= 0.0) & (t > 0.0), t, np.inf)


def _capsules(eye: F64, d: F64, solids: Solids) -> F64:
    """Nearest of all capsules (k) per ray (n): the least of two balls and a tube."""
    a, b, radius = solids.capsule_a, solids.capsule_b, solids.capsule_radius
    length = np.maximum(np.sqrt(((b - a) ** 2).sum(axis=1)), TINY)
    u = (b - a) / length[:, None]
    nearest = np.full(len(d), np.inf)
    for end in (a, b):
        o = eye - end
        half_b = product(d, o.T)
        under = half_b * half_b - ((o * o).sum(axis=1) - radius * radius)
        t = -half_b - np.sqrt(np.maximum(under, 0.0))
        nearest = np.minimum(nearest, np.where((under >= 0.0) & (t > 0.0), t, np.inf).min(axis=1))
    o = eye - a
    along_d, along_o = product(d, u.T), (o * u).sum(axis=1)
    square = np.maximum(1.0 - along_d * along_d, TINY)
    half_b = product(d, o.T) - along_d * along_o
    under = half_b * half_b - square * ((o * o).sum(axis=1) - along_o * along_o - radius * radius)
    t = (-half_b - np.sqrt(np.maximum(under, 0.0))) / square
    at = along_o + t * along_d
    side = (under >= 0.0) & (t > 0.0) & (at >= 0.0) & (at <= length)
    return np.asarray(np.minimum(nearest, np.where(side, t, np.inf).min(axis=1)))


def _triangles(o: F64, d: F64, corners: F64) -> F64:
    """Nearest of triangles (m, 3, 3) per ray: Moeller, Trumbore 1997, doi:10.1080/10867651.1997.10487468."""
    nearest: NDArray[np.float64] = np.full(len(d), np.inf)
    first, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    t = o - first
    q = np.cross(t, e1)
    for k, way in enumerate(d):
        p = np.cross(way, e2)
        whole = (p * e1).sum(axis=1)
        whole = np.where(np.abs(whole) < TINY, np.inf, whole)
        u, v = (p * t).sum(axis=1) / whole, (q * way).sum(axis=1) / whole
        far = (q * e2).sum(axis=1) / whole
        meets = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (far > 0.0)
        nearest[k] = far[meets].min(initial=np.inf)
    return nearest
