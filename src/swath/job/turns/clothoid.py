"""Turn with a steering that needs time: `swath.control.turns.clothoid`, in pieces of a job's paths."""

from collections.abc import Sequence

from swath.control.steer.guidance_line import Bend
from swath.control.turns import clothoid
from swath.control.turns.dubins import Place
from swath.job.path import Piece, Pose
from swath.job.turns import TurnLimits

bend_end = clothoid.bend_end


def plan(start: Pose, end: Pose, limits: TurnLimits) -> list[Piece]:
    """Pieces of the shortest such path between two poses."""
    return _pieces(clothoid.plan(Place(*start), Place(*end), limits))


def bend(angle: float, side: int, limits: TurnLimits) -> list[Piece]:
    """Pieces of a bend through an angle >= 0 [rad] to a side (+1 left)."""
    return _pieces(clothoid.bend(angle, side, limits))


def _pieces(bends: Sequence[Bend]) -> list[Piece]:
    return [Piece(b.begin, b.end, b.length) for b in bends]
