"""The look at blocks that are full, compiled: *.cpp here, each with what it does, over `block_rows`."""

from typing import Any

import warp as wp

from swath.control.edge import block_rows, canopy_classes
from swath.control.edge.detector_kernel import Grid, Memory, Numbers, code
from swath.control.edge.feet.canopy_offset import OFTEN
from swath.control.edge.feet.canopy_offset_kernel import Offset, learn_offset
from swath.control.edge.profile import EVENLY
from swath.kernels import once

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
FILES = (  # what each knows is what stands before it; the last has the rows of a world `m`, `track`
    *("rows", "line/edge_points", "arc_track", "populations", "blocks", "line/line_fits"),
    *("line/edge_breaks", "line/edge_wall", "feet/lodging", "feet/lean_ramp", "feet/canopy_feet"),
    *("block_track", "block_of_world"),
)
_NUMBERS = {**vars(canopy_classes), **vars(block_rows), "EVENLY": EVENLY, "OFTEN": OFTEN}
KNOWN: dict[str, Any] = {name: value for name, value in _NUMBERS.items() if name.isupper()}
KNOWN |= {"names": KNOWN.pop("NAMES")}


@wp.func_native(once(code(*FILES, "look_at_block", **KNOWN)))
def look_at_block(m: Memory, track: Numbers, ends: bool, found: wp.float64) -> int: ...


@wp.kernel
def look(
    active: wp.array(dtype=wp.bool),
    memories: wp.array(dtype=Memory),
    tracks: Grid,
    offsets: wp.array(dtype=Offset),
    seen: wp.array3d(dtype=wp.float64),
    heights: Grid,
    scratch: Numbers,
):
    """The blocks that are full, in each world. tracks: rows of `BLOCK_TRACK`, flat.

    offsets of all worlds; seen, heights: of each, scratch: for all, as `canopy_offset.shapes_of` says
    """
    w = wp.tid()
    if active[w]:
        m = memories[w]
        found = wp.float64(wp.nan)
        count = look_at_block(m, tracks[w], False, found)
        if count >= 0:
            found = learn_offset(
                offsets[0], m.told[0], m.told[1], m.told[2], count, m.told[3], seen[w], heights[w], scratch
            )
        look_at_block(m, tracks[w], True, found)
