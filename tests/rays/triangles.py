"""Plants as triangles, for engines and viewers that want them: a picture, never what our rays hit."""

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import PlantLibrary, Shape

Array = NDArray[np.float64]


def own_primitives(library: PlantLibrary, tile: int) -> tuple[NDArray[np.int64], Array, Array]:
    """A tile's primitives once each, whole plants: indices (m,), ends a and b (m, 3) [m] in the prototype.

    The library holds a piece once per tile side that it overlaps; here each stands over its stem's foot.
    """
    index = np.flatnonzero(
        (library.owner >= library.stem_start[tile]) & (library.owner < library.stem_start[tile + 1])
    )
    foot = np.c_[library.base[index].astype(float), np.zeros(len(index))]
    a, b = library.a[index] - foot, library.b[index] - foot
    key = np.c_[library.owner[index], library.organ[index], a[:, 2], b[:, 2]]  # what copies share to the bit
    flat = (library.shape[index] == Shape.TRIANGLE)[:, None]  # meshes have many of the same heights
    key = np.c_[key, np.where(flat, library.width[index], 0.0), np.where(flat, np.round(a, 4), 0.0)]
    _, first = np.unique(key, axis=0, return_index=True)
    first = np.sort(first)
    move = np.c_[library.stem_xy[library.owner[index[first]]].astype(float), np.zeros(len(first))]
    return index[first], a[first] + move, b[first] + move


def capsule_triangles(
    a: Array, b: Array, radius: Array, *, sides: int, rings: int, match_width: bool = True
) -> Array:
    """Capsules as prisms with `rings` per rounded end (0 = flat fans), (m * k, 3, 3) [m].

    match_width: widen the prism so that its mean silhouette width is the capsule's (Cauchy: perimeter / pi).
    A flat end lies pi / 4 of the radius beyond a or b, so that the silhouette's area stays too.
    Drivetrain for ends a, b (m, 3) in a frame where the capsule is round.
    """
    frame = _frames(b - a)
    if not rings:
        end = 0.25 * np.pi * radius[:, None] * frame[..., 2]
        a, b = a - end, b + end
    grow = np.pi / (sides * np.sin(np.pi / sides)) if match_width else 1.0
    turn = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * grow
    lift = np.arange(rings + 1) / max(rings, 1) * 0.5 * np.pi if rings else np.zeros(1)
    up = np.sin(lift) if rings else np.zeros(1)
    loops = [
        _loop(a, frame, radius, circle, w, -z) for w, z in zip(np.cos(lift)[::-1], up[::-1], strict=True)
    ]
    loops += [_loop(b, frame, radius, circle, w, z) for w, z in zip(np.cos(lift), up, strict=True)]
    if not rings:
        loops = [np.repeat(a[:, None], sides, axis=1), *loops, np.repeat(b[:, None], sides, axis=1)]
    grid = np.stack(loops, axis=1)
    low, high = grid[:, :-1], grid[:, 1:]
    low_next, high_next = np.roll(low, -1, axis=2), np.roll(high, -1, axis=2)
    first = np.stack([low, low_next, high], axis=3)
    second = np.stack([low_next, high_next, high], axis=3)
    flat = np.concatenate([first[:, 1:], second[:, :-1]], axis=1)  # the outermost loops are points
    result: Array = flat.reshape(-1, 3, 3)
    return result


def ribbon_triangles(a: Array, b: Array, width: Array) -> Array:
    """Ribbons as two triangles each, (2 m, 3, 3) [m]."""
    first = np.stack([a - width, a + width, b + width], axis=1)
    second = np.stack([a - width, b + width, b - width], axis=1)
    return np.concatenate([first, second])


def to_stand(points: Array, plane: Array, stand: Array, size: float) -> Array:
    """Prototype coordinates (..., 3) seen from a tile's lower corner; plane and stand as in the pages."""
    zeta = points[..., 2]
    x, y = points[..., 0] + stand[1] * zeta, points[..., 1] + stand[2] * zeta
    ground = plane[0] + plane[1] * (x - 0.5 * size) + plane[2] * (y - 0.5 * size)
    return np.stack([x, y, ground + stand[0] * zeta], axis=-1)


def _loop(centre: Array, frame: Array, radius: Array, circle: Array, wide: float, along: float) -> Array:
    local = np.concatenate([circle * wide, np.full((len(circle), 1), along)], axis=1)
    loop: Array = centre[:, None] + radius[:, None, None] * np.einsum("mij,sj->msi", frame, local)
    return loop


def _frames(along: Array) -> Array:
    z = along / np.linalg.norm(along, axis=1, keepdims=True)
    helper = np.where(np.abs(z[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)
