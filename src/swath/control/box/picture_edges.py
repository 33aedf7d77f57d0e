"""Edges in a picture, told from its noise.

Derivatives of the picture smoothed by a binomial of five pixels, in the colour in which they stand out most;
kept where they are largest across the edge (Canny 1986, doi:10.1109/TPAMI.1986.4767851) and above what noise
makes. The noise is that of the smoothest parts of the picture, by its second differences (as Immerkaer 1996,
doi:10.1006/cviu.1996.0060, by tiles, so that texture counts for little).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.signals import F64

BINOMIAL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
DERIVED = 0.15  # standard deviation of the derivative of a smoothed picture over that of the picture
OUTSTANDS = 5.0  # standard deviations of noise, from which on a derivative is an edge
TILE = 16  # side of the squares whose noise is looked at [px]
SMOOTHEST = 5.0  # percent of the tiles, of which the noisiest tells the noise
LEAST_NOISE = 0.3  # of steps of a byte


@dataclass(frozen=True)
class Edges:
    """Pixels (row, column), (n,), on edges; across: unit vector to the brighter side (n, 2), u and v
    strength: derivative over that of noise
    """

    row: NDArray[np.int64]
    column: NDArray[np.int64]
    across: F64
    strength: F64


def edges_of(colour: NDArray[np.uint8]) -> Edges:
    """Of a picture (height, width, 3)."""
    best, along_u, along_v = (
        np.zeros(colour.shape[:2]),
        np.zeros(colour.shape[:2]),
        np.zeros(colour.shape[:2]),
    )
    for k in range(3):
        channel = colour[..., k].astype(np.float64)
        du, dv = derivatives(smoothed(channel))
        size = np.hypot(du, dv) / (DERIVED * noise_of(channel))
        stands = size > best
        best[stands], along_u[stands], along_v[stands] = size[stands], du[stands], dv[stands]
    row, column = np.nonzero(_is_ridge(best, along_u, along_v) & (best > OUTSTANDS))
    size = np.maximum(np.hypot(along_u[row, column], along_v[row, column]), 1e-12)
    across = np.stack([along_u[row, column] / size, along_v[row, column] / size], axis=-1)
    return Edges(row, column, across, best[row, column])


def noise_of(channel: F64) -> float:
    """Standard deviation of the noise of a picture (height, width)."""
    second = channel[1:-1, 1:-1] - 0.25 * (
        channel[:-2, 1:-1] + channel[2:, 1:-1] + channel[1:-1, :-2] + channel[1:-1, 2:]
    )
    rows, columns = (n // TILE for n in second.shape)
    if rows * columns == 0:
        return LEAST_NOISE
    tiles = second[: rows * TILE, : columns * TILE].reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
    spread = np.sqrt((tiles.reshape(-1, TILE * TILE) ** 2).mean(axis=1) / 1.25)
    return max(float(np.percentile(spread, SMOOTHEST)), LEAST_NOISE)


def smoothed(channel: F64) -> F64:
    """By a binomial of five pixels both ways; at the border with what lies next to it."""
    wide = np.pad(channel, 2, mode="edge")
    rows = np.add.reduce([w * wide[k : k + channel.shape[0]] for k, w in enumerate(BINOMIAL)])
    return np.asarray(np.add.reduce([w * rows[:, k : k + channel.shape[1]] for k, w in enumerate(BINOMIAL)]))


def derivatives(picture: F64) -> tuple[F64, F64]:
    """Along u and v, by central differences, 0 at the border."""
    du, dv = np.zeros_like(picture), np.zeros_like(picture)
    du[:, 1:-1] = 0.5 * (picture[:, 2:] - picture[:, :-2])
    dv[1:-1] = 0.5 * (picture[2:] - picture[:-2])
    return du, dv


def _is_ridge(size: F64, du: F64, dv: F64) -> NDArray[np.bool_]:
    """Where the derivative is larger than at the neighbours to both sides of the edge."""
    found = np.zeros(size.shape, dtype=bool)
    inner = size[1:-1, 1:-1]
    u, v = du[1:-1, 1:-1], dv[1:-1, 1:-1]
    steep = np.abs(v) > 2.414 * np.abs(u)
    flat = np.abs(u) > 2.414 * np.abs(v)
    falls = ~steep & ~flat & (u * v < 0.0)
    ways = ((steep, 1, 0), (flat, 0, 1), (falls, 1, -1), (~steep & ~flat & ~falls, 1, 1))
    height, width = inner.shape
    for chosen, i, j in ways:
        ahead = size[1 + i : 1 + i + height, 1 + j : 1 + j + width]
        behind = size[1 - i : 1 - i + height, 1 - j : 1 - j + width]
        found[1:-1, 1:-1] |= chosen & (inner >= ahead) & (inner > behind)
    return found
