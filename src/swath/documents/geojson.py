"""GeoJSON files (RFC 7946) as they come: geometries with what is said of them, and lines."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.documents.json_file import read_json
from swath.documents.packed import readable

LINES = ("LineString", "MultiLineString")
Shapes = Sequence[tuple[dict[str, Any], Mapping[str, Any]]]
"""Geometries, each with its properties."""


def read_shapes(path: Path, key: str, what: str = "GeoJSON") -> tuple[Shapes, str]:
    """All geometries of a file, and the name of its system, '' = longitude and latitude.

    Features without a geometry are left out. Raises InputError with this key.
    """
    data = read_json(path, key, what)
    if not isinstance(data, dict):
        raise InputError(key, None, f"expected {what}", file=path)
    crs = data.get("crs")
    with readable(key, what, path):
        name = crs.get("properties", {}).get("name", "") if isinstance(crs, dict) else ""
        found = [(f.get("geometry", f), f.get("properties") or {}) for f in data.get("features", [data])]
        shapes = [(shape, notes) for shape, notes in found if shape is not None]
        if not all(isinstance(shape["type"], str) for shape, _ in shapes):
            raise InputError(key, None, f"expected {what}", file=path)
    return shapes, name


def lines_of(shapes: Shapes, path: Path, key: str) -> list[NDArray[np.float64]]:
    """Longitude and latitude [deg] of each line with two points or more, (n, 2), in the order of the file."""
    what = "lines of longitude and latitude"
    with readable(key, what, path):
        found = [
            np.array([(lon, lat) for lon, lat, *_ in line], float)
            for shape, _ in shapes
            if shape["type"] in LINES
            for line in (shape["coordinates"] if shape["type"] == LINES[1] else [shape["coordinates"]])
            if len(line) >= 2
        ]
    if not all((np.abs(line) <= (180.0, 90.0)).all() for line in found):
        raise InputError(key, None, f"expected {what}", file=path)
    return found
