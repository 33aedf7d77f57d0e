"""The look at blocks that are full, compiled: *.cpp here, each with what it does, over `block_rows`."""

from typing import Any

import warp as wp

from swath.control.edge import block_rows, canopy_classes
from swath.control.edge.detector_kernel import Grid, Memory, Numbers, code
from swath.control.edge.feet.canopy_offset import OFTEN
from swath.control.edge.feet.canopy_offset_kernel import Offset, Rays, count_rays, fitted_shift
from swath.control.edge.profile import EVENLY

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
FILES = (  # what each knows is what stands before it; the last has the rows of a world `m`, `track`
    *("rows", "line/edge_points", "arc_track", "populations", "blocks", "line/line_fits"),
    *("line/edge_breaks", "line/edge_wall", "feet/lodging", "feet/lean_ramp", "feet/canopy_feet"),
    *("block_track", "block_of_world"),
)
_NUMBERS = {**vars(canopy_classes), **vars(block_rows), "EVENLY": EVENLY, "OFTEN": OFTEN}
KNOWN: dict[str, Any] = {name: value for name, value in _NUMBERS.items() if name.isupper()}
KNOWN |= {"names": KNOWN.pop("NAMES")}


# calls are nothing here, some times a second; each copy of a function takes its time to compile
_BODY = code(*FILES, "look_at_block", **KNOWN)
_ALONE = f"#pragma clang attribute push(__attribute__((noinline)), apply_to=function)\n{_BODY}\n"


@wp.func_native(f"{_ALONE}#pragma clang attribute pop\n")
def look_at_block(m: Memory, track: Numbers, ends: bool, found: wp.float64) -> int: ...


@wp.kernel
def look(
    active: wp.array(dtype=wp.bool),
    memories: wp.array(dtype=Memory),
    tracks: Grid,
    offsets: wp.array(dtype=Offset),
    seen: wp.array3d(dtype=wp.float64),
    heights: Grid,
    scratch: wp.array3d(dtype=wp.float64),
):
    """The blocks that are full, in each world. tracks: rows of `BLOCK_TRACK`, flat.

    offsets, seen, heights, scratch: of all worlds, of each, for all: what the overhang is fitted to, see
    `canopy_offset_kernel`; scratch: for its logs, and for its scores
    """
    w = wp.tid()
    if active[w]:
        m = memories[w]
        found = wp.float64(wp.nan)
        count = look_at_block(m, tracks[w], False, found)
        if count >= 0:
            r = Rays()
            r.upper = m.told[0]
            r.lower = m.told[1]
            r.level = m.told[2]
            r.count = count
            r.top = m.told[3, 0]
            r.limit = m.told[3, 1]
            is_due = m.told[3, 3] > wp.float64(0.0)
            if count_rays(offsets[0], r, seen[w], heights[w]) and is_due:
                found = fitted_shift(offsets[0], m.told[3, 2], seen[w], scratch[0], scratch[1])
        look_at_block(m, tracks[w], True, found)
