"""The search for ways as a Warp kernel: search.cpp."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native((Path(__file__).parent / "search.cpp").read_text(encoding="utf-8"))
def search(
    numbers: wp.array(dtype=wp.float64),
    body: wp.array(dtype=wp.float64),
    ground: wp.array(dtype=wp.float32),
    node_rows: wp.array(dtype=wp.float64),
    heap_keys: wp.array(dtype=wp.float64),
    heap_nodes: wp.array(dtype=wp.int32),
    best_rows: wp.array(dtype=wp.float32),
    distance: wp.array(dtype=wp.float32),
    edge_rows: wp.array(dtype=wp.float32),
    reachable_from: wp.array(dtype=wp.float32),
    bare_rows: wp.array(dtype=wp.float32),
    within_rows: wp.array(dtype=wp.float32),
    following: wp.array(dtype=wp.int32),
    lane_rows: wp.array(dtype=wp.float32),
    taken_cells: wp.array(dtype=wp.uint8),
    near_sides: wp.array(dtype=wp.float64),
    patch_rows: wp.array(dtype=wp.float64),
    track_rows: wp.array(dtype=wp.float64),
    found: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def find_way(
    numbers: wp.array(dtype=wp.float64),
    body: wp.array(dtype=wp.float64),
    ground: wp.array(dtype=wp.float32),
    node_rows: wp.array(dtype=wp.float64),
    heap_keys: wp.array(dtype=wp.float64),
    heap_nodes: wp.array(dtype=wp.int32),
    best_rows: wp.array(dtype=wp.float32),
    distance: wp.array(dtype=wp.float32),
    edge_rows: wp.array(dtype=wp.float32),
    reachable_from: wp.array(dtype=wp.float32),
    bare_rows: wp.array(dtype=wp.float32),
    within_rows: wp.array(dtype=wp.float32),
    following: wp.array(dtype=wp.int32),
    lane_rows: wp.array(dtype=wp.float32),
    taken_cells: wp.array(dtype=wp.uint8),
    near_sides: wp.array(dtype=wp.float64),
    patch_rows: wp.array(dtype=wp.float64),
    track_rows: wp.array(dtype=wp.float64),
    found: wp.array(dtype=wp.float64),
):
    """One thread; see search.cpp."""
    search(
        numbers, body, ground, node_rows, heap_keys, heap_nodes, best_rows, distance, edge_rows,
        reachable_from, bare_rows, within_rows, following, lane_rows, taken_cells, near_sides, patch_rows,
        track_rows, found,
    )  # fmt: skip
