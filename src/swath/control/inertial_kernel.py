"""Steps over samples of an inertial unit as Warp kernels: inclination.cpp, yaw_rate.cpp."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_HERE = Path(__file__).parent


@wp.func_native(exact_code(_HERE / "inclination.cpp"))
def incline(memory: wp.array(dtype=wp.float64)): ...


@wp.kernel
def take_inclination(memory: wp.array(dtype=wp.float64)):
    """One thread; see inclination.cpp."""
    incline(memory)


@wp.func_native(exact_code(_HERE / "yaw_rate.cpp"))
def turn(memory: wp.array(dtype=wp.float64)): ...


@wp.kernel
def take_samples(
    head: wp.array(dtype=wp.int64),
    stamps: wp.array(dtype=wp.int64),
    rate_x: wp.array2d(dtype=wp.float64),
    rate_y: wp.array2d(dtype=wp.float64),
    rate_z: wp.array2d(dtype=wp.float64),
    force_x: wp.array2d(dtype=wp.float64),
    force_y: wp.array2d(dtype=wp.float64),
    force_z: wp.array2d(dtype=wp.float64),
    first: int,
    rows: wp.array2d(dtype=wp.float64),
):
    """Samples of a trail (`core.rows`) into the memory of each world; first: where they begin there."""
    w = wp.tid()
    count = int(head[1])
    rows[w, 0] = wp.float64(count)
    for k in range(count):
        at = first + 7 * k
        rows[w, at] = wp.float64(stamps[k])
        rows[w, at + 1] = rate_x[k, w]
        rows[w, at + 2] = rate_y[k, w]
        rows[w, at + 3] = rate_z[k, w]
        rows[w, at + 4] = force_x[k, w]
        rows[w, at + 5] = force_y[k, w]
        rows[w, at + 6] = force_z[k, w]
