"""Numbers that the compiled report of a detector reads and writes: structs of Python and of report.cpp."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swath.control.edge.feet.overhang import DEVIATIONS, HANGS, LEANS, NO_RAMP, NORMAL
from swath.signals import F64

# stages: the way of a scan; of a report the line and the feet behind it, the edge, both
DRIVE, FEET, EDGE, ALL = range(4)
ROOM, RETURNS = 256, 64  # points and returns of an edge that count, the newest


def _row(names: str, tables: Mapping[str, F64] | None = None) -> np.dtype[Any]:
    numbers = [(name, "f8") for name in names.split()]
    return np.dtype([*numbers, *((name, "f8", table.size) for name, table in (tables or {}).items())])


TABLES = {"prior": LEANS, "tall": LEANS, "hang": HANGS, "no_ramp": NO_RAMP}  # of leans and directions
TABLES |= {"deviation": DEVIATIONS, "normal": NORMAL}
ROWS = {
    # The state: place and heading when the newest scan ended, its time [ns]; sums of travel, and over it of
    # the width that cut nothing and of the place beside the header's end [m]. Then what comes with a step:
    # time [ns], speed [m/s], yaw rate [rad/s], rise of tops of plants toward the left [1], width missing and
    # travel of the step [m]; at last seconds to drive.
    "step": _row(
        "x u heading scan_t cut_way cut_missing cut_beside now speed yaw_rate rise missing travel seconds"
    ),
    # What stays. sign: +1 = crop to the left; ahead of the axle: reference, knife [m]; centre: the header's
    # end beside it, toward the crop [m]; hold [m], crab [1], open, closed, cut_sd [m]: as `Params` says;
    # early: how far ahead of a hole crop behind it may seem to stand, of its height; view: height of the
    # scanner [m]; spacing: of rows [m]; upright: height of a crop that stands [m], height_sd: its deviation,
    # of itself
    "detector": _row(
        "sign reference knife centre hold crab open closed early view spacing cut_sd upright height_sd",
        TABLES,
    ),
    # What changes with a block. Of the track: x, u [m], angle [rad], bend [1/m], distance [m]; of
    # `BlockTrack`; of `Populations` from crop to dust; swing of the wall [m]; plane of the stubble, its
    # deviation [m]; share and foot [m] of a ramp; tops over rows: sums of cosines, sines, their noise, how
    # sure the edge goes along them; overhang that was learned [m]; how many points and returns there are
    "block": _row(
        "is_begun x u angle bend distance bite turn_sd agreed scatter blank height crop stubble stopped dust "
        "swing plane plane_sd lean foot cosine sine noise along overhang points returns"
    ),
    # What scanners on several sides say: is_told, tangent of the lean outward, its deviation
    "told": _row("is_told lean sd"),
    # The edge near the place that is reported, in the machine's frame: x, u [m], angle [rad], bend [1/m], its
    # deviations; distance along it from there to the nearest point; spread of the points about it; distance
    # to the last one [m]
    "line": _row("x u angle bend offset_sd angle_sd gap spread seen_to"),
    # From stage to stage: whether there is an edge; its feet behind the canopy [m];
    # those of a lean inward, with its chance; how clearly rows are seen 0..1; how dense the stand is; its
    # lean by its height [rad]; deviation of what hangs over [m]
    "feet": _row("is_found shift shift_sd ramp_chance ramp ramp_sd rows dense low hang_sd"),
}
ROW = np.dtype(
    [*ROWS.items(), ("back", "f8", RETURNS)]
)  # back: distances where it was found behind a hole [m]


def members(kind: np.dtype[Any] = ROW) -> str:
    """A struct's members in C++."""
    own = {name: kind[name] for name in kind.names or ()}
    each = (
        f"struct {{ {members(k)} }} {n}"
        if k.names
        else f"double {n}[{k.shape[0]}]"
        if k.shape
        else f"double {n}"
        for n, k in own.items()
    )
    return " ".join(f"{member};" for member in each)
