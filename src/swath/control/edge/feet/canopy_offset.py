"""How far the edge of the canopy lies beyond the stem bases, learned from the scans themselves.

The step that the detector finds is where the outermost stems stop half of the rays: in dense crop those that
lean out furthest, in thin crop hardly any. It is a sharp mark to follow, but lies off the stem bases by
centimetres in wheat and by decimetres in rape. The stem bases end where half of the stand is there. That can
be seen without knowing the crop, because the stand within is its own measure: nine of ten of its rays are
stopped above a certain height; where half of the stand is there, a known smaller share is (`stopped`). Each
ray counts once, at the lateral place where it crosses the middle height of the echoes within.

Nothing is assumed of depth, height or habit of the crop but that it leans to both sides alike. The counts are
kept over the last tens of metres; the steps of single scans carry the line.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from swath.core.portable import exp, geomspace
from swath.signals import F64

FROM, TO, BIN = -0.8, 1.0, 0.025  # m, lateral places whose rays are counted
STEP = 0.005  # m, of which bins and shifts are multiples
TALLEST, LAYER = 4.0, 0.02  # m, of the heights counted within
BINS, HEIGHTS = round((TO - FROM) / BIN), round(TALLEST / LAYER)  # how many places and heights are counted
OFTEN = 0.5  # m of travel from fit to fit
SPREADS = 8  # of the stand's border that are tried

_Z = np.linspace(-6.0, 6.0, 1201)
_MET = np.linspace(0.0, 60.0, 3001)
_PHI = np.array([0.5 * (1.0 + math.erf(z / np.sqrt(2.0))) for z in _Z])


def tables_of(parts: int) -> dict[str, Any]:
    """What kernels need beside the counts, the members of `canopy_offset_kernel.Offset`.

    parts: of plants that make an echo together
    """
    middle, shifts = np.arange(FROM + 0.5 * BIN, TO, BIN), np.arange(-0.1, 0.45, 2 * STEP)
    spreads = geomspace(0.02, 0.3, SPREADS)
    lateral = np.subtract.outer(middle, shifts).T  # of places from shifts, few are distinct
    apart = np.round(lateral / STEP).astype(np.int64)
    steps = STEP * np.arange(apart.min(), apart.max() + 1) + float(lateral[0, 0] - STEP * apart[0, 0])
    there = np.interp(steps / spreads[:, None], _Z, _PHI)  # share of the stand, [spread, ...]
    some, share = np.unique(there, return_inverse=True)  # half of them are the same
    tables: dict[str, Any] = {"middle": middle, "shifts": shifts, "met": _MET, "chance": stopped(_MET, parts)}
    tables |= {"there": some, "share": np.ascontiguousarray(share.reshape(there.shape).T, np.int32)}
    tables["step"] = np.ascontiguousarray(apart - apart.min(), np.int32)
    return tables | {"first": FROM, "bin": BIN, "layer": LAYER}


def shapes_of(tables: Mapping[str, Any]) -> tuple[tuple[int, ...], ...]:
    """Of counts of rays that went on and that were stopped, by place; of heights; of the scratch."""
    shifts, shares, steps = (len(tables[name]) for name in ("shifts", "there", "share"))
    return (2, BINS), (HEIGHTS,), (2 * shares + SPREADS * (2 * steps + shifts),)


def stopped(met: F64, parts: int) -> F64:
    """Chance that a ray which meets `met` pieces of plants on average meets at least `parts` (Poisson)."""
    fewer = term = exp(-met)
    for k in range(1, parts):
        term = term * met / k
        fewer = fewer + term
    return 1.0 - fewer
