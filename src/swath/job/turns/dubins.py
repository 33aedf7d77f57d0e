"""Shortest turn of arcs of one radius and straights, without reversing: jumps from straight to full lock."""

import math

from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place, shortest
from swath.job.path import Piece, Pose
from swath.job.turns import TurnLimits


def plan(start: Pose, end: Pose, limits: TurnLimits) -> list[Piece]:
    """Pieces of the shortest path between two poses."""
    way = shortest(Place(*start), Place(*end), limits.radius)
    return [Piece(b.begin, b.end, b.length) for b in bends_of(way, limits.radius)]


def length(start: Pose, end: Pose, radius: float) -> float:
    """Length of the shortest path [m]."""
    return math.fsum(p.length for p in plan(start, end, TurnLimits(radius, 1.0)))
