"""Beams against the field as profiles along an edge: score_profile.cpp, profile.cpp."""

import warp as wp

from swath.field.edges.profile_kernel import Profile
from swath.rays.single.kernel import Beams, Canopy, source


@wp.func_native(source("score_profile"))
def chain_scores_along(
    profile: Profile,
    canopy: Canopy,
    beams: Beams,
    apart: wp.array(dtype=float),
    lines: int,
    range_max: float,
    world: int,
    station_at: wp.array(dtype=int),
): ...


@wp.func_native(source("profile"))
def meet_profile(
    p: int,
    profile: Profile,
    canopy: Canopy,
    beams: Beams,
    range_max: float,
    world: int,
    station_at: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def cast_profiles(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    canopies: wp.array(dtype=Canopy),
    beams: wp.array(dtype=Beams),
    profiles: wp.array(dtype=Profile),
    stations: wp.array(dtype=int),
):
    """One world a thread: all beams of a scan. needs: set where something is to be said of a beam."""
    w = wp.tid()
    if not active[w]:
        return
    b = beams[w]
    chain_scores_along(profiles[w], canopies[w], b, b.apart, b.lines, b.reach, w, stations)
    for p in range((b.count + 15) / 16):
        meet_profile(p, profiles[w], canopies[w], b, b.reach, w, stations)
    if b.flags[0] != 0:
        needs[0] = 1
