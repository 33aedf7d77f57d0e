"""The plan of a field: headland rounds, passes in lands, and what is cleaned up around holes and in corners.

Passes are lines of the header's middle. Along outlines first (rounds, clockwise: crop on the right, so that a
cart may drive on the left; or counterclockwise), each from corner to corner, bends between them driven
through; then straight ones parallel to the field's x axis. What is left of the field is shared out among the
combines as bands across it, by what each can cut an hour; a band has strips of its combine's header, of
which holes and gaps leave stretches; stretches that follow each other from strip to strip are a cell (a
boustrophedon decomposition, Choset 2000, DOI 10.1023/A:1008958800904), cut in lands round and round. At last,
with all around cut, what straight passes leave beside slanted edges of holes is cut along these edges. Lines
of others that cover the field are its passes instead.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num, percent_of
from swath.core.portable import arctan2, product, tan
from swath.fleet.files import PlanSettings
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Combine, Place
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Track, driven, eased, straight

Array = NDArray[np.float64]
HEADLAND, LAND, CLEAN = "headland", "land", "clean"
SLIVER = 1e-3  # m2 of shapes, m of lines, that only touch
SMOOTH = 0.1  # m, that a round may be off the line beside an outline


@dataclass(frozen=True)
class Params:
    """least_m2: crop for which no pass of its own is made, a thousandth of a hectare, and that is left at a
    bend that is driven through; bridge_m: gap without crop that a pass goes on over; edge_m: shortest
    headland pass. Chosen so that less than 0.5 % of drawn fields is left. round: radius of bends of a pass,
    times that of the tightest turn; part: of a tank that a pass with bends takes at most; look_m: between
    places that are looked at for crop along a round; opens_m: over which a way is opened to a headland pass
    at most; bent_m: most that points of a pass of others lie off its straight line; covers: share of a field
    that lines of its file cover, from which they are its passes. Estimates.
    """

    least_m2: float = 2.0
    bridge_m: float = 15.0
    edge_m: float = 6.0
    round: float = 1.5
    part: float = 0.5
    look_m: float = 1.0
    opens_m: float = 120.0
    bent_m: float = 0.5
    covers: float = 0.5


PARAMS = Params()


@dataclass(frozen=True)
class Pass:
    """start, end: of the header's middle [m]; width: of the narrowest header that cuts it [m]; kind:
    headland, land or clean; land: number of its land, of its round in the headland; combine: number, -1 for
    any; via: points between start and end at which it bends.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    kind: str
    land: int = 0
    combine: int = -1
    via: tuple[tuple[float, float], ...] = ()

    @property
    def line(self) -> tuple[tuple[float, float], ...]:
        """Its points [m]."""
        return self.start, *self.via, self.end

    @property
    def length(self) -> float:
        """Length [m]."""
        return math.fsum(math.dist(a, b) for a, b in pairwise(self.line))

    @property
    def heading(self) -> float:
        """Direction of driving at its start [rad]."""
        (x, y), (u, v) = self.line[:2]
        return math.atan2(v - y, u - x)

    def reversed(self) -> "Pass":
        """The same, driven the other way."""
        return replace(self, start=self.end, end=self.start, via=self.via[::-1])

    def behind(self, x: float, y: float) -> "Pass":
        """What is left of it from a point on its line on [m]."""
        point, line = shapely_here().Point(x, y), np.array(self.line)
        sides = shapely_here().linestrings(np.stack([line[:-1], line[1:]], axis=1))
        return replace(
            self, start=(x, y), via=self.via[int(np.argmin(shapely_here().distance(sides, point))) :]
        )


@dataclass(frozen=True)
class Plan:
    """passes: in the order of working, those of each combine by themselves; area: of the field; left: that no
    pass cuts [m2]; notes: on how it was made.
    """

    passes: tuple[Pass, ...]
    area: float
    left: float
    notes: tuple[str, ...] = ()

    def write(self, path: Path) -> None:
        """Write the plan as JSON, in the field's frame [m]."""
        rows = {"area_m2": self.area, "left_m2": self.left, "passes": [asdict(p) for p in self.passes]}
        write_whole(path, json.dumps(rows, indent=1) + "\n")


class _Stretch(NamedTuple):
    """A part of a strip with crop: its middle line's y and ends [m]."""

    y: float
    west: float
    east: float


def plan_of(
    ground: Ground,
    combines: Sequence[Combine],
    settings: PlanSettings,
    drawn: Sequence[Any] = (),
) -> Plan:
    """The plan of a field. drawn: lines of its file.

    InputError where a hundredth of it cannot be cut, but for passes of others.
    """
    widths = [c.width - settings.overlap_m for c in combines]
    made = _Planner(ground, combines, widths, settings)
    lines, notes = _lines_of_others(ground, min(c.width for c in combines), settings, drawn)
    if lines:
        made.along(lines)
        return Plan(tuple(made.passes), ground.field.area, made.rest.area, tuple(notes))
    made.rounds()
    made.bands()
    made.clean_up()
    plan = Plan(tuple(made.passes), ground.field.area, made.rest.area, tuple(notes))
    if plan.left > 0.01 * plan.area:
        expected = (
            f"expected a field of which 99 % can be cut, {num(plan.left)} of {num(plan.area)} m2 cannot"
        )
        raise InputError("field", None, expected)
    return plan


def _lines_of_others(
    ground: Ground, header: float, settings: PlanSettings, drawn: Sequence[Any]
) -> tuple[list[Array], list[str]]:
    """Both ends of each line that is a pass, (2, 2) each, and notes on lines of a file.

    InputError for passes that are not straight, or hardly longer than a point.
    """
    shapely = shapely_here()
    lines = [ground.frame.to_field(line) for line in settings.passes_m or drawn]
    if not lines:
        return [], []
    lengths = [math.dist(line[0], line[-1]) for line in lines]
    if min(lengths) <= PARAMS.bent_m:
        number = np.argmin(lengths) + 1
        expected = f"expected passes of more than {num(PARAMS.bent_m)} m, number {number} is shorter"
        raise InputError("plan.passes_m" if settings.passes_m else "field.file", None, expected)
    bent = [shapely.LineString(line[[0, -1]]).hausdorff_distance(shapely.LineString(line)) for line in lines]
    ends = [line[[0, -1]] for line in lines]
    worst = int(np.argmax(bent))
    if settings.passes_m:
        if bent[worst] > PARAMS.bent_m:
            expected = f"expected straight passes, number {worst + 1} bends by {num(bent[worst])} m"
            raise InputError("plan.passes_m", None, expected)
        return ends, []
    strips = [shapely.LineString(e).buffer(0.5 * header, cap_style="flat") for e in ends]
    share = shapely.intersection(shapely.union_all(strips), ground.field).area / ground.field.area
    if bent[worst] > PARAMS.bent_m:
        why = f"line {worst + 1} bends by {num(bent[worst])} m"
    elif share < PARAMS.covers:
        why = f"they cover {percent_of(share)} of the field"
    else:
        return ends, [f"shape: the {len(lines)} lines of the file are the passes, in their order"]
    return [], [f"shape: lines of the file say the direction of passes alone: {why}"]


class _Planner:
    """rest: crop that no pass made so far cuts."""

    def __init__(
        self,
        ground: Ground,
        combines: Sequence[Combine],
        widths: list[float],
        settings: PlanSettings,
    ) -> None:
        self.ground, self.combines, self.widths, self.settings = ground, combines, widths, settings
        self.narrowest = min(combines, key=lambda c: c.width)
        self.rest: Any = ground.field
        self.passes: list[Pass] = []
        self.land = 0

    def add(self, line: Any, width: float, kind: str, land: int, combine: int = -1) -> None:
        """A pass, and what it cuts is no longer there."""
        made = _pass_of(line, width, kind, land, combine)
        self.passes.append(made)
        cut = shapely_here().union_all(self.strips(made)) if made.via else strip_of(made)
        self.rest = shapely_here().difference(self.rest, cut)

    def strips(self, p: Pass, spacing: float = PARAMS.look_m) -> Any:
        """What a header goes over along a pass, polygons, so far from each other [m]."""
        track = track_along(p, self.narrowest)
        marks = np.linspace(0.0, track.length, max(2, math.ceil(track.length / spacing) + 1))
        return strips_along(track, p.width, self.narrowest.knife, marks)

    def rounds(self) -> None:
        """Headland passes along the outlines, outside in."""
        shapely = shapely_here()
        width = min(self.widths)
        outer = shapely.union_all([shapely.Polygon(p.exterior) for p in _parts(self.ground.field)])
        for k in range(self.settings.headland_rounds):
            here, middle, inner = (
                outer.buffer(-n * width, join_style="mitre", mitre_limit=5.0) for n in (k, k + 0.5, k + 1)
            )
            ring = shapely.difference(here, inner)
            for part in _parts(middle):
                self._round(part, width, ring, k)

    def _round(self, middle: Any, width: float, ring: Any, number: int) -> None:
        """Passes along the outline of a part, clockwise: from corner to corner, or all round.

        A corner that points into the field is driven through, since behind it no machine could stand to begin
        a pass: crop is all around. What is left there is cut by the passes after it.
        """
        tightest = max(c.drive.radius for c in self.combines)
        wanted = PARAMS.round * tightest
        points = _outline(middle)
        sides = np.roll(points, -1, axis=0) - points
        length = np.hypot(*sides.T)
        half = np.maximum(0.5 * length, 0.5 * WAYS.ramp_m)  # over which a bend grows and fades
        radius, turn = _bends(np.roll(sides, 1, axis=0), sides, np.roll(half, 1), half, wanted)
        points_out = _cross(np.roll(sides, 1, axis=0), sides) < 0.0
        missed = points_out & (_missed(radius, turn, width) > PARAMS.least_m2)
        corners = np.flatnonzero(missed | (radius < tightest)).tolist()
        most = float(length.sum()) / len(self.combines)
        for i, j in pairwise([*corners, corners[0] + len(points)] if corners else []):
            if length.take(range(i, j), mode="wrap").sum() >= PARAMS.edge_m:
                leg = points.take(range(i, j + 1), axis=0, mode="wrap")
                first, last = (3 * width * sides[k] / length[k] for k in (i, (j - 1) % len(points)))
                self._leg([leg[0] - first, *leg[1:-1], leg[-1] + last], 3 * width, most, ring, number)
        if not corners:  # it begins and ends in the middle of a side
            middles = points + 0.5 * sides
            way = np.hypot(*(middles - self.ground.gate).T) + self._opened(middles, sides)
            first = int(np.argmin(np.round(way, 1)))
            around = np.roll(points, -first - 1, axis=0)
            self._leg([middles[first], *around, middles[first]], 0.0, most, ring, number)

    def _opened(self, places: Array, sides: Array) -> Array:
        """How far crop stands straight behind places, driven along their sides, (n,) [m]."""
        shapely = shapely_here()
        back = PARAMS.opens_m * sides / np.hypot(*sides.T)[:, None]
        lines = shapely.linestrings(np.stack([places, places - back], axis=1))
        return np.asarray(shapely.length(shapely.intersection(lines, self.ground.field)))

    def _leg(self, points: Sequence[Any], more: float, most: float, ring: Any, number: int) -> None:
        """Passes along a line that is longer at both ends [m], as far as the ring of this round reaches.

        most: length of one that bends [m]
        """
        shapely, width = shapely_here(), min(self.widths)
        line, holes = shapely.LineString(points), self.ground.holes
        marks = np.linspace(0.0, line.length, max(2, math.ceil(line.length / PARAMS.look_m)) + 1)
        looks = _along(line, width, marks)
        crop = shapely.area(shapely.intersection(looks, shapely.intersection(ring, self.rest)))
        is_clear = np.full(len(looks), True)
        if not holes.is_empty:
            is_clear = shapely.distance(looks, holes) > GAPS.rim_m + 0.5 * self.settings.overlap_m
        for start, end in _bridged(_runs(crop > SLIVER, marks), PARAMS.bridge_m):
            if end > more and start < line.length - more:
                inside = (marks[:-1] > start - SLIVER) & (marks[1:] < end + SLIVER)
                for s, e in _runs(inside & is_clear, marks):
                    for part in self._parted(_between(line, s, e), most):
                        self._headland(part, width + self.settings.overlap_m, number)

    def _parted(self, line: Array, most: float) -> list[Array]:
        """A line with bends in pieces that end in middles of its sides, none much longer than some length [m]
        and than what a tank takes.
        """
        shapely = shapely_here()
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        grain = float(self.ground.density(shapely.linestrings([line]))[0]) * min(self.widths)
        takes = PARAMS.part * min(c.tank for c in self.combines) / grain
        count = math.ceil(ends[-1] / min(most, takes) - SLIVER) if len(line) > 2 else 1
        middles = 0.5 * (ends[1:] + ends[:-1])
        places = 0.5 * (line[1:] + line[:-1])
        opened = self._opened(places, np.diff(line, axis=0)) if count > 1 else middles
        cuts = {
            float(middles[np.argmin(np.abs(middles - k * ends[-1] / count) + opened)])
            for k in range(1, count)
        }
        whole = shapely.LineString(line)
        return [_between(whole, s, e) for s, e in pairwise([0.0, *sorted(cuts), float(ends[-1])])]

    def _headland(self, line: Array, header: float, number: int) -> None:
        """A pass along a line, in parts where there is no room for its bends."""
        shapely, c = shapely_here(), self.narrowest
        made = _pass_of(line, header, HEADLAND, number)
        strips, track = self.strips(made), track_along(made, c)
        if made.via and not shapely.contains(self.ground.rough, strips).all():
            half = len(line) // 2
            for part in (line[: half + 1], line[half:]):
                self._headland(part, header, number)
            return
        crop = shapely.intersection(shapely.union_all(strips), self.rest).area
        ends = [Place(*track.places[i].tolist()) for i in (0, -1)]
        if crop > PARAMS.least_m2 and self._can_stand(c, ends):
            turned = (self.settings.headland == "counterclockwise") == (self.ground.frame.side > 0.0)
            self.add(line[::-1] if turned else line, header, HEADLAND, number)

    def _crop_in(self, start: Array, end: Array, width: float) -> float:
        line = shapely_here().LineString([start, end])
        return float(line.buffer(0.5 * width, cap_style="flat").intersection(self.rest).area)

    def _clear(
        self, at: Array, u: Array, start: float, end: float, combine: int = -1
    ) -> list[tuple[float, float]]:
        """Stretches of a line, from `at` along u [m], on which the header of a combine, by default of the
        narrowest, keeps off holes, and whose ends it can get to and away from.
        """
        shapely = shapely_here()
        if self.ground.holes.is_empty:
            return [(start, end)]
        line = shapely.LineString([at + start * u, at + end * u])
        c = self.combines[combine] if combine >= 0 else self.narrowest
        strip = line.buffer(0.5 * c.width + GAPS.rim_m, cap_style="flat")
        met = [
            (s - GAPS.rim_m, e + GAPS.rim_m)
            for s, e in _spans(strip.intersection(self.ground.holes), at, u, SLIVER)
        ]
        free, begin = [], start
        for s, e in sorted(met):
            if s > begin:
                free.append((begin, s))
            begin = max(begin, e)
        if begin < end:
            free.append((begin, end))
        heading = math.atan2(u[1], u[0])
        points = [[at + d * u for d in span] for span in free]
        ends = [[Place(x, y, heading, heading).ahead(-c.knife) for x, y in two] for two in points]
        return [
            span
            for span, two in zip(free, ends, strict=True)
            if span[1] - span[0] > 0.5 and self._can_stand(c, two)
        ]

    def _can_stand(self, c: Combine, ends: Sequence[Place]) -> bool:
        """Whether a combine can stand at both ends of a pass, driven there, as given, or back."""
        shapely = shapely_here()
        turned = (p.ahead(2.0 * c.knife) for p in ends)
        back = [Place(p.x, p.y, p.heading + math.pi, p.heading + math.pi) for p in turned]
        for two in (ends, back):
            outlines = shapely.polygons(c.body.outlines(np.array(two), GAPS.search_m))
            if shapely.contains(self.ground.open, outlines).all():
                return True
        return False

    def along(self, lines: Sequence[Array]) -> None:
        """Passes of others, in their order; combines share them out by what they can cut an hour."""
        power = np.array([w * c.speed for w, c in zip(self.widths, self.combines, strict=True)])
        length = np.array([math.dist(a, b) for a, b in lines])
        middle = (np.cumsum(length) - 0.5 * length) / length.sum()
        numbers = np.searchsorted(np.cumsum(power / power.sum())[:-1], middle, side="right")
        for (a, b), number in zip(lines, numbers.tolist(), strict=True):
            header, u = self.combines[number].width, (b - a) / math.dist(a, b)
            strip = shapely_here().LineString([a, b]).buffer(0.5 * header, cap_style="flat")
            crop = strip.intersection(self.rest)
            for start, end in _bridged(_spans(crop, a, u, PARAMS.least_m2), PARAMS.bridge_m):
                for s, e in self._clear(a, u, start, end, number):
                    self.add((a + s * u, a + e * u), header, LAND, 0, number)

    def bands(self) -> None:
        """What the rounds leave, shared out in bands across the field, each in strips of its combine."""
        crop = self.rest
        if crop.area < PARAMS.least_m2:
            return
        power = [w * c.speed for w, c in zip(self.widths, self.combines, strict=True)]
        edges = _shares(crop, [p / math.fsum(power) for p in power])
        for number, (south, north) in enumerate(pairwise(edges)):
            self._band(number, south, north)

    def _band(self, number: int, south: float, north: float) -> None:
        width, header = self.widths[number], self.combines[number].width
        count = max(1, math.ceil((north - south) / width - 1e-6))
        pitch = (north - south) / count
        strips = [self._stretches(south + (i + 0.5) * pitch, pitch, number) for i in range(count)]
        for cell in _cells(strips):
            most = self.settings.land_passes if self.settings.order == "lands" else len(cell)
            for first in range(0, len(cell), most):
                for stretch, east in ORDERS[self.settings.order](cell[first : first + most]):
                    start, end = (stretch.west, stretch.y), (stretch.east, stretch.y)
                    start, end = (start, end) if east else (end, start)
                    self.add((start, end), header, LAND, self.land, number)
                self.land += 1

    def _stretches(self, y: float, pitch: float, combine: int) -> list[_Stretch]:
        """The parts of a strip in which there is crop, off holes."""
        shapely = shapely_here()
        west, _, east, _ = self.rest.bounds if not self.rest.is_empty else (0.0, 0.0, 0.0, 0.0)
        crop = self.rest.intersection(shapely.box(west - 1.0, y - 0.5 * pitch, east + 1.0, y + 0.5 * pitch))
        at, u = np.array([0.0, y]), np.array([1.0, 0.0])
        spans = _bridged(_spans(crop, at, u, PARAMS.least_m2), PARAMS.bridge_m)
        return [_Stretch(y, s, e) for start, end in spans for s, e in self._clear(at, u, start, end, combine)]

    def clean_up(self) -> None:
        """Passes along edges for what is left, as long as they cut anything worth it."""
        header = self.narrowest.width
        for _ in range(400):
            parts = [p for p in _parts(self.rest) if p.area > PARAMS.least_m2]
            best = max(
                (c for p in parts for c in self._along_edges(p, header)), default=None, key=lambda c: c[0]
            )
            if best is None or best[0] < PARAMS.least_m2:
                return
            self.add(best[1:], header, CLEAN, 0)

    def _along_edges(self, part: Any, header: float) -> list[tuple[float, Array, Array]]:
        """Passes that cut from a part of what is left: along hole edges near it, along x, across: area,
        ends.
        """
        shapely = shapely_here()
        lines: list[tuple[Array, Array]] = []
        for hole in _parts(self.ground.holes):
            points = shapely.get_coordinates(shapely.orient_polygons(hole, exterior_cw=False).exterior)
            for a, b in pairwise(points):
                if shapely.LineString([a, b]).distance(part) < 2.0 and math.dist(a, b) > 0.5:
                    u = (b - a) / math.dist(a, b)
                    lines.append((a + (0.5 * header + GAPS.rim_m) * np.array([u[1], -u[0]]), u))
        middle = shapely.get_coordinates(part.representative_point())[0]
        for u in (np.array([1.0, 0.0]), np.array([0.0, 1.0])):
            left = np.array([-u[1], u[0]])
            across = product(shapely.get_coordinates(part), left)
            offsets = (product(middle, left), across.min() + 0.48 * header, across.max() - 0.48 * header)
            lines += [(at * left, u) for at in offsets]
        found = []
        for at, u in lines:
            far = shapely.LineString([at + t * u for t in _reach(part, at, u)])
            for s, e in _spans(far.buffer(0.5 * header, cap_style="flat").intersection(part), at, u):
                for start, end in self._clear(at, u, s, e):
                    line = at + start * u, at + end * u
                    found.append((self._crop_in(*line, header), *line))
        return found


def strip_of(p: Pass) -> Any:
    """What the header of a pass goes over, but for what it swings out in bends."""
    return shapely_here().LineString(p.line).buffer(0.5 * p.width, cap_style="flat")


def track_along(p: Pass, c: Combine) -> Track:
    """The way of a combine along a pass: its axle keeps to the line, and rounds its bends."""
    start = Place(*p.start, p.heading, p.heading).ahead(-c.knife)
    if not p.via:
        return straight(start, p.length, c.body)
    sides = np.diff(np.array(p.line), axis=0)
    length = np.hypot(*sides.T)
    room = np.concatenate([length[:1], 0.5 * length[1:-1], length[-1:] - c.knife])  # of bends: half a side
    radius, turn = _bends(sides[:-1], sides[1:], room[:-1], room[1:], PARAMS.round * c.drive.radius)
    used = radius * tan(0.5 * turn)
    left = length - np.concatenate([[0.0], used]) - np.concatenate([used, [0.0]])
    left[[0, -1]] += c.knife, -c.knife
    bend = np.sign(_cross(sides[:-1], sides[1:])) / radius
    pieces = [(0.0, float(left[0]))]
    for k, over, rest in zip(bend.tolist(), (radius * turn).tolist(), left[1:].tolist(), strict=True):
        pieces += [(k, over), (0.0, rest)]
    pieces = [(k, over) for k, over in pieces if over > SLIVER]
    return eased(start, pieces, c.body, WAYS.ramp_m) or driven(start, pieces, c.body)


def strips_along(track: Track, width: float, knife: float, marks: Array) -> Any:
    """What a header of a width, so far ahead of an axle, goes over between marks along its way [m]."""
    x, y, h = (np.interp(marks, track.distance, column) for column in track.places.T[:3])
    middle = np.column_stack([x + knife * np.cos(h), y + knife * np.sin(h)])
    return _quads(middle, 0.5 * width * np.column_stack([-np.sin(h), np.cos(h)]))


def _quads(middle: Array, left: Array) -> Any:
    """Polygons between places that follow each other, so wide to both sides."""
    shapely = shapely_here()
    rows = middle[:-1] - left[:-1], middle[1:] - left[1:], middle[1:] + left[1:], middle[:-1] + left[:-1]
    made = shapely.polygons(np.stack(rows, axis=1))
    crossed = ~shapely.is_valid(made)  # in a bend that is narrower than half of the width
    made[crossed] = shapely.convex_hull(made[crossed])
    return made


def _along(line: Any, width: float, marks: Array) -> Any:
    """A strip along a line in polygons between marks [m]."""
    shapely = shapely_here()
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, marks))
    u = np.gradient(points, axis=0)
    left = np.column_stack([-u[:, 1], u[:, 0]]) / np.maximum(np.hypot(*u.T), SLIVER)[:, None]
    return _quads(points, 0.5 * width * left)


def _runs(is_in: Any, marks: Array) -> list[tuple[float, float]]:
    """From where to where something holds between marks."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(is_in, int), [0]])))
    return [(float(marks[i]), float(marks[j])) for i, j in ends.reshape(-1, 2)]


def _between(line: Any, start: float, end: float) -> Array:
    """Points of a part of a line [m], (n, 2)."""
    shapely = shapely_here()
    points = shapely.get_coordinates(line)
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    inner = points[(at > start + SLIVER) & (at < end - SLIVER)]
    ends = shapely.get_coordinates(shapely.line_interpolate_point(line, [start, end]))
    return np.vstack([ends[:1], inner, ends[1:]])


def _pass_of(line: Any, width: float, kind: str, land: int, combine: int = -1) -> Pass:
    start, *via, end = ((float(x), float(y)) for x, y in line)
    return Pass(start, end, width, kind, land, combine, tuple(via))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _bends(before: Array, after: Array, room: Array, more: Array, wanted: float) -> tuple[Array, Array]:
    """Radius of the bend from a side into the next one, each with some room for it, at most what is wanted
    [m], and the angle that is turned [rad], (n,).
    """
    turn = np.abs(arctan2(_cross(before, after), (before * after).sum(axis=1)))
    half = np.maximum(tan(0.5 * turn), 1e-9)
    return np.minimum(wanted, np.minimum(room, more) / half), turn


def _missed(radius: Array, turn: Array, width: float) -> Array:
    """Crop beside a strip that is left outside of its bends [m2]."""
    return (radius + 0.5 * width) ** 2 * (tan(0.5 * turn) - 0.5 * turn)


def _outline(area: Any) -> Array:
    """The outline of a part, clockwise, (n, 2)."""
    shapely = shapely_here()
    ring = shapely.orient_polygons(shapely.Polygon(area.exterior).simplify(SMOOTH), exterior_cw=True)
    points = shapely.get_coordinates(ring)[:-1]
    return np.roll(points, -int(np.lexsort(np.round(points.T[::-1], 1))[0]), axis=0)


def _parts(area: Any) -> list[Any]:
    """Polygons of a shape."""
    return [p for p in shapely_here().get_parts(area) if p.geom_type == "Polygon" and not p.is_empty]


def _reach(area: Any, at: Array, u: Array) -> tuple[float, float]:
    along = product(shapely_here().get_coordinates(area) - at, u)
    return float(along.min()) - 1.0, float(along.max()) + 1.0


def _spans(area: Any, at: Array, u: Array, least: float = 0.0) -> list[tuple[float, float]]:
    """From where to where the parts of a shape lie along a line from `at` [m], those over `least` [m2]."""
    shapely = shapely_here()
    spans = []
    for part in _parts(area):
        if part.area > least:
            along = product(shapely.get_coordinates(part) - at, u)
            spans.append((float(along.min()), float(along.max())))
    return sorted(spans)


def _bridged(spans: list[tuple[float, float]], gap: float) -> list[tuple[float, float]]:
    """Spans in order, those less than a gap apart as one."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(spans):
        if merged and start - merged[-1][1] < gap:
            merged[-1] = merged[-1][0], max(merged[-1][1], end)
        else:
            merged.append((start, end))
    return merged


def _shares(crop: Any, shares: list[float]) -> list[float]:
    """Values of y between which bands have shares of the crop's area."""
    shapely = shapely_here()
    west, south, east, north = crop.bounds
    grid = np.linspace(south, north, 201)
    boxes = shapely.box(west, grid[:-1], east, grid[1:])
    area = np.concatenate([[0.0], np.cumsum(shapely.area(shapely.intersection(crop, boxes)))])
    inner = np.interp(np.cumsum(shares)[:-1] * area[-1], area, grid)
    return [float(south), *inner.tolist(), float(north)]


def _cells(strips: list[list[_Stretch]]) -> list[list[_Stretch]]:
    """Stretches that follow each other from strip to strip, one on one."""
    cells: list[list[_Stretch]] = []
    open_: list[list[_Stretch]] = []
    for strip in strips:
        onto = [[c for c in open_ if c[-1].west < s.east and s.west < c[-1].east] for s in strip]
        goes_on = []
        for stretch, before in zip(strip, onto, strict=True):
            follows = len(before) == 1 and len([o for o in onto if before[0] in o]) == 1
            cell = before[0] if follows else []
            if not follows:
                cells.append(cell)
            cell.append(stretch)
            goes_on.append(cell)
        open_ = goes_on
    return cells


def _round_and_round(land: list[_Stretch]) -> list[tuple[_Stretch, bool]]:
    """Stretches of a land clockwise from outside in, whether each is driven eastwards."""
    order = []
    low, high = 0, len(land) - 1
    while low <= high:
        order.append((land[high], True))
        if low < high:
            order.append((land[low], False))
        low, high = low + 1, high - 1
    return order


def _adjacent(land: list[_Stretch]) -> list[tuple[_Stretch, bool]]:
    """One after the other from the north, there and back: every other one has cut ground on its left."""
    return [(stretch, n % 2 == 0) for n, stretch in enumerate(reversed(land))]


def _skip(land: list[_Stretch]) -> list[tuple[_Stretch, bool]]:
    """Every other one there, those between on the way back."""
    one = land[::-1]
    return [(stretch, n % 2 == 0) for n, stretch in enumerate([*one[::2], *reversed(one[1::2])])]


ORDERS = {"lands": _round_and_round, "adjacent": _adjacent, "skip": _skip}
