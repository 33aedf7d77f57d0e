"""What is worked out in C++: Warp kernels of one thread, each described in its .cpp file."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


def source(*names: str) -> str:
    """Code of native functions from the .cpp files of this folder, one behind the other."""
    return "".join((Path(__file__).parent / f"{name}.cpp").read_text(encoding="utf-8") for name in names)


@wp.struct
class Search:
    """The search for ways."""

    numbers: wp.array(dtype=wp.float64)
    body: wp.array(dtype=wp.float64)
    ground: wp.array(dtype=wp.float32)
    node_rows: wp.array(dtype=wp.float64)
    heap_keys: wp.array(dtype=wp.float64)
    heap_nodes: wp.array(dtype=wp.int32)
    best_rows: wp.array(dtype=wp.float32)
    distance: wp.array(dtype=wp.float32)
    edge_rows: wp.array(dtype=wp.float32)
    reachable_from: wp.array(dtype=wp.float32)
    bare_rows: wp.array(dtype=wp.float32)
    within_rows: wp.array(dtype=wp.float32)
    following: wp.array(dtype=wp.int32)
    lane_rows: wp.array(dtype=wp.float32)
    taken_cells: wp.array(dtype=wp.uint8)
    near_sides: wp.array(dtype=wp.float64)
    patch_rows: wp.array(dtype=wp.float64)
    track_rows: wp.array(dtype=wp.float64)
    sample_rows: wp.array(dtype=wp.float64)
    found: wp.array(dtype=wp.float64)


@wp.func_native(source("search"))
def search(its: Search): ...


@wp.kernel
def find_way(its: Search):
    """See search.cpp."""
    search(its)


@wp.struct
class Sweep:
    """Ground that a body sweeps along a path."""

    numbers: wp.array(dtype=wp.float64)
    places: wp.array(dtype=wp.float64)
    rectangles: wp.array(dtype=wp.float64)
    first: wp.array(dtype=wp.int32)
    last: wp.array(dtype=wp.int32)
    room: wp.array(dtype=wp.float64)
    outlines: wp.array(dtype=wp.float64)
    starts: wp.array(dtype=wp.int32)


@wp.func_native(source("sweep"))
def sweep(its: Sweep): ...


@wp.kernel
def sweep_path(its: Sweep):
    """See sweep.cpp."""
    sweep(its)


@wp.struct
class Meets:
    """Who sweeps the same ground."""

    numbers: wp.array(dtype=wp.float64)
    own_points: wp.array(dtype=wp.float64)
    own_starts: wp.array(dtype=wp.int32)
    own_boxes: wp.array(dtype=wp.float64)
    points: wp.array(dtype=wp.float64)
    starts: wp.array(dtype=wp.int32)
    first_outline: wp.array(dtype=wp.int32)
    machines: wp.array(dtype=wp.int32)
    boxes: wp.array(dtype=wp.float64)
    blocks: wp.array(dtype=wp.float64)
    found: wp.array(dtype=wp.int32)


@wp.func_native(source("convex", "meets"))
def meets(its: Meets): ...


@wp.kernel
def meet_all(its: Meets):
    """See meets.cpp."""
    meets(its)


@wp.struct
class Crop:
    """Crop in cells."""

    numbers: wp.array(dtype=wp.float64)
    points: wp.array(dtype=wp.float64)
    starts: wp.array(dtype=wp.int32)
    cells: wp.array(dtype=wp.float32)
    times: wp.array(dtype=wp.float64)


@wp.func_native(source("crop"))
def crop(its: Crop): ...


@wp.kernel
def crop_cells(its: Crop):
    """See crop.cpp."""
    crop(its)
