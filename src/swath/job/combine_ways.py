"""Ways of a combine from the end of a pass to the start of the next, and how fast: for all levels."""

import math

import numpy as np
from numpy.typing import NDArray

from swath.job.cart_ways import braked
from swath.job.machines import Combine
from swath.job.path import Path, Pose, joined, path_of
from swath.job.plan import PlannedPass
from swath.job.states import CombineState, way_between
from swath.job.turns import clothoid

Array = NDArray[np.float64]
FAR = 80.0  # m, beyond which a way is no turn but transport
START = 12.0  # m between combines in echelon before the first pass
STRAIGHT = 1e-4  # 1/m, least curvature of a bend


def is_far(here: Pose, start: Pose) -> bool:
    """True where the start of a pass is too far for a turn."""
    return way_between(here, start) >= FAR


def corner_angle(here: Pose, task: PlannedPass) -> float | None:
    """Angle [rad] of the corner between two sides of an opening round; None where none is driven."""
    turned = abs(math.remainder(task.start.heading - here.heading, 2.0 * math.pi))
    near = task.is_corner and not is_far(here, task.start)
    return turned if near and turned < math.radians(150.0) else None


def behind_first(first: CombineState, combine: CombineState) -> float:
    """How far before its first pass a combine in echelon is to begin, behind the first of them [m]."""
    task, lead = combine.task, first.task
    if combine.number == 0 or task is None or lead is None:
        return 0.0
    (x, y, course), start = task.start, lead.start
    ahead = (start.x - x) * math.cos(course) + (start.y - y) * math.sin(course)
    return max(combine.number * START - ahead, 0.0)


def way_to_pass(combine: Combine, axle: Pose, start: Pose, abreast: float = 4.0) -> Path:
    """From where the fixed axle is to where it is with the knife at the start of a pass.

    A pass that starts farther along it than `abreast` radii is reached along the own one first, then across.
    """
    goal = axle_pose(start, combine.sheet.knife_x)
    c, s = math.cos(goal.heading), math.sin(goal.heading)
    along = (goal.x - axle.x) * c + (goal.y - axle.y) * s
    room = abreast * combine.limits.radius
    if abs(along) <= room:
        return _turn(combine, axle, goal)
    way = along - room if along > 0.0 else along
    course = goal.heading if along > 0.0 else goal.heading + math.pi
    first = _turn(combine, axle, Pose(axle.x + way * c, axle.y + way * s, course))
    return joined([first, _turn(combine, first.end, goal)])


def _turn(combine: Combine, here: Pose, goal: Pose) -> Path:
    return path_of(clothoid.plan(here, goal, combine.limits), here)


def speed_limits(combine: Combine, path: Path, *, far: bool) -> Array:
    """Highest speed at every point of a path [m/s]: in bends that of turns, on the straights of a far way
    that of transport.
    """
    if not far:
        return np.full(len(path.distance), combine.turn_speed)
    fastest = max(combine.transport, combine.turn_speed)
    allowed = np.where(np.abs(path.curvature) > STRAIGHT, combine.turn_speed, fastest)
    return braked(allowed, path)


def axle_pose(knife: Pose, ahead: float) -> Pose:
    """Where the fixed axle is when the knife is at a pose."""
    c, s = math.cos(knife.heading), math.sin(knife.heading)
    return Pose(knife.x - ahead * c, knife.y - ahead * s, knife.heading)
