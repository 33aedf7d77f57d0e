"""A first-order autoregressive chain along each line of a scanner."""

import warp as wp


@wp.kernel(enable_backward=False)
def chain_lines(
    noise: wp.array2d(dtype=wp.float64),
    keep: wp.array2d(dtype=wp.float64),
    out: wp.array2d(dtype=wp.float64),
):
    line = wp.tid()
    z = noise[0, line]
    out[0, line] = z
    for i in range(1, noise.shape[0]):
        r = keep[i, line]
        z = r * z + wp.sqrt(wp.max(wp.float64(1.0) - r * r, wp.float64(0.0))) * noise[i, line]
        out[i, line] = z
