"""The outline of a field: from a file, or the ground its passes covered."""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError, some_of
from swath.documents.geojson import read_shapes
from swath.documents.packed import is_archive, open_archive, readable
from swath.documents.text_file import read_bytes
from swath.documents.xml_file import read_xml
from swath.field.maps.projection import known_crs, transform, utm_epsg
from swath.field_io.clean import Cleaned
from swath.field_io.logs.coordinates import place
from swath.field_io.logs.shapefiles import are_records, read_rings

Array = NDArray[np.float64]
CLOSING_WIDTHS = 1.1  # header widths: gaps between passes up to twice this are inside the field
SMALLEST_HOLE = 400.0  # m2: what is left out inside the field and larger is no crop
LARGEST_BYTES, LARGEST_KML = 1 << 27, 1 << 25
EMPTY_AREA = 100.0  # m2: less is no field
LEAST_TOLD = 1.0  # m2: less is left out without a word
MOST_CORNERS = 50_000  # of a polygon: one at 10 Hz around 100 ha has 20,000
MOST_SHAPES, MOST_PAIRS = 20_000, 100_000  # polygons of a file, and pairs of them that overlap
USUAL_PAIRS, BLOCK = 8, 64  # boxes of sides that meet that of one in an honest ring; looked up at once
MOST_CROSSINGS = 1000  # of the sides of a polygon with each other
PROBED = 1000  # records that say which field is meant
WITHIN = 0.98  # share of a polygon that lies in another, from which on it is one within it
ISLANDS = 0.5  # share of a field that islands have at most; more are zones or inner lines of it
NAMES = ("name", "field", "fieldname", "field_name", "title", "schlag", "parcelle")  # of an area, in GeoJSON


@dataclass(frozen=True)
class Outlines:
    """Areas of crop that a boundary file holds, largest first, in metres of a system.

    names: of the areas, '' where the file has none
    notes: what within them was taken as what
    """

    areas: tuple[Any, ...]
    names: tuple[str, ...]
    epsg: int
    notes: tuple[str, ...] = ()

    def field(self, places: Array | None = None) -> tuple[Any, list[str]]:
        """One polygon, with its holes, and notes on it and on what is left out.

        places: points (n, 2) [m] of the field that is meant; without them the largest area
        """
        some = np.zeros((0, 2)) if places is None else places[:: max(1, len(places) // PROBED)]
        held = [int(inside(area, some).sum()) for area in self.areas]
        index = int(np.argmax(held))
        field, notes = self.areas[index], list(self.notes)
        others = [i for i in range(len(self.areas)) if i != index]
        left_out = sum(self.areas[i].area for i in others)
        if left_out >= LEAST_TOLD:
            named = some_of((repr(self.names[i]) for i in others if self.names[i]), 5)
            count = "another area" if len(others) == 1 else f"{len(others)} other areas"
            own = f" {self.names[index]!r}" if self.names[index] else ""
            notes.append(
                f"the field{own} of {field.area / 1e4:.2f} ha is taken, {count} of {left_out / 1e4:.2f} ha "
                f"{'is' if len(others) == 1 else 'are'} left out{f': {named}' if named else ''}"
            )
        return field, notes


@dataclass(frozen=True)
class Shape:
    """A polygon of a file. name: that it has there; group: of those that belong together, a folder in KML."""

    polygon: Any
    name: str = ""
    group: int = 0


def read_outlines(path: Path, epsg: int | None = None) -> Outlines:
    """The areas of crop in a boundary file: GeoJSON, KML, KMZ or a polygon shapefile, zipped too.

    epsg: of the system that they are wanted in, None: the UTM zone of their middle. Polygons that overlap or
    touch are one area; one within another is an island, whichever way round its points stand. Raises
    InputError.
    """
    with readable("boundary", "GeoJSON, KML or a polygon shapefile", path):
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError("boundary", size, f"expected at most {LARGEST_BYTES} bytes", file=path)
        if path.suffix.lower() in (".kml", ".kmz"):
            shapes, crs, notes = _from_kml(path)
        elif is_archive(path) or os.path.isdir(path) or path.suffix.lower() == ".shp":
            shapes, crs, notes = *_from_shapefile(path), []
        else:
            shapes, crs, notes = _from_geojson(path, epsg)
        if not shapes:
            raise InputError("boundary", None, "expected a polygon", file=path)
        if len(shapes) > MOST_SHAPES:
            raise InputError("boundary", len(shapes), f"expected at most {MOST_SHAPES} polygons", file=path)
        corners = max(int(_shapely().get_num_coordinates(s.polygon)) for s in shapes)
        if corners > MOST_CORNERS:  # what looks for crossings takes time by their square
            raise InputError("boundary", corners, f"expected at most {MOST_CORNERS} corners", file=path)
        moved, epsg, crossings = _moved(shapes, known_crs(crs or "EPSG:4326"), epsg, path)
        return _arranged(moved, epsg, [*notes, *crossings], path)


def _moved(
    shapes: list[Shape], system: Any, epsg: int | None, path: Path
) -> tuple[list[Shape], int, list[str]]:
    """The shapes in metres of the system epsg, None: of the UTM zone that they lie in; crossings."""
    shapely = _shapely()
    polygons = [s.polygon for s in shapes]
    if epsg is None:
        middle = np.median(shapely.get_coordinates(polygons), axis=0)
        middle = transform(middle[None], system, "EPSG:4326")[0]
        if not np.isfinite(middle).all():
            raise InputError("boundary", None, f"expected places in {system.name}", file=path)
        epsg = utm_epsg(*middle)
    moved = shapely.transform(polygons, lambda p: transform(p[:, :2], system, f"EPSG:{epsg}"))
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        expected = "expected lon/lat in degrees (GeoJSON in EPSG:4326), or a shapefile with its .prj"
        raise InputError("boundary", None, expected, file=path)
    said = [str(shapely.is_valid_reason(p)) for p in moved]
    crossed = [text.partition("[")[2][:-1].split() for text in said if text.startswith("Self-intersection")]
    places = some_of((f"{float(x):.0f}, {float(y):.0f}" for x, y in crossed), 3, "; ")
    notes = [f"an outline crosses itself at {places} (EPSG:{epsg})"] if crossed else []
    return [replace(s, polygon=_surfaces(p)) for s, p in zip(shapes, moved, strict=True)], epsg, notes


def _arranged(shapes: list[Shape], epsg: int, notes: list[str], path: Path) -> Outlines:
    """Islands out, what touches together."""
    shapely = _shapely()
    too_small = InputError("boundary", None, f"expected a field of more than {EMPTY_AREA:.0f} m2", file=path)
    shapes = sorted((s for s in shapes if s.polygon.area > 0.0), key=lambda s: -s.polygon.area)
    if not shapes:
        raise too_small
    beside = [s for s in shapes if s.group != shapes[0].group]
    land, islands, others = _nested([s for s in shapes if s.group == shapes[0].group])
    whole = shapely.union_all([s.polygon for s in land])
    if islands:
        ground = shapely.union_all([s.polygon for s in islands]).intersection(whole).area
        if ground < ISLANDS * whole.area:
            whole = whole.difference(shapely.union_all([s.polygon for s in islands]))
            whole = shapely.union_all([whole, *(s.polygon for s in others)])
            many = "an area" if len(islands) == 1 else f"{len(islands)} areas"
            said = f"{many} of {ground / 1e4:.2f} ha within the field"
            notes.append(f"{said} {'is an island' if len(islands) == 1 else 'are islands'} without crop")
        else:
            said = f"{len(islands)} outlines of {ground / 1e4:.2f} ha within another are not used"
            notes.append(f"{said}: too large to be islands")
    if beside:
        within = shapely.union_all([s.polygon for s in beside]).intersection(whole).area
        if within >= LEAST_TOLD:
            notes.append(f"polygons of another folder within the field, {within / 1e4:.2f} ha, are not used")
    areas = [p for p in _parts(whole) if p.area > EMPTY_AREA]
    if not areas:
        raise too_small
    areas.sort(key=lambda p: -p.area)
    names, tree = [], shapely.STRtree([s.polygon.representative_point() for s in land])
    for area in areas:
        own = [land[i] for i in sorted(tree.query(area.buffer(0.5), predicate="contains").tolist())]
        names.append(own[0].name if len(own) == 1 else "")
        if len(own) > 1:
            sizes = some_of((f"{s.polygon.area / 1e4:.2f}" for s in own), 5, " + ")
            notes.append(f"{len(own)} polygons that touch are one field ({sizes} ha)")
    outside = [s for s in beside if not s.polygon.intersects(whole)]
    areas += [s.polygon for s in outside]
    names += [s.name for s in outside]
    return Outlines(tuple(areas), tuple(names), epsg, tuple(notes))


def _nested(shapes: list[Shape]) -> tuple[list[Shape], list[Shape], list[Shape]]:
    """Shapes that lie in no other, those within one (islands), and land within islands; largest first."""
    shapely = _shapely()
    tree = shapely.STRtree([s.polygon for s in shapes])
    depths: list[int] = []
    pairs_left = MOST_PAIRS
    for i, shape in enumerate(shapes):
        depth = 0
        for j in sorted(tree.query(shape.polygon).tolist()):
            if j >= i:
                break
            pairs_left -= 1
            if pairs_left < 0:
                raise ValueError(f"more than {MOST_PAIRS} pairs of polygons that overlap")
            shared = shapes[j].polygon.intersection(shape.polygon).area
            if shared > WITHIN * shape.polygon.area:
                if shape.polygon.area > WITHIN * shapes[j].polygon.area:
                    depth = -1  # the same once more
                    break
                depth = max(depth, depths[j] + 1)
        depths.append(depth)
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
        notes.append(
            f"{bare:.0%} of the field has no pass in the log: its crop is that of the passes next to it"
        )
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
    field = largest(closed)
    left_out = closed.area - field.area
    notes = (
        [f"ground in several parts: {left_out / 1e4:.2f} ha left out"] if left_out > 0.02 * field.area else []
    )
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


def _from_geojson(path: Path, epsg: int | None) -> tuple[list[Shape], str, list[str]]:
    found, name = read_shapes(path, "boundary", "GeoJSON or a polygon shapefile")
    shapes, attributes = [], dict[str, None]()
    for geometry, found_notes in found:
        attributes |= dict.fromkeys(map(str, found_notes))
        called = next((str(v) for k, v in found_notes.items() if k.lower() in NAMES and v), "")
        shapes += [Shape(p, called[:60]) for p in _parts(_shapely().geometry.shape(geometry))]
    if are_records(len(shapes), list(attributes), path):
        expected = "expected an outline, each has a yield: records of a log, which a .csv or .shp holds"
        raise InputError("boundary", f"{len(shapes)} polygons", expected, file=path)
    whole = [s for s in shapes if not s.polygon.is_empty]
    whole, notes = _ordered(whole, name, epsg)
    return whole, name, notes


def _ordered(shapes: list[Shape], name: str, epsg: int | None) -> tuple[list[Shape], list[str]]:
    """Shapes with their places east first, and a note where that is in doubt.

    GeoJSON is east first in every system; a system that is named by its URN may have north first.
    epsg: of a system that they must lie in
    """
    if not (shapes and name.lower().startswith("urn:ogc:def:crs:epsg")):
        return shapes, []
    system = known_crs(name)
    if system.axis_info[0].direction != "north":
        return shapes, []
    shapely, area = _shapely(), system.area_of_use
    middle = np.median(shapely.get_coordinates([s.polygon for s in shapes]), axis=0)
    lon, lat = transform(np.array([middle, middle[::-1]]), system, "EPSG:4326").T
    west, south, east, north = area.bounds if area else (-180.0, -90.0, 180.0, 90.0)
    both = list(zip(lon, lat, strict=True))
    can_be = [bool(west <= a <= east and south <= b <= north) for a, b in both]
    is_near = [can and epsg in (None, utm_epsg(*at)) for can, at in zip(can_be, both, strict=True)]
    straight, swapped = is_near if any(is_near) else can_be
    if not swapped:
        return shapes, []
    where = [place(np.array([at])) for at in both]
    said = f"order of axes: {name} has north first, GeoJSON east first; taken as"
    if straight:
        return shapes, [
            f"{said} {where[0]}; the other way round it lies at {where[1]}: then swap its numbers"
        ]
    flipped = [replace(s, polygon=shapely.transform(s.polygon, lambda c: c[:, ::-1])) for s in shapes]
    return flipped, [f"{said} {where[1]}, as nothing else fits"]


def _from_shapefile(path: Path) -> tuple[list[Shape], str]:
    """Rings of a shape by even and odd: some programs write them the wrong way round."""
    shapely = _shapely()
    found, crs = read_rings(path, "boundary")
    shapes = []
    for rings in found:
        polygons = [shapely.Polygon(ring) for ring in rings if len(ring) >= 4]
        shapes += [Shape(p) for p in _parts(valid(shapely.MultiPolygon(polygons)))]
    return shapes, crs


def _from_kml(path: Path) -> tuple[list[Shape], str, list[str]]:
    """Polygons of a KML file, or of the first in a KMZ; lon/lat by its standard (OGC 12-007r2)."""
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
            notes.append(f"of {len(names)} .kml in {path.name} the first is read, {names[0]}")
    else:
        data = read_bytes(path, "boundary", "KML", LARGEST_KML)
    shapes: list[Shape] = []
    pending = [(read_xml(data), "", 0)]
    folders = 0
    while pending:
        node, name, group = pending.pop()
        tag = node.tag.rpartition(":")[2]
        if tag in ("Folder", "Document"):
            folders += 1
            group = folders
        if tag == "Placemark":
            name = next((c.text or "" for c in node if c.tag.rpartition(":")[2] == "name"), "").strip()[:60]
        if tag in ("Polygon", "LinearRing"):
            rings: dict[str, list[Any]] = {"innerBoundaryIs": [], "outerBoundaryIs": []}
            around = "outerBoundaryIs"
            for part in node.iter():
                kind = part.tag.rpartition(":")[2]
                around = kind if kind in rings else around
                if kind == "coordinates":
                    rings[around].append(_ring(part.text or ""))
            outer, inner = rings["outerBoundaryIs"], rings["innerBoundaryIs"]
            if outer and len(outer[0]) >= 4:
                holes = [r for r in inner if len(r) >= 4]
                shapes.append(Shape(_shapely().Polygon(outer[0], holes), name, group))
            continue
        pending += [(child, name, group) for child in reversed(node)]
    return shapes, "", notes


def _ring(text: str) -> list[list[float]]:
    """Closed lon/lat of `lon,lat[,height] ...`, blanks around the commas or not."""
    places = [place.split(",") for place in re.sub(r"\s*,\s*", ",", text.strip()).split()]
    if any(len(place) not in (2, 3) for place in places):
        raise ValueError("a place is not longitude,latitude or longitude,latitude,height")
    ring = [[float(c) for c in place[:2]] for place in places]
    return ring if ring[:1] == ring[-1:] else [*ring, ring[0]]


def largest(shape: Any, path: Path | None = None) -> Any:
    """The largest part of a shape; InputError where it is below EMPTY_AREA."""
    parts = [p for p in getattr(shape, "geoms", [shape]) if p.geom_type == "Polygon" and p.area > EMPTY_AREA]
    if not parts:
        raise InputError("boundary", None, f"expected a field of more than {EMPTY_AREA:.0f} m2", file=path)
    return max(parts, key=lambda p: p.area)


def _shapely() -> Any:
    with Extra("geo", "field outlines"):
        import shapely
        import shapely.geometry
        import shapely.geometry.polygon
    return shapely
