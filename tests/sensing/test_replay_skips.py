"""What the march of `replay` leaves out changes no hit: bits against the march through every cell."""

import dataclasses

import numpy as np
import pytest

from swath.rays.height_cells import UNTOUCHED
from swath.rays.height_grid import DEEP, EVEN, NODE_CELLS, NODES, PER_THICKNESS, TILE
from swath.rays.heights import MEASURED, UNMEASURED, HeightCaster
from tests.rays.height_rays import cast_heights
from tests.sensing.replay_rig import hand_grid, levels, set_where


def patchy_grid(rng, yaw):
    """Rough ground; from block to block tall or low crop or stubble, some never measured or not held."""
    grid = hand_grid(tiles=(3, 4), cell=0.05, origin=(40.0, -30.0, 5.0), yaw=yaw, slope=0.02)
    grid.ground[:] += rng.normal(0.0, 0.01, grid.ground.shape)
    shape = grid.quantiles.shape[:3]
    size = rng.choice([0.02, 0.3, 0.9], (len(grid.quantiles), NODES, NODES), p=[0.5, 0.2, 0.3])
    size = np.repeat(np.repeat(size, NODE_CELLS, 1), NODE_CELLS, 2) + rng.uniform(-0.05, 0.05, shape)
    heights = np.sort(rng.uniform(0.1, 1.0, (*shape, EVEN)) * size[..., None], axis=-1)
    heights[rng.random(shape) < 0.1] = 0.0
    grid.quantiles[:] = [[[levels(cell) for cell in row] for row in tile] for tile in heights]
    open_below = rng.random(shape) < 0.3
    lowest = (0.4 * grid.quantiles[..., DEEP]).astype(np.int16)
    grid.quantiles[..., 0] = np.where(open_below, lowest, grid.quantiles[..., 0])
    thick = np.linspace(5.0, 4.2, DEEP - 1) * PER_THICKNESS
    grid.quantiles[open_below, 1:DEEP] = thick.astype(np.int16)
    grid.thickness[:] = np.where(open_below, rng.choice([5.2, 2.0, -5.2], shape), grid.thickness)
    set_where(grid, lambda u, v: (u > 2.0) & (u < 2.6) & (v > 1.0), None)
    table = grid.table.copy()
    table[2, 3] = -1
    return dataclasses.replace(
        grid,
        table=table,
        **{k: getattr(grid, k)[:-1] for k in ("quantiles", "thickness", "count", "intensity")},
    )


def rays(grid, rng, n):
    """From everywhere in and around the grid, up, level, flat and steep."""
    ny, nx = grid.table.shape
    side = grid.cell * TILE
    x, y = grid.to_world(rng.uniform(-2.0, nx * side + 2.0, n), rng.uniform(-2.0, ny * side + 2.0, n))
    z = grid.ground_height(x, y) + rng.choice([0.05, 0.5, 1.2, 3.0], n)
    turn, down = rng.uniform(-np.pi, np.pi, n), np.radians(rng.choice([-20, 0, 2, 8, 20, 45, 89], n))
    turn[::9] = grid.yaw + np.pi / 2 * rng.integers(0, 4, len(turn[::9]))  # along the cells
    d = np.stack([np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), -np.sin(down)], axis=1)
    return np.stack([x, y, z], axis=1), d


def bits(hits):
    return [getattr(hits, f.name).tobytes() for f in dataclasses.fields(hits)]


@pytest.mark.parametrize("yaw", [0.0, 0.9])
@pytest.mark.parametrize("share", [-1.0, 0.001, 0.5])
def test_stepping_over_blocks_changes_no_bit(yaw, share):
    rng = np.random.default_rng(3)
    grid = patchy_grid(rng, yaw)
    caster, plain = HeightCaster(grid), HeightCaster(grid, skips=False)
    o, d = rays(grid, rng, 4000)
    at = {"range_max": 30.0, "seed": 9, "share": share}
    first = cast_heights(caster, o, d, **at)
    assert bits(first) == bits(cast_heights(plain, o, d, **at))
    assert np.bincount(first.what, minlength=3)[[MEASURED, UNMEASURED]].min() > 200
    cell = rng.choice(grid.count.size, grid.count.size // 3, replace=False)
    stubble = rng.choice([0, 8, 20, UNTOUCHED], len(cell)).astype(np.uint8)
    for one in (caster, plain):
        one.cells.lower(cell, stubble)
        assert np.array_equal(one.cells.cut_at(cell), stubble)
    lower = cast_heights(caster, o, d, **at)
    assert bits(lower) == bits(cast_heights(plain, o, d, **at))
    assert bits(lower) != bits(first)
    ends = (o + lower.distance[:, None] * d)[lower.what == MEASURED]
    above = ends[:, 2] - grid.ground_height(ends[:, 0], ends[:, 1])
    cut = caster.cells.cut_at(lower.cell[lower.what == MEASURED].astype(np.int64))
    steep = d[lower.what == MEASURED, 2] < -0.5  # flat ones may be stopped at the side of a cell
    assert np.count_nonzero(steep & (cut == 8)) > 10
    assert above[steep & (cut == 8)].max() < 0.081
    caster.cells.lower(cell, np.full(len(cell), UNTOUCHED, np.uint8))
    assert bits(cast_heights(caster, o, d, **at)) == bits(first)
    plain.cells.restore()
    assert bits(cast_heights(plain, o, d, **at)) == bits(first)


def test_cells_of_one_height_are_met_at_it_whatever_the_step_of_their_heads():
    rng = np.random.default_rng(4)
    for height in (0.8, 0.801, 0.802, 0.803):
        caster = HeightCaster(hand_grid(heights=height))
        n = 50
        o = np.stack([rng.uniform(2.0, 17.0, n), rng.uniform(2.0, 11.0, n), np.full(n, 3.0)], axis=1)
        hits = cast_heights(caster, o, np.tile([0.0, 0.0, -1.0], (n, 1)), range_max=10.0, seed=1)
        np.testing.assert_allclose(hits.distance, 3.0 - height, atol=1e-3)
