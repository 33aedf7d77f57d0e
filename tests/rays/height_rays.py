"""Single rays through a grid of measured heights, and the surface of such a grid."""

from dataclasses import dataclass

import numpy as np

from swath.rays.height_grid import DEEP, LEVELS, NONE, SHARES, TILE, lattice_height
from swath.rays.single.buffers import BeamBuffer


@dataclass(frozen=True)
class HeightHits:
    """Nearest hits of n rays, all (n,), as `HeightCaster.march` says; what: the kind."""

    distance: np.ndarray
    what: np.ndarray
    cell: np.ndarray
    cosine: np.ndarray
    reflectance: np.ndarray


def cast_beams(caster, beams, *, range_max, seed=0, share=-1.0, grain=0.05, solids=None):
    """Fill a buffer."""
    caster.set_scan(range_max=range_max, seed=seed, share=share, grain=grain)
    caster.march(beams, solids)


def cast_heights(caster, origins, directions, **options):
    """Nearest hit of each ray. origins [m], directions (unit): (n, 3), world."""
    n = len(origins)
    beams = BeamBuffer(n)
    beams.origins[:n], beams.directions[:n] = origins, directions
    cast_beams(caster, beams, **options)
    return HeightHits(
        *(a[:n].copy() for a in (beams.distance, beams.kind, beams.cell, beams.cosine, beams.reflectance))
    )


def cells_at(grid, x, y):
    """Index of the cell of world points into the flattened pools, -1 = not held."""
    i, j = (np.floor(a / grid.cell).astype(np.int64) for a in grid.to_local(x, y))
    ny, nx = grid.table.shape
    known = (i >= 0) & (j >= 0) & (i < nx * TILE) & (j < ny * TILE)
    i, j = np.where(known, i, 0), np.where(known, j, 0)
    row = grid.table[j // TILE, i // TILE].astype(np.int64)
    return np.where(known & (row >= 0), (row * TILE + j % TILE) * TILE + i % TILE, -1)


def surface(grid, x, y, share):
    """Height of the surface that a share of the heights lie below, in the world [m], nan where nothing was
    measured."""
    u, v = grid.to_local(x, y)
    cell = cells_at(grid, x, y)
    q = grid.quantiles.reshape(-1, LEVELS)[cell]
    level = DEEP + int(np.searchsorted(SHARES, share))
    height = np.where((cell >= 0) & (q[..., 0] != NONE), q[..., level] * 1e-3, np.nan)
    return np.asarray(grid.origin[2] + lattice_height(grid.ground, grid.node, u, v) + height)
