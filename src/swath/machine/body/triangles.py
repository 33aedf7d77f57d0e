"""Boxes, cylinders and spheres of URDF and SDF as triangles (n, 3, 3) [m], around their middle."""

from itertools import pairwise
from math import cos, pi, sin

import numpy as np

from swath.core.frames import Array

SIDES = 24  # of a cylinder or a sphere


def box(size: Array) -> Array:
    """A box of this size (3,), edges along the axes: 12 triangles."""
    half = 0.5 * size
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            quad = np.zeros((4, 3))
            quad[:, axis] = sign * half[axis]
            quad[:, u] = half[u] * np.array([-1.0, 1.0, 1.0, -1.0])
            quad[:, v] = half[v] * np.array([-1.0, -1.0, 1.0, 1.0])
            quads.append(quad)
    return _halved(np.array(quads))


def cylinder(radius: float, length: float) -> Array:
    """A cylinder along z of SIDES sides, both ends closed."""
    ring = _ring(radius)
    low, high = (np.column_stack([ring, np.full(SIDES, z)]) for z in (-0.5 * length, 0.5 * length))
    wall = np.stack([low, np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high], axis=1)
    ends = [
        np.stack([np.full((SIDES, 3), [0.0, 0.0, rim[0, 2]]), rim, np.roll(rim, -1, axis=0)], axis=1)
        for rim in (low, high)
    ]
    return np.concatenate([_halved(wall), *ends])


def sphere(radius: float) -> Array:
    """A sphere of SIDES meridians."""
    rings = [
        np.column_stack([_ring(radius * sin(angle)), np.full(SIDES, radius * cos(angle))])
        for angle in (pi * i / (SIDES // 2) for i in range(SIDES // 2 + 1))
    ]
    quads = [
        np.stack([a, b, np.roll(b, -1, axis=0), np.roll(a, -1, axis=0)], axis=1) for a, b in pairwise(rings)
    ]
    triangles = _halved(np.concatenate(quads))
    area = np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )
    return np.asarray(triangles[area > 1e-9 * radius**2])


def _ring(radius: float) -> Array:
    angles = [2.0 * pi * i / SIDES for i in range(SIDES)]
    return radius * np.array([[cos(angle), sin(angle)] for angle in angles])


def _halved(quads: Array) -> Array:
    """Quads (n, 4, 3) as two triangles each."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
