"""Likelihood-ratio detectors, compiled: *.cpp here, each with what it does, over rows of `detector_rows`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import warp as wp

from swath.control import inclination, yaw_rate
from swath.control.edge import canopy_classes, detector_rows, ground_profile
from swath.control.edge.block_rows import USUAL, VAGUE
from swath.control.edge.detector_rows import ROW
from swath.control.edge.feet.overhang import DEVIATIONS, DIRECTIONS, LEANS
from swath.control.edge.profile import EVENLY, LEAST_SURE, MAD, TOLERANCE, TUKEY, UNSURE
from swath.control.inertial_kernel import incline, turn
from swath.kernels import constants, exact_code, known, once

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
ZERO, NS = constants(0.0, 1e9)
BIAS = wp.constant(yaw_rate.BIAS)
SLIP = wp.constant((ROW.fields["detector"][1] + ROW["detector"].fields["slip"][1]) // 8)
_FOLDER = Path(__file__).parent
_KNOWN = {"GRAVITY": inclination.GRAVITY, "UP": inclination.UP, "SINCE": inclination.SINCE}
_KNOWN |= {"SURE_S": inclination.SURE_S, "FEET": detector_rows.FEET, "EDGE": detector_rows.EDGE}
_TOLD = {"USUAL": USUAL, "VAGUE": VAGUE, "EVENLY": EVENLY, "TOLERANCE": TOLERANCE, "UNSURE": UNSURE}
_TOLD |= {"LEAST_SURE": LEAST_SURE, "LEANS": len(LEANS), "DIRECTIONS": len(DIRECTIONS)}
_TOLD |= {"NORMALS": len(DEVIATIONS), "BLOCK": canopy_classes.BLOCK}
_TOLD |= {"TUKEY": TUKEY, "MAD": MAD, "ROOM": detector_rows.POINTS}
CANOPY, GROUND = (
    {k: v for k, v in vars(module).items() if k.isupper()} for module in (canopy_classes, ground_profile)
)


def code(*files: str, names: Mapping[Any, str] | None = None, **numbers: Any) -> str:
    """The body of a native function, in files, that knows rows and numbers by their names.

    names: of rows whose numbers are a base of a struct of that name
    """
    body = exact_code(*(_FOLDER / f"{file}.cpp" for file in ("numbers", "moved", *files)))
    for row, name in (names or {}).items():
        own, head = detector_rows.members(row, names or {}), f"struct {name} : {name}Row "
        body = body.replace(head, f"struct {name}Row {{ {own} }};\n{head}")
    return "\n".join([known({**_KNOWN, **numbers}), detector_rows.structs(), body])


@wp.struct
class Memory:
    """What `Canopy` holds of a world: rows of `detector_rows`, flat.

    mean, covariance: state of the profile, at each scale; counts, solid: of `Block`; told: room for
    four numbers of each of its rays
    """

    row: wp.array(dtype=wp.float64)
    beams: wp.array(dtype=wp.float64)
    answers: wp.array(dtype=wp.float64)
    counts: wp.array(dtype=wp.float64)
    solid: wp.array(dtype=wp.float64)
    mean: wp.array(dtype=wp.float64)
    covariance: wp.array(dtype=wp.float64)
    scratch: wp.array(dtype=wp.float64)
    told: wp.array2d(dtype=wp.float64)


Ranges = wp.array3d(dtype=wp.float32)
Numbers = wp.array(dtype=wp.float64)
Grid = wp.array2d(dtype=wp.float64)


@wp.func_native(code("begin_step"))
def begin_step(
    row: Numbers,
    unit: Numbers,
    now: wp.int64,
    dt: wp.int64,
    speed: wp.float64,
    rate: wp.float64,
    fill: wp.float64,
): ...


@wp.func_native(code("canopy_rows", "silent_beams"))
def find_silent(w: int, stamp: wp.int64, ranges: Ranges, m: Memory) -> bool: ...


@wp.func_native(code("canopy_rows", "trace_beams", **CANOPY))
def trace_beams(w: int, stamp: wp.int64, ranges: Ranges, m: Memory): ...


@wp.func_native(code("canopy_rows", "stubble_plane", **CANOPY))
def fit_stubble(m: Memory): ...


@wp.func_native(code("canopy_rows", "ground_profile", **GROUND))
def go_over(m: Memory): ...


@wp.func_native(code("canopy_rows", "answer_rays", **CANOPY))
def answer_rays(m: Memory) -> bool: ...


@wp.kernel
def drive(
    active: wp.array(dtype=wp.bool),
    clock: wp.array(dtype=wp.int64),
    speeds: Numbers,
    rates: Numbers,
    angles: Numbers,
    fills: Numbers,
    upward: Grid,
    turning: Grid,
    rows: Grid,
):
    """What comes with a step. clock: its begin, end and length [ns].

    speeds, rates, angles: of the odometry; fills: shares of the header's width that cut, nan = not known
    upward, turning: memories of `Inclination` and `YawRate` with the samples since the last step
    """
    w = wp.tid()
    if active[w]:
        turning[w, 1] = rates[w]
        turning[w, 2] = speeds[w]
        turning[w, 3] = angles[w]
        turning[w, 4] = wp.float64(clock[2]) / NS
        turn(turning[w])
        speed = ZERO
        if wp.isfinite(speeds[w]):
            speed = speeds[w] / rows[w, SLIP]
        if upward[w, 0] > ZERO:
            upward[w, 1] = speed
            incline(upward[w])
        rate = rates[w] - turning[w, BIAS]
        begin_step(rows[w], upward[w], clock[1], clock[2], speed, rate, fills[w])


@wp.kernel
def take(
    active: wp.array(dtype=wp.bool),
    needs: wp.array(dtype=wp.int32),
    stamps: wp.array(dtype=wp.int64),
    ranges: Ranges,
    memories: wp.array(dtype=Memory),
):
    """A scan of each world into its block, where it is new. stamps: its time [ns].

    ranges: (worlds, beams, echoes) [m], no echoes = none was sent
    needs: set where a block has no room for one more scan
    """
    w = wp.tid()
    if active[w]:
        m = memories[w]
        if find_silent(w, stamps[0], ranges, m):
            trace_beams(w, stamps[0], ranges, m)
            fit_stubble(m)
            go_over(m)
            if answer_rays(m):
                needs[0] = 1


@wp.func_native(once(code("feet/overhang", "line/near", "report", **_TOLD)))
def tell(row: Numbers, points: wp.array(dtype=wp.vec4d), edge: wp.array(dtype=wp.uint8), stage: int): ...


@wp.kernel
def report(
    active: wp.array(dtype=wp.bool),
    rows: Grid,
    points: wp.array2d(dtype=wp.vec4d),
    edges: wp.array2d(dtype=wp.uint8),
    stage: int,
):
    """A stage of what detectors tell, as `Detectors` has it."""
    w = wp.tid()
    if active[w]:
        tell(rows[w], points[w], edges[w], stage)
