"""How far the feet stand behind the canopy's edge, compiled: canopy_offset.cpp, see `canopy_offset`."""

from pathlib import Path

import warp as wp

from swath.control.edge.feet.canopy_offset import SPREADS
from swath.kernels import exact_code, known

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

_HERE = Path(__file__).parent


def code(*files: Path) -> str:
    """The body of a native function, in files, after canopy_offset.cpp."""
    known_files = _HERE.parent / "numbers.cpp", _HERE / "canopy_offset.cpp"
    return known({"SPREADS": SPREADS}) + exact_code(*known_files, *files)


Numbers = wp.array(dtype=wp.float64)
Table = wp.array2d(dtype=wp.float64)


@wp.struct
class Offset:
    """Tables of `canopy_offset`. met, chance: the table of `stopped`, met in equal steps from 0 on.

    middle: of places [m]; first, bin: where they begin, how wide they are [m]; layer: of heights [m]
    there: shares of the stand that occur; step: [shift, place] -> lateral step of a place from a shift
    share: [step, spread] -> place in `there`
    """

    middle: Numbers
    shifts: Numbers
    met: Numbers
    chance: Numbers
    there: Numbers
    step: wp.array2d(dtype=int)
    share: wp.array2d(dtype=int)
    first: wp.float64
    bin: wp.float64
    layer: wp.float64


@wp.func_native(code(_HERE / "learn_offset.cpp"))
def learn_offset(
    o: Offset,
    upper: Numbers,
    lower: Numbers,
    level: Numbers,
    count: int,
    told: Numbers,
    seen: Table,
    heights: Numbers,
    scratch: Numbers,
) -> wp.float64:
    """Take `count` rays of a look, and fit the shift [m]; nan = it was not fitted.

    upper, lower: where a ray is beside the edge at the top and at the limit [m]; level: where it ends
    told: ground, then above that top of the canopy and limit [m], first guess of the shift [m], whether it
    is to be fitted; seen: rays that went on and that were stopped, by place
    """
