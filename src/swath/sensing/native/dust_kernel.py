"""Light through puffs of dust, beam by beam; float64 without fused multiply-adds."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

FAINT = wp.constant(wp.float64(20.0))  # an exponent beyond it adds nothing


@wp.func
def extinction(puffs: wp.array2d(dtype=wp.float64), point: wp.vec3d) -> wp.float64:
    """Of all puffs at a point over the ground [1/m]."""
    total = wp.float64(0.0)
    for k in range(puffs.shape[0]):
        dx = point[0] - puffs[k, 0]
        dy = point[1] - puffs[k, 1]
        flat = (dx * dx + dy * dy) * puffs[k, 3]
        if flat < FAINT:
            up = point[2] - puffs[k, 2]
            down = point[2] + puffs[k, 2]
            above = flat + up * up * puffs[k, 4]
            below = flat + down * down * puffs[k, 4]
            part = wp.float64(0.0)
            if above < FAINT:
                part += wp.exp(-above)
            if below < FAINT:
                part += wp.exp(-below)
            total += puffs[k, 5] * part
    return total


@wp.kernel
def through_dust(
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    puffs: wp.array2d(dtype=wp.float64),
    uniform: wp.float64,
    ground: wp.float64,
    step: wp.float64,
    depths: wp.array2d(dtype=wp.float64),
    local: wp.array2d(dtype=wp.float64),
):
    """Of beams: optical depth at the ends of their steps, and extinction in the middles.

    origins: world; uniform: extinction everywhere [1/m]; ground: height of the ground [m]; step: [m]
    """
    i = wp.tid()
    depth = wp.float64(0.0)
    for k in range(depths.shape[1]):
        way = step * (wp.float64(k) + wp.float64(0.5))
        point = origins[i] + way * directions[i]
        point[2] = wp.max(point[2] - ground, wp.float64(0.0))
        here = uniform + extinction(puffs, point)
        depth += step * here
        depths[i, k] = depth
        local[i, k] = here
