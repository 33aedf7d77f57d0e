"""What the likelihood-ratio detector tells, as kernels: place.cpp, aim.cpp, feet/overhang.cpp, report.cpp."""

from pathlib import Path

import warp as wp

from swath.control.edge import report_rows as rows
from swath.control.edge.block_track import BLOCK
from swath.control.edge.feet.canopy_feet import USUAL
from swath.control.edge.feet.overhang import DEVIATIONS, DIRECTIONS, LEANS
from swath.control.edge.line.near_line import VAGUE
from swath.control.edge.line.near_line_kernel import Asked, Line, near
from swath.control.edge.profile import EVENLY, LEAST_SURE, TOLERANCE, UNSURE
from swath.control.inclination import GRAVITY
from swath.kernels import exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_REAL = {"BLOCK_M": BLOCK, "USUAL": USUAL, "VAGUE": VAGUE, "EVENLY": EVENLY, "TOLERANCE": TOLERANCE}
_REAL |= {"UNSURE": UNSURE, "LEAST_SURE": LEAST_SURE, "GRAVITY": GRAVITY}
_WHOLE = {"LEANS": len(LEANS), "DIRECTIONS": len(DIRECTIONS), "NORMALS": len(DEVIATIONS)}
_WHOLE |= {"DRIVE": rows.DRIVE, "FEET": rows.FEET, "EDGE": rows.EDGE}


def _source(*files: str) -> str:
    """The body of a native function: what Python knows, too, then files."""
    known = [f"constexpr double {name} = {value!r};" for name, value in _REAL.items()]
    known += [f"constexpr int {name} = {value};" for name, value in _WHOLE.items()]
    body = exact_code(*(Path(__file__).parent / file for file in files))
    return "\n".join([*known, f"struct Row {{ {rows.members()} }};", body])


@wp.func_native(_source("aim.cpp"))
def aim(row: wp.array(dtype=wp.float64), asks: wp.array(dtype=Asked), world: int, stage: int) -> bool: ...


@wp.func_native(_source("feet/overhang.cpp", "report.cpp"))
def tell(
    row: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.vec4d),
    asks: wp.array(dtype=Asked),
    lines: wp.array(dtype=Line),
    edge: wp.array(dtype=wp.uint8),
    world: int,
    stage: int,
): ...


@wp.kernel
def report(
    rows: wp.array2d(dtype=wp.float64),
    points: wp.array2d(dtype=wp.vec4d),
    scratch: wp.array3d(dtype=wp.float64),
    asks: wp.array(dtype=Asked),
    lines: wp.array(dtype=Line),
    edges: wp.array2d(dtype=wp.uint8),
    stage: int,
):
    """A stage of `edge_report.EdgeReports`."""
    w = wp.tid()
    if aim(rows[w], asks, w, stage):
        lines[w] = near(asks[w], points[w], scratch[w])
    tell(rows[w], points[w], asks, lines, edges[w], w, stage)
