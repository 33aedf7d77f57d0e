"""Which rays go through the crop together: groups of neighbours.

A lane holds one ray; 16 lanes make a SIMD vector, which is computed at once. The traversal makes vectors of
the rays of a group by where they point (native/rays.cpp). None of this depends on the number of threads, and
none of it changes what a ray hits: only what it costs.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import hypot, log2

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
N = 16  # lanes of a vector
GROUP_RAYS = 1024  # the traversal's room
BUNDLES = 56  # of a group
IMAGE_RAYS = 1024  # of a group
HIGH = 2.0  # a patch of an image is about so much higher than wide: stems stand
SINGLES = 8  # rays of a vector of a lone line
SQUARE = 0.25  # side across parallel rays [m]
# bits of 0 to 255, each with a gap after it
_SPREAD = ((np.arange(256)[:, None] >> np.arange(8) & 1) << 2 * np.arange(8)).sum(axis=1).astype(np.uint16)
SUB_RAYS_MAX = 512  # of a bundle that goes through the traversal


@dataclass(frozen=True)
class Packing:
    """order: rays (n,), group after group, None = as they come; first: (groups + 1,) place of the first ray
    of each group
    lanes: rays of a vector; row: of an image, rays in a row of a group, else 0.
    """

    order: I32 | None
    first: I32
    lanes: int
    row: int = 0

    @property
    def group_count(self) -> int:
        """Groups."""
        return len(self.first) - 1

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Where order (0 = none) and first lie in memory."""
        return 0 if self.order is None else self.order.ctypes.data, self.first.ctypes.data


@lru_cache(maxsize=16)
def pack_bundles(count: int, sub_rays: int) -> Packing:
    """Groups of `count` bundles of sub-rays side by side."""
    if sub_rays == 1:
        return _in_a_row(count, GROUP_RAYS // N * SINGLES, SINGLES)
    return _in_a_row(count * sub_rays, min(BUNDLES, GROUP_RAYS // sub_rays) * sub_rays, N)


def _in_a_row(count: int, most: int, lanes: int, order: I32 | None = None) -> Packing:
    return Packing(order, np.append(np.arange(0, count, most), count).astype(np.int32), lanes)


@lru_cache(maxsize=16)
def pack_image(rows: int, columns: int, ratio: float) -> Packing:
    """Groups of an image (rows, columns): patches of equal size, about twice as high as wide.

    ratio: pitch of rows over that of columns. A lone row is a line of single rays.
    """
    if rows == 1:
        return pack_bundles(columns, 1)
    down, across = _patches(rows, columns, ratio)
    y, x = (v.ravel() for v in np.indices((rows, columns)))
    patch = y * down // rows * across + x * across // columns
    order = np.argsort(patch.astype(np.uint16), kind="stable").astype(np.int32)  # its radix sort
    first = np.append(np.flatnonzero(np.diff(patch[order], prepend=-1)), rows * columns)
    return Packing(order, first.astype(np.int32), N, columns // across)


def pack_parallel(origins: F64, direction: F64) -> Packing:
    """Groups of rays from (n, 3) in one direction, by squares across it along a curve of Morton (1966)."""
    level = np.array([direction[1], -direction[0], 0.0])
    level = np.array([1.0, 0.0, 0.0]) if hypot(*level) < 1e-6 else level / hypot(*level)
    square = np.zeros(len(origins), np.uint16)
    for k, axis in enumerate((level, np.cross(direction, level))):
        place = np.einsum("ij,j", origins, axis)
        low, high = float(place.min()), float(place.max())
        square |= _SPREAD[((place - low) * (1.0 / max(SQUARE, (high - low) / 255.0))).astype(np.uint8)] << k
    order = np.argsort(square, kind="stable").astype(np.int32)
    return _in_a_row(len(order), GROUP_RAYS, N, order)


def _patches(rows: int, columns: int, ratio: float) -> tuple[int, int]:
    """How many patches, down and across: few, and of the wanted shape."""

    def cost(across: int) -> tuple[float, int, int]:
        wide = -(-columns // across)
        down = -(-rows // max(1, IMAGE_RAYS // wide))
        shape = -(-rows // down) * ratio / wide
        return down * across * (1.0 + 0.1 * abs(log2(shape / HIGH))), down, across

    least = -(-columns // IMAGE_RAYS)
    return min(cost(across) for across in range(least, columns + 1))[1:]
