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
def take_yaw_rate(memory: wp.array(dtype=wp.float64)):
    """One thread; see yaw_rate.cpp."""
    turn(memory)
