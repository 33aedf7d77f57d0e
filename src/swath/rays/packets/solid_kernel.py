"""Rays against solids before the traversal, compiled where something stands in sight."""

import warp as wp

from swath.rays.kernel.cast import hit_solids
from swath.rays.kernel.scene import SolidArrays, facing, no_hit
from swath.rays.packets.kernel import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel(enable_backward=False)
def hit_nearest_solid(
    solids: SolidArrays,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    range_max: float,
    first: int,
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
):
    """Nearest solid of each ray, range_max and organ 0 without one: what the traversal starts with."""
    i = first + wp.tid()
    hit = hit_solids(solids, origins[i], wp.vec3(directions[i]), no_hit(range_max))
    distance[i] = hit.t
    organ[i] = wp.uint8(hit.organ)
    cosine[i] = hit.cosine
    reflectance[i] = hit.reflectance
    if normal.shape[0] > 0:
        normal[i] = facing(hit.normal, wp.vec3(directions[i]))
