"""Highest things in pages, which rays above them need not look at."""

import warp as wp

from swath.rays.kernel.scene import Scene

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func
def top_of(scene: Scene, slot: int, growth: float) -> float:
    """Highest thing in a page [m]: ground, straw, or live crop `growth` times as high."""
    half = float(wp.float64(0.5) * scene.tile_size)
    top = float(-wp.inf)
    for j in range(scene.tile_top.shape[1]):
        for i in range(scene.tile_top.shape[2]):
            plane = scene.tile_plane[slot, j, i]
            ground = plane[0] + half * (wp.abs(plane[1]) + wp.abs(plane[2]))
            over = wp.max(growth * scene.tile_top[slot, j, i], scene.tile_bump[slot, j, i])
            top = wp.max(top, ground + over)
    return top


@wp.kernel
def raise_tops(scene: Scene, growth: float):
    """One thread per page."""
    slot = wp.tid()
    scene.page_top[slot] = top_of(scene, slot, growth)
