"""Turns of a combine that does not reverse, and where its fixed axle is at the ends of a pass."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from swath.job.combine_ways import axle_pose, is_far
from swath.job.machines import Combine
from swath.job.path import Piece, Pose
from swath.job.plan import FieldPlan, PlannedPass, Shared
from swath.job.turns import TurnLimits, clothoid

GENTLE = 0.6  # of the steering's rate in a turn, the rest is for coming back to the path
STRAIGHT = 3.0  # m on the line of the next pass before its begin
ABREAST = 4.0  # radii before that, where a way leaves the line along the pass


def shared(plan: FieldPlan, by: Sequence[int], combines: Sequence[Combine]) -> Shared:
    """With the turns of `turn_between`."""
    passes = plan.passes
    turns = {i: turn_between(passes[i], passes[k], combines[by[i]]) for i, k in following(by)}
    return Shared(plan, list(by), turns)


def following(by: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Numbers of two passes that the same combine cuts one after the other."""
    for i, number in enumerate(by):
        then = next((k for k in range(i + 1, len(by)) if by[k] == number), None)
        if then is not None:
            yield i, then


def turn_between(p: PlannedPass, then: PlannedPass, combine: Combine) -> list[Piece]:
    """Pieces of the fixed axle's way from the end of a pass to the start of the next.

    Round a corner of an opening round it is a loop to the outside. A pass that starts far along the next one
    is reached as at the other levels: along it first, then across.
    """
    here, there = axle_at(p.end, combine), axle_at(then.start, combine, STRAIGHT)
    limits = replace(combine.limits, sharpness=GENTLE * combine.limits.sharpness)
    angle = math.remainder(there.heading - here.heading, 2.0 * math.pi)
    far = is_far(p.end, then.start)
    if then.is_corner and not far and math.radians(20.0) < abs(angle) < math.radians(150.0):
        return loop(here, there, angle, limits)
    c, s = math.cos(there.heading), math.sin(there.heading)
    along, room = (there.x - here.x) * c + (there.y - here.y) * s, ABREAST * limits.radius
    first: list[Piece] = []
    if far and abs(along) > room:
        way = along - room if along > 0.0 else along
        course = there.heading if along > 0.0 else there.heading + math.pi
        goal = Pose(here.x + way * c, here.y + way * s, course)
        first, here = clothoid.plan(here, goal, limits), goal
    return [*first, *clothoid.plan(here, there, limits), Piece(0.0, 0.0, STRAIGHT)]


def axle_at(knife: Pose, combine: Combine, back: float = 0.0) -> Pose:
    """Where the fixed axle is when the middle of the knife is at a pose, and so far back on its way [m]."""
    x, y, heading = axle_pose(knife, combine.sheet.knife_x + back)
    aside = combine.sheet.header_y
    return Pose(x + aside * math.sin(heading), y - aside * math.cos(heading), heading)


def loop(here: Pose, there: Pose, angle: float, limits: TurnLimits) -> list[Piece]:
    """Straight on, round to the other side through a full turn less the angle [rad], straight to the goal and
    STRAIGHT beyond.
    """
    side = -1 if angle > 0.0 else 1
    around = 2.0 * math.pi - abs(angle)
    end = clothoid.bend_end(around, side, limits)
    c, s = math.cos(here.heading), math.sin(here.heading)
    dx, dy = there.x - here.x, there.y - here.y
    gap = complex(c * dx + s * dy, c * dy - s * dx) - end
    # gap = first + last * exp(i angle)
    last = gap.imag / math.sin(angle)
    first = gap.real - last * math.cos(angle)
    if first < 0.0 or last < 0.0:
        return [*clothoid.plan(here, there, limits), Piece(0.0, 0.0, STRAIGHT)]
    straight = [Piece(0.0, 0.0, way) for way in (first, last + STRAIGHT)]
    return [straight[0], *clothoid.bend(around, side, limits), straight[1]]
