"""Things that go while a picture is exposed: each sample sees them where they are at its own time.

A thing with the velocity v that a ray meets s seconds after the time of the picture is met at that time by
the same ray from its origin less v s. So the picture is cast without the things that go, then each of them
alone from such origins, and the nearest of all counts. Depth and time stay; light and shadow on the thing are
those of the time of the picture. A turn within the exposure is left out.
"""

from collections.abc import Sequence
from math import hypot

import numpy as np

from swath.field.contact import bounds, parts_of
from swath.field.memory_layout import Solids
from swath.rays.engine import RayCaster
from swath.rays.hits import Hits
from swath.signals import F64

Moving = tuple[Solids, F64]  # what a thing consists of, and its velocity (3,) [m/s]
ROOM = 1.1  # of the ball around a thing in which rays are looked for


def over_moving(
    caster: RayCaster,
    hits: Hits,
    origins: F64,
    directions: F64,
    late: F64,
    moving: Sequence[Moving],
    reach: float,
) -> tuple[Hits, F64]:
    """Hits (rows, columns) of what stands, and those of things that go where these are nearer; origins as
    they are for each, (rows, columns, 3).

    origins, directions: (rows, columns, 3) or origins (3,); late: times of the samples after that of the
    picture [s], (rows, columns); reach: longest ray [m]
    """
    starts = np.array(np.broadcast_to(origins, directions.shape))
    made = Hits(*(array.copy() for array in hits.arrays))
    for solids, velocity in moving:
        chosen = np.flatnonzero(_near(solids, velocity, starts, directions, late, reach))
        if len(chosen) == 0:
            continue
        back = late.ravel()[chosen, None] * velocity
        eyes = np.broadcast_to(origins, directions.shape).reshape(-1, 3)[chosen] - back
        found = caster.cast_solids(eyes, directions.reshape(-1, 3)[chosen], range_max=reach, solids=solids)
        before = made.distance.ravel()[chosen]
        nearer = found.is_hit & ~(before <= found.distance)  # before: nan = nothing
        for array, there in zip(made.arrays, found.arrays, strict=True):
            array.reshape(-1)[chosen[nearer]] = there[nearer]
        starts.reshape(-1, 3)[chosen[nearer]] = eyes[nearer]
    return made, starts


def _near(solids: Solids, velocity: F64, starts: F64, directions: F64, late: F64, reach: float) -> F64:
    """Whether rays pass the ball around a thing, wherever it is meanwhile: (rows, columns)."""
    middle, half = bounds(parts_of(solids))
    first, last = float(late.min()), float(late.max())
    middle = middle + 0.5 * (first + last) * velocity
    radius = ROOM * (hypot(*half.tolist()) + 0.5 * (last - first) * hypot(*velocity.tolist()))
    away = middle - starts
    along = (away * directions).sum(axis=-1)
    across = (away * away).sum(axis=-1) - along * along
    return np.asarray((across <= radius * radius) & (along > -radius) & (along < reach + radius))
