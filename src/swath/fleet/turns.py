"""Turns that are rolled through: as sharp as the steering turns at the speed of a turn, without a stop."""

import math

from swath.control.turns import TurnLimits, clothoid
from swath.control.turns.dubins import Place as Pose
from swath.fleet.bodies import Body, Drive, Place
from swath.fleet.ways import SAMPLE, Track, driven


def rolled(start: Place, goal: Place, drive: Drive, body: Body) -> Track:
    """The shortest such way from a place to another, forwards; what stands there is not looked at."""
    if not math.isfinite(drive.steering):
        raise ValueError("expected a drive whose steering takes time")
    limits = TurnLimits(drive.radius, drive.steering / drive.turning)
    pieces = []
    for length, first, last in clothoid.plan(Pose(*start[:3]), Pose(*goal[:3]), limits):
        count = max(1, math.ceil(length / SAMPLE - 1e-9))
        pieces += [(first + (i + 0.5) / count * (last - first), length / count) for i in range(count)]
    return driven(start, [p for p in pieces if p[1] > 1e-9], body)
