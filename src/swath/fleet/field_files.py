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


@dataclass(frozen=True)
class FileField:
    """areas: polygons [m] of a system, epsg; direction of its passes, counter-clockwise from east [rad], and
    grain, its mean yield [kg/m2], nan for none; notes: on what it was taken from; lines: points of each
    (n, 2) [m], in the order of the file
    """

    areas: tuple[Any, ...]
    epsg: int
    direction: float = math.nan
    grain: float = math.nan
    notes: tuple[str, ...] = ()
    lines: tuple[Any, ...] = ()


def read_field(path: Path) -> FileField:
    """Task data of ISO 11783-10, GeoJSON, KML or a shapefile. InputError for what is none."""
    from swath.field_io.isoxml import is_taskdata
    from swath.field_io.outline import read_outlines

    if not path.exists():
        raise InputError("field.file", str(path), "expected a file that is there")
    if path.suffix.lower() not in (".geojson", ".json", ".kml", ".kmz") and is_taskdata(path):
        return _of_taskdata(path)
    outlines = read_outlines(path)
    made = FileField(outlines.areas, outlines.epsg, notes=outlines.notes)
    lines = _lines(path) if path.suffix.lower() in (".geojson", ".json") else []
    return _along(made, lines, "lines")


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

    if not lines:
        return made
    drawn = tuple(in_metres(np.asarray(line, float), made.epsg) for line in lines)
    longest = max(drawn, key=lambda line: math.dist(line[0], line[-1]))
    (ax, ay), (bx, by) = longest[[0, -1]].tolist()
    direction = math.atan2(by - ay, bx - ax)
    said = (
        f"longest of {len(lines)} {what}: {math.degrees(direction):.1f} degrees counter-clockwise from east"
    )
    return replace(made, direction=direction, notes=(*made.notes, said), lines=drawn)


def _lines(path: Path) -> list[Any]:
    """Lines of a GeoJSON file."""
    data = read_json(path, "field.file", "GeoJSON")
    features = data.get("features", [data]) if isinstance(data, dict) else []
    found: list[Any] = []
    for feature in features:
        shape = feature.get("geometry") or {} if isinstance(feature, dict) else {}
        if isinstance(shape, dict) and shape.get("type") in LINES:
            parts = shape.get("coordinates") or []
            found += parts if shape["type"] == LINES[1] else [parts]
    try:
        return [np.array([p[:2] for p in line], float) for line in found if len(line) >= 2]
    except (TypeError, ValueError, IndexError):
        raise InputError("field.file", str(path), "expected lines of longitude and latitude") from None


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
    known = cleaned.grain[cleaned.kept & np.isfinite(cleaned.grain)]
    grain = float(known.mean()) if len(known) else math.nan
    said = f"passes are planned along those of the log, {math.degrees(direction):.1f} degrees"
    return FileField(
        (ground,), log.epsg, direction, grain,
        (*log.notes, *notes, f"{said} counter-clockwise from east"),
    )  # fmt: skip
