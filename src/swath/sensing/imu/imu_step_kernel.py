"""A sample of an inertial unit with its errors as a Warp kernel: imu_step.cpp."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native(exact_code(Path(__file__).parent / "imu_step.cpp"))
def make_sample(memory: wp.array(dtype=wp.float64)): ...


@wp.kernel
def sample_each(memories: wp.array2d(dtype=wp.float64)):
    """One thread a world."""
    make_sample(memories[wp.tid()])


@wp.kernel
def sample_once(memory: wp.array(dtype=wp.float64)):
    """One thread; see imu_step.cpp."""
    make_sample(memory)
