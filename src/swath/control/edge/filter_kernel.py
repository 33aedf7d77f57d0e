"""The level `filter` as a kernel over worlds: filter.cpp, one thread a world."""

from dataclasses import fields
from pathlib import Path

import warp as wp

from swath.control.edge import filter as level

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

SIZES = f"""
static_assert(sizeof(Head) == {level.STATE} * sizeof(D) && sizeof(Node) == {level.NODE} * sizeof(D));
static_assert(NODES * GRID + 2 * L * S + 2 * S + SHAPES * L * 2 * K == {level.GRIDS});
static_assert(sizeof(Numbers) == {len(fields(level.Params)) - len(level.OTHERS)} * sizeof(D));
"""  # memory that Python lays out for it


@wp.func_native((Path(__file__).parent / "filter.cpp").read_text(encoding="utf-8") + SIZES)
def filter_edge(
    given: wp.array(dtype=wp.float64),
    setup: wp.array(dtype=wp.float64),
    numbers: wp.array(dtype=wp.float64),
    aim: wp.array(dtype=wp.float64),
    ago: wp.array(dtype=wp.float64),
    ranges: wp.array(dtype=wp.float64),
    state: wp.array(dtype=wp.float64),
    grids: wp.array(dtype=wp.float32),
    told: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def filter_edges(
    given: wp.array2d(dtype=wp.float64),
    setup: wp.array2d(dtype=wp.float64),
    numbers: wp.array2d(dtype=wp.float64),
    aim: wp.array2d(dtype=wp.float64),
    ago: wp.array2d(dtype=wp.float64),
    ranges: wp.array2d(dtype=wp.float64),
    state: wp.array2d(dtype=wp.float64),
    grids: wp.array2d(dtype=wp.float32),
    told: wp.array2d(dtype=wp.float64),
):
    """First axis the world; see filter.py."""
    w = wp.tid()
    filter_edge(given[w], setup[w], numbers[w], aim[w], ago[w], ranges[w], state[w], grids[w], told[w])
