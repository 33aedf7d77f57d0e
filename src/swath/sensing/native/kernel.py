"""Native functions around the rays of a scanner as Warp kernels: sweep.cpp, aim.cpp, report.cpp."""

from pathlib import Path

import warp as wp

from swath.rays.single.kernel import Beams, vectors

_HERE = Path(__file__).parent


def _source(name: str) -> str:
    return (_HERE / f"{name}.cpp").read_text(encoding="utf-8")


@wp.struct
class Electronics:
    """range_min [m]; least_energy: albedo / r2 that is just detected [1/m2], (1,); judged: only echoes from
    this kind of surface need it, -1 = all; blind: kind that gives no echo, -1 = none
    is_noisy: 0 = no bias [m], noise and resolution [m]; sigma: rows (range, one sigma) [m], flat
    by_signal: rows of the logarithms of signal to noise ratio and one sigma [m], flat, may be empty
    at_reach: the ratio of the weakest echo
    ranges, intensity, points: where the result goes, one echo per beam, points flat.
    """

    range_min: float
    least_energy: wp.array(dtype=float)
    judged: int
    blind: int
    is_noisy: int
    bias: float
    resolution: float
    sigma: wp.array(dtype=float)
    by_signal: wp.array(dtype=float)
    at_reach: float
    ranges: wp.array(dtype=float)
    intensity: wp.array(dtype=float)
    points: wp.array(dtype=wp.vec3d)


@wp.func_native(_source("sweep"))
def pose_beams(
    states: wp.array(dtype=wp.float64),
    mounting: wp.array(dtype=wp.float64),
    beam_t: wp.array(dtype=wp.float64),
    end: wp.float64,
    state_count: int,
    count: int,
    origins: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.float64),
): ...


@wp.kernel(enable_backward=False)
def sweep(
    states: wp.array(dtype=wp.float64),
    mounting: wp.array(dtype=wp.float64),
    beam_t: wp.array(dtype=wp.float64),
    sizes: wp.array(dtype=wp.float64),
    origins: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.float64),
):
    """sizes: end [ns], number of states, number of beams."""
    pose_beams(states, mounting, beam_t, sizes[0], int(sizes[1]), int(sizes[2]), origins, rotations)


@wp.struct
class Aiming:
    """The beams of a sweep before they have directions.

    words: key of the random stream and t
    mounting, beam_t: as in sweep.cpp
    rotations: (n, 3, 3) of the sensor, flat
    forward: (n, 3) beams in the sensor frame
    is_drawn: 0 = no random numbers
    """

    words: wp.array(dtype=wp.uint64)
    mounting: wp.array(dtype=wp.float64)
    beam_t: wp.array(dtype=wp.float64)
    rotations: wp.array(dtype=wp.float64)
    forward: wp.array(dtype=wp.vec3d)
    is_drawn: int


@wp.func_native(vectors() + _source("philox") + _source("aim"))
def aim_packet(p: int, sweep: Aiming, beams: Beams): ...


@wp.kernel(enable_backward=False)
def aim(sweep: Aiming, beams: Beams):
    """One thread per packet of 16 beams."""
    aim_packet(wp.tid(), sweep, beams)


@wp.func_native(vectors() + _source("report"))
def report_packet(p: int, e: Electronics, beams: Beams): ...


@wp.kernel(enable_backward=False)
def report(e: Electronics, beams: Beams):
    """One thread per packet of 16 beams."""
    report_packet(wp.tid(), e, beams)


@wp.kernel(enable_backward=False)
def report_sweeps(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    electronics: wp.array(dtype=Electronics),
    beams: wp.array(dtype=Beams),
    looked_at: wp.array(dtype=wp.int32),
):
    """One world a thread. looked_at: worlds whose scans Python has to see, which sets `needs`."""
    w = wp.tid()
    if not active[w]:
        return
    b = beams[w]
    for p in range((b.count + 15) / 16):
        report_packet(p, electronics[w], b)
    if looked_at[w] != 0:
        needs[0] = 1
