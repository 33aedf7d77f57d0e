"""Numbers of likelihood-ratio detectors that compiled code and Python share: structs of both."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swath.control.edge.feet.overhang import DEVIATIONS, HANGS, LEANS, NO_RAMP, NORMAL

# stages of a report: the line and the feet behind it, the edge, both
FEET, EDGE, ALL = range(1, 4)
POINTS, RETURNS = 256, 64  # points and returns of an edge that count, the newest


def _row(names: str, **sizes: int) -> np.dtype[Any]:
    """A struct of numbers, and of some that are several."""
    return np.dtype(
        [*((name, "f8") for name in names.split()), *((n, "f8", size) for n, size in sizes.items())]
    )


ROWS = {
    # The state: place and heading when the newest scan ended, its time [ns]; sums of travel, and over it of
    # the width that cut nothing and of the place beside the header's end [m]. Then what comes with a step:
    # time [ns], speed [m/s], yaw rate toward the crop [rad/s], rise of tops of plants ahead and toward the
    # left [1], whether that is sure, width missing and travel of the step [m].
    "step": _row(
        "x u heading scan_t cut_way cut_missing cut_beside now speed yaw_rate ahead rise is_sure missing "
        "travel"
    ),
    # What stays. sign: +1 = crop to the left; ahead of the axle: reference, knife [m]; centre: the header's
    # end beside it, toward the crop [m]; hold [m], crab [1], open, closed, cut_sd, search [m]: as `Params`
    # says; early: how far ahead of a hole crop behind it may seem to stand, of its height; view: height of
    # the scanner [m]; spacing: of rows [m]; upright: height of a crop that stands [m], height_sd: its
    # deviation, of itself; slip: of the wheels' speed over that over ground; width: of the header [m]; flat:
    # m per m that the middle beam goes ahead while it falls; base, first, cells: see `ground_profile`; place:
    # of the scanner [m]
    "detector": _row(
        "sign reference knife centre hold crab open closed early view spacing cut_sd upright height_sd "
        "search slip width flat base first cells",
        prior=LEANS.size,
        tall=LEANS.size,
        hang=HANGS.size,
        no_ramp=NO_RAMP.size,
        deviation=DEVIATIONS.size,
        normal=NORMAL.size,
        place=3,
    ),
    # As the newest scan left it. edge: a point of its arc, angle, bend there; across: as below; beams, room:
    # of the scan, most that were used; falling, beside: rays, echoes of the stubble; level, slope, known:
    # plane of the stubble; middle: of what shows it, where it is seen; grade: by which it rises [1]; echo: of
    # find_silent; is_full: a block; from cell_travel on: of the profile
    "canopy": _row(
        "travel edge_x edge_u edge_angle edge_bend across beams room falling beside level slope is_known "
        "is_seen middle_x middle_u grade echo_beams echo_scans "
        "is_full cell_travel",
        seen=5,
        felt=3,
        worth=4,
        chance=4,
    ),
    # What the scans of a block add up to. near: rays near the edge, along: sum of their places along the
    # frame [m]; lost: travel since a track was lost [m]; of the newest scan: rise of upright plants toward
    # the crop, by which places were moved to the feet, per height [1], and the angle at which rays to the
    # edge go across it, > 0 into the crop [rad]; rays: how many are held; first, next: numbers of the scans
    # that they are of
    "counted": _row("travel along near scans lost rise across rays first next"),
    # What changes with a block. Whether there is a track, and whether it is told; x, u [m], angle [rad], bend
    # [1/m] and distance [m] of that; from bite to height: as of block_track.cpp; from crop to dust: of both
    # sides, see populations.cpp; swing of the wall [m]; share and foot [m] of a ramp; tops over rows: sums of
    # cosines, sines, their noise, how sure the edge goes along them; overhang that was learned [m]; how many
    # points and returns there are
    "block": _row(
        "has_arc is_begun x u angle bend distance bite turn_sd agreed scatter blank height crop stubble "
        "stopped dust swing lean foot cosine sine noise along overhang points returns"
    ),
    "ground": _row("plane plane_sd"),  # of the stubble, over the ground, and its deviation [m]
    # What scanners on several sides say: is_told, tangent of the lean outward, its deviation
    "told": _row("is_told lean sd"),
    # The edge near the place that is reported, in the machine's frame: x, u [m], angle [rad], bend [1/m], its
    # deviations; distance along it from there to the nearest point; spread of the points about it; distance
    # to the last one [m]
    "line": _row("x u angle bend offset_sd angle_sd gap spread seen_to"),
    # From stage to stage: whether there is an edge; its feet behind the canopy [m]; those of a lean inward,
    # with its chance; how clearly rows are seen 0..1; how dense the stand is; its lean by its height [rad];
    # deviation of what hangs over [m]
    "feet": _row("is_found shift shift_sd ramp_chance ramp ramp_sd rows dense low hang_sd"),
}
# back: distances where an edge was found behind a hole [m]
ROW = np.dtype([*ROWS.items(), ("back", "f8", RETURNS)])
# Of each beam: its echo in the scan before, of those that fall [m], nan = none; scans in which it answered,
# whether it is silent; time [s], direction in the machine frame
BEAM = _row("before echoes is_dead ago", aim=3)
# Of a ray that falls, in (x, u, z) [m]: distance nan = no echo; stands: where it was in the scan before
RAY = _row("distance stands", start=3, aim=3)
# What a ray that falls says. height: of the echo above the stubble side [m], nan = none; upper, lower: where
# it is beside the edge at the crop's top and at the lower limit [m]; stands: it stands as it did in the scan
# before, and does not hang in the air; cell: its place and class, flat index of (PLACES, CLASSES), -1 = it
# does not count; ahead: of an echo in the canopy, along the edge ahead of the frame's origin [m], else nan;
# scan: its number
ANSWER = _row("height upper lower stands cell ahead scan")


def structs() -> str:
    """All of them in C++."""
    own = {"Row": ROW, "Beam": BEAM, "Ray": RAY, "Answer": ANSWER}
    return "\n".join(f"struct {name} {{ {members(kind, {})} }};" for name, kind in own.items())


def members(row: np.dtype[Any], names: Mapping[np.dtype[Any], str]) -> str:
    """Those of a struct in C++. names: of rows in it whose structs have one."""
    made = []
    for name in row.names or ():
        kind, shape = row[name].subdtype or (row[name], ())
        own = f"struct {{ {members(kind, names)} }}" if kind.names else "double"
        made.append(f"{names.get(kind, own)} {name}{''.join(f'[{n}]' for n in shape)};")
    return " ".join(made)
