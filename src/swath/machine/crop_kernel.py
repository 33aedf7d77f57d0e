"""What becomes of crop from the knife to the ground; numbers are float64 without fused multiply-adds."""

from pathlib import Path

import warp as wp

from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_HERE = Path(__file__).parent


@wp.struct
class Sweeping:
    """Lines of points in worlds, see sweep_lines.cpp, and what comes of it, see tell_flows.cpp.

    active: worlds that still run, no others sweep; clock: begin, end, length of the step [ns]
    """

    active: wp.array(dtype=wp.bool)
    clock: wp.array(dtype=wp.int64)
    head: wp.array(dtype=wp.int64)
    poses: wp.array3d(dtype=wp.float64)
    knives: wp.array2d(dtype=wp.float64)
    lines: wp.array4d(dtype=wp.float64)
    counts: wp.array(dtype=int)
    runs: wp.array3d(dtype=int)
    steps: wp.array(dtype=wp.float64)
    last: wp.array2d(dtype=wp.float64)
    polygons: wp.array3d(dtype=wp.float64)
    found: wp.array(dtype=int)
    sums: wp.array2d(dtype=wp.float64)
    forget: wp.array(dtype=wp.float64)
    gauges: wp.array2d(dtype=wp.float64)
    flows: wp.array2d(dtype=wp.float64)


@wp.struct
class Dropping:
    """Straw outlets in worlds, see drop_straw.cpp, and processes in front of them, see pass_on.cpp.

    active, clock: as above; head: of the trail of crop flows
    """

    active: wp.array(dtype=wp.bool)
    clock: wp.array(dtype=wp.int64)
    head: wp.array(dtype=wp.int64)
    grain: wp.array2d(dtype=wp.float64)
    cut_straw: wp.array2d(dtype=wp.float64)
    shares: wp.array2d(dtype=wp.float64)
    sums: wp.array2d(dtype=wp.float64)
    loads: wp.array2d(dtype=wp.float64)
    straw: wp.array(dtype=wp.float64)
    poses: wp.array2d(dtype=wp.float64)
    outlets: wp.array2d(dtype=wp.float64)
    states: wp.array2d(dtype=wp.float64)
    polygons: wp.array3d(dtype=wp.float64)
    found: wp.array(dtype=int)


@wp.func_native(exact_code(_HERE / "swept.cpp", _HERE / "sweep_lines.cpp"))
def sweep(w: int, its: Sweeping): ...


@wp.func_native(exact_code(_HERE / "pass_on.cpp"))
def take_in(w: int, its: Dropping): ...


@wp.func_native(exact_code(_HERE / "swept.cpp", _HERE / "drop_straw.cpp"))
def drop(w: int, its: Dropping): ...


@wp.func_native(exact_code(_HERE / "tell_flows.cpp"))
def tell(w: int, its: Sweeping): ...


@wp.kernel
def sweep_lines(its: Sweeping):
    """One world a thread."""
    sweep(wp.tid(), its)


@wp.kernel
def tell_flows(its: Sweeping):
    """One world a thread."""
    tell(wp.tid(), its)


@wp.kernel
def pass_on(its: Dropping):
    """One world a thread."""
    take_in(wp.tid(), its)


@wp.kernel
def drop_straw(its: Dropping):
    """One world a thread."""
    drop(wp.tid(), its)
