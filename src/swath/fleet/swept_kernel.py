"""Ground that machines sweep, who meets there, what crop is on it: Warp kernels of sweep, meets, crop.cpp."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_HERE = Path(__file__).parent


@wp.func_native((_HERE / "sweep.cpp").read_text(encoding="utf-8"))
def sweep(
    numbers: wp.array(dtype=wp.float64),
    places: wp.array(dtype=wp.float64),
    rectangles: wp.array(dtype=wp.float64),
    first: wp.array(dtype=wp.int32),
    last: wp.array(dtype=wp.int32),
    room: wp.array(dtype=wp.float64),
    outlines: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
): ...


@wp.kernel
def sweep_path(
    numbers: wp.array(dtype=wp.float64),
    places: wp.array(dtype=wp.float64),
    rectangles: wp.array(dtype=wp.float64),
    first: wp.array(dtype=wp.int32),
    last: wp.array(dtype=wp.int32),
    room: wp.array(dtype=wp.float64),
    outlines: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
):
    """One thread; see sweep.cpp."""
    sweep(numbers, places, rectangles, first, last, room, outlines, starts)


@wp.func_native((_HERE / "meets.cpp").read_text(encoding="utf-8"))
def meets(
    numbers: wp.array(dtype=wp.float64),
    own_points: wp.array(dtype=wp.float64),
    own_starts: wp.array(dtype=wp.int32),
    own_boxes: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    first_outline: wp.array(dtype=wp.int32),
    machines: wp.array(dtype=wp.int32),
    boxes: wp.array(dtype=wp.float64),
    blocks: wp.array(dtype=wp.float64),
    found: wp.array(dtype=wp.int32),
): ...


@wp.kernel
def meet_all(
    numbers: wp.array(dtype=wp.float64),
    own_points: wp.array(dtype=wp.float64),
    own_starts: wp.array(dtype=wp.int32),
    own_boxes: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    first_outline: wp.array(dtype=wp.int32),
    machines: wp.array(dtype=wp.int32),
    boxes: wp.array(dtype=wp.float64),
    blocks: wp.array(dtype=wp.float64),
    found: wp.array(dtype=wp.int32),
):
    """One thread; see meets.cpp."""
    meets(
        numbers, own_points, own_starts, own_boxes, points, starts, first_outline, machines, boxes, blocks,
        found,
    )  # fmt: skip


@wp.func_native((_HERE / "crop.cpp").read_text(encoding="utf-8"))
def crop(
    numbers: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    cells: wp.array(dtype=wp.float32),
    times: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def crop_cells(
    numbers: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    cells: wp.array(dtype=wp.float32),
    times: wp.array(dtype=wp.float64),
):
    """One thread; see crop.cpp."""
    crop(numbers, points, starts, cells, times)
