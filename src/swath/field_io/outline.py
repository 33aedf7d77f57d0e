"""The outline of a field: from a file, or the ground its passes covered."""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError, some_of
from swath.core.number_text import num, percent_of
from swath.documents.foreign import TABLE, refuse_foreign
from swath.documents.geojson import Shapes, pieces, read_shapes
from swath.documents.packed import is_archive, open_archive, readable
from swath.documents.text_file import read_bytes
from swath.documents.xml_file import read_xml
from swath.field.maps.projection import known_crs, transform, utm_epsg
from swath.field_io.clean import Cleaned
from swath.field_io.logs.coordinates import place
from swath.field_io.logs.shapefiles import are_records, read_rings
from swath.field_io.roles import BARE, FIELD, LINE, PART, UNKNOWN, named, role_of
from swath.field_io.task_data.taskdata import listed

Array = NDArray[np.float64]
CLOSING_WIDTHS = 1.1  # header widths: gaps between passes up to twice this are inside the field
SMALLEST_HOLE = 400.0  # m2: what is left out inside the field and larger is no crop
LARGEST_BYTES, LARGEST_KML = 1 << 27, 1 << 25
EMPTY_AREA, LARGEST_AREA = 100.0, 1e8  # m2: less and more is no field
FARTHEST_KM, DEGREE_KM = 100.0, 111.2  # from a field to what a farm has beside it; of a degree of latitude
BESIDE_DEG = 3.0, 1.0  # of longitude (half a zone) and latitude, beside the area of a system
BESIDE_ZONES = 2.5  # widths of it, from 12 to 18 E to 31 E of all of Norway, which is kept in UTM zone 33
BESIDE_M = 5.0  # m: lines that go so far over the edge still lie in the field
LEAST_TOLD = 1.0  # m2: less is left out without a word
MOST_CORNERS = 50_000  # of a polygon: one at 10 Hz around 100 ha has 20,000
MOST_SHAPES, MOST_PAIRS = 20_000, 100_000  # polygons of a file, and pairs of them that overlap
USUAL_PAIRS, BLOCK = 8, 64  # boxes of sides that meet that of one in an honest ring; looked up at once
MOST_CROSSINGS = 1000  # of the sides of a polygon with each other
PROBED = 1000  # records that say which field is meant
WITHIN = 0.98  # share of a polygon that lies in another, from which on it is one within it
ONE_FIELD = 0.2  # share of an outline that lies in another, from which on both are of one field
DIFFERS = 0.02  # share of an area by which two readings of it may differ
ISLANDS = 0.5  # share of a field that islands have at most; more are zones or inner lines of it
URN = "urn:ogc:def:crs:epsg", "http://www.opengis.net/def/crs/epsg"
KML_KINDS = {"Polygon": "Polygon", "LinearRing": "Polygon", "LineString": "LineString", "Point": "Point"}
NAMES = ("name", "field", "fieldname", "field_name", "title", "schlag", "parcelle")  # of an area, in GeoJSON


@dataclass(frozen=True)
class Outlines:
    """Areas of crop that a boundary file holds, largest first, in metres of a system.

    names: of the areas, '' where the file has none
    notes: what within them was taken as what
    lines: guidance lines, (n, 2) each
    misnamed: of the areas, the word in their name by which no crop would stand there, or ''
    """

    areas: tuple[Any, ...]
    names: tuple[str, ...]
    epsg: int
    notes: tuple[str, ...] = ()
    lines: tuple[Array, ...] = ()
    misnamed: tuple[str, ...] = ()

    def doubts_of(self, taken: Sequence[int]) -> list[str]:
        """A note where areas that are taken have such a name, and others have none."""
        words = dict.fromkeys(word for i in taken if (word := self.misnamed[i]))
        if not words or all(self.misnamed):
            return []
        return [f"sources: {some_of(words, 5)} by name, taken as a field: nothing states its kind"]

    def field(self, places: Array | None = None) -> tuple[Any, list[str]]:
        """One polygon, with its holes, and notes on it and on what is left out.

        places: points (n, 2) [m] of the field that is meant; without them the largest area
        """
        some = np.zeros((0, 2)) if places is None else places[:: max(1, len(places) // PROBED)]
        held = [int(inside(area, some).sum()) for area in self.areas]
        index = int(np.argmax(held))
        field, notes = self.areas[index], [*self.notes, *self.doubts_of([] if max(held) else [index])]
        others = [i for i in range(len(self.areas)) if i != index]
        left_out = sum(self.areas[i].area for i in others)
        if left_out >= LEAST_TOLD:
            named = some_of((repr(self.names[i]) for i in others if self.names[i]), 5)
            count = "another area" if len(others) == 1 else f"{len(others)} other areas"
            own = f" {self.names[index]!r}" if self.names[index] else ""
            is_out = f"{'is' if len(others) == 1 else 'are'} left out{f': {named}' if named else ''}"
            taken = f"the field{own} of {num(field.area / 1e4)} ha is taken"
            notes.append(f"unused: {taken}, {count} of {num(left_out / 1e4)} ha {is_out}")
        return field, notes


@dataclass(frozen=True)
class Piece:
    """A part of a geometry, as its file has it. kind: Polygon, LineString or Point; rings: of an area its
    outline and then its holes, (n, 2) each; said: of it; group: of those that belong together, a folder in
    KML; is_even_odd: whether the rings may be outlines and holes in any order.
    """

    kind: str
    rings: list[Array]
    said: Mapping[str, Any] = field(default_factory=dict)
    group: int = 0
    is_even_odd: bool = False

    @cached_property
    def role(self) -> tuple[str, str]:
        """Its role, and the word that makes it; of an area never its name, as fields have any."""
        stated = role_of(self.said)
        return stated if stated[0] or self.kind == "Polygon" else named(self.said)

    @property
    def label(self) -> str:
        """It in a list of what is not used."""
        thing = {"Polygon": "area", "LineString": "line", "Point": "point"}[self.kind]
        return f"{self.role[1]} {thing}".strip()


@dataclass(frozen=True)
class Shape:
    """An area [m]. name: that it has; group: as of a piece; role: of roles.py, and the word that makes it;
    misnamed: as of Outlines.
    """

    polygon: Any
    name: str = ""
    group: int = 0
    role: str = ""
    word: str = ""
    misnamed: str = ""


def read_outlines(path: Path, epsg: int | None = None, or_lines: bool = False) -> Outlines:
    """The areas of crop in a boundary file: GeoJSON, KML, KMZ or a polygon shapefile, zipped too.

    What an area says of itself comes first (roles.py). Others that overlap or touch are one area; one within
    another is an island, whichever way round its points stand.
    epsg: of the system that they are wanted in, None: the UTM zone of their middle
    or_lines: whether a file of lines alone will do, which then has no areas
    Raises InputError.
    """
    refuse_foreign(path, "boundary", ("KML", "KMZ"))
    with readable("boundary", "GeoJSON, KML or a polygon shapefile", path):
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError("boundary", size, f"expected at most {LARGEST_BYTES} bytes", file=path)
        if path.suffix.lower() in (".kml", ".kmz"):
            found, crs, notes = _from_kml(path)
        elif is_archive(path) or os.path.isdir(path) or path.suffix.lower() == ".shp":
            found, crs, notes = _from_shapefile(path)
        else:
            found, crs, notes = _from_geojson(path)
        unused = Counter(p.label for p in found if p.kind == "Point")
        found, told = _of_numbers([p for p in found if p.kind != "Point"], unused)
        found, joined = _closed_lines(found)
        areas = [p for p in found if p.kind == "Polygon"]
        if not areas and not (or_lines and found):
            held = f", it has {listed(unused)} alone; for a log export {TABLE}" if unused.total() else ""
            raise InputError("boundary", None, f"expected a polygon{held}", file=path)
        if len(areas) > MOST_SHAPES:
            raise InputError("boundary", len(areas), f"expected at most {MOST_SHAPES} polygons", file=path)
        corners = max(sum(map(len, p.rings)) for p in found)
        if corners > MOST_CORNERS:  # what looks for crossings takes time by their square
            raise InputError("boundary", corners, f"expected at most {MOST_CORNERS} corners", file=path)
        lon_lat, more = _east_first(found, crs, epsg, path)
        found, lon_lat, far = _together(found, lon_lat) if epsg is None else (found, lon_lat, [])
        of_areas = [at for p, at in zip(found, lon_lat, strict=True) if p.kind == "Polygon"]
        zone = epsg or utm_epsg(*np.median(np.concatenate(of_areas or lon_lat), axis=0))
        metres = _split(transform(np.concatenate(lon_lat), "EPSG:4326", f"EPSG:{zone}"), lon_lat)
        found = [replace(p, rings=_split(at, p.rings)) for p, at in zip(found, metres, strict=True)]
        notes += [*told, *joined, *more, *far]
        made = Outlines((), (), zone)
        if areas:
            made = arranged(shapes_of(found, zone, notes), zone, path, unused)
        lines = _guidance(made.areas, [p for p in found if p.kind == "LineString"], unused)
        if not made.areas and not lines:
            raise InputError("unused", listed(unused), "expected an area, or lines of passes", file=path)
        left = [f"unused: {listed(unused)}"] if unused.total() else []
        return replace(made, lines=lines, notes=(*notes, *made.notes, *left))


def _closed_lines(found: list[Piece]) -> tuple[list[Piece], list[str]]:
    """Areas first; lines that say field are some, and one that is closed where there is no area; notes."""
    lines = [p for p in found if p.kind == "LineString"]
    taken = [p for p in lines if p.role[0] == FIELD and len(p.rings[0]) > 2]
    if len(lines) == len(found) and not taken:
        closed = [p for p in lines if len(p.rings[0]) > 3 and _gap(p.rings[0]) <= DIFFERS]
        taken = [p for p in closed if len(closed) == 1 and not role_of(p.said)[0] and p.role[0] != LINE]
    key = "outline" if any(_gap(p.rings[0]) > DIFFERS for p in taken) else "shape"
    notes = [f"{key}: {len(taken)} lines are outlines, their ends are joined"] if taken else []
    made = [replace(p, kind="Polygon") if any(p is t for t in taken) else p for p in found]
    return sorted(made, key=lambda p: p.kind != "Polygon"), notes


def _gap(line: Array) -> float:
    """Between the ends of a line, as a share of its length."""
    return float(np.hypot(*(line[-1] - line[0])) / max(np.hypot(*np.diff(line, axis=0).T).sum(), 1e-12))


def _of_numbers(found: list[Piece], unused: Counter[str]) -> tuple[list[Piece], list[str]]:
    """Pieces without places that are no numbers, and without rings of too few places; notes."""
    lost, kept = 0, []
    for piece in found:
        known = [ring[np.isfinite(ring).all(axis=1)] for ring in piece.rings]
        lost += sum(map(len, piece.rings)) - sum(map(len, known))
        least = 3 if piece.kind == "Polygon" else 2
        rings = [ring for ring in known if len(np.unique(ring, axis=0)) >= least]
        if rings and (piece.is_even_odd or rings[0] is known[0]):
            kept.append(replace(piece, rings=rings))
        elif any(map(len, known)) and list(map(len, known)) != list(map(len, piece.rings)):
            raise InputError("damaged", piece.label, "expected two numbers for each of its places")
        else:
            unused[f"{piece.label} of fewer than {least} places"] += 1
    return kept, [f"damaged: {lost} places are no two numbers, they are left out"] if lost else []


def _split(places: Array, like: list[Array]) -> list[Array]:
    return np.split(places, np.cumsum([len(ring) for ring in like])[:-1])


def _east_first(found: list[Piece], crs: str, epsg: int | None, path: Path) -> tuple[list[Array], list[str]]:
    """Places of each piece, lon/lat [deg], (n, 2), and notes on the order of their axes.

    GeoJSON is east first in every system; a system that is named by its URN may have north first. Where only
    the other order lies where its system is used, or in the zone of a log, it is taken.
    epsg: of a system that they must lie in
    """
    system = known_crs(crs or "EPSG:4326")
    areas = [ring for p in found if p.kind == "Polygon" for ring in p.rings]
    numbers = np.concatenate(areas or [ring for p in found for ring in p.rings])
    middle, most = np.median(numbers, axis=0), np.abs(numbers).max(axis=0)
    both, limits = transform([middle, middle[::-1]], system, "EPSG:4326"), np.array([most, most[::-1]])
    tries = [_fits(limits, both, system, margin) for margin in _margins(system)]
    can_be = next((fits for fits in tries if any(fits)), [])
    near = [fits and epsg in (None, utm_epsg(*at)) for fits, at in zip(can_be, both, strict=bool(can_be))]
    straight, swapped = near if any(near) else can_be or (False, False)
    if not straight and not swapped:
        of = system.name if crs else "degrees, or the name of their system as `crs` or .prj"
        raise InputError(
            "place", f"{num(middle[0])}, {num(middle[1])}", f"expected places in {of}", file=path
        )
    raw = [np.concatenate(p.rings) for p in found]
    where, notes = [place(at[None]) for at in both], []
    if straight and swapped and crs.lower().startswith(URN) and system.axis_info[0].direction == "north":
        notes = [
            f"place: {crs} has north first, GeoJSON east first; taken as {where[0]}; the other way round it "
            f"lies at {where[1]}: then swap its numbers"
        ]
    elif not straight:
        raw = [places[:, ::-1] for places in raw]
        notes = [f"reference: north first in {crs or 'degrees'}: taken as {where[1]}, as nothing else fits"]
    if not any(any(fits) for fits in tries[:2]):
        notes.append(f"place: far beside where {system.name} is used: taken as {where[0 if straight else 1]}")
    return _split(transform(np.concatenate(raw), system, "EPSG:4326"), raw), notes


def _margins(system: Any) -> list[tuple[float, float]]:
    """Of longitude and latitude [deg] around the area of a system: it alone, its usual neighbourhood, and
    the zones beside it, where a zone is kept for a whole country.
    """
    used = system.area_of_use
    if used is None or system.is_geographic:
        return [(0.0, 0.0), BESIDE_DEG]
    zones = BESIDE_ZONES * ((used.east - used.west) % 360.0 or 360.0)
    return [(0.0, 0.0), BESIDE_DEG, (min(max(zones, BESIDE_DEG[0]), BESIDE_ZONES * 6.0), BESIDE_DEG[1])]


def _fits(most: Array, lon_lat: Array, system: Any, beside: tuple[float, float]) -> list[bool]:
    """Whether places lie where their system is used, or beside it. most: their largest numbers, as read two
    ways; beside: [deg] of longitude and latitude.
    """
    used = system.area_of_use
    west, south, east, north = used.bounds if used else (-180.0, -90.0, 180.0, 90.0)
    is_angle = (most <= (360.0, 90.0)).all(axis=1) == system.is_geographic
    lon, lat = np.where(np.isfinite(lon_lat), lon_lat, np.nan).T
    margin, far = beside
    is_across = (lon - west + margin) % 360.0 <= ((east - west) % 360.0 or 360.0) + 2.0 * margin
    return [bool(fit) for fit in is_angle & is_across & (lat >= south - far) & (lat <= north + far)]


def _together(found: list[Piece], raw: list[Array]) -> tuple[list[Piece], list[Array], list[str]]:
    """Without what is farther from the largest area than a farm reaches. raw: places of each [deg]."""
    middles = np.array([np.median(places, axis=0) for places in raw])
    sizes = [
        (p.kind == "Polygon" and p.role[0] in (FIELD, "")) * np.ptp(places, axis=0).prod()
        for p, places in zip(found, raw, strict=True)
    ]
    off = middles - middles[int(np.argmax(sizes))]
    away = np.hypot(off[:, 0] * np.cos(np.radians(middles[:, 1])), off[:, 1]) * DEGREE_KM
    kept = [i for i in range(len(found)) if away[i] <= FARTHEST_KM]
    left = [i for i in range(len(found)) if away[i] > FARTHEST_KM]
    names = listed(Counter(found[i].label for i in left))
    said = f"place: left out, as it lies up to {num(away.max())} km from the field: {names}"
    return [found[i] for i in kept], [raw[i] for i in kept], [said] if left else []


def shapes_of(found: list[Piece], epsg: int, notes: list[str]) -> list[Shape]:
    """The areas among pieces [m], valid."""
    shapely, shapes, crossed, outside, apart = _shapely(), list[Shape](), list[str](), 0, 0.0
    for piece in found:
        if piece.kind != "Polygon":
            continue
        drawn = [shapely.Polygon(ring) for ring in piece.rings]
        for ring in drawn:
            spot = str(shapely.is_valid_reason(ring)).partition("Self-intersection[")[2]
            crossed += [", ".join(num(float(c)) for c in spot[:-1].split())] if spot else []
        mended = [_mended(ring) for ring in drawn]
        rings = [ring for ring, _ in mended]
        apart = max([apart, *(by for _, by in mended)])
        if piece.is_even_odd:
            polygon = _surfaces(shapely.MultiPolygon(drawn))
        else:
            outside += sum(rings[0].intersection(h).area < 0.5 * h.area for h in rings[1:])
            polygon = rings[0].difference(shapely.union_all(rings[1:]))
        role, word = piece.role
        names = (str(v).strip() for k, v in piece.said.items() if k.lower() in NAMES and v)
        by_name, misnamed = named(piece.said)
        misnamed = misnamed if not role and by_name != FIELD else ""
        shapes.append(Shape(polygon, next(names, "")[:60], piece.group, role, word, misnamed))
    if crossed:
        places, key = some_of(crossed, 3, "; "), "outline" if apart > DIFFERS else "shape"
        notes.append(f"{key}: an outline crosses itself at {places} (EPSG:{epsg})")
    if outside:
        notes.append(f"outline: holes outside of their outline, {outside} in number, leave nothing out")
    return shapes


def _mended(ring: Any) -> tuple[Any, float]:
    """The areas that a ring goes around, and by what share they differ with how its crossings are read."""
    if ring.is_valid:
        return ring, 0.0
    shapely, even_odd = _shapely(), _surfaces(ring)
    corners = shapely.get_coordinates(ring)
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all([ring.exterior])])).tolist()
    around = [f for f in faces if _turns(corners, *f.representative_point().coords[0]) != 0]
    area = shapely.union_all(around)
    if not area.area:
        return area, 0.0
    largest_part = max(part.area for part in _parts(area))
    return area, float(max(1.0 - largest_part / area.area, 1.0 - even_odd.area / area.area))


def _turns(ring: Array, x: float, y: float) -> int:
    """How often a closed ring goes around a point, > 0 counter-clockwise."""
    (x0, y0), (x1, y1) = ring[:-1].T, ring[1:].T
    is_left = (x1 - x0) * (y - y0) > (x - x0) * (y1 - y0)
    return int(((y0 <= y) & (y < y1) & is_left).sum()) - int(((y1 <= y) & (y < y0) & ~is_left).sum())


def arranged(shapes: list[Shape], epsg: int, path: Path, unused: Counter[str]) -> Outlines:
    """What says that it is a field, or says nothing, is one: islands out, what touches together, what bears
    no crop out. unused: what has no part, counted.
    """
    shapely, notes = _shapely(), list[str]()
    too_small = InputError(
        "plausible", None, f"expected a field of more than {num(EMPTY_AREA)} m2", file=path
    )
    shapes = sorted((s for s in shapes if s.polygon.area > 0.0), key=lambda s: -s.polygon.area)
    if not shapes:
        raise too_small
    shapes.sort(key=lambda s: s.role != FIELD)
    is_said = shapes[0].role == FIELD
    open_to = (FIELD, "") if is_said else ("", UNKNOWN)
    if not any(s.role in open_to for s in shapes):
        open_to = (PART, PART)
    fields = [s for s in shapes if s.role in open_to]
    if fields and PART in open_to:
        words = some_of(dict.fromkeys(s.word for s in fields), 5)
        notes.append(f"shape: {words} areas are the field, as nothing else is one")
    unused.update(f"{s.word} area" for s in shapes if s.role not in (*open_to, BARE))
    if not fields:
        words = some_of(dict.fromkeys(s.word for s in shapes), 5)
        raise InputError("unused", words, "expected an area that says field, or nothing", file=path)
    beside = [s for s in fields if s.group != fields[0].group]
    land, islands, others = _nested([s for s in fields if s.group == fields[0].group], notes, path)
    if is_said:
        unused["area beside the field that says nothing"] += sum(not s.role for s in land)
        land = [s for s in land if s.role]
    whole = shapely.union_all([s.polygon for s in land])
    if islands:
        ground = shapely.union_all([s.polygon for s in islands]).intersection(whole).area
        if ground < ISLANDS * whole.area:
            whole = whole.difference(shapely.union_all([s.polygon for s in islands]))
            whole = shapely.union_all([whole, *(s.polygon for s in others)])
            many = "an area" if len(islands) == 1 else f"{len(islands)} areas"
            said = f"shape: {many} of {num(ground / 1e4)} ha within the field"
            notes.append(f"{said} {'is an island' if len(islands) == 1 else 'are islands'} without crop")
        else:
            key = "sources" if ground < (1.0 - DIFFERS) * whole.area else "shape"
            said = f"{key}: {len(islands)} outlines of {num(ground / 1e4)} ha within another are not used"
            notes.append(f"{said}: too large to be islands")
    if beside:
        within = shapely.union_all([s.polygon for s in beside]).intersection(whole).area
        if within >= LEAST_TOLD:
            notes.append(f"unused: polygons of another folder within the field, {num(within / 1e4)} ha")
    strange = [s for s in shapes if s.role == UNKNOWN and is_said]
    unknown = shapely.union_all([s.polygon for s in strange])
    within = unknown.intersection(whole).area
    for size, where in ((within, "of the field"), (unknown.area - within, "beside the field")):
        if size > DIFFERS * whole.area:
            words = some_of(dict.fromkeys(s.word for s in strange), 5)
            taken = "crop there" if where == "of the field" else "left out"
            notes.append(f"lost: {num(size / 1e4)} ha {where} are of an unknown kind, {taken}: {words}")
    whole = _without_bare(whole, [s for s in shapes if s.role == BARE], unused, notes)
    areas = [p for p in _parts(whole) if p.area > EMPTY_AREA]
    if not areas:
        raise too_small
    areas.sort(key=lambda p: -p.area)
    if areas[0].area > LARGEST_AREA:
        expected = f"expected a field of at most {num(LARGEST_AREA / 1e4)} ha"
        raise InputError("plausible", f"{num(areas[0].area / 1e4)} ha", expected, file=path)
    names, misnamed, tree = [], [], shapely.STRtree([s.polygon.representative_point() for s in land])
    for area in areas:
        own = [land[i] for i in sorted(tree.query(area.buffer(0.5), predicate="contains").tolist())]
        names.append(own[0].name if len(own) == 1 else "")
        against = dict.fromkeys(s.misnamed for s in own if s.misnamed)
        misnamed.append(some_of(against, 5) if against else "")
        if len(own) > 1:
            sizes = some_of((num(s.polygon.area / 1e4) for s in own), 5, " + ")
            notes.append(f"shape: {len(own)} polygons that touch are one field ({sizes} ha)")
            if misnamed[-1] and not all(s.misnamed for s in own):
                notes.append(f"sources: {misnamed[-1]} by name, taken as a part of the field that it touches")
                misnamed[-1] = ""
    outside = [s for s in beside if not s.polygon.intersects(whole)]
    areas += [s.polygon for s in outside]
    names += [s.name for s in outside]
    misnamed += [s.misnamed for s in outside]
    return Outlines(tuple(areas), tuple(names), epsg, tuple(notes), misnamed=tuple(misnamed))


def _without_bare(whole: Any, bare: list[Shape], unused: Counter[str], notes: list[str]) -> Any:
    """Land without what says that no crop stands there; what lies beside it is counted."""
    shapely = _shapely()
    shapely.prepare(whole)
    sizes = dict[str, float]()
    for shape in bare:
        shared = whole.intersection(shape.polygon).area if whole.intersects(shape.polygon) else 0.0
        if shared > LEAST_TOLD:
            sizes[shape.word] = sizes.get(shape.word, 0.0) + shared
        else:
            unused[f"{shape.word} area outside of the field"] += 1
    if sizes:
        listed_sizes = ", ".join(f"{word} {num(size / 1e4)} ha" for word, size in sizes.items())
        notes.append(f"shape: no crop in it: {listed_sizes}")
    return whole.difference(shapely.union_all([s.polygon for s in bare]))


def _guidance(areas: Sequence[Any], lines: list[Piece], unused: Counter[str]) -> tuple[Array, ...]:
    """Lines that say that they are guidance, or say nothing and lie in the field."""
    shapely, taken = _shapely(), list[Array]()
    ground = shapely.union_all(list(areas)).buffer(BESIDE_M)
    for piece in lines:
        line = shapely.LineString(piece.rings[0])
        is_within = not areas or line.intersection(ground).length >= 0.5 * line.length
        if piece.role[0] == LINE or (not piece.role[0] and is_within):
            taken.append(piece.rings[0])
        else:
            unused[piece.label if piece.role[0] else "line outside of the field"] += 1
    return tuple(taken)


def _nested(
    shapes: list[Shape], notes: list[str], path: Path
) -> tuple[list[Shape], list[Shape], list[Shape]]:
    """Shapes that lie in no other, those within one (islands), and land within islands; largest first.

    InputError where two outlines are of one field, differ, and nothing says which counts.
    """
    shapely = _shapely()
    tree = shapely.STRtree([s.polygon for s in shapes])
    depths: list[int] = []
    pairs_left, copies = MOST_PAIRS, 0
    for i, shape in enumerate(shapes):
        depth = 0
        for j in sorted(tree.query(shape.polygon).tolist()):
            if j >= i or depths[j] < 0:
                continue
            pairs_left -= 1
            if pairs_left < 0:
                raise ValueError(f"more than {MOST_PAIRS} pairs of polygons that overlap")
            shared = shapes[j].polygon.intersection(shape.polygon).area
            other, own = shapes[j].polygon.area, shape.polygon.area
            is_field = [s.role == FIELD for s in (shapes[j], shape)]
            is_within = shared > WITHIN * own
            if shared > WITHIN * max(own, other):
                copies, depth = copies + 1, -1
            elif is_within and not all(is_field):
                depth = max(depth, depths[j] + 1)
            elif shared > ONE_FIELD * min(own, other):
                sizes, depth = f"{num(other / 1e4)} and {num(own / 1e4)} ha", -1
                is_told = is_field[0] != is_field[1]
                if not (is_told or is_within or own > (1.0 - DIFFERS) * other or own < DIFFERS * other):
                    expected = "expected one outline of the field, or what each is (kind: field, island)"
                    raise InputError("sources", sizes, expected, file=path)
                which = "the one that says so" if is_told else "the larger one"
                notes.append(f"sources: two outlines of one field, {sizes}: {which} counts")
            if depth < 0:
                break
        depths.append(depth)
    if copies:
        notes.append(f"copies: {copies} of {len(shapes)} areas are there once more, alike: each counts once")
    pairs = list(zip(shapes, depths, strict=True))
    land, within = [s for s, d in pairs if d == 0], [s for s, d in pairs if d > 0 and d % 2 == 0]
    return land, [s for s, d in pairs if d > 0 and d % 2 == 1], within


def _surfaces(shape: Any) -> Any:
    """The areas of a shape, valid."""
    return _shapely().union_all(_parts(valid(shape)))


def valid(shape: Any) -> Any:
    """A shape, mended where its rings cross.

    ValueError where they do so too often, as in a star, which has the square of its corners of crossings:
    mending takes more than the square of these.
    """
    shapely = _shapely()
    if not shapely.is_valid(shape):
        corners = shapely.get_coordinates(shape)
        sides = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
        tree, near, crossed = shapely.STRtree(sides), 0, 0
        for first in range(0, len(sides), BLOCK):
            one, other = tree.query(sides[first : first + BLOCK])
            near += len(one)
            if not (is_dense := near > MOST_PAIRS + USUAL_PAIRS * len(sides)):
                crossed += int(shapely.crosses(sides[first + one], sides[other]).sum())
            if is_dense or crossed > 2 * MOST_CROSSINGS:  # each is met from both sides
                raise ValueError(f"lines between its {len(corners)} corners that cross too often")
    return shapely.make_valid(shape)


def _parts(shape: Any) -> list[Any]:
    """The polygons of a shape."""
    parts = getattr(shape, "geoms", [shape])
    return [q for p in parts for q in (_parts(p) if hasattr(p, "geoms") else [p]) if q.geom_type == "Polygon"]


def covered_ground(cleaned: Cleaned) -> tuple[Any, list[str]]:
    """Polygon that the passes of a log covered, in the log's system [m], and what was left out of it."""
    shapely = _shapely()
    log = cleaned.log
    width = float(np.median(log.width[log.width > 0.0])) if (log.width > 0.0).any() else 0.0
    index = np.flatnonzero(cleaned.cutting)
    ends = (np.diff(index) > 2) | (np.diff(np.cumsum(log.gap)[index]) != 0)
    pieces = np.split(index, np.flatnonzero(ends) + 1)
    passes = [piece for piece in pieces if len(piece) > 5]
    lines = [shapely.LineString(log.position[piece]).simplify(0.3) for piece in passes]
    if not lines or width <= 0.0:
        raise InputError("log", None, "expected at least one pass of 30 m with the header in the crop")
    halves = [0.5 * float(np.median(log.width[piece])) for piece in passes]
    own = zip(lines, halves, strict=True)
    strips = shapely.union_all([line.buffer(half, cap_style="flat") for line, half in own])
    field, notes = _closed(strips, width, 0.5)
    bare = 1.0 - strips.intersection(field).area / field.area
    if bare > 0.05:
        beside = "its crop is that of the passes next to it"
        notes.append(f"derived: {percent_of(bare)} of the field has no pass in the log: {beside}")
    return field, notes


def mapped_ground(cleaned: Cleaned) -> tuple[Any, list[str]]:
    """Polygon around the records of a map, in the log's system [m], and what was left out of it."""
    shapely = _shapely()
    kept = cleaned.kept
    width = float(np.median(cleaned.log.width[kept]))
    cells = np.unique(np.floor(cleaned.log.position[kept] / width), axis=0) * width
    ground = shapely.union_all(shapely.box(*cells.T, *(cells + width).T))
    return _closed(ground, width, 0.5 * width)


def _closed(ground: Any, width: float, tolerance: float) -> tuple[Any, list[str]]:
    """The largest piece of some ground, with what lies between its passes, and what was left out.

    width: of the header [m]; tolerance: of the outline [m]
    """
    grow = CLOSING_WIDTHS * width
    closed = ground.buffer(grow, join_style="mitre").buffer(-grow, join_style="mitre").simplify(tolerance)
    field = max(_parts(closed), key=lambda part: part.area, default=_shapely().Polygon())
    if field.area <= EMPTY_AREA:
        raise InputError("plausible", None, f"expected a field of more than {num(EMPTY_AREA)} m2")
    left_out = closed.area - field.area
    said = f"unused: ground in several parts: {num(left_out / 1e4)} ha left out"
    notes = [said] if left_out > 0.02 * field.area else []
    polygon = _shapely().Polygon
    return polygon(field.exterior, [r for r in field.interiors if polygon(r).area >= SMALLEST_HOLE]), notes


def long_axis(polygon: Any) -> float:
    """Direction of the long side of the smallest rectangle around, clockwise from north [rad], in [0, pi)."""
    corners = np.array(polygon.minimum_rotated_rectangle.exterior.coords)
    sides = np.diff(corners, axis=0)
    east, north = sides[np.hypot(*sides.T).argmax()]
    return float(np.arctan2(east, north) % np.pi)


def rings(polygon: Any) -> tuple[Array, tuple[Array, ...]]:
    """Exterior, counter-clockwise, and holes, clockwise, not closed, shape (n, 2) each."""
    polygon = _shapely().geometry.polygon.orient(polygon)
    holes = tuple(np.asarray(ring.coords, dtype=float)[:-1, :2] for ring in polygon.interiors)
    return np.asarray(polygon.exterior.coords, dtype=float)[:-1, :2], holes


def inside(polygon: Any, points: Array) -> NDArray[np.bool_]:
    """Whether points, shape (n, 2), lie in the polygon."""
    shapely = _shapely()
    shapely.prepare(polygon)
    return np.asarray(shapely.contains_xy(polygon, points[:, 0], points[:, 1]))


def _from_geojson(path: Path) -> tuple[list[Piece], str, list[str]]:
    shapes, name = read_shapes(path, "boundary", "GeoJSON or a polygon shapefile")
    found = [Piece(kind, rings, said) for shape, said in shapes for kind, rings in pieces(shape)]
    if is_log(shapes, path):
        expected = "expected an outline, each has a yield: a log, for `field import` or `log` of a job"
        raise InputError("boundary", f"{len(shapes)} records", expected, file=path)
    empty = sum(next(pieces(shape), None) is None for shape, _ in shapes)
    return found, name, [f"unused: {empty} features without a geometry"] if empty else []


def is_log(shapes: Shapes, path: Path) -> bool:
    """Whether features of GeoJSON are records of a harvest."""
    kinds = Counter(str(shape["type"]) for shape, _ in shapes)
    names = list(dict.fromkeys(str(name) for _, said in shapes for name in said))
    return are_records(kinds["Point"] or kinds["Polygon"] + kinds["MultiPolygon"], names, path)


def _from_shapefile(path: Path) -> tuple[list[Piece], str, list[str]]:
    """Rings of a shape by even and odd: some programs write them the wrong way round."""
    found, crs = read_rings(path, "boundary")
    made = [
        Piece("Polygon", [np.asarray(ring, float) for ring in rings], said, is_even_odd=True)
        for rings, said in found
    ]
    return made, crs, [] if crs else ["reference: no .prj: places taken as WGS 84"]


def _from_kml(path: Path) -> tuple[list[Piece], str, list[str]]:
    """Pieces of a KML file, or of the first in a KMZ; lon/lat by its standard (OGC 12-007r2)."""
    notes = []
    if is_archive(path):
        with open_archive(path, "boundary") as archive:
            names = [n for n in archive.namelist() if n.lower().endswith(".kml")]
            if not names:
                raise InputError("boundary", None, "expected a .kml in it", file=path)
            if archive.getinfo(names[0]).file_size > LARGEST_KML:
                raise InputError("boundary", None, f"expected KML of at most {LARGEST_KML} bytes", file=path)
            data = archive.read(names[0])
        if len(names) > 1:
            notes.append(f"unused: of {len(names)} .kml in {path.name} all but the first, {names[0]}")
    else:
        data = read_bytes(path, "boundary", "KML", LARGEST_KML)
    found: list[Piece] = []
    pending: list[tuple[Any, dict[str, str], int]] = [(read_xml(data), {}, 0)]
    folders = 0
    while pending:
        node, said, group = pending.pop()
        tag = _tag(node)
        if tag in ("Folder", "Document"):
            folders += 1
            group, said = folders, {"folder": _text_of(node, "name")}
        elif tag == "Placemark":
            said = {**said, "name": _text_of(node, "name"), **_data_of(node)}
        elif tag in KML_KINDS:
            rings: dict[str, list[Array]] = {"innerBoundaryIs": [], "outerBoundaryIs": []}
            around = "outerBoundaryIs"
            for part in node.iter():
                around = _tag(part) if _tag(part) in rings else around
                if _tag(part) == "coordinates":
                    rings[around].append(_line(part.text or ""))
            if outer := rings["outerBoundaryIs"]:
                found.append(Piece(KML_KINDS[tag], [outer[0], *rings["innerBoundaryIs"]], said, group))
            continue
        pending += [(child, said, group) for child in reversed(node)]
    return found, "", notes


def _tag(node: Any) -> str:
    return str(node.tag).rpartition(":")[2]


def _text_of(node: Any, tag: str) -> str:
    return next((str(c.text or "").strip() for c in node if _tag(c) == tag), "")


def _data_of(placemark: Any) -> dict[str, str]:
    """What a placemark says of itself beside its name."""
    inner = [node for node in placemark.iter() if _tag(node) in ("Data", "SimpleData")]
    return {str(n.get("name")): _text_of(n, "value") or str(n.text or "").strip() for n in inner}


def _line(text: str) -> Array:
    """Lon/lat of `lon,lat[,height] ...`, blanks around the commas or not, (n, 2)."""
    places = [place.split(",") for place in re.sub(r"\s*,\s*", ",", text.strip()).split()]
    if any(len(place) not in (2, 3) for place in places):
        raise ValueError("a place is not longitude,latitude or longitude,latitude,height")
    return np.array([[float(c) for c in place[:2]] for place in places]).reshape(-1, 2)


def _shapely() -> Any:
    with Extra("geo", "field outlines"):
        import shapely
        import shapely.geometry
        import shapely.geometry.polygon
    return shapely
