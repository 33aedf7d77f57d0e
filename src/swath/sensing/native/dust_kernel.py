"""Light through puffs of dust, and what it sends back, as Warp kernels: dust.cpp, air_echo.cpp."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_HERE = Path(__file__).parent


@wp.func_native((_HERE / "dust.cpp").read_text(encoding="utf-8"))
def sum_puffs(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)): ...


@wp.kernel
def through_dust(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)):
    """One thread for all beams; see dust.cpp."""
    sum_puffs(whole, real)


@wp.func_native((_HERE / "air_echo.cpp").read_text(encoding="utf-8"))
def find_echoes(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)): ...


@wp.kernel
def air_echoes(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)):
    """One thread for all beams; see air_echo.cpp."""
    find_echoes(whole, real)
