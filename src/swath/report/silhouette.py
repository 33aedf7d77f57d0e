"""The outline of a body from above."""

import numpy as np

from swath.signals import F64

SLICE = 0.1  # along x [m]


def silhouette(triangles: F64) -> F64:
    """Corners (n, 2) of the outline of triangles (m, 3, 3) seen from above [m], left side first.

    Slices along x, each from its rightmost to its leftmost point: notches across x are kept; holes are
    filled, gaps along x bridged.
    """
    flat = np.asarray(triangles, dtype=float)[:, :, :2]
    starts, ends = flat.reshape(-1, 2), np.roll(flat, -1, axis=1).reshape(-1, 2)
    steps = max(2, int(np.ceil(np.abs(ends - starts).max() / (0.5 * SLICE))) + 1)
    share = np.linspace(0.0, 1.0, min(steps, 400))[:, None, None]
    points = (starts + share * (ends - starts)).reshape(-1, 2)
    first = points[:, 0].min()
    number = ((points[:, 0] - first) / SLICE).astype(int)
    right, left = np.full(number.max() + 1, np.inf), np.full(number.max() + 1, -np.inf)
    np.minimum.at(right, number, points[:, 1])
    np.maximum.at(left, number, points[:, 1])
    kept = np.flatnonzero(np.isfinite(right))
    low, high = first + kept * SLICE, np.minimum(first + (kept + 1) * SLICE, points[:, 0].max())
    x = np.column_stack([low, high]).ravel()
    sides = [np.column_stack([x, np.repeat(y[kept], 2)]) for y in (left, right)]
    return np.concatenate([sides[0], sides[1][::-1]])
