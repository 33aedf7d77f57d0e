"""A field without a yield: boundary, guidance and working width of ISO 11783-10 task data, or an outline."""

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, some_of
from swath.core.number_text import num
from swath.documents.geojson import read_shapes
from swath.field.crop import Crop
from swath.field.maps.projection import Origin, transform, utm_epsg
from swath.field.maps.raster import Raster
from swath.field_io import outline, trade
from swath.field_io.agopengps import HEADLAND_LINE, is_agopengps, read_agopengps
from swath.field_io.folder import FieldFolder
from swath.field_io.grid import make_grid
from swath.field_io.logs.coordinates import place
from swath.field_io.logs.shapefiles import is_of_polygons
from swath.field_io.outline import Piece
from swath.field_io.passes import Track, row_azimuth, straight_windows
from swath.field_io.task_data.taskdata import (
    PATTERNS,
    PIVOT,
    SPIRAL,
    Description,
    Part,
    Pattern,
    drawn,
    listed,
    pivot_radius,
    read_description,
)
from swath.field_io.task_data.taskfiles import task_files

Array = NDArray[np.float64]
JSON = ".geojson", ".json"
OUTLINES = ".kml", ".kmz", *JSON
SPEED = 2.0  # m/s, of a guidance line that nobody has driven yet
BEYOND = 5000.0  # m: a straight line is drawn on by so much to both sides, then cut at the field


def read_plan(path: Path) -> Description:
    """What TASKDATA.XML says, of the fields those that have a boundary. Raises InputError."""
    with task_files(path) as files:
        described = read_description(files)
    whole = {key: part for key, part in described.parts.items() if part.boundary}
    described.unused["field without a boundary"] += len(described.parts) - len(whole)
    described.parts = whole
    return described


def largest_part(described: Description, path: Path) -> tuple[str, Any, int, list[str]]:
    """Id of the largest field, its polygon without ground that bears no crop in UTM [m], the system, and what
    of it is left out.
    """
    parts = described.parts
    key = max(parts, key=lambda k: parts[k].rough_area)
    part, (polygon, epsg, notes) = parts[key], _polygon(parts[key], path)
    if len(parts) > 1:
        taken = f"the largest is taken, {part.name or 'without a name'}"
        notes = [f"unused: all but one of {len(parts)} fields in it: {taken}", *notes]
    return key, polygon, epsg, notes


def origin_near(polygon: Any, terrain: Raster, epsg: int) -> Origin:
    """Whole metres near the middle of the field."""
    west, south, east, north = polygon.bounds
    height = float(np.round(np.nanmedian(terrain.values)))
    return Origin(epsg, float(np.round((west + east) / 2)), float(np.round((south + north) / 2)), height)


def plan_field(
    path: Path,
    out: Path,
    *,
    crop: str | None,
    width: float | None,
    cell: float,
    load: Callable[[str], Crop],
    terrain: Callable[[Any, int], tuple[Raster, dict[str, Any]]],
) -> FieldFolder:
    """A field folder, not yet written, of an outline or the largest field of task data, its crop even.

    crop, width [m]: instead of what the data say; terrain: makes it of a polygon and its epsg
    Some field in it has a boundary. Raises InputError for a crop without a data sheet, and without a width.
    """
    import shapely

    part, polygon, epsg, stated, notes = _read(path, width)
    of_file = trade.crop_in_name(path.name) if is_outline(path) and not crop else None
    sheet = crop or of_file or trade.crop_of_rows([part.crop])[0] or trade.DEFAULT
    if not crop:
        by = f"{sheet} ({part.crop})" if part.crop else f"it names none, taken as {sheet} (--crop)"
        notes.append(f"crop: {sheet}, by the name of the file" if of_file else f"crop: {by}")
    facts = load(sheet)
    used = width or stated
    if not used:
        raise InputError(
            "header_width", None, "expected a working width in it, or --header-width-m", file=path
        )
    ground, info = terrain(polygon, epsg)
    origin = origin_near(polygon, ground, epsg)
    corner = np.array([origin.easting, origin.northing])
    tracks: list[Track] = []
    missed = 0
    for pattern in part.guidance:
        found = _guidance(len(tracks), pattern, polygon, origin, used)
        tracks += found
        missed += not found
    if missed:
        notes.append(f"unused: {listed({'guidance pattern': missed})} outside the field")
    stems = facts.stand.density
    grid = make_grid(polygon.bounds, cell, 0.0, epsg)
    x, y = np.meshgrid(*grid.centres())
    inside = shapely.contains_xy(polygon, x, y)
    even = {
        "stems": stems, "height": facts.stand.height, "moisture": facts.yields.grain_moisture,
        "grain": stems * facts.yields.grain_mass,
    }  # fmt: skip
    values = {key: np.where(inside, value, np.nan).astype(np.float32) for key, value in even.items()}
    maps = {key: Raster(v, grid.x0, grid.y0, cell, epsg) for key, v in values.items()}
    rasters = {key: raster.shifted(*-corner) for key, raster in maps.items()}
    above = Raster(ground.values - np.float32(origin.height), ground.x0, ground.y0, ground.cell, epsg)
    exterior, holes = outline.rings(polygon)
    azimuth = row_azimuth(tuple(tracks)) if any(t.straights for t in tracks) else outline.long_axis(polygon)
    about = {
        "source": {"file": path.name, "profile": notes[0].split(": ")[1], "field": part.name},
        "machines": [{"name": "as given", "header_width_m": used}],
        "field": {
            "place": place(origin.to_lon_lat([[0.0, 0.0]])),
            "area_ha": polygon.area / 1e4,
            "guidance_lines": len(tracks),
        },
        "crop": {"name": sheet, "stems_per_m2": stems, "grain_g_per_stem": 1000.0 * facts.yields.grain_mass},
        "terrain": info,
        "notes": [*notes, *ground.notes],
    }
    return FieldFolder(
        path=out, origin=origin, boundary=exterior - corner, holes=tuple(h - corner for h in holes),
        row_azimuth=azimuth, tracks=tuple(tracks), obstacles=(), info=about, terrain=above.shifted(*-corner),
        **rasters,
    )  # fmt: skip


def is_outline(path: Path) -> bool:
    """True for a file of outlines: by its name and no records, or a shapefile of polygons."""
    if os.path.isfile(path) and path.suffix.lower() in OUTLINES:
        return path.suffix.lower() not in JSON or not outline.is_log(read_shapes(path, "boundary")[0], path)
    return is_of_polygons(path)


def _read(path: Path, width: float | None) -> tuple[Part, Any, int, float, list[str]]:
    """The field with its crop, its polygon and system, the working width [m], 0 = none, and what was assumed.

    width [m]: that is given, which no other is sought beside
    """
    if is_outline(path):
        found = outline.read_outlines(path)
        polygon, told = found.field()
        told += [f"unused: {len(found.lines)} guidance lines"] if found.lines else []
        notes = ["form: an outline alone: the crop stands evenly", *told]
        return Part("", ""), polygon, found.epsg, 0.0, notes
    if is_agopengps(path):
        field = read_agopengps(path)
        part = field.part(path.name)
        polygon, epsg, told = _polygon(part, path)
        notes = ["form: a field of AgOpenGPS: the crop stands evenly", *told, *field.notes]
        return part, polygon, epsg, 0.0, notes
    described = read_plan(path)
    key, polygon, epsg, left_out = largest_part(described, path)
    notes = ["form: ISO 11783-10 task data without a yield: the crop stands evenly", *left_out]
    stated, what = (0.0, "") if width else _width(described, key, path)
    notes += [f"derived: header width {num(stated)} m, {what}"] if stated else []
    part = replace(described.parts[key], crop=described.crop_of(key))
    for pattern in part.guidance:
        if pattern.kind in (PIVOT, SPIRAL):
            is_round = pattern.kind == PIVOT
            shape = f"its circle of {num(pivot_radius(pattern))} m" if is_round else "its own line"
            notes.append(f"shape: guidance of a {PATTERNS[pattern.kind]} {shape}, none beside it")
    unused = part.unused + described.unused
    notes += [f"unused: {listed(unused)}"] if unused.total() else []
    return part, polygon, epsg, stated, [*notes, *described.problems]


def _width(described: Description, part: str, path: Path) -> tuple[float, str]:
    """The working width of the machines of a field's tasks, else of all [m], 0 = none, and what it is."""
    own = {d for task in described.tasks.values() if task.part == part for d in task.devices}
    devices = [d for d in described.devices if d in own] or list(described.devices)
    found = [width for d in devices if (width := described.width_of([d]))[0]]
    if len({width for width, _ in found}) > 1:
        named = some_of((f"{num(width)} m ({what})" for width, what in found), 4)
        raise InputError("header_width", named, "expected one, --header-width-m says which", file=path)
    return found[0] if found else (0.0, "")


def _polygon(part: Part, path: Path) -> tuple[Any, int, list[str]]:
    """The field in UTM metres without its holes and what bears no crop, the system, and what is left out."""
    epsg = utm_epsg(*np.median(part.boundary[0].exteriors[0], axis=0))
    notes = [] if "field" in part.polygons else ["shape: main field and headland, the field has no boundary"]
    said = [("field", p) for p in part.boundary] + [(p.name, p) for p in part.polygons.get("bare", [])]
    found = [
        Piece(
            "Polygon",
            [in_metres(ring, epsg) for ring in (*p.exteriors, *p.interiors)],
            {"kind": word},
            0,
            True,
        )
        for word, p in said
    ]
    shapes, unused = outline.shapes_of(found, epsg, notes), Counter[str]()
    polygon, told = outline.arranged(shapes, epsg, path, unused).field()
    return polygon, epsg, [*notes, *told, *([f"unused: {listed(unused)}"] if unused.total() else [])]


def in_metres(ring: Array, epsg: int) -> Array:
    """A boundary in lon/lat [deg] as UTM [m], (n, 2). InputError for one that does not lie in one place."""
    found = transform(ring, "EPSG:4326", f"EPSG:{epsg}")
    if not np.isfinite(found).all():
        raise InputError("boundary", None, f"expected longitudes and latitudes of one field, in EPSG:{epsg}")
    return found


def local_line(pattern: Pattern, origin: Origin) -> Array:
    """A pattern's own line in local metres, (n, 2); a straight one goes on far beyond its points."""
    points = origin.to_local(drawn(pattern))
    if len(points) != 2:
        return points
    direction = points[1] - points[0]
    beyond = direction * (BEYOND / max(float(np.hypot(*direction)), 1e-9))
    return np.array([points[0] - beyond, points[1] + beyond])


def _guidance(first: int, pattern: Pattern, polygon: Any, origin: Origin, width: float) -> list[Track]:
    """Guidance within the field, from end to end of it; first: index of its first piece."""
    import shapely

    points = local_line(pattern, origin)
    corner = np.array([origin.easting, origin.northing])
    if not np.isfinite(points).all() or not np.ptp(points, axis=0).any():
        return []
    inside = shapely.LineString(points + corner).intersection(polygon)
    inside = shapely.line_merge(inside) if inside.geom_type == "MultiLineString" else inside
    pieces = [g for g in getattr(inside, "geoms", [inside]) if g.geom_type == "LineString" and g.length > 1.0]
    tracks: list[Track] = []
    for piece in pieces:
        local = np.asarray(piece.coords, dtype=float)[:, :2] - corner
        azimuth = float(np.arctan2(*(local[-1] - local[0])) % (2.0 * np.pi))
        straights = () if pattern.name == HEADLAND_LINE else straight_windows(local)
        index = first + len(tracks)
        made = Track(local, pattern.name, index, width, SPEED, 0.0, azimuth, piece.length, straights)
        tracks.append(made)
    return tracks
