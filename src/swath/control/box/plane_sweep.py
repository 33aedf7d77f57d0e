"""Grain in a box whose rim is known, from two pictures: the height at which both show the same.

A level grid over the box is set to height after height and looked at in both pictures (plane sweep, Collins
1996, doi:10.1109/CVPR.1996.517097); where they agree best, by the normalised cross-correlation of a square
around, there lies the grain. What lies along the base of the two cameras, a wall or the edge of a shadow,
looks the same at every height: only what differs from its surroundings along the box counts. Behind a wall
there is nothing to be seen. Where noise is stronger than the grain's own contrast they agree nowhere.

A level square tells the mean height of what lies in it: on a slope that is the height of its middle, on the
ridge of a heap it is tan(a) / 4 of its side too little. So the pictures are looked at again on a grid that
lies as the surface was found, a little higher and lower: there only the difference is averaged.
"""

import numpy as np
from numpy.typing import NDArray

from swath.control.box.picture_edges import noise_of, smoothed
from swath.control.box.rim_fit import Rim
from swath.control.box.view import View, sampled
from swath.core.frames import Pose
from swath.signals import F64

CELL = 0.03  # of the grid [m]
STEP = 0.04  # from height to height [m]
ABOVE, BELOW = 0.9, 2.0  # the rim: beyond there is no grain [m]
REACH = 5  # cells, to all sides, of the square that is compared
ALONG = 4  # cells, to both sides along the box, of the surroundings
AGREES = 0.7  # least correlation: contrast as strong as noise has 0.5
UNIQUE = 0.1  # above the best one half a metre away
APART = 6  # steps, from where on a height is another one
MARGIN = 0.15  # from a wall, within which smoothing mixes it into the grain [m]
INNER = 0.75  # of the cells around are on the surface, too: at its border heights are worst
WHOLE = 0.6  # of a square that both cameras see
LEAST_CONTRAST = 1.5  # of a square over the noise of the smoothed picture: a wall of one colour has none
SMOOTH = 0.27  # noise of a smoothed picture over that of the picture
BLOCK = 5  # cells, side of the blocks that a surface is told by
EDGE = 6.0  # times the usual step from cell to cell
FILLED = 0.4  # of the cells of a block are known
STEEP = 0.5  # of a surface of grain, over the way: 27 deg
NOISE = 0.08  # what noise adds [m]
EVEN = 2  # cells, to all sides, over which a surface is smoothed that is looked at again
FINER = 0.025  # from height to height about it [m]
NEARBY = FINER * np.arange(-4.0, 5.0)
ALIKE = 60.0  # cells that err alike, since their squares overlap: half of a square's


def grain_points(
    pictures: tuple[F64, F64], views: tuple[View, View], rim: Rim, length: float, width: float
) -> F64:
    """Points of the grain (n, 3) in the box's frame: along it, to its left, height above the ground [m]."""
    x, y = _middles(length), _middles(width)
    heights = rim.height + np.arange(-BELOW, ABOVE, STEP)
    box = Pose.from_euler([rim.x, rim.y, 0.0], 0.0, 0.0, rim.heading)
    eyes = [box.inverse().apply(view.pose.position) for view in views]
    least = (LEAST_CONTRAST * SMOOTH * max(noise_of(p) for p in pictures)) ** 2
    pictures = smoothed(pictures[0]), smoothed(pictures[1])

    def agreement(surface: F64 | float) -> F64:
        """Of both pictures on a surface over the grid."""
        grid = np.stack(np.broadcast_arrays(x[:, None], y[None, :], surface), axis=-1)
        both = [
            np.where(
                _is_free(grid, eye, rim.height, length, width), sampled(p, v.project(box.apply(grid))), np.nan
            )
            for p, v, eye in zip(pictures, views, eyes, strict=True)
        ]
        return correlation(_alone(both[0]), _alone(both[1]), least)

    found = _best(np.stack([agreement(h) for h in heights]), heights, x, y)
    base = _filled(found)
    found = base + _nearest(np.stack([agreement(base + d) for d in NEARBY]), np.isfinite(found))
    i, j = np.nonzero(np.isfinite(found))
    return np.column_stack([x[i], y[j], found[i, j]])


def _middles(size: float) -> F64:
    """Of the cells across a size."""
    count = max(2, round(size / CELL))
    return ((np.arange(count) + 0.5) / count - 0.5) * size


def _is_free(grid: F64, eye: F64, rim: float, length: float, width: float) -> NDArray[np.bool_]:
    """Which points of a grid no wall hides from an eye above the rim: the way there passes the rim inside of
    the box.
    """
    share = (float(eye[2]) - rim) / (float(eye[2]) - grid[..., 2:])
    at = eye[:2] + share * (grid[..., :2] - eye[:2])
    inside = (np.abs(at[..., 0]) < 0.5 * length - MARGIN) & (np.abs(at[..., 1]) < 0.5 * width - MARGIN)
    return np.asarray(inside | (grid[..., 2] >= rim))


def _alone(values: F64) -> F64:
    """Values (nx, ny) less the mean of their surroundings along x; nan about steps that stick out, as where
    a wall ends or a shadow, since such a step alone would look alike at many heights.
    """
    steps = np.abs(np.diff(values, axis=0, prepend=values[:1]))
    seen = steps[np.isfinite(steps)]
    if len(seen):
        is_edge = (steps > EDGE * float(np.median(seen))).astype(np.float64)
        values = np.where(_summed(is_edge, ALONG, 0) > 0.0, np.nan, values)
    known = np.isfinite(values)
    total = _summed(np.where(known, values, 0.0), ALONG, 0)
    return values - total / np.maximum(_summed(known.astype(np.float64), ALONG, 0), 1.0)


def correlation(a: F64, b: F64, least: float) -> F64:
    """Normalised cross-correlation of two grids (nx, ny) in the square around each cell, -1 to 1.

    -1 where too little is seen in both, or the variance is less than the least.
    """
    known = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(known, a, 0.0), np.where(known, b, 0.0)
    count = _square(known.astype(np.float64))
    n = np.maximum(count, 1.0)
    mean_a, mean_b = _square(a) / n, _square(b) / n
    vary_a, vary_b = _square(a * a) / n - mean_a**2, _square(b * b) / n - mean_b**2
    both = _square(a * b) / n - mean_a * mean_b
    is_whole = (count >= WHOLE * (2 * REACH + 1) ** 2) & known & (np.minimum(vary_a, vary_b) > least)
    return np.where(is_whole, both / np.sqrt(np.maximum(vary_a * vary_b, 1e-12)), -1.0)


def _square(values: F64, reach: int = REACH) -> F64:
    return _summed(_summed(values, reach, 0), reach, 1)


def _summed(values: F64, reach: int, axis: int) -> F64:
    """Sums over so many neighbours to both sides along an axis."""
    wide = np.pad(values, [(reach + 1, reach) if k == axis else (0, 0) for k in (0, 1)])
    total = np.cumsum(wide, axis=axis)
    count = values.shape[axis]
    ahead = np.take(total, np.arange(2 * reach + 1, 2 * reach + 1 + count), axis=axis)
    return ahead - np.take(total, np.arange(count), axis=axis)


def _best(agreed: F64, heights: F64, x: F64, y: F64) -> F64:
    """Heights at which the pictures agree (nx, ny), between two by a parabola, nan where they do not."""
    k = np.argmax(agreed, axis=0)
    i, j = np.indices(k.shape)
    best = agreed[k, i, j]
    others = np.where(np.abs(np.arange(len(heights))[:, None, None] - k) >= APART, agreed, -1.0).max(axis=0)
    inner = np.clip(k, 1, len(heights) - 2)
    low, high = agreed[inner - 1, i, j], agreed[inner + 1, i, j]
    is_sure = (best >= AGREES) & (best >= others + UNIQUE) & (k == inner) & (low > -1.0) & (high > -1.0)
    bend = np.where(is_sure, low - 2.0 * best + high, -1.0)
    shift = np.where(bend < 0.0, 0.5 * (low - high) / bend, 0.0)
    found = heights[inner] + STEP * np.clip(shift, -1.0, 1.0)
    clear = (np.abs(x) < -x[0] - MARGIN)[:, None] & (np.abs(y) < -y[0] - MARGIN)
    is_sure = surface(np.where(is_sure, found, np.nan)) & clear
    share = _square(is_sure.astype(np.float64)) / np.maximum(_square(clear.astype(np.float64)), 1.0)
    is_sure &= share >= INNER
    return np.where(is_sure, found, np.nan)


def _filled(heights: F64) -> F64:
    """A surface by heights (nx, ny): smoothed, and carried on where none is known."""
    known = np.isfinite(heights)
    held, wide = np.where(known, heights, 0.0), known.astype(np.float64)
    base = np.full(heights.shape, float(held.sum()) / max(float(wide.sum()), 1.0))
    for reach in (4 * REACH, REACH, EVEN):
        count = _square(wide, reach)
        base = np.where(count > 0.5, _square(held, reach) / np.maximum(count, 1.0), base)
    return base


def _nearest(agreed: F64, known: NDArray[np.bool_]) -> F64:
    """How far from a surface the pictures agree best, of `NEARBY` heights, nan where none was known or is."""
    k = np.clip(np.argmax(agreed, axis=0), 1, len(NEARBY) - 2)
    i, j = np.indices(k.shape)
    low, best, high = (agreed[k + d, i, j] for d in (-1, 0, 1))
    bend = low - 2.0 * best + high
    is_sure = known & (best >= AGREES) & (low > -1.0) & (high > -1.0) & (bend < 0.0)
    shift = 0.5 * (low - high) / np.where(is_sure, bend, -1.0)
    return np.where(is_sure & (np.abs(shift) <= 1.0), NEARBY[k] + FINER * shift, np.nan)


def surface(heights: F64) -> NDArray[np.bool_]:
    """Cells (nx, ny) that lie on the largest surface; heights: nan where none is known.

    Told by blocks of cells: those beside each other are one surface where they lie as grain can.
    """
    nx, ny = (n // BLOCK for n in heights.shape)
    blocks = heights[: nx * BLOCK, : ny * BLOCK].reshape(nx, BLOCK, ny, BLOCK).swapaxes(1, 2)
    blocks = np.sort(blocks.reshape(nx, ny, BLOCK * BLOCK), axis=2)
    count = np.isfinite(blocks).sum(axis=2)
    middle = np.take_along_axis(blocks, np.maximum(count // 2, 0)[..., None], axis=2)[..., 0]
    middle = np.where(count >= FILLED * BLOCK * BLOCK, middle, np.nan)
    own = np.where(_largest(middle), middle, np.nan)
    i, j = np.indices(heights.shape)
    there = own[np.minimum(i // BLOCK, nx - 1), np.minimum(j // BLOCK, ny - 1)]
    return np.asarray(np.abs(heights - there) < NOISE)


def _largest(heights: F64) -> NDArray[np.bool_]:
    """The largest part of a grid (nx, ny) whose neighbours, up to three apart, are about as high."""
    known = np.isfinite(heights)
    label = np.where(known, np.arange(heights.size).reshape(heights.shape), -1)
    ways = [(i, j) for i in range(4) for j in range(-3, 4) if (i, j) > (0, 0) and i * i + j * j <= 9]
    nx, ny = heights.shape
    before = np.zeros_like(label)
    while (label != before).any():
        before = label.copy()
        for i, j in ways:
            a = np.s_[: nx - i, max(-j, 0) : ny - max(j, 0)]
            b = np.s_[i:, max(j, 0) : ny - max(-j, 0)]
            most = NOISE + STEEP * BLOCK * CELL * (i * i + j * j) ** 0.5
            joined = np.abs(heights[a] - heights[b]) < most
            both = np.where(joined, np.maximum(label[a], label[b]), -1)
            label[a] = np.maximum(label[a], both)
            label[b] = np.maximum(label[b], both)
    count = np.bincount(label[known], minlength=1)
    return np.asarray(known & (label == int(np.argmax(count))))
