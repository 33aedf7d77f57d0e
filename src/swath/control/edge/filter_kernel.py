"""The level `filter` as a kernel over worlds: filter.cpp, one thread a world."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native((Path(__file__).parent / "filter.cpp").read_text(encoding="utf-8"))
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
