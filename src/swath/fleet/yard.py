"""Where machines stand: at the start, at the end, a cart between two loads; a combine that is emptied.

Waiting places are along the outer edge of open ground, off the strip around the field, which is a way, if
there is room elsewhere; carts, who come back to theirs, first. Every place has a way in and a way out, to and
from the field's gate, and the truck for who empties there, searched with all places before it taken. The
ground of the ways of carts is kept clear of later places, since they come and go; combines leave theirs once,
the last one first. Who drives or stands elsewhere in a yard is not looked at here.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.fleet.ground import CELL, Ground, fits, run_of, shapely_here
from swath.fleet.ground import PARAMS as GROUND
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Body, Drive, Place
from swath.fleet.plan import HEADLAND, Plan
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Finder, Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params:
    """dock_m: before and behind the truck, kept clear; edges_m: that a waiting place is off the outer edge,
    the second so far that a trailer comes straight to it along a round one; spots_m: between places that are
    looked at, twice as much about the gate; tries: of the nearest that ways are searched to, and then of
    each `apart`th farther off; outer_m: between places to be emptied at around the field, twice as much on
    headland passes; off_m: of them from the field, the first of who passes the gate, too; clear_m: between
    who waits or is emptied; poses: of a search, times those of others, the second where a place is missing.
    Estimates: so many that one is near, so few that they are looked through at
    once.
    """

    dock_m: float = 25.0
    edges_m: tuple[float, float] = (2.0, 7.0)
    spots_m: float = 5.0
    tries: int = 60
    apart: int = 4
    outer_m: float = 30.0
    off_m: tuple[float, ...] = (7.0, 9.0, 12.0, 14.0)
    clear_m: float = 2.0
    poses: tuple[float, ...] = (0.5, 4.0)


PARAMS = Params()
WIDE = GAPS.rim_m + CELL  # that a waiting place is wider than its machine [m]


@dataclass(frozen=True)
class Waits:
    """A machine that needs a place. dock: its place beside the truck, None if it never empties there."""

    name: str
    body: Body
    drive: Drive
    dock: Place | None


@dataclass(frozen=True)
class Home:
    """A waiting place.

    ways: from it to the gate, from there to it, and the same for the truck
    areas: of each, kept free of others who wait
    """

    place: Place
    ways: tuple[Track, ...]
    areas: tuple[Any, ...]


def waiting_places(ground: Ground, finder: Finder, machines: Sequence[Waits]) -> dict[str, Home]:
    """A place for each machine, as near to the gate as there is one; who needs most room is first.

    Carts for which there is no room have none, as long as another one has.

    InputError where there is none for a combine, or for no cart.
    """
    carts = [m for m in machines if m.body.has_trailer]
    for more in PARAMS.poses:
        left = list(machines)
        while True:
            for is_deep in (False, True):
                places = _filled(ground, finder, left, int(more * WAYS.poses), is_deep)
                if all(m.name in places for m in left):
                    break
            placed = [m for m in carts if m.name in places]
            if bool(placed) == bool(carts) and all(m.name in places or m in carts for m in machines):
                return places
            if len(placed) < 2:
                break
            left = [m for m in machines if m not in carts or m in placed[:-1]]
    expected = f"expected room for {len(machines)} machines to wait, each with a way in and out"
    raise InputError("field.around_m", None, expected)


def _filled(
    ground: Ground, finder: Finder, machines: Sequence[Waits], most: int, is_deep: bool
) -> dict[str, Home]:
    """Places of machines, one after the other, without those for which there is no room.

    most: poses of a search; is_deep: who stands in the strip around the field leaves room for combines that
    are placed later between it and the gate, since they do not get past it
    """
    shapely = shapely_here()
    used = [
        run_of(m.body, m.dock, ahead, 3.0)
        for m in machines
        if m.dock is not None
        for ahead in (PARAMS.dock_m, -PARAMS.dock_m)
    ]
    taken: list[Any] = []
    full: set[Body] = set()  # for whom there is no room any more
    places: dict[str, Home] = {}
    later = [m.body for m in machines if not m.body.has_trailer]
    for m in sorted(machines, key=lambda m: (not m.body.has_trailer, -m.body.length_behind)):
        if not m.body.has_trailer:
            later.remove(m.body)
        room = math.fsum(b.length_behind + max(r.front for r in b.own) + PARAMS.clear_m for b in later)
        found, offs = None, (ground.around, ground.field) if m.body not in full else ()
        for off in offs:  # in yards, or in the strip around the field, too
            bare = shapely.difference(ground.open, shapely.union_all([off, *used]))
            shapely.prepare(bare)
            deep = room if is_deep and off is ground.field and not m.body.has_trailer else 0.0
            for place in _places(ground, bare, m.body, deep):
                found = _ways(ground, finder, m, place, taken, most)
                if found is not None:
                    break
            if found is not None:
                break
        if found is None:
            full.add(m.body)
            continue
        places[m.name] = Home(place, tuple(found), tuple(_swept(t, m.body, 0.0) for t in found))
        taken.append(run_of(m.body, place, 0.0, WIDE))
        used.append(run_of(m.body, place, 0.0, PARAMS.clear_m))
        if m.body.has_trailer:
            used += [_swept(t, m.body) for t in found]
    return places


def _places(ground: Ground, bare: Any, body: Body, deep: float) -> Iterator[Place]:
    """Places along the outer edge of open ground, the nearest to the gate first, where a body has room;
    not too many. deep: least distance behind the nearest [m].
    """
    shapely = shapely_here()
    spots: list[tuple[float, Place]] = []
    rings = [
        part.exterior
        for off in PARAMS.edges_m
        for part in shapely.get_parts(shapely.buffer(ground.open, -(body.half_width + off)))
        if not part.is_empty
    ]
    for ring in rings:
        at = np.arange(0.0, ring.length, PARAMS.spots_m)
        here, before, ahead = (
            shapely.get_coordinates(shapely.line_interpolate_point(ring, (at + d) % ring.length))
            for d in (0.0, -PARAMS.spots_m, PARAMS.spots_m)
        )
        for (x, y), (u, v) in zip(here.tolist(), (ahead - before).tolist(), strict=True):
            far = round(math.dist((x, y), ground.gate), 3)
            turns = (math.atan2(v, u), math.atan2(-v, -u))
            spots += [(far, Place(x, y, heading, heading)) for heading in turns]
    there = ((far, place) for far, place in sorted(spots) if fits(bare, body, place))
    first = next(there, (0.0, None))
    near = (place for far, place in chain([first], there) if place and far >= first[0] + deep)
    yield from islice(near, PARAMS.tries)
    yield from islice(near, 0, PARAMS.tries * PARAMS.apart, PARAMS.apart)


def _ways(
    ground: Ground, finder: Finder, m: Waits, place: Place, taken: Sequence[Any], most: int
) -> list[Track] | None:
    """Ways of a machine from a place and to it, None where one is missing."""
    out: list[Track] = []
    groups = [at_gate(ground)] + ([[m.dock]] if m.dock is not None else [])
    for goals in groups:
        for ends in ([(place, g) for g in goals], [(g, place) for g in goals]):
            ways = (
                finder.find(
                    m.body, m.drive, start, goal, stand=taken, in_line=WAYS.line_deg, most=most,
                )
                for start, goal in ends
            )  # fmt: skip
            way = next((w for w in ways if w is not None), None)
            if way is None:
                return None
            out.append(way)
    return out


def at_gate(ground: Ground) -> list[Place]:
    """Places at the gate, in each direction: a machine passes in one of them at least."""
    (x, y), along, off = ground.gate, ground.out, PARAMS.off_m[0]
    x, y = x + off * math.cos(along), y + off * math.sin(along)
    return [Place(x, y, along + turn, along + turn) for turn in (0.5 * math.pi, -0.5 * math.pi, 0.0, math.pi)]


def _swept(way: Track, body: Body, gap: float = WIDE + 0.5) -> Any:
    """The ground of a way, so wide that it is free for the search when others wait beside it."""
    shapely = shapely_here()
    outlines = body.outlines(way.places[:: max(1, len(way.places) // 200)], gap)
    return shapely.union_all(shapely.polygons(outlines.reshape(-1, *outlines.shape[2:])))


def service_places(
    ground: Ground,
    combine: Body,
    cart: Body,
    beside: tuple[float, float],
    waits: Sequence[tuple[Body, Place]],
) -> Iterator[Place]:
    """Places of a combine on ground without crop, a cart beside it, so far ahead and leftward [m]; off who
    waits or empties, bodies at their places.
    """
    shapely = shapely_here()
    taken = [shapely.polygons(b.outlines(np.array([p]), PARAMS.clear_m)[0]) for b, p in waits]
    bare = shapely.difference(ground.open, ground.field)
    bare = shapely.difference(bare, shapely.union_all(np.concatenate(taken)))
    shapely.prepare(bare)
    for place in _beside_field(ground):
        if fits(bare, combine, place) and fits(bare, cart, place.ahead(*beside)):
            yield place


def along_passes(plan: Plan) -> Iterator[Place]:
    """Places on headland passes, in both directions."""
    for p in plan.passes:
        if p.kind == HEADLAND:
            line = shapely_here().LineString(p.line)
            count = max(1, int(p.length / (2.0 * PARAMS.outer_m)))
            for at in (np.arange(count) + 0.5) * p.length / count:
                ((x, y), (u, v)) = (line.interpolate(at + d).coords[0] for d in (0.0, 0.1))
                heading = math.atan2(v - y, u - x)
                for h in (heading, heading + math.pi):
                    yield Place(x, y, h, h)


def _beside_field(ground: Ground) -> Iterator[Place]:
    """Places beside the outlines, along them in both directions, and about the gate and the truck."""
    shapely = shapely_here()
    for part in shapely.get_parts(ground.field):
        points = shapely.get_coordinates(shapely.orient_polygons(part, exterior_cw=False).exterior)
        for a, b in pairwise(points):
            length, heading = math.dist(a, b), math.atan2(*(b - a)[::-1])
            count = max(1, int(length / PARAMS.outer_m))
            for i in range(count):
                middle = a + (i + 0.5) / count * (b - a)
                for out in PARAMS.off_m:
                    for turn in (0.0, math.pi):
                        h = heading + turn
                        x, y = middle + out * np.array([math.sin(heading), -math.cos(heading)])
                        yield Place(float(x), float(y), h, h)
    x0, y0 = ground.gate
    far = GROUND.yard_m - PARAMS.spots_m
    steps = np.arange(-far, far + 1.0, 2.0 * PARAMS.spots_m)
    for x in steps:
        for y in steps:
            for h in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
                h = h + ground.dock.heading
                yield Place(x0 + float(x), y0 + float(y), h, h)
