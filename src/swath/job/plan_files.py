"""Plans made by others: lines of a GeoJSON file, guidance lines of ISO 11783-10 task data, or an outline
alone.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.documents.json_file import read_json
from swath.documents.packed import readable
from swath.field.projection import Origin, origin_at
from swath.field_io.isoxml import is_taskdata
from swath.field_io.outline import read_outlines, rings
from swath.field_io.plan import largest_part, local_line, read_plan
from swath.field_io.taskdata import A_PLUS, AB, listed
from swath.job.lands import PlanSettings, plan_field
from swath.job.plan import FieldPlan, PlannedPass, checked_ring, shapely_here, with_ground

Array = NDArray[np.float64]
BEYOND = 1.0  # m: lines shorter than this inside the field are none


@dataclass(frozen=True)
class FileField:
    """ring (n, 2) and holes [m] of a field; notes: what the file has beside it."""

    ring: Array
    holes: tuple[Array, ...] = ()
    notes: tuple[str, ...] = ()


def plan_from_file(path: Path, header: float, settings: PlanSettings, *, pipe: float) -> FieldPlan:
    """The plan of a file. Its lines are driven in the order in which they stand there, each from its first
    point; without lines the field inside its outline is planned by the settings. Guidance lines
    of task data with two points, A and B, say the direction of all passes. Islands are not driven around:
    passes lead over them, and cut nothing there.

    header [m]; pipe: how far left a cart drives [m]. InputError for a file without lines and outline.
    """
    if not path.exists():
        raise InputError("field.file", str(path), "expected a file that is there")
    is_task = _is_task(path)
    lines, field = _of_taskdata(path) if is_task else _of_geojson(path)
    if is_task and lines and all(len(line) == 2 for line in lines):
        (ax, ay), (bx, by) = lines[0].tolist()
        settings = replace(settings, direction_deg=math.degrees(math.atan2(by - ay, bx - ax)))
        lines = []
    if not lines:
        assert field is not None
        return _without_islands(plan_field(field.ring, header, settings, pipe=pipe), field, header, pipe)
    width = header - settings.overlap_m
    field = field or FileField(checked_ring(_around(lines, header), "field.file"))
    ring = field.ring
    clipped = [part for line in lines for part in _inside(line, ring)]
    if not clipped:
        raise InputError("field.file", str(path), "expected lines inside the field")
    passes = with_ground([PlannedPass(line) for line in clipped], ring, header, pipe=pipe)
    area = float(shapely_here().Polygon(ring).area)
    done = _without_islands(FieldPlan(ring, passes, width, 0.0, area), field, header, pipe)
    passes = tuple(p for p in done.passes if p.area > 0.02 * header * p.length)
    done = replace(done, passes=passes)
    left = done.area_left
    notes = (f"{left / 1e4:.2f} ha of the field lie under no line",) if left > 0.02 * area else ()
    return replace(done, area=done.area - left, notes=(*done.notes, *notes))


def _without_islands(plan: FieldPlan, field: FileField, header: float, pipe: float) -> FieldPlan:
    """The plan with no crop on the islands, and what the user is told."""
    if not field.holes:
        return replace(plan, notes=(*plan.notes, *field.notes))
    passes = with_ground(list(plan.passes), field.ring, header, holes=field.holes, pipe=pipe)
    area = float(shapely_here().Polygon(field.ring, field.holes).area)
    left = plan.area - area
    said = f"{left / 1e4:.2f} ha of islands carry no crop, but passes lead over them as over bare ground"
    return replace(plan, passes=passes, area=area, holes=field.holes, notes=(*plan.notes, *field.notes, said))


def _is_task(path: Path) -> bool:
    return path.suffix.lower() not in (".geojson", ".json", ".kml", ".kmz") and is_taskdata(path)


def _of_geojson(path: Path) -> tuple[list[Array], FileField | None]:
    """Lines and field of a file in local metres, from its middle."""
    if path.suffix.lower() in (".kml", ".kmz", ".shp", ".zip") or path.is_dir():
        return [], _outline(path)
    data = read_json(path, "field.file", "GeoJSON")
    with readable("field.file", "GeoJSON with lines or a polygon", path):
        shapes = [_geometry(f) for f in data.get("features", [data])] if isinstance(data, dict) else []
        lon_lat = [
            _points(part)
            for kind, coordinates in shapes
            if kind in ("LineString", "MultiLineString")
            for part in (coordinates if kind == "MultiLineString" else [coordinates])
            if len(part) >= 2
        ]
        has_outline = any(kind in ("Polygon", "MultiPolygon") for kind, _ in shapes)
    if not lon_lat and not has_outline:
        raise InputError("field.file", str(path), "expected lines or a polygon", file=path)
    if not lon_lat:
        return [], _outline(path)
    middle = np.median(np.concatenate(lon_lat), axis=0)
    origin = origin_at(float(middle[1]), float(middle[0]))
    field = None
    if has_outline:
        polygon, notes = read_outlines(path, origin.epsg).field()
        field = _field_of(polygon, notes, np.array([origin.easting, origin.northing]))
    return [origin.to_local(line) for line in lon_lat], field


def _geometry(feature: Any) -> tuple[str, Any]:
    geometry = feature.get("geometry", feature) if isinstance(feature, dict) else None
    if not isinstance(geometry, dict):
        return "", None
    return str(geometry.get("type", "")), geometry.get("coordinates")


def _points(part: Any) -> Array:
    """Longitude and latitude of a line [deg], (n, 2). ValueError for what is none on Earth."""
    points = np.array([point[:2] for point in part], dtype=float)
    if points.shape != (len(part), 2) or not (np.abs(points) <= (180.0, 90.0)).all():
        raise ValueError("a point of a line is no longitude and latitude")
    return points


def _outline(path: Path) -> FileField:
    """The outline of a file in local metres."""
    return _field_of(*read_outlines(path).field())


def _field_of(polygon: Any, notes: list[str], corner: Array | None = None) -> FileField:
    """A polygon from a corner, by default its own."""
    exterior, holes = rings(polygon)
    corner = np.floor(exterior.min(axis=0)) if corner is None else corner
    ring = checked_ring(exterior - corner, "field.file")
    return FileField(ring, tuple(hole - corner for hole in holes), tuple(notes))


def _of_taskdata(path: Path) -> tuple[list[Array], FileField]:
    """Guidance lines and the largest field of task data, with what of it is not used."""
    described = read_plan(path)
    if not described.parts:
        raise InputError("field.file", str(path), "expected a field with a boundary", file=path)
    key, polygon, epsg, notes = largest_part(described)
    part = described.parts[key]
    corner = np.floor(rings(polygon)[0].min(axis=0))
    origin = Origin(epsg, float(corner[0]), float(corner[1]))
    if len(part.guidance) > 1 and all(p.kind in (AB, A_PLUS) for p in part.guidance):
        notes.append(f"passes along the first of {len(part.guidance)} guidance lines")
    unused = part.unused + described.unused
    notes += [f"task data, not used: {listed(unused)}"] if unused.total() else []
    notes += described.problems
    return [local_line(pattern, origin) for pattern in part.guidance], _field_of(polygon, notes)


def _around(lines: list[Array], header: float) -> Array:
    """The ground that lines cover, where a file has no outline."""
    shapely = shapely_here()
    strips = [shapely.LineString(line).buffer(0.5 * header, cap_style="flat") for line in lines]
    grown = shapely.union_all(strips).buffer(0.5 * header, join_style="mitre").buffer(-0.5 * header)
    ground = max(getattr(grown, "geoms", [grown]), key=lambda g: g.area)
    return np.asarray(ground.exterior.coords, dtype=float)[:-1]


def _inside(line: Array, ring: Array) -> list[Array]:
    """The parts of a line inside a ring, in its direction."""
    shapely = shapely_here()
    whole = shapely.LineString(line)
    cut = whole.intersection(shapely.Polygon(ring))
    parts = [g for g in getattr(cut, "geoms", [cut]) if g.geom_type == "LineString" and g.length > BEYOND]
    found = [np.asarray(p.coords, dtype=float)[:, :2] for p in parts]
    return sorted(found, key=lambda p: _along(whole, p))


def _along(whole: Any, part: Array) -> float:
    shapely = shapely_here()
    at = float(whole.project(shapely.Point(*part[0])))
    return at if math.isfinite(at) else 0.0
