"""Native functions around the rays of a scanner as Warp kernels: sweep.cpp, aim.cpp, report.cpp."""

from pathlib import Path

import warp as wp

from swath.rays.single.kernel import lanes

_HERE = Path(__file__).parent


def _source(name: str) -> str:
    return (_HERE / f"{name}.cpp").read_text(encoding="utf-8")


@wp.struct
class Electronics:
    """range_min [m]; least_energy: albedo / r2 that is just detected [1/m2]; judged: only echoes from this
    kind of surface need it, -1 = all; blind: kind that gives no echo, -1 = none
    is_noisy: 0 = no bias [m], noise and resolution [m]; sigma: rows (range, one sigma) [m], flat
    by_signal: rows of the logarithms of signal to noise ratio and one sigma [m], flat, may be empty
    at_reach: the ratio of the weakest echo
    """

    range_min: float
    least_energy: float
    judged: int
    blind: int
    is_noisy: int
    bias: float
    resolution: float
    sigma: wp.array(dtype=float)
    by_signal: wp.array(dtype=float)
    at_reach: float


@wp.func_native(_source("sweep"))
def pose_beams(
    states: wp.array(dtype=wp.float64),
    mounting: wp.array(dtype=wp.float64),
    beam_t: wp.array(dtype=wp.float64),
    end: wp.float64,
    state_count: int,
    count: int,
    origins: wp.array(dtype=wp.float64),
    rotations: wp.array(dtype=wp.float64),
): ...


@wp.kernel(enable_backward=False)
def sweep(
    states: wp.array(dtype=wp.float64),
    mounting: wp.array(dtype=wp.float64),
    beam_t: wp.array(dtype=wp.float64),
    sizes: wp.array(dtype=wp.float64),
    origins: wp.array(dtype=wp.float64),
    rotations: wp.array(dtype=wp.float64),
):
    """sizes: end [ns], number of states, number of beams."""
    pose_beams(states, mounting, beam_t, sizes[0], int(sizes[1]), int(sizes[2]), origins, rotations)


@wp.func_native(lanes() + _source("aim"))
def aim_pack(
    p: int,
    words: wp.array(dtype=wp.uint64),
    origins: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.float64),
    forward: wp.array(dtype=wp.vec3d),
    count: int,
    is_drawn: int,
    directions: wp.array(dtype=wp.vec3d),
    normal: wp.array2d(dtype=float),
    fault: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def aim(
    words: wp.array(dtype=wp.uint64),
    origins: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.float64),
    forward: wp.array(dtype=wp.vec3d),
    count: int,
    is_drawn: int,
    directions: wp.array(dtype=wp.vec3d),
    normal: wp.array2d(dtype=float),
    fault: wp.array(dtype=int),
):
    """One thread per pack of 16 beams."""
    aim_pack(wp.tid(), words, origins, rotations, forward, count, is_drawn, directions, normal, fault)


@wp.func_native(lanes() + _source("report"))
def report_pack(
    p: int,
    e: Electronics,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    distance: wp.array(dtype=float),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    kind: wp.array(dtype=int),
    normal: wp.array2d(dtype=float),
    count: int,
    ranges: wp.array(dtype=float),
    intensity: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec3d),
): ...


@wp.kernel(enable_backward=False)
def report(
    e: Electronics,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    distance: wp.array(dtype=float),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    kind: wp.array(dtype=int),
    normal: wp.array2d(dtype=float),
    count: int,
    ranges: wp.array(dtype=float),
    intensity: wp.array(dtype=float),
    points: wp.array(dtype=wp.vec3d),
):
    """One thread per pack of 16 beams."""
    report_pack(
        wp.tid(),
        e,
        origins,
        directions,
        distance,
        cosine,
        reflectance,
        kind,
        normal,
        count,
        ranges,
        intensity,
        points,
    )
