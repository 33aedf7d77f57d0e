"""What the likelihood-ratio detector tells, as a kernel: overhang.cpp, near.cpp, report.cpp."""

from pathlib import Path

import warp as wp

from swath.control.edge import report_rows as rows
from swath.control.edge.block_track import BLOCK
from swath.control.edge.feet.canopy_feet import USUAL
from swath.control.edge.feet.overhang import DEVIATIONS, DIRECTIONS, LEANS
from swath.control.edge.line.near_line import VAGUE
from swath.control.edge.profile import EVENLY, LEAST_SURE, MAD, TOLERANCE, TUKEY, UNSURE
from swath.control.inclination import GRAVITY
from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
# what Python knows, too
_REAL = {"BLOCK_M": BLOCK, "USUAL": USUAL, "VAGUE": VAGUE, "EVENLY": EVENLY, "TOLERANCE": TOLERANCE}
_REAL |= {"TUKEY": TUKEY, "MAD": MAD, "UNSURE": UNSURE, "LEAST_SURE": LEAST_SURE, "GRAVITY": GRAVITY}
_WHOLE = {"LEANS": len(LEANS), "DIRECTIONS": len(DIRECTIONS), "NORMALS": len(DEVIATIONS)}
_WHOLE |= {"ROOM": rows.ROOM, "DRIVE": rows.DRIVE, "FEET": rows.FEET, "EDGE": rows.EDGE}


_KNOWN = [f"constexpr double {name} = {value!r};" for name, value in _REAL.items()]
_KNOWN += [f"constexpr int {name} = {value};" for name, value in _WHOLE.items()]
_KNOWN += [f"struct Row {{ {rows.members()} }};"]
_FILES = (Path(__file__).parent / file for file in ("feet/overhang.cpp", "line/near.cpp", "report.cpp"))


@wp.func_native("\n".join([*_KNOWN, exact_code(*_FILES)]))
def tell(
    row: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.vec4d),
    edge: wp.array(dtype=wp.uint8),
    stage: int,
): ...


@wp.kernel
def report(
    rows: wp.array2d(dtype=wp.float64),
    points: wp.array2d(dtype=wp.vec4d),
    edges: wp.array2d(dtype=wp.uint8),
    stage: int,
):
    """A stage of `edge_report.EdgeReports`."""
    w = wp.tid()
    tell(rows[w], points[w], edges[w], stage)
