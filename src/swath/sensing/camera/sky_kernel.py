"""Light on surfaces by their normals as a Warp kernel."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.kernel
def light_on(
    normals: wp.array(dtype=wp.vec3),
    sun_cosine: wp.array(dtype=wp.float64),
    table: wp.array2d(dtype=wp.vec3),
    sun: wp.array(dtype=wp.vec3d),
    found: wp.array(dtype=wp.vec3d),
):
    """See `shading.Daylight.on`. Bilinear in a table on the octahedron of normals that is folded open."""
    i = wp.tid()
    n = normals[i]
    size = wp.abs(n[0]) + wp.abs(n[1]) + wp.abs(n[2])
    x = n[0] / size
    y = n[1] / size
    if n[2] < 0.0:
        wide = 1.0 - wp.abs(y)
        y = wp.where(y < 0.0, wp.abs(x) - 1.0, 1.0 - wp.abs(x))
        x = wp.where(x < 0.0, -wide, wide)
    last = table.shape[0] - 1
    u = (0.5 + 0.5 * x) * float(last)
    v = (0.5 + 0.5 * y) * float(last)
    a = wp.clamp(int(u), 0, last - 1)
    b = wp.clamp(int(v), 0, last - 1)
    u -= float(a)
    v -= float(b)
    low = (1.0 - u) * table[b, a] + u * table[b, a + 1]
    high = (1.0 - u) * table[b + 1, a] + u * table[b + 1, a + 1]
    sky = (1.0 - v) * low + v * high
    found[i] = sun_cosine[i] * sun[0] + wp.vec3d(wp.float64(sky[0]), wp.float64(sky[1]), wp.float64(sky[2]))
