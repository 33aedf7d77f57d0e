"""Single rays through measured heights as a Warp kernel, 16 beams side by side."""

import warp as wp

from swath.rays.single.kernel import Beams, source


@wp.struct
class Heights:
    """A `HeightGrid`, all flat but the ground; cells in the order of `by_blocks`.

    block_top: no ray above it meets a cell of the block, height above origin z; tile_top: of all blocks of a
    tile; top_bound: the highest of them
    patch: height of the ground in a block, c0 + c1 u + (c2 + c3 u) v with u, v in 0 .. 1
    first: place of its first cell, < 0 where the block is not held
    Of a cell: lid, above which nothing was measured [mm], in steps of 4, 1 more where `passed` is not 0, 2
    more where nothing goes on below its quantiles; cut: 255 = as measured, else stubble height [cm]
    rest: the levels below the quantiles, thickness and passed (float), the share of beams that went below the
    quantiles, 0 where these say so, < 0 where it is cut
    intensity: as in the grid
    """

    origin: wp.vec3d
    turn: wp.vec2d
    cell: float
    nodes_per_m: float
    block_top: wp.array(dtype=float)
    tile_top: wp.array(dtype=float)
    top_bound: float
    patch: wp.array(dtype=float)
    first: wp.array(dtype=int)
    lid: wp.array(dtype=wp.int16)
    quantiles: wp.array(dtype=wp.int16)
    rest: wp.array(dtype=wp.int16)
    cut: wp.array(dtype=wp.uint8)
    intensity: wp.array(dtype=float)
    ground: wp.array2d(dtype=float)


@wp.func_native(source("heights"))
def meet_heights(
    p: int, g: Heights, seed: int, share: float, grain: float, range_max: float, beams: Beams, has_solids: int
): ...


@wp.kernel(enable_backward=False)
def cast_heights(g: Heights, whole: wp.array(dtype=int), real: wp.array(dtype=float), beams: Beams):
    """One thread per packet of 16 rays.

    whole: seed of this scan, flag of solids
    real: share u of all beams, < 0 = drawn per cell of the ground, whose side [m], range [m]
    """
    meet_heights(wp.tid(), g, whole[0], real[0], real[1], real[2], beams, whole[1])
