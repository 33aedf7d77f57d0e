"""A sample of an inertial unit with its errors as a Warp kernel: imu_step.cpp."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


real = wp.float64


@wp.func_native(exact_code(Path(__file__).parent / "imu_step.cpp"))
def make_sample(memory: wp.array(dtype=wp.float64), told: wp.array(dtype=wp.float64)): ...


@wp.kernel
def lay_states(
    head: wp.array(dtype=wp.int64),
    stamps: wp.array(dtype=wp.int64),
    poses: wp.array3d(dtype=wp.float64),
    memories: wp.array2d(dtype=wp.float64),
    needs: wp.array(dtype=int),
):
    """Put the states of a trail (`core.rows`) into the memories.

    needs: 1 where one needs more than the states
    """
    w = wp.tid()
    count = int(head[1])
    memory = memories[w]
    memory[0] = real(0.0)
    is_plain = count > 0 and wp.isfinite(memory[1]) and wp.isfinite(memory[52])
    if is_plain:
        is_plain = real(stamps[0]) > memory[1]
    if not is_plain:
        needs[0] = 1
        return
    memory[0] = real(wp.min(count, 2))
    for back in range(2):
        k = count - 1 - back
        if k >= 0:
            at = 27 - 13 * back
            memory[at] = real(stamps[k])
            for i in range(12):
                memory[at + 1 + i] = poses[k, w, i]


@wp.kernel
def sample_each(memories: wp.array2d(dtype=wp.float64), samples: wp.array2d(dtype=wp.float64)):
    """Sample the worlds whose states were taken. samples: rates and forces with their errors."""
    w = wp.tid()
    if memories[w, 0] > real(0.0):
        make_sample(memories[w], samples[w])
