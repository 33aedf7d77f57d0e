"""A sample of an inertial unit with its errors as a Warp kernel: imu_step.cpp."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

Wholes = wp.array(dtype=wp.int64)
Numbers = wp.array(dtype=wp.float64)


@wp.func_native(exact_code(Path(__file__).parent / "imu_step.cpp"))
def make_sample(
    head: Wholes,
    stamps: Wholes,
    poses: wp.array3d(dtype=wp.float64),
    world: int,
    share: wp.float64,
    dt: wp.int64,
    memory: Numbers,
    told: Numbers,
): ...


@wp.kernel
def sample_each(
    head: Wholes,
    stamps: Wholes,
    poses: wp.array3d(dtype=wp.float64),
    clock: Wholes,
    shares: Numbers,
    units: wp.array2d(dtype=wp.float64),
    samples: wp.array2d(dtype=wp.float64),
):
    """head, stamps, poses: of a trail (`core.rows`) of states; clock: begin, end, length of the step [ns].

    shares: engine speed over rated speed; samples: rates and forces with their errors
    """
    w = wp.tid()
    make_sample(head, stamps, poses, w, shares[w], clock[2], units[w], samples[w])
