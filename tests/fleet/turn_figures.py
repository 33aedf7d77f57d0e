"""Figures of a headland turn from its track, as recorded: the same for a logged and for a simulated one.

The heading is that of the chord from the record before to the record after, averaged over three records. The
turn begins with the last record within 5 deg of the finished pass and ends with the first after the last
that is farther than 5 deg from the next pass. The path is summed up to the record before the last, as in the
summary of the Montana turns.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.portable import arctan2

Array = NDArray[np.float64]
TOLERANCE = math.radians(5.0)


@dataclass(frozen=True)
class TurnFigures:
    """duration [s], path: driven [m], depth: beyond the start of the turn [m], excursion: farthest sideways
    from the finished pass [m].
    """

    duration: float
    path: float
    depth: float
    excursion: float


def measure(time: Array, points: Array) -> TurnFigures:
    """Figures of a turn through half a circle.

    time [s], (n,); points (n, 2) [m]: along the finished pass, and towards the next. InputError for no turn.
    """
    heading = smoothed_heading(points)
    turned = np.abs(heading) > 0.5 * math.pi
    if not turned.any() or len(time) < 5:
        raise InputError("turn", None, "expected a track that turns through half a circle")
    middle = int(np.flatnonzero(turned)[0])
    before = np.flatnonzero(np.abs(heading[:middle]) < TOLERANCE)
    from_next = math.pi - np.abs(heading)
    outside = np.flatnonzero(from_next[:-2] > TOLERANCE)
    first = int(before[-1]) if len(before) else 0
    last = min(int(outside[-1]) + 1, len(time) - 1)
    part = points[first : last + 1]
    steps = np.diff(part[:-1], axis=0)
    return TurnFigures(
        duration=float(time[last] - time[first]),
        path=float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        depth=float(part[:, 0].max() - part[0, 0]),
        excursion=float(part[:, 1].max()),
    )


def smoothed_heading(points: Array) -> Array:
    """Direction of travel at each record of a track (n, 2) [rad], (n,)."""
    chord = points[2:] - points[:-2]
    angle = arctan2(chord[:, 1], chord[:, 0])
    angle = np.concatenate([angle[:1], angle, angle[-1:]])
    x, y = np.cos(angle), np.sin(angle)
    x = np.concatenate([x[:1], x, x[-1:]])
    y = np.concatenate([y[:1], y, y[-1:]])
    return arctan2(y[:-2] + y[1:-1] + y[2:], x[:-2] + x[1:-1] + x[2:])
