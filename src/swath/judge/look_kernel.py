"""Looks of judges at samples, right after these are sent, in float64 without fused multiply-adds."""

import warp as wp

from swath.field.cutting.cut_kernel import look_along
from swath.field.cutting.land_kernel import Land
from swath.field.edges.profile_kernel import Profile, crop_along

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

FAR = wp.constant(wp.float64(1.0e6))  # as in field.py
LOOK, WAIT, TAKE = wp.constant(1), wp.constant(2), wp.constant(3)  # as in edge_looks.py


@wp.struct
class Across:
    """A machine whose edge is judged.

    has_profile: whether its field has one
    counters: of the pages, see `memory_layout.REVISION`; moved: how often they had when they were taken over
    turn: cosine and sine of the yaw of the stand; cell: of the pages [m]
    begin: y of the begin of a line, of `width` [m] for a step; end_y, knife_x: of the header end [m]
    """

    has_profile: int
    counters: wp.array(dtype=wp.int64)
    moved: wp.int64
    turn: wp.vec2d
    cell: wp.float64
    begin: wp.float64
    width: wp.float64
    end_y: wp.float64
    knife_x: wp.float64


@wp.kernel
def look_across(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    machines: wp.array(dtype=Across),
    lands: wp.array(dtype=Land),
    profiles: wp.array(dtype=Profile),
    edge_t: wp.array(dtype=wp.int64),
    reference_x: wp.array(dtype=wp.float64),
    offset: wp.array(dtype=wp.float64),
    confidence: wp.array(dtype=wp.float64),
    is_held: wp.array(dtype=wp.bool),
    offset_sd: wp.array(dtype=wp.float64),
    state_t: wp.array(dtype=wp.int64),
    pose: wp.array2d(dtype=wp.float64),
    distance: wp.array(dtype=wp.float64),
    asks: wp.array(dtype=wp.int32),
    waits: wp.array(dtype=wp.int32),
    reference: wp.array(dtype=wp.float64),
    starts: wp.array3d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float64),
    is_missing: wp.array2d(dtype=int),
    stations: wp.array(dtype=int),
    rows: wp.array3d(dtype=wp.float64),
    crop: wp.array4d(dtype=wp.bool),
    counts: wp.array(dtype=wp.int32),
):
    """One world a thread; see `edge_looks.EdgeLooks`, of which are all arrays from `asks` on."""
    w = wp.tid()
    asks[w] = 0
    if not active[w]:
        return
    t = edge_t[w % edge_t.shape[0]]
    if waits[w] != 0 or t != state_t[w % state_t.shape[0]]:
        asks[w] = WAIT
        needs[0] = 1
        return
    its = machines[w]
    if wp.isfinite(reference_x[w]):  # where none is reported, the last one counts
        reference[w] = reference_x[w]
    ahead = reference[w]
    px = pose[w, 0]
    py = pose[w, 1]
    ax = pose[w, 3]
    bx = pose[w, 4]
    ay = pose[w, 6]
    by = pose[w, 7]
    x = px + bx * its.begin + ax * ahead
    y = py + by * its.begin + ay * ahead
    dx = bx * its.width
    dy = by * its.width
    n = counts[w]
    row = rows[w, n]
    row[0] = wp.float64(t)
    row[1] = distance[w]
    row[2] = offset[w]
    row[3] = confidence[w]
    row[4] = wp.where(is_held[w], wp.float64(1.0), wp.float64(0.0))
    row[5] = offset_sd[w]
    row[6] = px + ax * ahead + bx * its.end_y
    row[7] = py + ay * ahead + by * its.end_y
    row[8] = px + ax * its.knife_x + bx * its.end_y
    row[9] = py + ay * its.knife_x + by * its.end_y
    row[10] = bx
    row[11] = by
    row[12] = ax
    row[13] = ay
    row[14] = x
    row[15] = y
    asks[w] = LOOK
    far = wp.float64(crop.shape[3])
    is_near = wp.abs(x) <= FAR and wp.abs(y) <= FAR
    is_near = is_near and wp.abs(x + far * dx) <= FAR and wp.abs(y + far * dy) <= FAR
    if is_near and its.has_profile != 0:
        stations[w] = crop_along(profiles[w], x, y, dx, dy, crop[w, n, 0], stations[w])
        asks[w] = 0
    if is_near and its.has_profile == 0 and its.counters[1] == its.moved:
        c = its.turn[0]
        s = its.turn[1]
        starts[w, 0, 0] = (c * x + s * y) / its.cell
        starts[w, 0, 1] = (c * y - s * x) / its.cell
        steps[w, 0] = (c * dx + s * dy) / its.cell
        steps[w, 1] = (c * dy - s * dx) / its.cell
        is_missing[w, 0] = 0
        look_along(lands[w], starts[w], steps[w], crop[w, n], is_missing[w])
        asks[w] = is_missing[w, 0]
    if asks[w] == 0:
        counts[w] = n + 1
        if n + 1 == rows.shape[1]:
            asks[w] = TAKE
    if asks[w] != 0:
        needs[0] = 1


@wp.kernel
def watch_way(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    clock: wp.array(dtype=wp.int64),
    distance: wp.array(dtype=wp.float64),
    rest: wp.int64,
    every: wp.float64,
    next_t: wp.array(dtype=wp.int64),
    next_way: wp.array(dtype=wp.float64),
    asks: wp.array(dtype=wp.int32),
):
    """Ask where a machine has gone on by a way `every` [m]; seen every `rest` [ns]."""
    w = wp.tid()
    asks[w] = 0
    t = clock[1]
    if not active[w] or t < next_t[w]:
        return
    next_t[w] = t + rest
    if distance[w] >= next_way[w] and t > wp.int64(0):
        next_way[w] = distance[w] + every
        asks[w] = 1
        needs[0] = 1


@wp.kernel
def watch_tilt(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    t: wp.array(dtype=wp.int64),
    pose: wp.array2d(dtype=wp.float64),
    least: wp.float64,
    rests: wp.array(dtype=wp.int64),
    asks: wp.array(dtype=wp.int32),
):
    """Ask where a machine is tilted: its vertical axis has a z below `least`; not before `rests` [ns]."""
    w = wp.tid()
    asks[w] = 0
    if active[w] and t[w % t.shape[0]] >= rests[w] and pose[w, 11] < least:
        asks[w] = 1
        needs[0] = 1
