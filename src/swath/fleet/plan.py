"""The plan of a field: headland rounds, passes in lands, and what is cleaned up around holes and in corners.

Passes are straight lines of the header's middle. Along outlines first (rounds, clockwise: crop on the
right, so that a cart may drive on the left; or counterclockwise), then parallel to the field's x axis. What
is left of the field is shared out among the combines as bands across it, by what each can cut an hour; a band
has strips of its combine's header, of which holes and gaps leave stretches; stretches that follow each other
from strip to strip are a cell (a boustrophedon decomposition, Choset 2000, DOI 10.1023/A:1008958800904), cut
in lands round and round. At last, with all around cut, what straight passes leave beside slanted edges of
holes is cut along these edges. Lines of others that cover the field are its passes instead.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.portable import product
from swath.core.whole_file import write_whole
from swath.documents.json_file import read_json
from swath.fleet.files import PlanSettings
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Combine, Place

Array = NDArray[np.float64]
HEADLAND, LAND, CLEAN = "headland", "land", "clean"
SLIVER = 1e-3  # m2, of shapes that only touch


@dataclass(frozen=True)
class Params:
    """least_m2: crop for which no pass of its own is made, a thousandth of a hectare; bridge_m: gap without
    crop that a pass goes on over; edge_m: shortest side of an outline that gets a headland pass of its own.
    Chosen so that less than 0.5 % of drawn fields is left. bent_m: most that points of a pass of others lie
    off its straight line; covers: share of a field that lines of its file cover, from which they are its
    passes; both estimates.
    """

    least_m2: float = 2.0
    bridge_m: float = 15.0
    edge_m: float = 6.0
    bent_m: float = 0.5
    covers: float = 0.5


PARAMS = Params()


@dataclass(frozen=True)
class Pass:
    """start, end: of the header's middle [m]; width: of the narrowest header that cuts it [m]; kind:
    headland, land or clean; land: number of its land, of its round in the headland; combine: number, -1 for
    any.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    kind: str
    land: int = 0
    combine: int = -1

    @property
    def length(self) -> float:
        """Length [m]."""
        return math.dist(self.start, self.end)

    @property
    def heading(self) -> float:
        """Direction of driving [rad]."""
        return math.atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])

    def reversed(self) -> "Pass":
        """The same, driven the other way."""
        return Pass(self.end, self.start, self.width, self.kind, self.land, self.combine)


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


def read_plan(path: Path) -> Plan:
    """A plan as `Plan.write` has it."""
    rows = read_json(path, "plan", "a plan")
    passes = tuple(Pass(**{**p, "start": tuple(p["start"]), "end": tuple(p["end"])}) for p in rows["passes"])
    return Plan(passes, rows["area_m2"], rows["left_m2"])


class _Stretch(NamedTuple):
    """A part of a strip with crop: its middle line's y and ends [m]."""

    y: float
    west: float
    east: float


def plan_of(
    ground: Ground, combines: Sequence[Combine], settings: PlanSettings, drawn: Sequence[Any] = ()
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
        expected = f"expected a field of which 99 % can be cut, {plan.left:.0f} of {plan.area:.0f} m2 cannot"
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
        expected = f"expected passes of more than {PARAMS.bent_m:g} m, number {number} is shorter"
        raise InputError("plan.passes_m" if settings.passes_m else "field.file", None, expected)
    bent = [shapely.LineString(line[[0, -1]]).hausdorff_distance(shapely.LineString(line)) for line in lines]
    ends = [line[[0, -1]] for line in lines]
    worst = int(np.argmax(bent))
    if settings.passes_m:
        if bent[worst] > PARAMS.bent_m:
            expected = f"expected straight passes, number {worst + 1} bends by {bent[worst]:.1f} m"
            raise InputError("plan.passes_m", None, expected)
        return ends, []
    strips = [shapely.LineString(e).buffer(0.5 * header, cap_style="flat") for e in ends]
    share = shapely.intersection(shapely.union_all(strips), ground.field).area / ground.field.area
    if bent[worst] > PARAMS.bent_m:
        why = f"line {worst + 1} bends by {bent[worst]:.1f} m"
    elif share < PARAMS.covers:
        why = f"they cover {100.0 * share:.0f} % of the field"
    else:
        return ends, [f"the {len(lines)} lines of the file are the passes, in their order"]
    return [], [f"lines of the file say the direction of passes alone: {why}"]


class _Planner:
    """rest: crop that no pass made so far cuts."""

    def __init__(
        self, ground: Ground, combines: Sequence[Combine], widths: list[float], settings: PlanSettings
    ) -> None:
        self.ground, self.combines, self.widths, self.settings = ground, combines, widths, settings
        self.narrowest = min(combines, key=lambda c: c.width)
        self.rest: Any = ground.field
        self.passes: list[Pass] = []
        self.land = 0

    def add(self, start: Any, end: Any, width: float, kind: str, land: int, combine: int = -1) -> None:
        """A pass, and what it cuts is no longer there."""
        made = Pass(
            (float(start[0]), float(start[1])), (float(end[0]), float(end[1])), width, kind, land, combine
        )
        self.passes.append(made)
        self.rest = shapely_here().difference(self.rest, strip_of(made))

    def rounds(self) -> None:
        """Headland passes along the sides of the outlines, outside in."""
        shapely = shapely_here()
        width = min(self.widths)
        outer = shapely.union_all([shapely.Polygon(p.exterior) for p in _parts(self.ground.field)])
        for k in range(self.settings.headland_rounds):
            here = outer.buffer(-k * width, join_style="mitre", mitre_limit=5.0)
            ring = shapely.difference(here, here.buffer(-width, join_style="mitre", mitre_limit=5.0))
            for part in _parts(here):
                points = shapely.get_coordinates(
                    shapely.orient_polygons(shapely.Polygon(part.exterior), exterior_cw=True).exterior
                )
                for a, b in pairwise(points):
                    if math.dist(a, b) >= PARAMS.edge_m:
                        self._side(a, b, width, ring, k)

    def _side(self, a: Array, b: Array, width: float, ring: Any, number: int) -> None:
        """The pass along a side from a to b, crop on its right: as far as the ring of this round reaches."""
        shapely = shapely_here()
        length = math.dist(a, b)
        u = (b - a) / length
        right = np.array([u[1], -u[0]])
        far, wide = 3 * width * u, width * right
        band = shapely.Polygon([a - far, b + far, b + far + wide, a - far + wide])
        crop = shapely.intersection_all([band, ring, self.rest])
        spans = [(s, e) for s, e in _spans(crop, a, u) if e > 0.0 and s < length]
        for start, end in _bridged(spans, PARAMS.bridge_m):
            for s, e in self._clear(a + 0.5 * width * right, u, start, end):
                line = a + 0.5 * width * right + s * u, a + 0.5 * width * right + e * u
                if self._crop_in(*line, width) > PARAMS.least_m2:
                    if (self.settings.headland == "counterclockwise") == (self.ground.frame.side > 0.0):
                        line = line[1], line[0]
                    self.add(*line, width + self.settings.overlap_m, HEADLAND, number)

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
        return [(s, e) for s, e in free if e - s > 0.5 and self._can_stand_at_ends(c, at + s * u, at + e * u)]

    def _can_stand_at_ends(self, c: Combine, start: Array, end: Array) -> bool:
        """Whether a combine can stand at both ends of a pass, driven there or back."""
        heading = math.atan2(end[1] - start[1], end[0] - start[0])
        for along in (heading, heading + math.pi):
            ends = [Place(float(x), float(y), along, along).ahead(-c.knife) for x, y in (start, end)]
            outlines = shapely_here().polygons(c.body.outlines(np.array(ends), GAPS.search_m))
            if shapely_here().contains(self.ground.open, outlines).all():
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
                    self.add(a + s * u, a + e * u, header, LAND, 0, number)

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
                    self.add(start, end, header, LAND, self.land, number)
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
            self.add(best[1], best[2], header, CLEAN, 0)

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
    """What the header of a pass goes over."""
    return shapely_here().LineString([p.start, p.end]).buffer(0.5 * p.width, cap_style="flat")


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
