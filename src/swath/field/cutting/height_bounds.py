"""Tops of tiles: how high a ray has to look for crop.

A stem stands on its own cell but leans over others, and a tile shows every stem whose foot lies within reach
of it. So a tile counts as standing as long as crop stands on it or on a tile within that reach.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.field.memory_layout import PlantLibrary
from swath.field.paging.pages import PageStore
from swath.field.paging.stored_changes import Key
from swath.kernels import filled, start_warp


def update_tops(store: PageStore, library: PlantLibrary, keys: list[Key], *, sway: float = 0.0) -> None:
    """Write `tile_top` of the pages `keys` and of the pages around them, as far as they are in memory.

    sway: the most that wind leans stems on top of their own lean [m aside per m of height]
    """
    around = {(i + a, j + b) for i, j in keys for a in (-1, 0, 1) for b in (-1, 0, 1)}
    here = [key for key in around if key in store.keys]
    sizes = {"height_max": library.height_max, "stem_reach": library.reach, "sway": sway}
    _write("tops", store, here, ("tile_stand", "tile_top"), code_max=store.code_max, **sizes)


def update_bumps(store: PageStore, keys: list[Key]) -> None:
    """Write `tile_bump` of pages in memory: how far ground and straw rise above each tile's plane."""
    _write("bumps", store, keys, ("ground", "straw", "tile_plane", "tile_bump"))


def _write(what: str, store: PageStore, keys: Sequence[Key], pools: Sequence[str], **more: Any) -> None:
    """Tops or bumps of pages in memory. pools: that these take; more: what else they take."""
    if not keys:
        return
    wp, pages = start_warp(), store.pages
    from swath.field.cutting import height_kernel as kernel
    from swath.field.cutting.land_kernel import Land

    given = {name: getattr(pages, name) for name in ("table", "table_x", "table_y", "counters", *pools)}
    land = filled(Land, tile_size=store.tile_size, **given, **more)
    inputs = [land, wp.array(np.array(keys, np.int32), device="cpu")]
    wp.launch(getattr(kernel, f"write_{what}"), dim=1, inputs=inputs, device="cpu")
