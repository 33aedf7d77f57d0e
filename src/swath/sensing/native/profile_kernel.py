"""The LiDAR level `profile` as a kernel over worlds."""

import warp as wp

from swath.field.profile_kernel import Profile
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


@wp.struct
class States:
    """Of a machine between two sweeps: rows of t [ns], position and rotation."""

    rows: wp.array(dtype=wp.float64)


@wp.kernel(enable_backward=False)
def scan_profiles(
    sweeps: wp.array(dtype=Sweep),
    states: wp.array(dtype=States),
    asked: wp.array(dtype=wp.float64),
    aimed: wp.array(dtype=Aiming),
    profiles: wp.array(dtype=Profile),
    canopies: wp.array(dtype=Canopy),
    beams: wp.array(dtype=Beams),
    electronics: wp.array(dtype=Electronics),
    stations: wp.array(dtype=int),
):
    """One world a thread: a whole sweep. asked: its end [ns], number of states."""
    w = wp.tid()
    sweep = sweeps[w]
    b = beams[w]
    packets = (b.count + 15) / 16
    pose_beams(
        states[w].rows,
        sweep.mounting,
        sweep.beam_t,
        asked[0],
        int(asked[1]),
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
