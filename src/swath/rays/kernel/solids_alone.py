"""One ray against solids alone: no crop and no ground."""

import warp as wp

from swath.rays.kernel.cast import hit_solids
from swath.rays.kernel.scene import SolidArrays, facing, no_hit


@wp.kernel(enable_backward=False)
def cast_solids(
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
    i = first + wp.tid()
    hit = hit_solids(solids, origins[i], wp.vec3(directions[i]), no_hit(range_max))
    if hit.organ == 0:
        distance[i] = wp.nan
    else:
        distance[i] = hit.t
    organ[i] = wp.uint8(hit.organ)
    cosine[i] = hit.cosine
    reflectance[i] = hit.reflectance
    if normal.shape[0] > 0:
        normal[i] = facing(hit.normal, wp.vec3(directions[i]))
