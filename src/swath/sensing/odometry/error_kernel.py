"""The level `error` of odometry as a kernel over worlds."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.kernel
def measure(
    speeds: wp.array(dtype=wp.float64),
    rates: wp.array(dtype=wp.float64),
    angles: wp.array(dtype=wp.float64),
    slips: int,
    constant: wp.array2d(dtype=wp.float64),
    sd: wp.array2d(dtype=wp.float64),
    noise: wp.array2d(dtype=wp.float64),
    samples: wp.array2d(dtype=wp.float64),
):
    """slips: 1 where the wheels' slip has to be added to the speed; constant, samples: see
    `error.Odometers`.
    """
    w = wp.tid()
    samples[w, 0] = speeds[w] * constant[w, slips] + sd[w, 0] * noise[w, 0]
    samples[w, 1] = rates[w] + constant[w, 2] + sd[w, 1] * noise[w, 1]
    samples[w, 2] = angles[w] + constant[w, 3] + sd[w, 2] * noise[w, 2]
