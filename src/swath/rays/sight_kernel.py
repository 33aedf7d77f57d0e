"""Which pages beams can get to, compiled."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native((Path(__file__).parent / "single" / "sight.cpp").read_text(encoding="utf-8"))
def walk_pages(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)): ...


@wp.kernel
def find_missing(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)):
    """One thread for all beams; see sight.cpp."""
    walk_pages(whole, real)
