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
