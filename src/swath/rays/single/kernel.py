"""Single rays as Warp kernels: their bodies are native code, 16 beams side by side, after `vectors.cpp`."""

from pathlib import Path

import warp as wp

from swath.rays.kernel.scene import Scene, SolidArrays, no_hit
from swath.rays.kernel.solids_alone import hit_solids

_HERE = Path(__file__).parent


def vectors() -> str:
    """What native functions for single rays share."""
    return (_HERE / "vectors.cpp").read_text(encoding="utf-8")


def source(name: str) -> str:
    """The body of a native function with what it includes."""
    text = (_HERE / f"{name}.cpp").read_text(encoding="utf-8")
    for part in ("canopy.cpp", "chain.cpp"):
        text = text.replace(f'#include "{part}"\n', (_HERE / part).read_text(encoding="utf-8"))
    return vectors() + text


@wp.struct
class Grid:
    """One grid of the table, `spread.Spread`.

    axes: log density, height [m], log tan depression, log spot, one after the other; size: of each
    quantile: relative heights, node_count per cell; ground: log(-log(ground share)) per cell
    lift: mean measured height of ground returns per cell [m]
    densities: the lowest and the highest [1/m2]; tangents: of the flattest and the steepest depression
    """

    axes: wp.array(dtype=float)
    size: wp.vec4i
    quantile: wp.array(dtype=float)
    ground: wp.array(dtype=float)
    lift: wp.array(dtype=float)
    densities: wp.vec2
    tangents: wp.vec2


@wp.struct
class Canopy:
    """The table as native code reads it, see `rays/spread.py`.

    node_count: quantiles of a cell
    depth: projected area per stem above depth_steps equal steps `fine` of the relative height [m2], for one
    depression after the other; view: tangents of depressions at which the next one is used
    aside: how far what is seen at a height stands aside of its foot, per crop height, along and across the
    beam's heading: (levels, k, 2), k a power of two; levels every `aside_step` of the relative height
    row: from one row of plants to the next [m], 0 = no rows; from_row: share of `aside` across the rows that
    is left when feet are taken to the middle of their rows, (levels,)
    pitch: step along the ray [m]; height: of the crop at scale 1; top_bound: it stops no beam above [m]
    stubble_bound: stubble stops no beam above this multiple of its height
    side_axes: relative heights and log spots of `SideSpread`, one after the other; side_size: of each
    side_factor: below and above the median, per height and spot; side_median: log of the depth, per spot
    density_max [1/m2]
    exit, divergence: of the beam [m, rad]; cosine: mean |cos| of incidence on crop
    correlation: c0 [m], c1
    """

    standing: Grid
    stubble: Grid
    node_count: int
    depth: wp.array(dtype=float)
    depth_steps: int
    view: wp.array(dtype=float)
    fine: float
    aside: wp.array(dtype=float)
    aside_step: float
    aside_levels: int
    row: float
    from_row: wp.array(dtype=float)
    side_axes: wp.array(dtype=float)
    side_size: wp.vec2i
    side_factor: wp.array(dtype=float)
    side_median: wp.array(dtype=float)
    top_bound: float
    stubble_bound: float
    pitch: float
    height: float
    density_max: float
    exit: float
    divergence: float
    cosine: float
    correlation: wp.vec2


@wp.struct
class Beams:
    """A `buffers.BeamBuffer` as native code reads and fills it."""

    count: int
    lines: int
    reach: float
    apart: wp.array(dtype=float)
    origins: wp.array(dtype=wp.vec3d)
    directions: wp.array(dtype=wp.vec3d)
    normal: wp.array2d(dtype=float)
    score: wp.array(dtype=float)
    distance: wp.array(dtype=float)
    kind: wp.array(dtype=int)
    cell: wp.array(dtype=int)
    cosine: wp.array(dtype=float)
    reflectance: wp.array(dtype=float)
    flags: wp.array(dtype=int)


@wp.func
def meet_solid(i: int, solids: SolidArrays, range_max: float, beams: Beams):
    """Nearest solid of a beam, range_max and kind 0 without one."""
    hit = hit_solids(solids, beams.origins[i], wp.vec3(beams.directions[i]), no_hit(range_max))
    beams.distance[i] = hit.t
    beams.kind[i] = hit.organ
    beams.cosine[i] = hit.cosine
    beams.reflectance[i] = hit.reflectance


@wp.kernel(enable_backward=False)
def meet_solids(solids: SolidArrays, range_max: float, beams: Beams):
    """Nearest solid of each beam."""
    meet_solid(wp.tid(), solids, range_max, beams)


@wp.func_native(source("scores"))
def chain_scores(
    scene: Scene, canopy: Canopy, beams: Beams, apart: wp.array(dtype=float), lines: int, range_max: float
): ...


@wp.func_native(source("bodies"))
def meet_bodies(p: int, scene: Scene, canopy: Canopy, beams: Beams, range_max: float, has_solids: int): ...


@wp.kernel(enable_backward=False)
def cast_bodies(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    asks: wp.array(dtype=wp.int32),
    scenes: wp.array(dtype=Scene),
    solids: wp.array(dtype=SolidArrays),
    canopies: wp.array(dtype=Canopy),
    beams: wp.array(dtype=Beams),
    aired: wp.array(dtype=wp.int32),
):
    """One world a thread: all beams of a scan.

    asks: worlds whose scene is not known; aired: worlds whose air may change a scan
    needs: set for these, or where something is to be said of a beam
    """
    w = wp.tid()
    if not active[w] or asks[w] != 0:
        return
    b = beams[w]
    has_solids = wp.min(solids[w].count, 1)
    if has_solids != 0:
        for i in range(b.count):
            meet_solid(i, solids[w], b.reach, b)
    chain_scores(scenes[w], canopies[w], b, b.apart, b.lines, b.reach)
    for p in range((b.count + 15) / 16):
        meet_bodies(p, scenes[w], canopies[w], b, b.reach, has_solids)
    if aired[w] != 0 or b.flags[0] != 0:
        needs[0] = 1
