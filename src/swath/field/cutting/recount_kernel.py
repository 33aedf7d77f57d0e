"""What is gone from the stems of a page, compiled."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native((Path(__file__).parent / "recount.cpp").read_text(encoding="utf-8"))
def count_page(
    whole: wp.array(dtype=wp.int64),
    real: wp.array(dtype=wp.float64),
    masses: wp.array2d(dtype=wp.float64),
    counts: wp.array2d(dtype=int),
): ...


@wp.kernel
def recount_page(
    whole: wp.array(dtype=wp.int64),
    real: wp.array(dtype=wp.float64),
    masses: wp.array2d(dtype=wp.float64),
    counts: wp.array2d(dtype=int),
):
    """One thread for a page; see recount.cpp.

    whole: addresses of the codes at the start and now, of prototypes and stand of the tiles; then of the
    library's stem_start, stem_xy, stem_rank, stem_height (float64), ear_height, grain_kg, straw_kg, ~is_weed
    """
    count_page(whole, real, masses, counts)
