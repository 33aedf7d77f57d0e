"""The level `otsu` as a kernel over worlds: scan and odometry in, crop edge out; otsu_*.cpp here.

`tests/control/otsu_in_numpy.py` has the same functions in numpy.
"""

from pathlib import Path

import warp as wp

from swath.control import inclination
from swath.control.edge import canopy_classes, profile
from swath.control.edge.feet import canopy_offset
from swath.control.edge.feet.canopy_offset_kernel import Offset, learn_offset
from swath.control.inertial_kernel import incline
from swath.core import schedule
from swath.kernels import constants, exact_code, known

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

Numbers = wp.array(dtype=wp.float64)
Table = wp.array2d(dtype=wp.float64)
ZERO, HALF = constants(0.0, 0.5)
# Rows of the scratch: echoes of a scan; those about the edge in lateral order, as they came first and as they
# count; heights, and what has no name; points of a fit, their variances and weights
_ROWS = (
    *("ECHO_X", "ECHO_U", "ECHO_Z", "RAW_X", "RAW_LEVEL", "RAW_UPPER", "RAW_LOWER"),
    *("AHEAD", "LATERAL", "LEVEL", "UPPER", "LOWER", "VALUES", "MET"),
    *("FIT_X", "FIT_U", "FIT_VARIANCE", "ROBUST"),
)
UPPER, LOWER, LEVEL = map(_ROWS.index, ("UPPER", "LOWER", "LEVEL"))
SCRATCH = len(_ROWS)
_NUMBERS = {
    "MIN_POINTS": 5,  # fewest on each side of a step
    "LOWEST": -1.5,  # m: heights of the echoes that count
    "HIGHEST": 2.2,
    "FIRST_TOP": 1.5,  # m, tried while the crop's height is unknown: dust hides edges
    "SECOND_TOP": 1.15,
    "CLEARER": 1.3,  # times the separation that a lower top must reach to count
    # of a ray's way through the upper half of the crop, from its end nearer to the crop: there it
    # counts. 0.36 for 4 to 10 mean free paths of crop and a way across three times the overhang, 0.5 for one
    # along the edge
    "INNER": 0.35,
    "MAX_GROUND": 0.6,  # m: stubble off the machine's plane
    "RESOLUTION": 0.02,  # m: least deviation of a point
    "SLOPE_SD": 0.07,  # [1], 1/m: of how far an edge is from straight ahead
    "BEND_SD": 0.02,
    # 95 % efficiency on normal errors (Beaton & Tukey 1974, doi:10.1080/00401706.1974.10489171); sd / median
    "TUKEY": profile.TUKEY,
    "MAD": profile.MAD,
    "TINY": 1e-9,  # in the place of nothing, to divide by
    "SMALL": 1e-6,  # s, m2
    "LATE": 0.1,  # shares: newest scan, echoes of crop
    "TOP": 0.9,
    "LEAST_SURE": profile.LEAST_SURE,
    "ERROR_ODDS": 3.0,  # nat: odds of an echo on its side of a threshold between heights, 95 %
    "WINDOW_S": 6.0,  # s: greatest age
    "FORGET_S": 4.0,  # s: memory of the lost
    "MIN_SHARE": 0.6,  # of scans
    "PER_SAMPLE": 8.0,  # scans see the same stems
    "LEVER": 1.2,  # m: a point's place in its scan
    "CLOSE": 0.12,  # m: scans whose edge point is further from the line show a notch, not the edge
    "CRAB": inclination.CRAB,
    "GRAVITY": inclination.GRAVITY,
    "OFTEN": canopy_offset.OFTEN,
    "NS": float(schedule.NS),
    "SCRATCH": SCRATCH,
    **{name: row for row, name in enumerate(_ROWS)},
    **{name: getattr(canopy_classes, name) for name in ("NEAR", "FAR", "HEADROOM", "ROOM")},
}


def _code(name: str) -> str:
    files = "edge/numbers", "edge/otsu_split", "edge/otsu_step", "edge/otsu_track", f"edge/{name}"
    folder = Path(__file__).parents[1]
    return known(_NUMBERS) + exact_code(*(folder / f"{file}.cpp" for file in files))


@wp.struct
class Settings:
    """What stays: numbers of `Params` in SI, and where the detector looks from.

    sign: +1 where u is y, -1 where it is -y
    centre: u of the header end; mounting: pose_machine_sensor, its position, then rows of the rotation
    lost: after so long without an edge none is reported [ns]
    reference: where ahead the offset holds
    lean, spot: first guess of the canopy's offset over the crop's height [1], and on top of that [m]
    memory: travel over which it is learned [m], 0 = it is not
    """

    sign: wp.float64
    centre: wp.float64
    reference: wp.float64
    lost: wp.float64
    min_step: wp.float64
    min_gain: wp.float64
    min_separation: wp.float64
    window: wp.float64
    search: wp.float64
    track: wp.float64
    gate: wp.float64
    lost_s: wp.float64
    acquire_s: wp.float64
    jump_s: wp.float64
    lean: wp.float64
    spot: wp.float64
    memory: wp.float64


@wp.struct
class State:
    """What a detector knows. time: of its last scan [ns]; rows: of its track.

    x0 to is_there: its line, u(x) = offset + slope (x - x0) + bend (x - x0)^2 / 2; is_there: 0 = none
    """

    time: wp.int64
    rows: wp.int64
    x0: wp.float64
    offset: wp.float64
    slope: wp.float64
    bend: wp.float64
    is_there: wp.float64
    is_found: wp.float64
    unseen: wp.float64
    crop: wp.float64
    stubble: wp.float64
    ground: wp.float64
    since: wp.float64
    shift: wp.float64


@wp.func_native(_code("otsu_scan"))
def take_scan(
    w: int,
    stamp: wp.int64,
    speed: wp.float64,
    yaw_rate: wp.float64,
    rise: wp.float64,
    is_known: bool,
    ranges: wp.array(dtype=float),
    directions: wp.array(dtype=wp.vec3d),
    ago: Numbers,
    mounting: Numbers,
    settings: wp.array(dtype=Settings),
    states: wp.array(dtype=State),
    track: Table,
    seen: Table,
    heights: Numbers,
    scratch: Table,
    indices: wp.array(dtype=int),
    told: Numbers,
) -> int: ...


@wp.func_native(_code("otsu_tell"))
def tell(
    w: int,
    now: wp.int64,
    speed: wp.float64,
    yaw_rate: wp.float64,
    settings: wp.array(dtype=Settings),
    states: wp.array(dtype=State),
    track: Table,
    edge: Numbers,
): ...


@wp.kernel
def detect(
    settings: wp.array(dtype=Settings),
    offsets: wp.array(dtype=Offset),
    mountings: wp.array2d(dtype=wp.float64),
    clock: wp.array(dtype=wp.int64),
    scanned: wp.array(dtype=wp.int64),
    speeds: Numbers,
    yaw_rates: Numbers,
    inertial: wp.array2d(dtype=wp.float64),
    ranges: wp.array2d(dtype=float),
    directions: wp.array2d(dtype=wp.vec3d),
    ago: wp.array2d(dtype=wp.float64),
    states: wp.array(dtype=State),
    tracks: wp.array3d(dtype=wp.float64),
    seen: wp.array3d(dtype=wp.float64),
    heights: wp.array2d(dtype=wp.float64),
    all_scratch: wp.array3d(dtype=wp.float64),
    indices: wp.array2d(dtype=int),
    logs: Numbers,
    edges: wp.array2d(dtype=wp.float64),
):
    """clock: begin and end of the step [ns]; scanned: time of the scan [ns]
    directions, ago: of each world or of all
    all_scratch to logs: of one world, used by one after the other
    edges: offset, heading, curvature, confidence, height of crop and stubble, and one that stays.
    """
    w = wp.tid()
    speed = ZERO
    if wp.isfinite(speeds[w]):
        speed = speeds[w]
    yaw_rate = ZERO
    if wp.isfinite(yaw_rates[w]):
        yaw_rate = yaw_rates[w]
    if inertial[w, 0] > ZERO:
        inertial[w, 1] = speed
        incline(inertial[w])
    rise = inertial[w, 3] / wp.max(inertial[w, 4], HALF)
    is_known = inertial[w, 8] != ZERO
    of = wp.min(w, directions.shape[0] - 1)
    scratch, told = all_scratch[0], all_scratch[0, SCRATCH]
    count = take_scan(
        w, scanned[0], speed, yaw_rate, rise, is_known, ranges[w], directions[of], ago[of], mountings[w],
        settings, states, tracks[w], seen[w], heights[w], scratch, indices[0], told,
    )  # fmt: skip
    if count > 0:
        found = learn_offset(
            offsets[w], scratch[UPPER], scratch[LOWER], scratch[LEVEL], count, told, seen[w], heights[w], logs
        )
        if wp.isfinite(found):
            states[w].since = ZERO
            states[w].shift = found
    tell(w, clock[1], speed, yaw_rate, settings, states, tracks[w], edges[w])
