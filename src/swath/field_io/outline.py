"""The outline of a field: from a file, or the ground its passes covered."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, MissingExtra
from swath.documents.json_file import read_json
from swath.documents.packed import open_archive, readable
from swath.field.projection import known_crs, transform
from swath.field_io.clean import Cleaned
from swath.field_io.table import shapefile_parts

Array = NDArray[np.float64]
CLOSING_WIDTHS = 1.1  # header widths: gaps between passes up to twice this are inside the field
SMALLEST_HOLE = 400.0  # m2: what is left out inside the field and larger is no crop
LARGEST_BYTES = 1 << 27
EMPTY_AREA = 100.0  # m2: less is no field


def read_outline(path: Path, epsg: int) -> Any:
    """Polygon of a boundary file in the system epsg [m]: GeoJSON (lon/lat) or polygon shapefile, zipped too.

    Several polygons are united; the largest part is the field. Raises InputError.
    """
    shapely = _shapely()
    with readable("boundary", "GeoJSON or a polygon shapefile", path):
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError("boundary", size, f"expected at most {LARGEST_BYTES} bytes", file=path)
        with path.open("rb") as stream:
            zipped = stream.read(4) == b"PK\x03\x04"
        is_bare = path.suffix.lower() == ".shp"
        geometries, crs = (_from_zip if zipped else _from_shp if is_bare else _from_geojson)(path)
        shapes = [shapely.geometry.shape(g) for g in geometries]
    polygons = [s for s in shapes if s.geom_type in ("Polygon", "MultiPolygon") and not s.is_empty]
    if not polygons:
        raise InputError("boundary", [s.geom_type for s in shapes][:3], "expected a polygon", file=path)
    system = known_crs(crs or "EPSG:4326")
    moved = [shapely.transform(s, lambda p: transform(p[:, :2], system, f"EPSG:{epsg}")) for s in polygons]
    if not all(np.isfinite(shapely.get_coordinates(s)).all() for s in moved):
        expected = "expected lon/lat in degrees (GeoJSON in EPSG:4326), or a shapefile with its .prj"
        raise InputError("boundary", None, expected, file=path)
    return _largest(shapely.union_all([shapely.make_valid(s) for s in moved]), path)


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
    field = _largest(closed.simplify(0.5), None)
    notes = []
    if field.area < 0.98 * closed.area:
        notes.append(f"covered ground in several parts: {(closed.area - field.area) / 1e4:.2f} ha left out")
    holes = [ring for ring in field.interiors if shapely.Polygon(ring).area >= SMALLEST_HOLE]
    field = shapely.Polygon(field.exterior, holes)
    bare = 1.0 - strips.intersection(field).area / field.area
    if bare > 0.05:
        notes.append(f"{bare:.0%} of the field has no pass in the log: its crop is taken from beside it")
    return field, notes


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


def _from_shp(path: Path) -> tuple[list[Any], str]:
    prj = path.with_suffix(".prj")
    with path.open("rb") as stream:
        shapes = _shapes(stream)
    return shapes, prj.read_text(encoding="utf-8", errors="replace") if prj.is_file() else ""


def _from_zip(path: Path) -> tuple[list[Any], str]:
    with open_archive(path, "boundary") as archive:
        parts = shapefile_parts(archive, path, "boundary")
        shp, prj = parts["shp"], parts.get("prj")
        with archive.open(shp) as stream:
            shapes = _shapes(stream)
        return shapes, archive.read(prj).decode("utf-8", "replace") if prj else ""


def _shapes(stream: Any) -> list[Any]:
    try:
        import shapefile
    except ImportError as error:
        raise MissingExtra("geo", "reading a shapefile") from error
    return [shape.__geo_interface__ for shape in shapefile.Reader(shp=stream).shapes()]


def _largest(shape: Any, path: Path | None) -> Any:
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
