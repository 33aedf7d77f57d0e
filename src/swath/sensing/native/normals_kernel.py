"""normals.cpp as a kernel."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


_HERE = Path(__file__).parent


@wp.func_native("\n".join((_HERE / f).read_text(encoding="utf-8") for f in ("philox.cpp", "normals.cpp")))
def numpys_normals(
    keys: wp.array2d(dtype=wp.uint64),
    counter: wp.array(dtype=wp.uint64),
    widths: wp.array(dtype=wp.float64),
    heights: wp.array(dtype=wp.float64),
    bounds: wp.array(dtype=wp.int64),
    rows: wp.array2d(dtype=wp.float64),
    slow: wp.array(dtype=wp.bool),
    needs: wp.array(dtype=int),
): ...


@wp.kernel
def draw_normals(
    keys: wp.array2d(dtype=wp.uint64),
    counter: wp.array(dtype=wp.uint64),
    widths: wp.array(dtype=wp.float64),
    heights: wp.array(dtype=wp.float64),
    bounds: wp.array(dtype=wp.int64),
    rows: wp.array2d(dtype=wp.float64),
    slow: wp.array(dtype=wp.bool),
    needs: wp.array(dtype=int),
):
    """All streams in one thread."""
    numpys_normals(keys, counter, widths, heights, bounds, rows, slow, needs)
