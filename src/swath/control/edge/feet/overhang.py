"""Leans that a stand may have, and what is known of them beforehand: see overhang.cpp."""

from math import cos, pi, sin

import numpy as np

from swath.core import portable
from swath.core.units import DEG
from swath.signals import F64

WALL = 0.92  # of the height of the tops: where the wall of wheat that leans out by 20 to 32 deg was seen
STEEP, STEEPER = 0.2, 0.35  # tangents of a lean inward that may, and that must show a ramp
MISTAKEN = 0.1  # chance that stands lean by anything, against what the driver says, estimated
LEANS, DIRECTIONS = DEG * np.arange(0.0, 75.0, 2.5), pi * ((np.arange(8) + 0.5) / 8 - 0.5)
DEVIATIONS = np.arange(-2.5, 2.6, 0.25)  # that stand for a normal, and its chance of each
NORMAL = portable.exp(-0.5 * DEVIATIONS**2) / float(portable.exp(-0.5 * DEVIATIONS**2).sum())
TALL = np.array([cos(lean) for lean in LEANS.tolist()])
# tangents of the lean out over the edge, in half a turn of directions
_OUT = portable.tan(LEANS)[:, None] * np.array([sin(turn) for turn in DIRECTIONS.tolist()])
HANGS = WALL * np.maximum(_OUT, -STEEPER)  # of the feet behind the edge of the tops, of their height
NO_RAMP = 1.0 - np.clip((-_OUT - STEEP) / (STEEPER - STEEP), 0.0, 1.0)  # chance that a lean in shows none


def prior_of(lean_deg: float) -> F64:
    """Chances of LEANS where stands lean so far in the mean, as the driver says, in any direction."""
    prior = portable.exp(-LEANS / (DEG * max(lean_deg, 0.1)))
    return (1.0 - MISTAKEN) * prior / float(prior.sum()) + MISTAKEN / len(LEANS)
