"""Who goes first where the ways of combines meet.

All ways are sampled in steps of time as if nothing stopped anybody. Of two combines, those pairs of samples
are no place to be at which outlines come near each other, or that the caller forbids. The cheapest way from
both begins to both ends around them, in steps of one, the other, or both, says on which side each of them is
passed (O'Donnell and Lozano-Perez 1989, doi:10.1109/ROBOT.1989.100033, on the coordination of two paths). A
third combine is coordinated in the same manner with the way that the first two found together. A combine then
goes on once the others are past all that it lets go first. Such an order cannot come to a standstill: the way
that was found stays open. Each region of pairs that is no place to be is a crossing, which is passed on one
side or on the other.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.control.job.abreast import own_passes
from swath.control.job.cart_ways import ASIDE
from swath.control.job.passes import Pass, Route, route_of, way_along
from swath.control.job.right_of_way import LIMITS
from swath.control.job.turn_speed import speed_between
from swath.core.units import KMH
from swath.job.machines import Combine
from swath.job.plan import shapely_here
from swath.signals import F64

RUN_UP = 4.0  # m before its first pass, where a combine starts
APART = 1.0  # m between the outlines of two combines, at least
LEAVES = 15.0, 30.0  # m before and behind the end of a pass, where a cart leaves
EXIT = 0.0, 30.0  # m ahead of that end, along which it does
STEP = 1.0  # s
CART, WIDE = 8.0, 3.0  # m of a cart beside, ahead of the combine's axle and behind it; of its width
LANDS = 0.5  # m beyond the mouth of the pipe, where grain comes down: the middle of a cart
TOGETHER = 12  # samples
SHORT_OF = 0.15  # of the way between two samples: who is so near to one has come there
DRIVES, STANDS = 4, 6  # cost of a step, and of one for which one of them stands between two passes
NEVER = 100_000_000  # cost
MOST = 3000  # samples of a way; more of them are farther apart
NO_ORDER = "expected passes on which the combines can keep clear of each other"
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Costs = NDArray[np.int32]
Rule = dict[str, float]
Meeting = dict[str, list[Rule]]


class Member(NamedTuple):
    """A combine of several. start, run_out: how far before its first pass it begins, and drives on behind its
    last one [m]; job: its settings
    """

    start: float
    job: dict[str, Any]
    run_out: float


class Samples(NamedTuple):
    """Of a way. task: number of the pass; way: along it and the turn behind it [m]; place: x, y, heading;
    turns: behind the pass; beside: in a pass beside which carts drive; leaves: about the end of a pass, where
    a cart that was beside drives straight on; end: place at the end of the pass
    """

    task: Indices
    way: F64
    place: F64
    turns: Mask
    beside: Mask
    leaves: Mask
    end: F64


class Shapes(NamedTuple):
    """Of a combine at its samples. bodies: its outline, and a tree of them; beside: samples in a pass beside
    which carts drive, and the ground of these carts; exits: samples about the end of a pass, and the ground
    along which a cart leaves it
    """

    bodies: Any
    tree: Any
    beside: Indices
    carts: Any
    exits: list[tuple[Indices, Any]]


Forbidden = Callable[[int, Samples, int, Samples], Mask]
Uncut = Callable[[int, int], Mask]


class Ways(NamedTuple):
    """Of all combines. passes: of all; routes: along the passes of each and the turns behind them; step: of
    samples [s]
    """

    passes: Sequence[Pass]
    routes: list[dict[int, Route]]
    samples: list[Samples]
    step: float


def ways_of(
    passes: Sequence[Pass], combines: Sequence[Combine], starts: Sequence[float], outs: Sequence[float]
) -> Ways:
    """The ways of all combines. starts, outs: how far before its first pass each begins, and drives on behind
    its last one [m]
    """
    routes = [_routes(passes, i, combines[i], outs[i]) for i in range(len(combines))]
    step = STEP * max(1.0, *(_time(w, passes, c) / MOST for w, c in zip(routes, combines, strict=True)))
    made = [_samples(routes[i], passes, combines[i], starts[i], step) for i in range(len(combines))]
    return Ways(passes, routes, made, step)


def crossings_of(
    made_ways: Ways,
    combines: Sequence[Combine],
    forbidden: Forbidden | None = None,
    *,
    with_carts: bool = False,
    uncut: Uncut | None = None,
) -> list[Meeting] | None:
    """`crossings` of all combines; None where there is no order. forbidden: of two combines and their
    samples, which pairs (n, m) of these are no place to be for another reason: the second waits there, and
    the order cannot be another one;
    with_carts: between their passes they keep off carts beside others; uncut: of the numbers of two combines,
    which pairs have crop where another one is to cut before: no place to be
    """
    numbers, ways = range(len(combines)), made_ways.samples
    shapes = [_shapes(way, combine) for way, combine in zip(ways, combines, strict=True)]
    near = {
        (i, k): _near((ways[i], ways[k]), (shapes[i], shapes[k]), with_carts=with_carts)
        for k in numbers
        for i in range(k)
    }
    if uncut is not None:
        near = {pair: mask | uncut(*pair) for pair, mask in near.items()}
    late = {
        (i, k): forbidden(i, ways[i], k, ways[k]) if forbidden else np.zeros_like(mask)
        for (i, k), mask in near.items()
    }
    costs = [_costs(way, routes) for way, routes in zip(ways, made_ways.routes, strict=True)]
    joint: Indices = np.arange(len(ways[0].way))[:, None]
    for k in numbers[1:]:
        blocked = np.zeros((len(joint), len(ways[k].way)), dtype=bool)
        for i in range(k):
            blocked |= _widened(near[i, k] | late[i, k])[joint[:, i]]
        blocked[0, 0] = blocked[-1, -1] = False  # where they begin and end is as it is
        of_joint = np.max([costs[i][joint[:, i]] for i in range(k)], axis=0)
        found = _way_through(blocked, (of_joint, costs[k]))
        if found is None:
            return None
        joint = np.column_stack([joint[found[:, 0]], found[:, 1]])
    made: list[Meeting] = []
    for (i, k), mask in near.items():
        through = _range_of(joint[:, i], joint[:, k])
        made += _meetings(mask & ~late[i, k], through, ways[i], ways[k], fixed=forbidden is not None)
    return made


def _meetings(
    mask: Mask, through: tuple[Indices, Indices], first: Samples, second: Samples, *, fixed: bool
) -> list[Meeting]:
    """The regions of a mask, each with the rules of who waits there. through: `_range_of` the way through;
    fixed: the other one never goes first
    """
    shapely_here()  # scipy comes with it
    from scipy import ndimage

    made: list[Meeting] = []
    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    for number, place in enumerate(ndimage.find_objects(labels), 1):
        part, (rows, columns) = labels[place] == number, place
        after = np.arange(columns.start, columns.stop)[None, :]
        low, high = (side[rows][:, None] for side in through)
        is_first, is_second = part & (after > high), part & (after < low)  # who goes first
        meeting = {
            "first": [
                *_rules(is_first, place, first, second, np.searchsorted(through[1], after[0])),
                *_rules(is_second.T, place[::-1], second, first, through[0][rows]),
            ]
        }
        # who is in it at first goes first, and who ends in it last
        ends = 0 in (rows.start, columns.start) or rows.stop == len(mask) or columns.stop == mask.shape[1]
        if not fixed and not ends and (part == is_first).all():
            meeting["instead"] = _rules(part.T, place[::-1], second, first)
        elif not fixed and not ends and (part == is_second).all():
            meeting["instead"] = _rules(part, place, first, second)
        if meeting["first"]:
            made.append(meeting)
    return made


def _widened(mask: Mask) -> Mask:
    """With the samples around: who waits for another one may wait until that has gone on."""
    wide, made = np.pad(mask, 1), np.zeros_like(mask)
    for i in range(3):
        for k in range(3):
            made |= wide[i : i + len(mask), k : k + mask.shape[1]]
    return made


def _range_of(first: Indices, second: Indices) -> tuple[Indices, Indices]:
    """Least and greatest sample of the second at each of the first, on a way through for both."""
    begins = np.flatnonzero(np.diff(first, prepend=-1))
    ends = np.append(begins[1:], len(first)) - 1
    return second[begins], second[ends]


def _routes(passes: Sequence[Pass], number: int, combine: Combine, run_out: float) -> dict[int, Route]:
    own = own_passes(passes, number)
    mine, sheet = [passes[i] for i in own], combine.sheet
    return {i: route_of(mine, k, sheet.knife_x, LIMITS, sheet.header_y, run_out) for k, i in enumerate(own)}


def _time(routes: dict[int, Route], passes: Sequence[Pass], combine: Combine) -> float:
    """Of the whole way [s]."""
    return sum(
        r.length / (passes[i].speed_kmh * KMH) + r.turn / combine.turn_speed for i, r in routes.items()
    )


def _samples(
    routes: dict[int, Route], passes: Sequence[Pass], combine: Combine, start: float, step: float
) -> Samples:
    rows = []
    way, last = -start, max(routes)
    for i, route in routes.items():
        end = route.length + (route.turn if i != last else way_along(route.points) - route.length - 1.0)
        at_end = (*route.line.point(route.length), route.line.heading(route.length - 1.0))
        cutting = passes[i].speed_kmh * KMH
        while way < end:
            x, y = route.line.point(way)
            turning = way >= route.length
            beside = passes[i].cart_beside and not turning
            leaves = passes[i].has_cart and -LEAVES[0] < way - route.length < LEAVES[1]
            rows.append((i, way, x, y, route.line.heading(way), turning, beside, leaves, *at_end))
            fast = speed_between(route, way, combine.turn_speed, combine.transport) if turning else cutting
            way += step * fast
        way -= end
    table = np.array(rows)
    of_way, (turns, beside, leaves), ends = table[:, :5], table[:, 5:8].T > 0.0, table[:, 8:]
    return Samples(of_way[:, 0].astype(np.int64), of_way[:, 1], of_way[:, 2:], turns, beside, leaves, ends)


def _shapes(of: Samples, combine: Combine) -> Shapes:
    shapely, boxes = shapely_here(), np.array(combine.sheet.outline)
    bodies = _bodies(of.place, boxes, shapely)
    beside = np.flatnonzero(of.beside)
    carts = _bodies(of.place, _beside(combine, -CART, CART), shapely)[beside]
    exits = []
    for task in np.unique(of.task[of.leaves]):
        rows = np.flatnonzero(of.leaves & (of.task == task))
        exits.append((rows, _bodies(of.end[rows[:1]], _beside(combine, *EXIT), shapely)))
    return Shapes(bodies, shapely.STRtree(bodies), beside, carts, exits)


def _near(ways: Sequence[Samples], shapes: Sequence[Shapes], *, with_carts: bool) -> Mask:
    """Which pairs of samples of two combines are nearer than APART. with_carts: or have a combine between two
    passes so near to a cart beside the other one, or one where a cart leaves the other one straight on
    """
    near = np.zeros((len(ways[0].way), len(ways[1].way)), dtype=bool)
    rows, columns = _within(shapes[1], shapes[0].bodies)
    near[rows, columns] = True
    if with_carts:
        for own, other, of, mask in zip(shapes, shapes[::-1], ways[::-1], (near, near.T), strict=True):
            rows, columns = _within(other, own.carts)
            turns = of.turns[columns]
            mask[own.beside[rows[turns]], columns[turns]] = True
            for leaves, ahead in own.exits:
                mask[np.ix_(leaves, _within(other, ahead)[1])] = True
    return near


def _within(of: Shapes, shapes: Any) -> Indices:
    """Numbers (2, n) of the pairs of shapes, and of samples of a combine, that are nearer than APART."""
    found: Indices = of.tree.query(shapes, predicate="dwithin", distance=APART)
    return found


def _beside(combine: Combine, rear: float, front: float) -> F64:
    """Box (1, 4) where a cart drives, as in `_bodies`: on the line of the pipe, or coming up farther out."""
    line = combine.pipe + LANDS
    return np.array([[rear, front, line - 0.5 * WIDE, line + ASIDE + 0.5 * WIDE]])


def _bodies(place: F64, boxes: F64, shapely: Any) -> Any:
    """A machine at each place and halfway to the next: transport goes some 3 m on in a step.

    boxes: rear, front, right, left (k, 4), from its axle [m]
    """
    there = np.concatenate([place[1:], place[-1:]])
    turned = np.arctan2(np.sin(there[:, 2] - place[:, 2]), np.cos(there[:, 2] - place[:, 2]))
    halfway = np.column_stack([0.5 * (place[:, :2] + there[:, :2]), place[:, 2] + 0.5 * turned])
    both = np.stack([place, halfway], axis=1)[:, :, None, None]
    x, y, heading = both[..., 0], both[..., 1], both[..., 2]
    ahead, left = boxes[:, [0, 1, 1, 0]], boxes[:, [2, 2, 3, 3]]
    c, s = np.cos(heading), np.sin(heading)
    corners = np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=-1)  # (n, 2, k, 4, 2)
    return shapely.multipolygons(shapely.polygons(corners.reshape(len(place), -1, 4, 2)))


def _way_through(blocked: Mask, costs: tuple[Costs, Costs]) -> Indices | None:
    """The cheapest way through: pairs of samples (n, 2), each at most one on from the one before; None where
    there is none. costs: of each step for which the one stands at a sample while the other one drives on
    """
    rows, columns = blocked.shape
    left = _cost_left(blocked, costs)
    if left[0, 0] >= NEVER:
        return None
    found = [(0, 0)]
    while found[-1] != (rows - 1, columns - 1):
        i, j = found[-1]
        steps = ((i + 1, j + 1), DRIVES), ((i + 1, j), costs[1][j]), ((i, j + 1), costs[0][i])
        found.append(min(steps, key=lambda step: left[step[0]] + step[1])[0])
    return np.array(found)


def _cost_left(blocked: Mask, costs: tuple[Costs, Costs]) -> Costs:
    """From every pair of samples to the last one, with a row and a column of NEVER beyond that."""
    rows, columns = blocked.shape
    left = np.full((rows + 1, columns + 1), NEVER, dtype=np.int32)
    at = np.arange(columns, dtype=np.int32)
    for i in range(rows - 1, -1, -1):
        best = np.minimum(left[i + 1, :-1] + costs[1], left[i + 1, 1:] + DRIVES)
        if i == rows - 1:
            best[-1] = 0
        ends = np.flatnonzero(np.diff(np.concatenate([[True], blocked[i], [True]]).astype(np.int8)))
        for first, end in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
            free, alone = slice(first, end), at[first:end] * costs[0][i]  # along it the second drives alone
            reached = np.minimum.accumulate((best[free] + alone)[::-1])[::-1] - alone
            left[i, free] = np.minimum(reached, NEVER)
    return left


def _costs(of: Samples, routes: dict[int, Route]) -> Costs:
    """Of standing for a step at each sample: between two passes carts come by, and it is dearer."""
    lengths = np.array([routes[int(task)].length for task in of.task])
    return np.where(of.way > lengths, STANDS, DRIVES).astype(np.int32)


def _rules(
    before: Mask, place: tuple[slice, slice], other: Samples, own: Samples, reached: Indices | None = None
) -> list[Rule]:
    """Of a machine that waits. before: rows of the other one, columns of its own, at a place among all: what
    the other one is past first; reached: row of the other one on the way through, when the own one comes to a
    column

    Where the way through allows it a rule says at once what the next TOGETHER samples want.
    """
    rows, columns = place
    least = np.where(before.any(axis=0), rows.stop - 1 - before[::-1].argmax(axis=0), -1)
    rules, met = [], -1
    for j in range(len(least)):
        if least[j] <= met:
            continue
        soon = least[j : j + TOGETHER]
        if reached is not None:  # both may go on at once there: neither waits for the other one to be past
            soon = soon[(soon < reached[j] - 1) | (soon <= least[j])]
        met = int(soon.max())
        k, past = max(columns.start + j - 1, 0), min(met + 1, len(other.way) - 1)
        until = float(other.way[past])
        if past > met and other.task[past] == other.task[met]:  # it may have to wait at the sample itself
            until -= SHORT_OF * (until - float(other.way[met]))
        rules.append(
            {
                "task": int(own.task[k]), "way_m": round(float(own.way[k]), 3),
                "other": int(other.task[past]), "other_m": round(until, 3),
            }
        )  # fmt: skip
    return rules
