"""From the states of machines to the beams of their scanners, as kernels over worlds."""

import warp as wp

from swath.rays.single.kernel import Beams
from swath.sensing.native.kernel import Aiming, aim_packet, pose_beams


@wp.kernel(enable_backward=False)
def take_states(
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
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
    if active[w]:
        swept[w] += wp.int64(1)
    if is_asked != 0:
        needs[0] = 1


@wp.kernel(enable_backward=False)
def aim_sweeps(
    clock: wp.array(dtype=wp.int64),
    active: wp.array(dtype=wp.bool),
    states: wp.array2d(dtype=wp.float64),
    counts: wp.array(dtype=int),
    aimed: wp.array(dtype=Aiming),
    beams: wp.array(dtype=Beams),
):
    """One world a thread. counts: of states, 0 = the beams start where they are."""
    w = wp.tid()
    if not active[w]:
        return
    a = aimed[w]
    b = beams[w]
    if counts[w] > 0:
        end = wp.float64(clock[1])
        pose_beams(states[w], a.mounting, a.beam_t, end, counts[w], b.count, b.origins, a.rotations)
    for p in range((b.count + 15) / 16):
        aim_packet(p, a, b)
