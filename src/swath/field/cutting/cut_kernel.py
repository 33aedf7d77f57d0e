"""What changes the pages of a field, and looks at the crop along lines, compiled, in native code.

Rules and units are those of `cut_result.py` here and `field/cutting/height_bounds.py`; numbers are float64
without fused multiply-adds.
"""

import warp as wp

from swath.field.cutting.height_kernel import code
from swath.field.cutting.land_kernel import Land, Work

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native(code("pages.cpp", "tops.cpp", "cut_polygons.cpp"))
def cut(w: int, its: Work): ...


@wp.func_native(code("pages.cpp", "bumps.cpp", "lay_straw.cpp"))
def lay(w: int, its: Work): ...


@wp.func_native(code("crop_along.cpp"))
def look_along(
    land: Land,
    starts: wp.array2d(dtype=wp.float64),
    step: wp.array(dtype=wp.float64),
    crop: wp.array2d(dtype=wp.bool),
    is_missing: wp.array(dtype=int),
): ...


@wp.kernel
def cut_polygons(its: Work):
    """Bring all cells of polygons that are higher down to a code, one world a thread."""
    cut(wp.tid(), its)


@wp.kernel
def lay_straw(its: Work):
    """Lay straw within polygons, one world a thread."""
    lay(wp.tid(), its)


@wp.kernel
def crop_along(
    lands: wp.array(dtype=Land),
    starts: wp.array2d(dtype=wp.float64),
    step: wp.array(dtype=wp.float64),
    crop: wp.array2d(dtype=wp.bool),
    is_missing: wp.array(dtype=int),
):
    """Whether crop stands at the middles of steps (2,) from starts (n, 2) on, cell units.

    is_missing: becomes 1 where a page is not in memory
    """
    look_along(lands[0], starts, step, crop, is_missing)
