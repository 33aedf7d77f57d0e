"""How far ground and straw rise above the planes of tiles, compiled; float64 without fused multiply-adds."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.struct
class Bumps:
    """As in `memory_layout.Pages`; slots: of the pages whose `tile_bump` is written."""

    ground: wp.array3d(dtype=float)
    straw: wp.array3d(dtype=float)
    tile_plane: wp.array4d(dtype=float)
    tile_bump: wp.array3d(dtype=float)
    slots: wp.array(dtype=int)
    tile_size: wp.float64


def code(*files: str) -> str:
    """The body of a native function, with what comes before it."""
    return "\n".join((Path(__file__).parent / file).read_text(encoding="utf-8") for file in files)


@wp.func_native(code("bumps.cpp", "write_bumps.cpp"))
def write(its: Bumps): ...


@wp.kernel
def write_bumps(its: Bumps):
    """All pages in one thread."""
    write(its)
