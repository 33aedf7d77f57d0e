"""The ways of a cart on ground that is cut: to the line beside a pass, and to the truck."""

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, cos, hypot, inf, isfinite, nan, pi, sin
from typing import NamedTuple

import numpy as np

from swath.control.job.abreast import own_passes
from swath.control.job.carts import AROUND, BEYOND, IN_LINE, TURNED, WAITS, Disc
from swath.control.job.ground import Ground, Point, beside
from swath.control.job.passes import Pass, way_along
from swath.control.job.right_of_way import (
    ALONG,
    EVERY,
    FORE,
    KEEP,
    KEEP_STRAIGHT,
    CombineWays,
    outline_of,
    place_of,
)
from swath.control.job.ways import Search
from swath.control.steer.guidance_line import along_bends, wrapped
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place
from swath.signals import F64, PeerState, Phase

HALF, NARROW = 2.0, 1.2  # m, of the machine to either side, and of that about start and goal
CUTS_IN = 1.3  # m, that a trailer runs inside of its machine's tightest bend
STRIP = 2.5  # m, radius of the discs that cover what a combine cuts next
BEGINS = 6.0  # m from its outline there, within which a way begins that may lead over that place
GETS_OUT = 15.0  # m, likewise, where else there is no way: across what the combine drives over, not along it
LEAST = 1.5  # m about another cart, where the way begins near to it
LESS = 1.0  # m nearer to carts that stand, where there is no way else
CELL = 0.5  # m, that a way may pass nearer than it was looked for
COME_UP = 25.0  # m behind the combine, where it comes onto the line beside the pass
NEARER_UP = 8.0  # m, likewise, where the combine stands and another machine leaves no room farther behind it
STRAIGHT = 14.0  # m before that on the same line: the trailer is straight behind
FRONT = 4.6  # m, that a tractor reaches ahead of its axle
BEGIN = -4.0  # m from the begin of a pass, where the line beside it begins
PULL_AHEAD = 10.0  # m on before it turns away from a combine beside it
NEAR = 18.0  # m from a combine, where it does so
GONE_BY = 6.0  # m ahead of the own axle: a combine there has driven past
COMES_IN = 35.0  # m behind the combine, from where on it comes in from a line farther out
ASIDE = 0.7  # m farther out than under the pipe, where a header and a trailer pass each other
SHIFT = 7.0  # m of way, on which it drives out so far
MOVES = 0.3  # m/s, faster than which a combine will be elsewhere
FAR = 50.0  # m of its way to the next pass, that are kept clear of
SOON = 100.0  # m of the line beside a pass, on which no other cart is to be met


class Way(NamedTuple):
    """points: (n, 2) [m]; beside: length of its last piece, the line beside a pass [m], 0 = none"""

    points: F64
    beside: float

    @property
    def length(self) -> float:
        """As far as that piece [m]."""
        return way_along(self.points.tolist()) - self.beside


class CartWays:
    """passes, boundary: of the field; header: width of the combines' [m]; left: of a pass, where the cart
    drives [m]; radius: of its tightest turn [m]; places: beside the field, where it stands [m]
    """

    def __init__(
        self,
        passes: Sequence[Pass],
        boundary: Sequence[Point],
        header: float,
        left: float,
        radius: float,
        places: Sequence[Point] = (),
    ) -> None:
        self._passes, self._boundary, self._places = passes, boundary, places
        self._header, self._left, self._radius = header, left, radius
        self._ways = CombineWays(passes)
        self._uncut: Ground | None = None  # made when it is asked for

    def to_place(
        self,
        here: Place,
        place: Point,
        combine: PeerState,
        discs: Sequence[Disc] = (),
        rest: Sequence[PeerState] = (),
        past: Sequence[Disc] | None = None,
    ) -> Way | None:
        """To a place, in any direction. combine: the nearest; discs: that other carts take up (x, y, radius)
        [m]; rest: the other combines; past: of the discs, those of others when it gets there, for one that
        finds no way else
        """
        goals = [Place(*place, 2.0 * pi * i / 12) for i in range(12)]
        ahead = self._ahead_of(here, combine)
        for taken in (discs,) if past is None or len(past) == len(discs) else (discs, past):
            free = [goal for goal in goals if _has_room(goal, taken)]
            way = self._found(here, [combine, *rest], free, taken, first=ahead) if free else None
            if way is not None:
                return way
        return None

    def to_pass(
        self,
        here: Place,
        task: int,
        combine: PeerState,
        discs: Sequence[Disc] = (),
        rest: Sequence[PeerState] = (),
        *,
        soon: bool = False,
    ) -> Way | None:
        """Onto the line beside a pass behind the combine, and along it; nearer behind one that stands where
        there is no other way. discs, rest: likewise; soon: on the ground as it is when the combine begins
        that pass
        """
        way = self._onto_pass(here, task, combine, discs, rest, COME_UP, soon=soon)
        if way is None and task == combine.task and combine.phase == Phase.STANDS:
            way = self._onto_pass(here, task, combine, discs, rest, NEARER_UP, soon=soon)
        return way

    def _onto_pass(
        self,
        here: Place,
        task: int,
        combine: PeerState,
        discs: Sequence[Disc],
        rest: Sequence[PeerState],
        behind: float,
        *,
        soon: bool,
    ) -> Way | None:
        """As `to_pass`, onto the line so far behind the combine [m]."""
        # the header of one that is to come drives by the trailer
        aside = ASIDE if task > combine.task else self._leans(here, combine)
        (ax, ay), (bx, by) = line = self._beside(self._passes[task], aside)
        length = way_along(line)
        course = atan2(by - ay, bx - ax)
        ux, uy = cos(course), sin(course)
        at = place_of(here, combine)
        come = (at.x - ax) * ux + (at.y - ay) * uy
        begin = min(max(come - behind - STRAIGHT, BEGIN - STRAIGHT), length)
        if task > combine.task:
            begin = BEGIN - STRAIGHT
        goal = Place(ax + ux * begin, ay + uy * begin, course)
        beyond = bx + BEYOND * ux, by + BEYOND * uy
        then = replace(combine, task=task, remaining=nan, phase=int(Phase.CUTS)) if soon else combine
        ground = self._ground([then, *rest])
        is_in_crop = not self._passes[task].cart_beside and _is_in_crop(line, begin + STRAIGHT, ground)
        if is_in_crop or _is_line_taken(line, beyond, begin, discs):
            return None
        if task == combine.task and (on := self._along_line(here, line, beyond, come)) is not None:
            return on
        stand = [c for c in rest if c.speed <= MOVES and self._is_beside(c) and abs(c.heading) < ALONG]
        ahead = self._ahead_of(here, stand[0]) if stand else []

        def found(first: Sequence[Place]) -> Way | None:
            return self._found(
                here, [combine, *rest], [goal], discs, first=first, rest=[beyond], ground=ground
            )

        way = found(ahead)
        if way is None and not ahead and combine.speed <= MOVES:  # beside it, too near to turn away
            ahead = self._ahead_of(here, combine)
            way = found(ahead) if ahead else None
        return way

    def _along_line(self, here: Place, line: Sequence[Point], beyond: Point, come: float) -> Way | None:
        """Straight on, of a cart that is on the line beside a pass already, too near behind the combine, that
        has come so far [m], for a way that comes onto it; None where it is not.
        """
        (ax, ay), (bx, by) = line
        course = atan2(by - ay, bx - ax)
        c, s = cos(course), sin(course)
        at, aside = c * (here.x - ax) + s * (here.y - ay), c * (here.y - ay) - s * (here.x - ax)
        is_near = come - COME_UP - 2.0 * STRAIGHT < at < come - SHIFT
        if not is_near or abs(aside) > IN_LINE or abs(wrapped(here.heading - course)) > TURNED:
            return None
        onto = ax + c * (at + SHIFT), ay + s * (at + SHIFT)
        return Way(np.array([here[:2], onto, beyond]), hypot(beyond[0] - onto[0], beyond[1] - onto[1]))

    def onto_line(self, here: Place, points: F64, task: int, combine: PeerState) -> Way | None:
        """From a way (n, 2) farther out [m] onto the line beside a pass in which the combine is now, ahead of
        it; None = it leads there, or the combine is too near.
        """
        (ax, ay), (bx, by) = line = self._beside(self._passes[task], self._leans(here, combine))
        course, length = atan2(by - ay, bx - ax), way_along(line)
        c, s = cos(course), sin(course)
        come, out = c * (here.x - ax) + s * (here.y - ay) + COME_UP, c * (points[-1, 1] - ay)
        is_aside = out - s * (points[-1, 0] - ax) > 0.5 * ASIDE
        if not is_aside or combine.x < COMES_IN or come > length:
            return None
        beyond = bx + BEYOND * c, by + BEYOND * s
        made = np.array([here[:2], (ax + c * come, ay + s * come), beyond])
        return Way(made, way_along(made.tolist()))

    def _leans(self, here: Place, combine: PeerState) -> float:
        """How far left of its pass a combine drives, towards the cart's line, at most ASIDE [m]: it follows
        the edge.
        """
        (ax, ay), (bx, by) = self._passes[combine.task].line_m[0], self._passes[combine.task].line_m[-1]
        course, at = atan2(by - ay, bx - ax), place_of(here, combine)
        if combine.phase not in (Phase.CUTS, Phase.STANDS) or abs(wrapped(at.heading - course)) > ALONG:
            return 0.0
        header = combine.header_left if isfinite(combine.header_left) else 0.0
        left = cos(course) * (at.y - ay) - sin(course) * (at.x - ax) + header
        return min(max(left, 0.0), ASIDE)

    def _is_beside(self, combine: PeerState) -> bool:
        return combine.y < -0.5 * self._left and hypot(combine.x, combine.y) < NEAR

    def _ahead_of(self, here: Place, combine: PeerState) -> list[Place]:
        """Straight on, from a combine that is near and has not driven past; from beside it farther out."""
        if hypot(combine.x, combine.y) >= NEAR or combine.x > GONE_BY:
            return []
        return _pulled_ahead(here, ASIDE if self._is_beside(combine) else 0.0)

    def is_cut_before(self, place: Place, task: int, combine: PeerState) -> bool:
        """Whether crop stands at a place which a combine cuts before it begins a pass."""
        then = replace(combine, task=task, remaining=nan, phase=int(Phase.CUTS))
        now, later = self._ground([combine]), self._ground([then])
        x, y, _ = place
        return now.is_in(now.crop, x, y) and not later.is_in(later.crop, x, y)

    def _found(
        self,
        here: Place,
        combines: Sequence[PeerState],
        goals: list[Place],
        taken: Sequence[Disc],
        *,
        first: Sequence[Place] = (),
        rest: Sequence[Point] = (),
        ground: Ground | None = None,
    ) -> Way | None:
        """Through the first places, to the goal, through the rest; None = no way. ground: None = that of now

        Where there is such a way, it keeps off what combines drive over next (`_before`), and about one that
        stands its trailer has room to cut corners. Where there is none else, it goes by carts that stand
        LESS nearer, to a place then also over their ways: one in the way of another one has to get out.
        """
        ground = self._ground(combines) if ground is None else ground
        start = first[-1] if first else here
        looked: list[list[Disc]] = []
        stands = [(c, at) for c in combines for at in self._stands(here, c)]
        waits, near = (
            [disc for c in combines for disc in self._before(here, start, c, ground, begins)]
            for begins in (BEGINS, GETS_OUT)
        )
        bodies = taken if rest else [disc for disc in taken if disc[2] != WAITS]
        for more, keep, carts, less in (
            (waits, KEEP + CUTS_IN, taken, 0.0), (waits, KEEP, taken, 0.0), (near, KEEP, taken, 0.0),
            ([], KEEP + CUTS_IN, taken, 0.0), ([], KEEP, taken, 0.0), ([], KEEP, taken, LESS),
            ([], KEEP, bodies, LESS),
        ):  # fmt: skip
            discs = [disc for c, at in stands for disc in _discs(start, c, at, keep)]
            both = [*discs, *more, *_close(start, carts, less)]
            if both in looked:  # the same as before
                continue
            looked.append(both)
            masks = ground.clear_of(HALF, both), ground.clear_of(NARROW, both)
            way = Search(ground, *masks, self._radius).way(start, goals)
            if way is not None:
                break
        else:
            return None
        before = [place[:2] for place in first[:-1]]
        points = np.array([*before, *along_bends(*start, bends_of(way, self._radius)), *rest])
        last = hypot(rest[0][0] - goals[0].x, rest[0][1] - goals[0].y) if rest else 0.0
        return Way(points, last)

    def _stands(self, here: Place, combine: PeerState) -> list[Place]:
        """Where a combine stands, or may soon: at the end of its pass, and all along behind its last one.
        Else one that moves is waited for.

        here: where the own machine is
        """
        if combine.speed <= MOVES or combine.phase not in (Phase.CUTS, Phase.TURNS):
            return [place_of(here, combine)]
        if combine.phase == Phase.CUTS and combine.remaining < FORE:
            return self._ways.ahead(here, combine, max(combine.remaining, 0.0))[-1:]
        return self._ways.ahead(here, combine, self._ways.run_out)[::3] if self._leaves(combine) else []

    def _leaves(self, combine: PeerState) -> bool:
        """Whether a combine drives on behind its last pass."""
        last = own_passes(self._passes, self._passes[combine.task].combine)[-1]
        return combine.phase == Phase.TURNS and combine.task == last

    def _before(
        self, here: Place, start: Place, combine: PeerState, ground: Ground, begins: float
    ) -> list[Disc]:
        """What a combine drives over where no crop stands in what is left of its pass, or of a far way to
        the next, but where the way begins, within `begins` [m]; or, where it stands in its turn, in the next
        FORE metres, or all along behind its last pass, unless the way begins there.
        """
        cuts = combine.phase == Phase.CUTS and combine.remaining > 0.0
        if not cuts and combine.phase != Phase.TURNS:
            return []
        outline, moves, leaves = outline_of(combine), combine.speed > MOVES, self._leaves(combine)
        reach = combine.remaining if cuts else self._ways.run_out if leaves else inf if moves else FORE
        ahead = self._ways.ahead(here, combine, reach)
        if not cuts and not moves:
            keep = KEEP_STRAIGHT if leaves else KEEP
            is_near = any(outline.away(at, start.x, start.y) < keep for at in ahead[1:])
            return [] if is_near else [(*p, keep - NARROW) for at in ahead[1:] for p in outline.points(at)]
        if not cuts and EVERY * len(ahead) < FAR:
            return []
        ahead = [at for at in ahead[3::2] if outline.away(at, start.x, start.y) > begins]  # from its knife on
        half = 0.5 * self._header
        across = np.linspace(-half + STRIP, half - STRIP, max(round(half / STRIP), 2)).tolist()
        places = [beside(*at, 0.0, left) for at in ahead for left in across]
        return [(x, y, STRIP + KEEP - HALF) for x, y in places if not ground.is_in(ground.crop, x, y)]

    def _ground(self, combines: Sequence[PeerState]) -> Ground:
        """Crop as it stands now, by the passes that are done and the way in the present ones."""
        if self._uncut is None:
            self._uncut = Ground(self._boundary, self._places)
            for one in self._passes:
                self._uncut.sweep(one.line_m, self._header)
        ground = self._uncut.copy()
        for combine in combines:
            for i in own_passes(self._passes, self._passes[combine.task].combine):
                self._cut(ground, i, combine)
        return ground

    def _cut(self, ground: Ground, i: int, combine: PeerState) -> None:
        """What a combine has cut of the pass with a number."""
        size, line = None, self._passes[i].line_m
        if i == combine.task and isfinite(combine.remaining):
            size = max(way_along(line) - combine.remaining - 4.0, 0.0)
        is_done = i == combine.task and combine.phase != Phase.CUTS
        if i < combine.task or size is not None or is_done:
            ground.cut(line, self._header, size)

    def _beside(self, of: Pass, aside: float) -> list[Point]:
        """A pass's line where a cart drives, and so far aside of that, at begin and end [m]."""
        (ax, ay), (bx, by) = of.line_m[0], of.line_m[-1]
        course = atan2(by - ay, bx - ax)
        return [beside(x, y, course, 0.0, self._left + aside) for x, y in ((ax, ay), (bx, by))]


def _has_room(goal: Place, discs: Sequence[Disc]) -> bool:
    """Whether a cart that stands at a place does not reach into what other carts take up."""
    fx, fy = beside(*goal, FRONT, 0.0)
    return not any(hypot(fx - x, fy - y) < size for x, y, size in discs)


def _is_line_taken(line: Sequence[Point], beyond: Point, begin: float, discs: Sequence[Disc]) -> bool:
    """Whether other carts stand or drive on the next of the line beside a pass, from `begin` on [m]."""
    (ax, ay), (bx, by) = line[0], beyond
    length = hypot(bx - ax, by - ay)
    ux, uy, end = (bx - ax) / length, (by - ay) / length, min(length - BEYOND, begin + SOON)
    return any(
        begin - size < ux * (x - ax) + uy * (y - ay) < end + size
        and abs(ux * (y - ay) - uy * (x - ax)) < size
        for x, y, size in discs
    )


def _is_in_crop(line: Sequence[Point], begin: float, ground: Ground) -> bool:
    """Whether crop stands on the line beside a pass, from `begin` on [m]."""
    (ax, ay), (bx, by) = line
    length = way_along(line)
    ways = np.arange(max(begin, 0.0), length, EVERY) / length
    return any(ground.is_in(ground.crop, ax + w * (bx - ax), ay + w * (by - ay)) for w in ways.tolist())


def _close(start: Place, taken: Sequence[Disc], less: float) -> list[Disc]:
    """What other carts take up, as far as the start is from it; less [m] of that about those that stand."""
    found = []
    for x, y, size in taken:
        wanted = size - less if size == AROUND else size
        found.append((x, y, _left_free(hypot(x - start.x, y - start.y), wanted)))
    return found


def _left_free(away: float, wanted: float) -> float:
    """Radius of a disc about another cart so far away [m] from which the way can begin, LEAST at least."""
    return max(min(wanted, away - NARROW - 0.5 * CELL), LEAST)


def _discs(start: Place, combine: PeerState, at: Place, keep: float) -> list[Disc]:
    """What is left free about a combine at a place, as far as the start is from it. keep: from its outline"""
    outline = outline_of(combine)
    radius = max(min(outline.away(at, start.x, start.y), keep + CELL) - NARROW - 0.5 * CELL, 0.3)
    return [(x, y, radius) for x, y in outline.points(at)]


def _pulled_ahead(here: Place, aside: float) -> list[Place]:
    """Places every metre straight on, meanwhile so far to the left [m], by a cubic without a kink."""
    found = []
    for i in range(round(PULL_AHEAD) + 1):
        share = min(i / SHIFT, 1.0)
        x, y = beside(*here, float(i), aside * share * share * (3.0 - 2.0 * share))
        found.append(Place(x, y, here.heading))
    return found
