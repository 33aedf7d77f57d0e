"""How far plants reach aside of their feet, by height: what hangs over an edge where the crop ends.

A stem bends, an ear nods, a branch of rape leaves the stem altogether. A beam is stopped by what it sees of
them: an ear that nods across the beam shows its side, one that nods along it only its end. Places are
therefore told from the beam, along and across its heading, in proportion to the silhouette it sees there.
"""

import math

import numpy as np

from swath.field.memory_layout import Shape
from swath.field.plants.parts import Plants
from swath.signals import F64

LEVELS, STEP = 25, 0.05  # of the relative height
COUNT = 64  # places at a level, a power of two
PIECES = 8  # of a primitive
FEWEST = 8 * COUNT  # of them at a level
VIEW = math.radians(15.0)  # how far beams look down
HEADINGS = 6  # from which every plant is seen, over half a turn


def overhang(plants: Plants, crop_height: float) -> F64:
    """Places from the foot per crop height, (LEVELS, COUNT, 2): along the beam's heading, and across it.

    Level k is from k STEP to (k + 1) STEP of the relative height. Those across are quantiles, alike on both
    sides, in the order of bit reversal, so that any few in a row span them all. A level where little is takes
    over the one below.
    """
    made = [_seen(plants, math.pi * k / HEADINGS) for k in range(HEADINGS)]
    place, seen = (np.concatenate(parts) for parts in zip(*made, strict=True))
    level = np.minimum((place[:, 2] / (crop_height * STEP)).astype(np.int64), LEVELS - 1)
    along, across = place[:, 0] / crop_height, place[:, 1] / crop_height
    rank = np.array([int(f"{k:0{COUNT.bit_length() - 1}b}"[::-1], 2) for k in range(COUNT)])
    side = (2 * rank + 1) / COUNT - 1.0
    found = np.zeros((LEVELS, COUNT, 2))
    for k in range(LEVELS):
        mine = np.flatnonzero((level == k) & (place[:, 2] >= 0.0))
        if len(mine) < FEWEST * HEADINGS:
            found[k] = found[k - 1] if k else 0.0
            continue
        mine = mine[np.argsort(np.abs(across[mine]), kind="stable")]
        below = np.cumsum(seen[mine])
        at = mine[np.searchsorted(below, np.abs(side) * below[-1])]
        found[k] = np.stack([along[at], np.sign(side) * np.abs(across[at])], axis=1)
    return found


def _seen(plants: Plants, heading: float) -> tuple[F64, F64]:
    """Middles of pieces (n, 3) [m] in the beam's frame, and their silhouettes (n,) up to one factor."""
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    span, width = (plants.b - plants.a) @ turn.T, plants.width @ turn.T
    beam = np.array([math.cos(VIEW), 0.0, -math.sin(VIEW)])
    rod = 2.0 * plants.radius * np.linalg.norm(np.cross(span, beam), axis=1)
    face = 2.0 * np.abs(np.cross(span, width) @ beam)
    face = np.where(plants.shape == Shape.TRIANGLE, 0.5 * face, face)
    seen = np.where(plants.shape == Shape.CAPSULE, rod, face)
    share = (np.arange(PIECES) + 0.5) / PIECES
    place = (plants.a @ turn.T)[:, None] + share[None, :, None] * span[:, None]
    return place.reshape(-1, 3), np.repeat(seen / PIECES, PIECES)
