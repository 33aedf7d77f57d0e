"""One ray against solids alone: no crop and no ground."""

import warp as wp

from swath.rays.kernel.scene import Hit, SolidArrays, facing, no_hit
from swath.rays.kernel.shapes import MISS, axis_point, hit_box, hit_capsule, hit_sphere

SOLID = wp.constant(7)
BLOCK = 64  # threads of a CUDA block; 1,024 on a multiprocessor leave 64 registers each


@wp.func
def hit_solids(solids: SolidArrays, o: wp.vec3d, d: wp.vec3, hit: Hit) -> Hit:
    """Nearest solid."""
    to_all = wp.vec3(solids.middle - o)
    beside = to_all - wp.dot(to_all, d) * d
    if wp.dot(beside, beside) > solids.reach * solids.reach:
        return hit
    for i in range(solids.count):
        away = wp.vec3(solids.centre[i] - o)
        along = wp.dot(away, d)
        across = away - along * d
        bound = solids.bound[i]
        if wp.dot(across, across) <= bound * bound and along + bound > 0.0 and along - bound < hit.t:
            axes = solids.axes[i]
            half = solids.half[i]
            p = -(wp.transpose(axes) * away)
            v = wp.transpose(axes) * d
            t = float(MISS)
            n = wp.vec3(0.0, 0.0, 1.0)
            kind = solids.kind[i]
            if kind == 0:
                box = hit_box(p, v, half)
                t = box[0]
                n = wp.vec3(box[1], box[2], box[3])
            elif kind == 1:
                a = wp.vec3(0.0, 0.0, -half[2])
                b = wp.vec3(0.0, 0.0, half[2])
                t = hit_capsule(p, v, a, b, half[0])
                q = p + t * v
                n = q - axis_point(q, a, b)
            elif kind == 3:  # seen from both sides: it need not be closed
                found = wp.mesh_query_ray(solids.tree[i], p, v, wp.min(hit.t, along + bound))
                if found.result:
                    t = found.t
                    n = found.normal
            else:
                pe = wp.cw_div(p, half)
                ve = wp.cw_div(v, half)
                stretch = wp.length(ve)
                t = hit_sphere(pe, ve / stretch, wp.vec3(0.0, 0.0, 0.0), 1.0)
                if t < MISS:
                    n = wp.cw_div(pe + t * (ve / stretch), half)
                    t = t / stretch
            if t > 0.0 and t < hit.t:
                hit.t = t
                hit.organ = SOLID
                hit.cosine = wp.min(1.0, wp.abs(wp.dot(n, v)) / wp.max(wp.length(n), 1.0e-20))
                hit.reflectance = solids.reflectance[i]
                hit.normal = axes * n
    return hit


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
    d = wp.vec3(directions[wp.min(i, directions.shape[0] - 1)])
    hit = hit_solids(solids, origins[wp.min(i, origins.shape[0] - 1)], d, no_hit(range_max))
    if hit.organ == 0:
        distance[i] = wp.nan
    else:
        distance[i] = hit.t
    organ[i] = wp.uint8(hit.organ)
    cosine[i] = hit.cosine
    reflectance[i] = hit.reflectance
    if normal.shape[0] > 0:
        normal[i] = facing(hit.normal, d)
