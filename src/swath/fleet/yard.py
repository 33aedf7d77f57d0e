"""Waiting places: where each machine stands at the start, at the end, and a cart between two loads.

They are along the outer edge of open ground, off the strip around the field, which is a way, if there is room
elsewhere; carts, who come back to theirs, first. Every place
has a way in and a way out, to and from the field's gate, and the truck for who empties there, searched with
all places before it taken. The ground of the ways of carts is kept clear of later places, since they come
and go; combines leave theirs once, the last one first. Who drives or stands elsewhere in a yard is not
looked at here.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.fleet.bodies import Body, Drive, Place
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Finder, Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params:
    """dock_m: before and behind the truck, kept clear; gate_m: from the field to who passes the gate;
    body_m: that the outline of who waits is wider; wide_m: that a way keeps off machines that stand, more
    than a cell of the search and two gaps of bodies; edges_m: that a place is off the outer edge, the
    second so far that a trailer comes straight to it along a round one; spots_m: between places that are
    looked at; tries: of the nearest that ways are searched to, and then of each `apart`th farther off; poses:
    that such a search looks at, so that a place is one to which a way is found fast
    """

    dock_m: float = 25.0
    gate_m: float = 7.0
    body_m: float = 0.3
    wide_m: float = 0.5
    edges_m: tuple[float, float] = (2.0, 7.0)
    spots_m: float = 5.0
    tries: int = 60
    apart: int = 4
    poses: int = 3000


PARAMS = Params()
WIDE = PARAMS.body_m + PARAMS.wide_m  # that a waiting place is wider than its machine [m]


@dataclass(frozen=True)
class Waits:
    """A machine that needs a place. dock: its place beside the truck, None if it never empties there"""

    name: str
    body: Body
    drive: Drive
    dock: Place | None


@dataclass(frozen=True)
class Home:
    """A waiting place. ways: from it to the gate, from there to it, and the same for the truck; areas: of
    each, kept free of others who wait
    """

    place: Place
    ways: tuple[Track, ...]
    areas: tuple[Any, ...]


def waiting_places(ground: Ground, finder: Finder, machines: Sequence[Waits]) -> dict[str, Home]:
    """A place for each machine, as near to the gate as there is one; who needs most room is first. Carts for
    which there is no room have none, as long as another one has.

    InputError where there is none for a combine, or for no cart.
    """
    carts = [m for m in machines if m.body.has_trailer]
    left = list(machines)
    while True:
        places = _filled(ground, finder, left)
        placed = [m for m in carts if m.name in places]
        if bool(placed) == bool(carts) and all(m.name in places or m in carts for m in machines):
            return places
        if len(placed) < 2:
            expected = f"expected room for {len(machines)} machines to wait, each with a way in and out"
            raise InputError("field.around_m", None, expected)
        left = [m for m in machines if m not in carts or m in placed[:-1]]


def _filled(ground: Ground, finder: Finder, machines: Sequence[Waits]) -> dict[str, Home]:
    """Places of machines, one after the other, without those for which there is no room."""
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
    for m in sorted(machines, key=lambda m: (not m.body.has_trailer, -m.body.length_behind)):
        found, offs = None, (ground.around, ground.field) if m.body not in full else ()
        for off in offs:  # in yards, or in the strip around the field, too
            bare = shapely.difference(ground.open, shapely.union_all([off, *used]))
            shapely.prepare(bare)
            for place in _places(ground, bare, m.body):
                found = _ways(ground, finder, m, place, taken)
                if found is not None:
                    break
            if found is not None:
                break
        if found is None:
            full.add(m.body)
            continue
        places[m.name] = Home(place, tuple(found), tuple(_swept(t, m.body, 0.0) for t in found))
        taken.append(run_of(m.body, place, 0.0, WIDE))
        used.append(run_of(m.body, place, 0.0, 2.0))
        if m.body.has_trailer:
            used += [_swept(t, m.body) for t in found]
    return places


def _places(ground: Ground, bare: Any, body: Body) -> Iterator[Place]:
    """Places along the outer edge of open ground, the nearest to the gate first, where a body has room;
    not too many.
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
    near = (place for _, place in sorted(spots) if fits(bare, body, place))
    yield from islice(near, PARAMS.tries)
    yield from islice(near, 0, PARAMS.tries * PARAMS.apart, PARAMS.apart)


def _ways(ground: Ground, finder: Finder, m: Waits, place: Place, taken: Sequence[Any]) -> list[Track] | None:
    """Ways of a machine from a place and to it, None where one is missing."""
    out: list[Track] = []
    groups = [at_gate(ground)] + ([[m.dock]] if m.dock is not None else [])
    for goals in groups:
        for ends in ([(place, g) for g in goals], [(g, place) for g in goals]):
            ways = (
                finder.find(
                    m.body, m.drive, start, goal, stand=taken, in_line=WAYS.line_deg, most=PARAMS.poses,
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
    along = ground.dock.heading + 0.5 * math.pi  # from the gate to the truck
    x, y = ground.gate[0] + PARAMS.gate_m * math.cos(along), ground.gate[1] + PARAMS.gate_m * math.sin(along)
    return [Place(x, y, along + turn, along + turn) for turn in (0.5 * math.pi, -0.5 * math.pi, 0.0, math.pi)]


def _swept(way: Track, body: Body, gap: float = WIDE + 0.5) -> Any:
    """The ground of a way, so wide that it is free for the search when others wait beside it."""
    shapely = shapely_here()
    outlines = body.outlines(way.places[:: max(1, len(way.places) // 200)], gap)
    return shapely.union_all(shapely.polygons(outlines.reshape(-1, *outlines.shape[2:])))


def run_of(body: Body, place: Place, ahead: float, gap: float = 0.3) -> Any:
    """The ground of a body from a place to one straight ahead [m], < 0 behind it, wider by a gap."""
    shapely = shapely_here()
    outlines = body.outlines(np.array([place, place.ahead(ahead)]), gap)
    return shapely.convex_hull(shapely.multipoints(outlines.reshape(-1, 2)))


def fits(area: Any, body: Body, place: Place) -> bool:
    """Whether a body at a place is in an area, half a metre off its edge."""
    shapely = shapely_here()
    return bool(shapely.contains(area, shapely.polygons(body.outlines(np.array([place]), 0.5)[0])).all())
