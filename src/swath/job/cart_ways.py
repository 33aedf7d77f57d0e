"""Ways of a cart over headland and passes, and how fast they are driven: the same for all levels.

A way leads along the goal's course to abreast of it and then across, corners rounded by shortest turns, or
straight there where that is shorter and leads over cut ground. It is driven as fast as the sideways
acceleration in its bends allows, with the drive's acceleration and deceleration: the speed profile of a point
mass, forwards and backwards over the path (Bobrow 1985, doi:10.1177/027836498500400301).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.job.machines import Cart, Combine
from swath.job.path import Path, Pose, ahead_of, joined, path_of, polyline
from swath.job.states import CombineState
from swath.job.turns import TurnLimits, dubins

Array = NDArray[np.float64]
RADIUS = 8.0  # m, of a tractor with a trailer
SIDEWAYS = 0.8  # m/s2, most in a bend, as the level with sensors drives
BRAKE = 0.5  # m/s2, with a load
LANDS = 0.5  # m, that the stream lands beyond the mouth of the pipe
RUN_UP = 12.0  # m before a pass, from where a cart drives straight along it
ASIDE = 15.0  # m beside its line, from where a cart can follow a combine
AT_TRUCK = 3.0  # m beside its place at the truck: a cart still stands there
STRAIGHT_OUT = 20.0  # m that it drives straight from there, past the truck, or from beside a combine
BAND = 2.4  # m to both sides of a cart's middle, where nothing is to come by
SWATH, BY = 18.0, 1.5  # m right and left of the line beside a combine, where no cart comes against it
OVER = 25.0  # m of way, in which it moves over to there
JOIN = 30.0  # m of a pass that are cut, from where a cart near its line turns onto it
TRIES = (-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0, 32.0)  # m from abreast of it, and before its place: joins
FARTHER = 25.0  # m between the joins that are tried where a cart comes straight over cut ground
LOOKED_AT = 2.0  # m between the points of a straight way that are held against standing crop
SAVES = 10.0  # m, at least, by which it is shorter
LEAST = 8.0  # m before its place beside the combine, that it joins the line at the latest
AHEAD = 40.0  # m ahead of a combine, where a cart on its line waits for it
KEEP = 2.0  # m from the bodies of its combine to the middle of a cart
ONTO = 20.0  # m of way, in which it moves over onto the line beside a combine
BEYOND = 30.0  # m that its way goes on behind the pass
CLOSE = 0.3  # m/s, slowest towards the end of a way
CATCH_UP = 0.3  # 1/s, speed per distance to the place beside a combine
NEAR = 0.5  # m before the end of a way, where it is done
IN_PLACE = 1.0  # m along the pass, within which a cart is beside its combine


def beside(place: Pose, combine: Combine, cart: Cart) -> Pose:
    """Where a cart's tractor is whose box is under the pipe of a combine with its knife at a place."""
    back, left = box_offset(combine) - box_behind(cart), aside(combine)
    c, s = math.cos(place.heading), math.sin(place.heading)
    return Pose(place.x - back * c - left * s, place.y - back * s + left * c, place.heading)


def box_offset(combine: Combine) -> float:
    """How far the pipe is behind the knife [m]."""
    pipe = combine.sheet.pipe
    return combine.sheet.knife_x - (pipe.x if pipe is not None else 0.0)


def aside(combine: Combine) -> float:
    """How far left of a combine's middle the stream lands [m]."""
    return combine.pipe + LANDS


def box_behind(cart: Cart) -> float:
    """From a tractor's axle back to the middle of the box [m]."""
    hitch, box = cart.sheet.hitch, cart.sheet.box
    assert box is not None
    return -box.x if hitch is None else hitch.drawbar - hitch.x - box.x


class WayBeside(NamedTuple):
    """A cart's way beside a combine. begin: distance on the path at which the box is under the pipe of the
    combine that begins its pass, < 0 behind it; length: of the pass; onto: distance on the path from which
    that is the line beside the pass [m]
    """

    path: Path
    begin: float
    length: float
    onto: float

    def place(self, combine: CombineState) -> float:
        """Distance on the path at which the box is under the pipe of the combine where that is now [m]."""
        if combine.phase in ("way", "hold"):
            return self.begin
        if combine.task is None:  # at the end of its last pass
            return self.begin + self.length
        return self.begin + (1.0 - combine.left / combine.task.length) * self.length


def way_beside(
    here: Pose, at: CombineState, cart: Cart, truck: Pose, *,
    run_up: float = RUN_UP, direct: bool = False, leaves: bool = False,
    is_free: Callable[[Path], bool] | None = None,
) -> WayBeside:  # fmt: skip
    """To the start of a combine's pass, along it on its left and beyond.

    A cart that is beside the pass already follows the combine; where that has no pass any more: to where it
    stands. truck: its place there, from where it drives straight on first; run_up: before the pass, straight
    [m]; direct: there in one turn; leaves: another combine, beside which it drives straight on first;
    is_free: whether a way leads over cut ground; straight there, if shorter
    """
    out = straight_out(here, at, cart, truck, leaves=leaves)
    begin, here = here, ahead_of(here, out)
    combine, task = at.spec, at.task
    line = np.array([at.place[:2], at.place[:2]]) if task is None else task.line
    course = at.place.heading if task is None else task.start.heading
    beside_it = shifted(line, course, aside(combine))
    c, s = math.cos(course), math.sin(course)
    first = Pose(float(beside_it[0, 0] - run_up * c), float(beside_it[0, 1] - run_up * s), course)
    last = course if len(line) < 3 else math.atan2(*(line[-1] - line[-2])[::-1])
    end = beside_it[-1] + BEYOND * np.array([math.cos(last), math.sin(last)])
    points = np.array([*beside_it[1:-1], end])
    across = c * (here.y - first.y) - s * (here.x - first.x)
    is_behind = c * (here.x - first.x) + s * (here.y - first.y) < 0.0
    if _follows(here, first, at, cart):
        path, onto = _onto_line(here, first, points, _place_on(at, cart))
    elif (join := _nearer(here, first, at, cart)) is not None:
        path, onto = way_in(here, join, points, straight=True)
    else:
        path, onto = way_in(
            here, first, points, straight=direct or (is_behind and abs(across) < 2.0 * RADIUS)
        )
        if is_free is not None:
            join = _straight_there(here, first, at, cart, onto, is_free)
            path, onto = (path, onto) if join is None else way_in(here, join, points, straight=True)
    path = straight_first(begin, out, path)
    length = float(np.hypot(*np.diff(beside_it, axis=0).T).sum())
    begins = path.length - BEYOND - length - box_offset(combine) + box_behind(cart)
    return WayBeside(path, begins, length, out + onto)


def straight_out(here: Pose, at: CombineState, cart: Cart, truck: Pose, *, leaves: bool) -> float:
    """How far a cart drives straight on first [m], as in `way_beside`."""
    is_there = math.hypot(here.x - truck.x, here.y - truck.y) <= AT_TRUCK
    return STRAIGHT_OUT if is_there or leaves else out_of_turn(here, at, cart)


def out_of_turn(here: Pose, at: CombineState, cart: Cart) -> float:
    """How far a cart drives straight on from beside a combine [m], until the ends of the header do not come
    by it in the turn that the combine drives now.
    """
    if at.phase != "way" or at.turn is None or math.cos(here.heading - at.place.heading) < 0.9:
        return 0.0
    c, s = math.cos(here.heading), math.sin(here.heading)
    dx, dy = at.place.x - here.x, at.place.y - here.y
    if abs(c * dy - s * dx + aside(at.spec)) > 2.0 or abs(c * dx + s * dy) > 2.0 * ASIDE:
        return 0.0
    step = np.gradient(at.turn, axis=0)
    step /= np.hypot(step[:, 0], step[:, 1])[:, None]
    side, middle = np.column_stack([-step[:, 1], step[:, 0]]), at.turn + at.spec.sheet.knife_x * step
    half = 0.5 * at.spec.sheet.header_width
    ends = np.concatenate([middle + half * side, middle - half * side]) - here[:2]
    along, across = ends[:, 0] * c + ends[:, 1] * s, ends[:, 1] * c - ends[:, 0] * s
    swept = along[np.abs(across) < BAND]
    return max(0.0, float(swept.max()) + cart.length_behind) if len(swept) else 0.0


def straight_first(here: Pose, out: float, way: Path) -> Path:
    """A way that begins so far [m] straight ahead, from here on."""
    return joined([polyline(np.array([here[:2], ahead_of(here, out)[:2]])), way]) if out > 0.0 else way


def shifted(line: Array, course: float, left: float) -> Array:
    """A line [m] moved to its left by a distance [m]; course: of one without length [rad]."""
    steps = np.diff(line, axis=0).tolist()
    angles = [math.atan2(y, x) if math.hypot(x, y) > 0.0 else course for x, y in steps]
    moved = []
    for (x, y), before, after in zip(line.tolist(), [angles[0], *angles], [*angles, angles[-1]], strict=True):
        half = 0.5 * math.remainder(after - before, 2.0 * math.pi)
        out = left / math.cos(half)  # a mitre keeps both sides at that distance
        moved.append((x - out * math.sin(before + half), y + out * math.cos(before + half)))
    return np.array(moved)


def _onto_line(here: Pose, first: Pose, points: Array, place: float) -> tuple[Path, float]:
    """Onto the line from `first` over points on, where it is beside it: within ONTO of way, or less where its
    place is nearer. place: along the line [m]
    """
    start = np.array(first[:2])
    for i, point in enumerate(points):
        step = point - start
        way = float(np.hypot(*step))
        c, s = step / way
        dx, dy = here.x - float(start[0]), here.y - float(start[1])
        along, across = dx * c + dy * s, dy * c - dx * s
        turned = math.remainder(here.heading - math.atan2(s, c), 2.0 * math.pi)
        least = min(_least_onto(across, turned), ONTO)
        join = max(along + min(max(place - along, least), ONTO), 0.0)
        if join < way - 1.0:
            there = Pose(float(start[0] + join * c), float(start[1] + join * s), math.atan2(s, c))
            return way_in(here, there, points[i:], straight=True)
        start, place = point, place - way
    path = rounded([(float(start[0]), float(start[1]))], here)
    return path, path.length


def way_in(here: Pose, first: Pose, points: Array, *, straight: bool = False) -> tuple[Path, float]:
    """Over passes and headland to a place in its direction, and from there along points; the way to there.

    straight: by a shortest turn; else along the place's direction to abreast of it first
    """
    limits, parts = TurnLimits(RADIUS, 1.0), []
    abreast = corner_way(here, first)[0]
    if not straight and math.hypot(abreast[0] - here.x, abreast[1] - here.y) > 2.0 * RADIUS:
        parts.append(rounded(_beside_swath(here, abreast, first), here))
        here = parts[-1].end
    parts.append(path_of(dubins.plan(here, first, limits), here, 0.5))
    line = polyline(np.array([parts[-1].end[:2], *points]), 0.5)
    return joined([*parts, line]), math.fsum(p.length for p in parts)


def _beside_swath(here: Pose, abreast: tuple[float, float], first: Pose) -> list[tuple[float, float]]:
    """Points of the way against the direction of a pass to abreast of its begin: not where the combine comes
    along, but to the left of it.
    """
    c, s = math.cos(first.heading), math.sin(first.heading)
    left = c * (here.y - first.y) - s * (here.x - first.x)
    back = c * (here.x - first.x) + s * (here.y - first.y)
    if back < 3.0 * OVER or not -SWATH < left < BY:
        return [abreast]
    return [(first.x + a * c - BY * s, first.y + a * s + BY * c) for a in (back - OVER, 0.0)]


def _follows(here: Pose, first: Pose, at: CombineState, cart: Cart) -> bool:
    """Whether a cart is beside a combine's pass in its direction, and can be on the line there behind its
    place, or a little ahead where it waits for the combine. first: of the way there
    """
    if at.task is None or at.phase not in ("cut", "stand"):
        return False
    c, s = math.cos(first.heading), math.sin(first.heading)
    dx, dy = here.x - first.x, here.y - first.y
    along, across = c * dx + s * dy, c * dy - s * dx
    turned = math.remainder(here.heading - first.heading, 2.0 * math.pi)
    ahead = 0.0
    if at.phase == "cut" and at.per_metre > 0.0:  # not so far that it would stand, full, before it is there
        ahead = min(AHEAD, at.left, (at.spec.tank - at.tank) / at.per_metre)
    last = _place_on(at, cart) + ahead - _least_onto(across, turned)
    return RUN_UP < along < last and abs(across) < ASIDE and math.cos(turned) > 0.7


def _place_on(at: CombineState, cart: Cart) -> float:
    """How far a cart's place beside a combine in its pass is from where its way begins to be straight [m]."""
    assert at.task is not None
    return RUN_UP + at.task.length - at.left - box_offset(at.spec) + box_behind(cart)


def _least_onto(across: float, turned: float) -> float:
    """Way that a cart needs onto a line so far beside it [m] that it is turned against [rad]: two arcs."""
    return 2.0 + math.sqrt(4.0 * RADIUS * abs(across)) + 2.0 * RADIUS * abs(turned)


def _nearer(here: Pose, first: Pose, at: CombineState, cart: Cart) -> Pose | None:
    """Where on the line beside a straight pass a cart joins it that is near that line already, but not in its
    direction: behind its place beside the combine, so that the way there is the shortest, and clear of it.
    """
    task = at.task
    if task is None or at.phase not in ("cut", "stand") or len(task.line) > 2:
        return None
    c, s = math.cos(first.heading), math.sin(first.heading)
    done, goal = task.length - at.left, _place_on(at, cart)
    dx, dy = here.x - first.x, here.y - first.y
    along, across = c * dx + s * dy, c * dy - s * dx
    if (
        abs(across) > ASIDE
        or along < RUN_UP
        or done < JOIN
        or along > goal + (0.0 if at.phase == "cut" else JOIN)
    ):
        return None
    ways = []
    for join in (*(along + d for d in TRIES), *(goal - d for d in TRIES if d > 0.0)):
        if not 0.0 < join <= goal - LEAST:
            continue
        pose = Pose(first.x + join * c, first.y + join * s, first.heading)
        way = path_of(dubins.plan(here, pose, TurnLimits(RADIUS, 1.0)), here, 0.5)
        if _is_off(way, at):
            ways.append((way.length + goal - join, pose))
    return min(ways)[1] if ways else None


def _straight_there(
    here: Pose, first: Pose, at: CombineState, cart: Cart, onto: float, is_free: Callable[[Path], bool]
) -> Pose | None:
    """Where a cart joins the line beside a pass in one turn over cut ground, clear of its combine, and is at
    its place sooner than by a way that begins the line after so far [m]; None: nowhere.
    """
    goal, joins = 0.0, [0.0]
    if at.task is not None and at.phase in ("cut", "stand"):
        goal, done = _place_on(at, cart), at.task.length - at.left
        if len(at.task.line) == 2 and done >= JOIN:
            joins += [goal - LEAST - d * FARTHER for d in range(math.ceil((goal - LEAST) / FARTHER))]
    limits = TurnLimits(RADIUS, 1.0)
    poses = [ahead_of(first, join) for join in joins]
    turns = [dubins.plan(here, pose, limits) for pose in poses]
    ways = [math.fsum(p.length for p in t) + goal - join for t, join in zip(turns, joins, strict=True)]
    for i in sorted(range(len(joins)), key=lambda i: (ways[i], i)):
        if ways[i] > onto + goal - SAVES:
            return None
        way = path_of(turns[i], here, LOOKED_AT)
        if (joins[i] == 0.0 or _is_off(way, at)) and is_free(way):
            return poses[i]
    return None


def _is_off(way: Path, at: CombineState) -> bool:
    """Whether a cart's way leads clear of its combine where that is now."""
    assert at.task is not None
    sheet, (x, y, course) = at.spec.sheet, at.task.at(at.task.length - at.left)
    c, s = math.cos(course), math.sin(course)
    dx, dy = way.points[:, 0] - x, way.points[:, 1] - y
    ahead, left = dx * c + dy * s, np.abs(dy * c - dx * s)
    rear, _, half, *_ = sheet.body
    header = (np.abs(ahead) < 2.0 * KEEP) & (left < 0.5 * sheet.header_width + KEEP)
    body = (ahead < KEEP) & (ahead > rear - sheet.knife_x - KEEP) & (left < half + KEEP)
    return not bool((header | body).any())


def speed_limits(path: Path, cart: Cart) -> Array:
    """Highest speed at every point of a path [m/s], so that bends ahead are reached slowly enough."""
    allowed = np.minimum(np.sqrt(SIDEWAYS / np.maximum(np.abs(path.curvature), 1e-9)), cart.speed)
    return braked(allowed, path)


def braked(allowed: Array, path: Path) -> Array:
    """Speed limits at the points of a path [m/s] that braking from each to the next can keep."""
    limits = allowed.tolist()
    steps = np.diff(path.distance).tolist()
    for i in range(len(steps) - 1, -1, -1):
        limits[i] = min(limits[i], math.sqrt(limits[i + 1] ** 2 + 2.0 * BRAKE * steps[i]))
    return np.array(limits)


def speed_to_end(left: float, cart: Cart) -> float:
    """Speed [m/s] that a cart wants so far before the end of its way [m]."""
    return min(cart.speed, max(math.sqrt(2.0 * BRAKE * left), CLOSE))


def speed_beside(gap: float, speed: float, pace: float, cart: Cart) -> float:
    """Speed [m/s] that a cart wants so far behind its place beside a combine [m].

    speed, pace: of the combine, now and wanted in its pass [m/s]
    """
    return min(max(0.5 * (speed + pace) + CATCH_UP * gap, 0.0), cart.speed)


def corner_way(here: Pose, goal: Pose) -> list[tuple[float, float]]:
    """From a place along the goal's course to abreast of it, then across: points [m]."""
    c, s = math.cos(goal.heading), math.sin(goal.heading)
    along = (goal.x - here.x) * c + (goal.y - here.y) * s
    return [(here.x + along * c, here.y + along * s), (goal.x, goal.y)]


def rounded(points: list[tuple[float, float]], start: Pose, radius: float = RADIUS) -> Path:
    """A path through points, by shortest turns from each to the course of the next piece."""
    limits = TurnLimits(radius, 1.0)
    parts: list[Path] = []
    here = start
    for i, (x, y) in enumerate(points):
        if i + 1 < len(points) and math.hypot(x - here.x, y - here.y) < 2.0 * radius:
            continue  # too near for a turn of its own
        u, v = points[i + 1] if i + 1 < len(points) else (x, y)
        if math.hypot(u - x, v - y) > 1.0:
            course = math.atan2(v - y, u - x)
        else:
            course = (
                math.atan2(y - here.y, x - here.x)
                if math.hypot(x - here.x, y - here.y) > 1.0
                else here.heading
            )
        goal = Pose(x, y, course)
        if math.hypot(x - here.x, y - here.y) < 1.0 and abs(math.sin(course - here.heading)) < 0.1:
            continue
        parts.append(path_of(dubins.plan(here, goal, limits), here, 0.5))
        here = parts[-1].end
    return joined(parts) if parts else polyline(np.array([start[:2], (start.x + 1.0, start.y)]))
