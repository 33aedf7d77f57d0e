"""GeoJSON files (RFC 7946) as they come: geometries with what is said of them, lines, and records."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.documents.foreign import refuse_foreign
from swath.documents.json_file import read_json
from swath.documents.packed import readable

Array = NDArray[np.float64]
Shapes = Sequence[tuple[dict[str, Any], Mapping[str, Any]]]
"""Geometries, each with its properties."""
NOWHERE: dict[str, Any] = {"type": "GeometryCollection", "geometries": []}
"""The geometry of a feature that has none."""


def read_shapes(path: Path, key: str, what: str = "GeoJSON") -> tuple[Shapes, str]:
    """All geometries of a file, and the name of its system, '' = longitude and latitude.

    Raises InputError with this key.
    """
    refuse_foreign(path, key)
    data = read_json(path, key, what)
    if not isinstance(data, dict):
        raise InputError(key, None, f"expected {what}", file=path)
    with readable(key, what, path):
        features = data.get("features", [data])
        shapes = [(f.get("geometry", f) or NOWHERE, _said(f.get("properties") or {})) for f in features]
        if not all(isinstance(shape["type"], str) for shape, _ in shapes):
            raise InputError(key, None, f"expected {what}", file=path)
    return shapes, _system(data.get("crs"))


def _said(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Properties of a feature, with the tags that OpenStreetMap's own exports keep one level below."""
    inner = properties.get("tags")
    return {**properties, **inner} if isinstance(inner, dict) else dict(properties)


def _system(crs: Any) -> str:
    """The name of a system: as text, as the format of 2008 says it, or by its number as that of 2006 does."""
    about = crs.get("properties") if isinstance(crs, dict) else None
    if isinstance(about, dict):
        return str(about.get("name") or (f"EPSG:{about['code']}" if "code" in about else ""))
    return crs if isinstance(crs, str) else ""


def pieces(shape: Mapping[str, Any]) -> Iterator[tuple[str, list[Array]]]:
    """`Polygon`, `LineString` and `Point` of which a geometry consists, each with its rings or its one line,
    (n, 2). ValueError for what is no geometry.
    """
    kind = shape["type"]
    if kind == NOWHERE["type"]:
        for inner in shape["geometries"]:
            yield from pieces(inner)
    elif kind.startswith("Multi"):
        for part in shape["coordinates"]:
            yield from pieces({"type": kind.removeprefix("Multi"), "coordinates": part})
    elif kind in ("Polygon", "LineString", "Point"):
        nested = {"Polygon": 0, "LineString": 1, "Point": 2}[kind]
        rings = shape["coordinates"]
        for _ in range(nested):
            rings = [rings]
        yield kind, [_places(ring) for ring in rings]
    else:
        raise ValueError(f"{kind!r} is no geometry of GeoJSON")


def _places(points: Any) -> Array:
    """Places of a line, their heights left out, nan where they are null, (n, 2)."""
    return np.array([(x, y) for x, y, *_ in points], float).reshape(-1, 2)


def lines_of(shapes: Shapes, path: Path, key: str) -> list[Array]:
    """Longitude and latitude [deg] of each line with two points or more, (n, 2), in the order of the file."""
    what = "lines of longitude and latitude"
    with readable(key, what, path):
        found = [line for shape, _ in shapes for kind, (line, *_) in pieces(shape) if kind == "LineString"]
    found = [line for line in found if len(line) >= 2]
    if not all((np.abs(line) <= (180.0, 90.0)).all() for line in found):
        raise InputError(key, None, f"expected {what}", file=path)
    return found


def read_records(path: Path, key: str) -> tuple[dict[str, list[Any]], Array, str]:
    """Columns, places (n, 2) and the name of the system ('' = longitude and latitude) of a file of records:
    each feature is one, its place a point or the middle of an area. Raises InputError with this key.
    """
    shapes, crs = read_shapes(path, key, "GeoJSON of records")
    with readable(key, "GeoJSON of records", path):
        places = np.array([_middle(shape) for shape, _ in shapes], float).reshape(-1, 2)
    names = dict.fromkeys(name for _, said in shapes for name in said)
    return {str(name): [said.get(name) for _, said in shapes] for name in names}, places, crs


def _middle(shape: Mapping[str, Any]) -> Array:
    """The middle of the corners of a record's first piece, nan where it is a line or nothing."""
    kind, rings = next(pieces(shape), ("", []))
    if kind not in ("Polygon", "Point") or not rings or not len(rings[0]):
        return np.full(2, np.nan)
    return np.asarray(np.mean(rings[0][:-1] if kind == "Polygon" else rings[0], axis=0), float)
