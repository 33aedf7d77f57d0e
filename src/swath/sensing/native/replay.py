"""A scan of single rays through measured heights as one Warp kernel: aim, march, report."""

import warp as wp

from swath.rays.single.kernel import Heights, meet_heights
from swath.sensing.native.kernel import Electronics, aim_pack, report_pack


@wp.kernel(enable_backward=False)
def scan_heights(
    words: wp.array(dtype=wp.uint64),
    rotations: wp.array(dtype=wp.float64),
    forward: wp.array(dtype=wp.vec3d),
    is_drawn: int,
    g: Heights,
    whole: wp.array(dtype=int),
    real: wp.array(dtype=float),
    e: Electronics,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    normal: wp.array2d(dtype=float),
    distance: wp.array(dtype=float),
    kind: wp.array(dtype=int),
    cell: wp.array(dtype=int),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    fault: wp.array(dtype=int),
    count: int,
    ranges: wp.array(dtype=float),
    intensity: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec3d),
):
    """One thread per pack of 16 beams, without solids; rest as in `aim`, `cast_heights`, `report`."""
    p = wp.tid()
    aim_pack(p, words, origins, rotations, forward, count, is_drawn, directions, normal, fault)
    meet_heights(
        p, g, whole[0], real[0], real[1], real[2], origins, directions, count, 0,
        distance, kind, cell, cosine, reflectance, fault,
    )  # fmt: skip
    report_pack(
        p, e, origins, directions, distance, cosine, reflectance, kind, normal, count,
        ranges, intensity, points,
    )  # fmt: skip
