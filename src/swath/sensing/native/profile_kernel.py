"""The LiDAR level `profile` as a kernel over worlds."""

import warp as wp

from swath.field.edges.profile_kernel import Profile
from swath.rays.single.kernel import Beams, Canopy
from swath.rays.single.profile_kernel import chain_scores_along, meet_profile
from swath.sensing.native.kernel import Aiming, Electronics, aim_packet, pose_beams, report_packet


@wp.struct
class Sweep:
    """Of a scanner: mounting and beam_t as in sweep.cpp; angles between neighbours [rad] and lines as in
    scores.cpp; reach [m]; origins and rotations: of the beams, the memory of `Beams` and `Aiming`.
    """

    mounting: wp.array(dtype=wp.float64)
    beam_t: wp.array(dtype=wp.float64)
    apart: wp.array(dtype=float)
    lines: int
    reach: float
    origins: wp.array(dtype=wp.float64)
    rotations: wp.array(dtype=wp.float64)


@wp.kernel(enable_backward=False)
def take_states(
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=wp.int32),
    head: wp.array(dtype=wp.int64),
    stamps: wp.array(dtype=wp.int64),
    poses: wp.array3d(dtype=wp.float64),
    last: wp.array2d(dtype=wp.float64),
    states: wp.array2d(dtype=wp.float64),
    counts: wp.array(dtype=int),
    words: wp.array2d(dtype=wp.uint64),
    swept: wp.array(dtype=wp.int64),
    laid_at: wp.array2d(dtype=wp.float64),
    most: wp.float64,
    is_asked: int,
):
    """The states of a machine between two sweeps: t [ns], position and rotation of each, the newest before
    them first.

    head, stamps, poses: of the trail of states; last: of each world that newest one, t < 0 = none
    swept: sweeps so far
    laid_at: where the ground was laid, nan where it is to be laid anew: farther than `most` [m] from there
    needs: set where ground is to be laid, or always
    """
    w = wp.tid()
    room = states.shape[1] // 13
    came = int(head[1])
    old = int(0)
    if last[w, 0] >= wp.float64(0.0):
        old = 1
    count = came + old
    kept = wp.min(count, room)
    spread = wp.float64(count - 1) / wp.float64(wp.max(room - 1, 1))
    for k in range(kept):
        of = k
        if count > room:
            of = int(wp.rint(wp.float64(k) * spread))
            if k == room - 1:
                of = count - 1
        at = 13 * k
        if of < old:
            for i in range(13):
                states[w, at + i] = last[w, i]
        else:
            states[w, at] = wp.float64(stamps[of - old])
            for i in range(12):
                states[w, at + 1 + i] = poses[of - old, w, i]
        east = states[w, at + 1] - laid_at[w, 0]
        north = states[w, at + 2] - laid_at[w, 1]
        if not (wp.sqrt(east * east + north * north) < most):
            laid_at[w, 0] = wp.float64(wp.nan)
            needs[0] = 1
    if came > 0:
        last[w, 0] = wp.float64(stamps[came - 1])
        for i in range(12):
            last[w, 1 + i] = poses[came - 1, w, i]
    counts[w] = kept
    words[w, 2] = wp.uint64(clock[1])
    swept[w] += wp.int64(1)
    if is_asked != 0:
        needs[0] = 1


@wp.kernel(enable_backward=False)
def scan_profiles(
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=wp.int32),
    sweeps: wp.array(dtype=Sweep),
    states: wp.array2d(dtype=wp.float64),
    counts: wp.array(dtype=int),
    aimed: wp.array(dtype=Aiming),
    profiles: wp.array(dtype=Profile),
    canopies: wp.array(dtype=Canopy),
    beams: wp.array(dtype=Beams),
    electronics: wp.array(dtype=Electronics),
    stations: wp.array(dtype=int),
    looked_at: wp.array(dtype=int),
):
    """One world a thread: a whole sweep. counts: of states; looked_at: worlds whose scans Python has to see.

    needs: set where it has to, or where something is to be said of a beam
    """
    w = wp.tid()
    sweep = sweeps[w]
    b = beams[w]
    packets = (b.count + 15) / 16
    pose_beams(
        states[w],
        sweep.mounting,
        sweep.beam_t,
        wp.float64(clock[1]),
        counts[w],
        b.count,
        sweep.origins,
        sweep.rotations,
    )
    for p in range(packets):
        aim_packet(p, aimed[w], b)
    chain_scores_along(profiles[w], canopies[w], b, sweep.apart, sweep.lines, sweep.reach, w, stations)
    for p in range(packets):
        meet_profile(p, profiles[w], canopies[w], b, sweep.reach, w, stations)
        report_packet(p, electronics[w], b)
    if looked_at[w] != 0 or b.flags[0] != 0:
        needs[0] = 1
