"""A field without a yield: boundary, guidance and working width of ISO 11783-10 task data, or an outline."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.crop import Crop
from swath.field.projection import Origin, transform, utm_epsg
from swath.field.raster import Raster
from swath.field_io import outline, trade
from swath.field_io.folder import FieldFolder
from swath.field_io.grid import make_grid
from swath.field_io.passes import Track, row_azimuth, straight_windows
from swath.field_io.shapefiles import is_of_polygons
from swath.field_io.taskfiles import Element, elements, hex_number, number, task_files

Array = NDArray[np.float64]
WIDTHS = (67, 68, 70)  # DDI of the actual, default and maximum working width [mm]
EXTERIOR, INTERIOR, GUIDANCE = "1", "2", "5"  # types of a line string
OUTLINES = ".kml", ".kmz", ".geojson", ".json"
SPEED = 2.0  # m/s, of a guidance line that nobody has driven yet


@dataclass
class Part:
    """A field of the task data. rings: (type, lon/lat (n, 2)) of its boundary; lines: guidance, lon/lat."""

    name: str
    crop: str
    rings: list[tuple[str, Array]] = field(default_factory=list)
    lines: list[Array] = field(default_factory=list)


def read_plan(path: Path) -> tuple[list[Part], float | None]:
    """The fields of TASKDATA.XML and the working width [m] of its devices. Raises InputError."""
    with task_files(path) as files:
        data = files.get("TASKDATA.XML", b"")
    found, _ = elements(data, ("CTP", "PFD", "PLN", "GPN", "LSG", "PNT", "DPT"))
    crops = {a.get("A", ""): a.get("B", "") for tag, a, _ in found if tag == "CTP"}
    widths = [number(a.get("C"), 0.0) / 1000.0 for tag, a, _ in found if tag == "DPT" and _is_width(a)]
    parts: dict[str, Part] = {}
    for index, (tag, a, _) in enumerate(found):
        if tag == "PFD":
            parts[a.get("A", "")] = Part(a.get("C", ""), crops.get(a.get("G", ""), ""))
        if tag == "LSG":
            _take_line(found, index, parts)
    return [p for p in parts.values() if p.rings], max(widths, default=0.0) or None


def _is_width(a: dict[str, str]) -> bool:
    return hex_number(a.get("B")) in WIDTHS


def _take_line(found: list[Element], index: int, parts: dict[str, Part]) -> None:
    """Put a line string, whose points follow it, to its field."""
    _, line, around = found[index]
    owner = next((parts[b["A"]] for t, b in around if t == "PFD" and b.get("A") in parts), None)
    points = []
    for tag, a, _ in found[index + 1 :]:
        if tag != "PNT":
            break
        points.append((number(a.get("D"), np.nan), number(a.get("C"), np.nan)))
    places = np.array(points, dtype=float).reshape(-1, 2)
    if owner is None or not np.isfinite(places).all():
        return
    kind = line.get("A", "")
    if kind == GUIDANCE and len(places) >= 2:
        owner.lines.append(places)
    elif kind in (EXTERIOR, INTERIOR) and len(places) >= 3 and any(t == "PLN" for t, _ in around):
        owner.rings.append((kind, places))


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

    part, (polygon, epsg), stated, notes = _read(path)
    sheet = crop or (trade.crop_of_rows([part.crop])[0] if part.crop else None) or trade.DEFAULT
    facts = load(sheet)
    used = width or stated or 0.0
    if not used:
        raise InputError(
            "header_width", None, "expected a working width in it, or --header-width-m", file=path
        )
    ground, info = terrain(polygon, epsg)
    west, south, east, north = polygon.bounds
    height = float(np.round(np.nanmedian(ground.values)))
    origin = Origin(epsg, float(np.round((west + east) / 2)), float(np.round((south + north) / 2)), height)
    corner = np.array([origin.easting, origin.northing])
    tracks = tuple(
        track for i, line in enumerate(part.lines) for track in _guidance(i, line, polygon, origin, used)
    )
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
    above = Raster(ground.values - np.float32(height), ground.x0, ground.y0, ground.cell, epsg)
    exterior, holes = outline.rings(polygon)
    azimuth = row_azimuth(tracks) if tracks else outline.long_axis(polygon)
    about = {
        "source": {"file": path.name, "profile": notes[0].partition(":")[0], "field": part.name},
        "machines": [{"name": "as given", "header_width_m": used}],
        "field": {"area_ha": polygon.area / 1e4, "guidance_lines": len(tracks)},
        "crop": {"name": sheet, "stems_per_m2": stems, "grain_g_per_stem": 1000.0 * facts.yields.grain_mass},
        "terrain": info,
        "notes": [*notes, *ground.notes],
    }
    return FieldFolder(
        path=out, origin=origin, boundary=exterior - corner, holes=tuple(h - corner for h in holes),
        row_azimuth=azimuth, tracks=tracks, obstacles=(), info=about, terrain=above.shifted(*-corner),
        **rasters,
    )  # fmt: skip


def is_outline(path: Path) -> bool:
    """True for a file of polygons: by its name, or a shapefile of such."""
    return (path.is_file() and path.suffix.lower() in OUTLINES) or is_of_polygons(path)


def _read(path: Path) -> tuple[Part, tuple[Any, int], float | None, list[str]]:
    """The field, its polygon and system, the working width [m] and what was assumed."""
    if is_outline(path):
        found = outline.read_outlines(path)
        polygon, notes = found.field()
        return Part("", ""), (polygon, found.epsg), None, ["an outline alone: the crop stands evenly", *notes]
    parts, stated = read_plan(path)
    shapes = [polygon_of(part) for part in parts]
    part, place = max(zip(parts, shapes, strict=True), key=lambda pair: pair[1][0].area)
    notes = ["ISO 11783-10 task data without a yield: the crop stands evenly"]
    if len(parts) > 1:
        notes.append(f"{len(parts)} fields in it: the largest is taken, {part.name or 'without a name'}")
    return part, place, stated, notes


def polygon_of(part: Part) -> tuple[Any, int]:
    """The field in UTM metres without its holes, and the system."""
    import shapely

    first = next((ring for kind, ring in part.rings if kind == EXTERIOR), part.rings[0][1])
    epsg = utm_epsg(*np.median(first, axis=0))
    made = {EXTERIOR: shapely.Polygon(), INTERIOR: shapely.Polygon()}
    for kind, ring in part.rings:
        shape = shapely.make_valid(shapely.Polygon(in_metres(ring, epsg)))
        made[kind] = made[kind].union(shape)
    return outline.largest(made[EXTERIOR].difference(made[INTERIOR])), epsg


def in_metres(ring: Array, epsg: int) -> Array:
    """A boundary in lon/lat [deg] as UTM [m], (n, 2). InputError for one that does not lie in one place."""
    found = transform(ring, "EPSG:4326", f"EPSG:{epsg}")
    if not np.isfinite(found).all():
        raise InputError("boundary", None, f"expected longitudes and latitudes of one field, in EPSG:{epsg}")
    return found


def _guidance(index: int, line: Array, polygon: Any, origin: Origin, width: float) -> list[Track]:
    """A guidance line within the field; a straight one from end to end of it."""
    import shapely

    points = origin.to_local(line)
    corner = np.array([origin.easting, origin.northing])
    if not np.isfinite(points).all() or not np.ptp(points, axis=0).any():
        return []
    if len(points) == 2:
        along = (points[1] - points[0]) / np.hypot(*(points[1] - points[0]))
        points = np.array([points[0] - 5000.0 * along, points[1] + 5000.0 * along])
    inside = shapely.LineString(points + corner).intersection(polygon)
    pieces = [g for g in getattr(inside, "geoms", [inside]) if g.geom_type == "LineString" and g.length > 1.0]
    if not pieces:
        return []
    best = max(pieces, key=lambda g: g.length)
    local = np.asarray(best.coords, dtype=float)[:, :2] - corner
    first, last = local[0], local[-1]
    azimuth = float(np.arctan2(*(last - first)) % (2.0 * np.pi))
    return [
        Track(local, "guidance line", index, width, SPEED, 0.0, azimuth, best.length, straight_windows(local))
    ]
