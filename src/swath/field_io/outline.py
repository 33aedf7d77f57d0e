"""The outline of a field: from a file, or the ground its passes covered."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, MissingExtra
from swath.documents.json_file import read_json
from swath.documents.packed import open_archive, readable
from swath.field.projection import known_crs, transform, utm_epsg
from swath.field_io.clean import Cleaned
from swath.field_io.shapefiles import read_shapes
from swath.field_io.taskfiles import element_texts

Array = NDArray[np.float64]
CLOSING_WIDTHS = 1.1  # header widths: gaps between passes up to twice this are inside the field
SMALLEST_HOLE = 400.0  # m2: what is left out inside the field and larger is no crop
LARGEST_BYTES = 1 << 27
EMPTY_AREA = 100.0  # m2: less is no field


def read_outline(path: Path, epsg: int) -> Any:
    """Polygon of a boundary file in the system epsg [m].

    GeoJSON, KML (lon/lat) or a polygon shapefile, zipped too. Several polygons are united; the largest
    part is the field. Raises InputError.
    """
    return _united(*_polygons(path), epsg, path)


def read_place(path: Path) -> tuple[Any, int]:
    """Polygon of a boundary file as `read_outline` reads it, and the UTM system that it lies in."""
    polygons, system = _polygons(path)
    middle = transform(np.array(polygons[0].centroid.coords)[:, :2], system, "EPSG:4326")[0]
    if not np.isfinite(middle).all():
        raise InputError("boundary", None, f"expected places in {system}", file=path)
    epsg = utm_epsg(*middle)
    return _united(polygons, system, epsg, path), epsg


def _polygons(path: Path) -> tuple[list[Any], str]:
    """Polygons of a boundary file and their system."""
    shapely = _shapely()
    with readable("boundary", "GeoJSON, KML or a polygon shapefile", path):
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError("boundary", size, f"expected at most {LARGEST_BYTES} bytes", file=path)
        zipped = zipfile.is_zipfile(path)
        if path.suffix.lower() in (".kml", ".kmz"):
            geometries, crs = _from_kml(path)
        elif zipped or path.is_dir() or path.suffix.lower() == ".shp":
            geometries, crs = read_shapes(path, "boundary")
        else:
            geometries, crs = _from_geojson(path)
        shapes = [shapely.geometry.shape(g) for g in geometries]
    polygons = [s for s in shapes if s.geom_type in ("Polygon", "MultiPolygon") and not s.is_empty]
    if not polygons:
        raise InputError("boundary", [s.geom_type for s in shapes][:3], "expected a polygon", file=path)
    return polygons, known_crs(crs or "EPSG:4326")


def _united(polygons: list[Any], system: str, epsg: int, path: Path) -> Any:
    shapely = _shapely()
    moved = [shapely.transform(s, lambda p: transform(p[:, :2], system, f"EPSG:{epsg}")) for s in polygons]
    if not all(np.isfinite(shapely.get_coordinates(s)).all() for s in moved):
        expected = "expected lon/lat in degrees (GeoJSON in EPSG:4326), or a shapefile with its .prj"
        raise InputError("boundary", None, expected, file=path)
    return largest(shapely.union_all([shapely.make_valid(s) for s in moved]), path)


def covered_ground(cleaned: Cleaned) -> tuple[Any, list[str]]:
    """Polygon that the passes of a log covered, in the log's system [m], and what was left out of it."""
    shapely = _shapely()
    log = cleaned.log
    width = float(np.median(log.width[log.width > 0.0])) if (log.width > 0.0).any() else 0.0
    index = np.flatnonzero(cleaned.cutting)
    ends = (np.diff(index) > 2) | (np.diff(np.cumsum(log.gap)[index]) != 0)
    pieces = np.split(index, np.flatnonzero(ends) + 1)
    lines = [shapely.LineString(log.position[p]).simplify(0.3) for p in pieces if len(p) > 5]
    if not lines or width <= 0.0:
        raise InputError("log", None, "expected at least one pass of 30 m with the header in the crop")
    strips = shapely.union_all([line.buffer(0.5 * width, cap_style="flat") for line in lines])
    grow = CLOSING_WIDTHS * width
    closed = strips.buffer(grow, join_style="mitre").buffer(-grow, join_style="mitre")
    field = largest(closed.simplify(0.5), None)
    notes = []
    if field.area < 0.98 * closed.area:
        notes.append(f"covered ground in several parts: {(closed.area - field.area) / 1e4:.2f} ha left out")
    holes = [ring for ring in field.interiors if shapely.Polygon(ring).area >= SMALLEST_HOLE]
    field = shapely.Polygon(field.exterior, holes)
    bare = 1.0 - strips.intersection(field).area / field.area
    if bare > 0.05:
        notes.append(f"{bare:.0%} of the field has no pass in the log: its crop is taken from beside it")
    return field, notes


def mapped_ground(cleaned: Cleaned) -> tuple[Any, list[str]]:
    """Polygon around the records of a map, in the log's system [m], and what was left out of it."""
    shapely = _shapely()
    kept = cleaned.kept
    width = float(np.median(cleaned.log.width[kept]))
    cells = np.unique(np.floor(cleaned.log.position[kept] / width), axis=0) * width
    ground = shapely.union_all(shapely.box(*cells.T, *(cells + width).T))
    grow = CLOSING_WIDTHS * width
    closed = ground.buffer(grow, join_style="mitre").buffer(-grow, join_style="mitre").simplify(0.5 * width)
    field = largest(closed, None)
    holes = [ring for ring in field.interiors if shapely.Polygon(ring).area >= SMALLEST_HOLE]
    left_out = (closed.area - field.area) / 1e4
    notes = (
        [f"ground in several parts: {left_out:.2f} ha left out"] if left_out > 0.02 * field.area / 1e4 else []
    )
    return shapely.Polygon(field.exterior, holes), notes


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
    """Which points, shape (n, 2), lie in the polygon."""
    shapely = _shapely()
    shapely.prepare(polygon)
    return np.asarray(shapely.contains_xy(polygon, points[:, 0], points[:, 1]))


def _from_geojson(path: Path) -> tuple[list[Any], str]:
    data = read_json(path, "boundary", "GeoJSON or a polygon shapefile")
    if not isinstance(data, dict) or "type" not in data:
        raise InputError("boundary", None, "expected GeoJSON", file=path)
    name = (
        data.get("crs", {}).get("properties", {}).get("name", "") if isinstance(data.get("crs"), dict) else ""
    )
    kind = data["type"]
    if kind == "FeatureCollection":
        return [f["geometry"] for f in data["features"] if f.get("geometry")], name
    if kind == "Feature":
        return [data["geometry"]], name
    return [data], name


def _from_kml(path: Path) -> tuple[list[Any], str]:
    """Polygons of a KML file, or of the first in a KMZ; lon/lat by its standard (OGC 12-007r2)."""
    if zipfile.is_zipfile(path):
        with open_archive(path, "boundary") as archive:
            data = archive.read(next(n for n in archive.namelist() if n.lower().endswith(".kml")))
    else:
        data = path.read_bytes()
    rings = element_texts(data, ("coordinates",))
    polygons: list[Any] = []
    for around, text in rings:
        if "LinearRing" in around:
            ring = [[float(c) for c in place.split(",")[:2]] for place in text.split()]
            if "innerBoundaryIs" in around and polygons:
                polygons[-1]["coordinates"].append(ring)
            else:
                polygons.append({"type": "Polygon", "coordinates": [ring]})
    return polygons, ""


def largest(shape: Any, path: Path | None = None) -> Any:
    """The largest part of a shape; InputError where it is below EMPTY_AREA."""
    parts = [p for p in getattr(shape, "geoms", [shape]) if p.geom_type == "Polygon" and p.area > EMPTY_AREA]
    if not parts:
        raise InputError("boundary", None, f"expected a field of more than {EMPTY_AREA:.0f} m2", file=path)
    return max(parts, key=lambda p: p.area)


def _shapely() -> Any:
    try:
        import shapely
        import shapely.geometry
        import shapely.geometry.polygon
    except ImportError as error:
        raise MissingExtra("geo", "field outlines") from error
    return shapely
