"""A field from files of others: outlines, guidance lines, a yield log.

Of lines and of a log the direction is taken; lines that cover the field are its passes (plan.py).
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.documents.json_file import read_json

SIMPLER = 0.3  # m, within which points of an outline from a file are left out
LINES = ("LineString", "MultiLineString")
AREAS = ("Polygon", "MultiPolygon", "GeometryCollection")
SHORT = 1.0  # m between the ends of a line, below which it has no direction


@dataclass(frozen=True)
class Params:
    """yield_m: side of the squares in which the yield of a log is averaged, about a header's width."""

    yield_m: float = 10.0


PARAMS = Params()


@dataclass(frozen=True)
class FileField:
    """areas: polygons [m] of a system, epsg; direction of its passes, counter-clockwise from east [rad], and
    grain, its mean yield [kg/m2], nan for none; notes: on what it was taken from; lines: points of each
    (n, 2) [m], in the order of the file; yields: x, y [m] of middles of squares, yield there [kg/m2]
    """

    areas: tuple[Any, ...]
    epsg: int
    direction: float = math.nan
    grain: float = math.nan
    notes: tuple[str, ...] = ()
    lines: tuple[Any, ...] = ()
    yields: tuple[tuple[float, float, float], ...] = ()


def read_field(path: Path, header: float) -> FileField:
    """Task data of ISO 11783-10, GeoJSON, KML or a shapefile. InputError for what is none.

    header: width of the strip [m] that each line covers, of which a file of lines alone is the field
    """
    from swath.field_io.isoxml import is_taskdata
    from swath.field_io.outline import read_outlines

    if not path.exists():
        raise InputError("field.file", str(path), "expected a file that is there")
    if path.suffix.lower() not in (".geojson", ".json", ".kml", ".kmz") and is_taskdata(path):
        return _of_taskdata(path)
    is_json = path.suffix.lower() in (".geojson", ".json")
    shapes = _shapes(path) if is_json else []
    lines = _lines(path, shapes)
    if lines and not any(shape["type"] in AREAS for shape in shapes):
        return _along(_under(lines, header), lines, "lines")
    outlines = read_outlines(path)
    return _along(FileField(outlines.areas, outlines.epsg, notes=outlines.notes), lines, "lines")


def _of_taskdata(path: Path) -> FileField:
    from swath.field_io.plan import largest_part, read_plan
    from swath.field_io.taskdata import drawn, listed

    described = read_plan(path)
    if not described.parts:
        raise InputError("field.file", str(path), "expected a field with a boundary", file=path)
    key, polygon, epsg, notes = largest_part(described)
    unused = described.parts[key].unused + described.unused
    notes += [f"task data, not used: {listed(unused)}"] if unused.total() else []
    made = FileField((polygon,), epsg, notes=(*notes, *described.problems))
    return _along(made, [drawn(p) for p in described.parts[key].guidance], "guidance lines")


def _along(made: FileField, lines: list[Any], what: str) -> FileField:
    """With the direction of the longest of some lines in lon/lat [deg]."""
    from swath.field_io.plan import in_metres

    drawn = tuple(in_metres(np.asarray(line, float), made.epsg) for line in lines)
    drawn = tuple(line for line in drawn if math.dist(line[0], line[-1]) > SHORT)
    if len(drawn) < len(lines):
        said = f"{len(lines) - len(drawn)} of {len(lines)} {what} without a direction are left out"
        made = replace(made, notes=(*made.notes, said))
    if not drawn:
        return made
    longest = max(drawn, key=lambda line: math.dist(line[0], line[-1]))
    (ax, ay), (bx, by) = longest[[0, -1]].tolist()
    direction = math.atan2(by - ay, bx - ax)
    said = (
        f"longest of {len(drawn)} {what}: {math.degrees(direction):.1f} degrees counter-clockwise from east"
    )
    return replace(made, direction=direction, notes=(*made.notes, said), lines=drawn)


def _under(lines: list[Any], header: float) -> FileField:
    """The ground under lines in lon/lat [deg], the largest piece, gaps of less than a header closed."""
    from swath.field.projection import origin_at
    from swath.field_io.plan import in_metres

    middle = np.median(np.concatenate(lines), axis=0)
    epsg = origin_at(float(middle[1]), float(middle[0])).epsg
    metres = [in_metres(line, epsg) for line in lines]
    import shapely  # of the extra of the projection, which is there

    strips = [shapely.LineString(line).buffer(0.5 * header, cap_style="flat") for line in metres]
    grown = shapely.union_all(strips).buffer(0.5 * header, join_style="mitre")
    ground = shapely.get_parts(grown.buffer(-0.5 * header, join_style="mitre"))
    largest = max(ground, key=lambda part: part.area)
    said = f"the file has no outline: the field is the {largest.area / 1e4:.2f} ha under its lines"
    return FileField((largest,), epsg, notes=(said,))


def _shapes(path: Path) -> list[dict[str, Any]]:
    """Geometries of a GeoJSON file."""
    data = read_json(path, "field.file", "GeoJSON")
    features = data.get("features", [data]) if isinstance(data, dict) else []
    if not isinstance(features, list):
        return []
    shapes = [f.get("geometry", f) for f in features if isinstance(f, dict)]
    return [shape for shape in shapes if isinstance(shape, dict) and isinstance(shape.get("type"), str)]


def _lines(path: Path, shapes: list[dict[str, Any]]) -> list[Any]:
    """Points (n, 2) of each line of some geometries [deg]."""
    found: list[Any] = []
    try:
        for shape in shapes:
            if shape["type"] in LINES:
                parts = shape.get("coordinates") or []
                found += parts if shape["type"] == LINES[1] else [parts]
        lines = [np.array([p[:2] for p in line], float) for line in found if len(line) >= 2]
    except (TypeError, ValueError, IndexError):
        lines = [np.full((2, 2), math.inf)]
    if any(line.shape != (len(line), 2) or not (np.abs(line) <= (180.0, 90.0)).all() for line in lines):
        raise InputError("field.file", str(path), "expected lines of longitude and latitude", file=path)
    return lines


def read_log_field(path: Path) -> FileField:
    """Ground that a yield log covers, with the direction of its passes and its mean yield."""
    from swath.field.projection import Origin
    from swath.field_io.clean import clean
    from swath.field_io.importer import find_log
    from swath.field_io.log import read_log
    from swath.field_io.outline import covered_ground
    from swath.field_io.passes import make_tracks, row_azimuth

    log = read_log(find_log(path))
    cleaned = clean(log)
    ground, notes = covered_ground(cleaned)
    origin = Origin(log.epsg, float(log.east.min()), float(log.north.min()))
    direction = 0.5 * math.pi - row_azimuth(make_tracks(cleaned, origin))
    known = cleaned.kept & np.isfinite(cleaned.grain)
    grain = float(cleaned.grain[known].mean()) if known.any() else math.nan
    yields, told = _in_squares(log.position[known], cleaned.grain[known])
    said = f"passes are planned along those of the log, {math.degrees(direction):.1f} degrees"
    return FileField(
        (ground,), log.epsg, direction, grain,
        (*log.notes, *notes, f"{said} counter-clockwise from east", *told), yields=yields,
    )  # fmt: skip


def _in_squares(position: Any, grain: Any) -> tuple[tuple[tuple[float, float, float], ...], list[str]]:
    """Mean yields of squares, and what is to be told of them. position (n, 2) [m]; grain (n,) [kg/m2]"""
    if not len(grain):
        return (), []
    side = PARAMS.yield_m
    squares, number = np.unique(np.floor(position / side), axis=0, return_inverse=True)
    mean = np.bincount(number.ravel(), grain) / np.bincount(number.ravel())
    low, high = np.percentile(10.0 * mean, [5.0, 95.0])
    told = f"yield varies as in the log, {low:.1f} to {high:.1f} t/ha in 90 % of squares of {side:g} m"
    middles = side * (squares + 0.5)
    return tuple(zip(*middles.T.tolist(), mean.tolist(), strict=True)), [f"{told}; elsewhere it is the mean"]
