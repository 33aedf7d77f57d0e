"""Tops and bumps of tiles of pages, compiled; numbers are float64 without fused multiply-adds."""

from pathlib import Path

import warp as wp

from swath.field.cutting.land_kernel import Land

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


def code(*files: str) -> str:
    """The body of a native function, with what comes before it."""
    return "\n".join((Path(__file__).parent / file).read_text(encoding="utf-8") for file in files)


@wp.func_native(code("pages.cpp", "tops.cpp", "write_tops.cpp"))
def tops(land: Land, keys: wp.array2d(dtype=int)): ...


@wp.func_native(code("pages.cpp", "bumps.cpp", "write_bumps.cpp"))
def bumps(land: Land, keys: wp.array2d(dtype=int)): ...


@wp.kernel
def write_tops(land: Land, keys: wp.array2d(dtype=int)):
    """All pages (n, 2) in one thread."""
    tops(land, keys)


@wp.kernel
def write_bumps(land: Land, keys: wp.array2d(dtype=int)):
    """All pages (n, 2) in one thread."""
    bumps(land, keys)
