"""Which rays go together: packets of rays side by side, and groups of packets.

A lane holds one ray; 16 lanes make a SIMD vector, which is computed at once; a packet is the vectors of one
bundle of sub-rays, or one vector of several bundles or of a patch of an image; a group is some packets side
by side. None of this depends on the number of threads, and none of it changes what a ray hits: only what it
costs.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import log, log2

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import arctan2, product

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
N = 16  # lanes of a vector
GROUP_LANES = 1024  # the traversal's room
GROUP_PACKETS = 32  # of an image
LINE_PACKETS = 48  # of bundles side by side
SINGLES = 8  # rays of a packet, where bundles are single rays
SUB_RAYS_MAX = 512  # of a bundle that goes through the traversal


@dataclass(frozen=True)
class Packing:
    """table: (packets, width) number of the ray in each lane, -1 = none, width a multiple of 16
    first: (groups + 1,) first packet of each group
    """

    table: I32
    first: I32

    @property
    def group_count(self) -> int:
        """Groups."""
        return len(self.first) - 1

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Where table and first lie in memory."""
        return self.table.ctypes.data, self.first.ctypes.data


def pack_bundles(count: int, directions: F64) -> Packing:
    """Packets of `count` bundles of sub-rays side by side; directions (s, 3) of the first bundle.

    A bundle is a packet; its vectors are sectors of the spot, so that each is compact. Of single rays SINGLES
    make a packet.
    """
    s = len(directions)
    if s <= N:
        return _pack_in_order(count, tuple(range(s)))
    with np.errstate(invalid="ignore"):  # rays that are none are refused later
        order = np.argsort(_turn(directions), kind="stable")
    return _pack_in_order(count, tuple(order.tolist()))


@lru_cache(maxsize=16)
def _pack_in_order(count: int, order: tuple[int, ...]) -> Packing:
    """The same for sub-rays in this order."""
    s = len(order)
    if s == 1:
        table = np.full((-(-count // SINGLES), N), -1, np.int32)
        table[:, :SINGLES] = np.arange(table.shape[0] * SINGLES, dtype=np.int32).reshape(-1, SINGLES)
        table[table >= count] = -1
        return _grouped(table, GROUP_LANES // N)
    vectors = -(-s // N)
    parts = np.array_split(np.array(order), vectors)
    column = np.concatenate([N * i + np.arange(len(part)) for i, part in enumerate(parts)])
    table = np.full((count, N * vectors), -1, np.int32)
    table[:, column] = np.arange(count, dtype=np.int32)[:, None] * s + np.array(order, np.int32)
    return _grouped(table)


def pack_image(rows: int, columns: int, pitch: tuple[float, float]) -> Packing:
    """Packets of an image (rows, columns): patches, about square by the pitch [rad] of the pixels.

    A lone row is a line of single rays.
    """
    if rows == 1:
        return _pack_in_order(columns, (0,))
    ratio = pitch[0] / pitch[1] if min(pitch) > 0.0 else 1.0
    high = int(2 ** np.clip(np.round(2.0 - 0.5 * log2(ratio)), 0, 4))
    patch, group = (high, N // high), _near_square(high, N // high, ratio)
    y, x = np.arange(-(-rows // patch[0])), np.arange(-(-columns // patch[1]))
    py, px = (v.ravel() for v in np.meshgrid(y, x, indexing="ij"))
    order = np.lexsort((px, py, px // group[1], py // group[0]))
    py, px = py[order], px[order]
    lane = np.arange(N)
    row = py[:, None] * patch[0] + lane // patch[1]
    column = px[:, None] * patch[1] + lane % patch[1]
    table = np.where((row < rows) & (column < columns), row * columns + column, -1).astype(np.int32)
    key = (py // group[0]) * (len(x) // group[1] + 1) + px // group[1]
    first = np.concatenate([np.flatnonzero(np.diff(key, prepend=-1)), [len(key)]]).astype(np.int32)
    return Packing(table, first)


def _near_square(high: int, wide: int, ratio: float) -> tuple[int, int]:
    """Packs along rows and columns of a group, about square in angle."""
    best, found = np.inf, (1, GROUP_PACKETS)
    for n in (1, 2, 4, 8, 16, 32):
        aspect = abs(log(max(ratio, 1e-9) * high * n / (wide * GROUP_PACKETS / n)))
        if aspect < best:
            best, found = float(aspect), (n, GROUP_PACKETS // n)
    return found


def _turn(directions: F64) -> F64:
    """Angle of each direction around the middle of the spot [rad]."""
    mx, my, mz = directions.mean(axis=0).tolist()
    ax, ay, az = (my, -mx, 0.0) if abs(mz) < 0.9 else (0.0, mz, -my)  # across the middle
    x = product(directions, np.array([ax, ay, az]))
    y = product(directions, np.array([ay * mz - az * my, az * mx - ax * mz, ax * my - ay * mx]))
    return np.asarray(arctan2(y - y.mean(), x - x.mean()))


def _grouped(table: I32, most: int = LINE_PACKETS) -> Packing:
    """Groups of at most so many packets side by side."""
    packets, width = table.shape
    step = max(1, min(most, GROUP_LANES // width))
    first = np.append(np.arange(0, packets, step), packets).astype(np.int32)
    return Packing(table, first)
