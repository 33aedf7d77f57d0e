"""Guidance lines out of a GeoJSON file: lon/lat (RFC 7946) in the field's frame."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.projection import Origin
from swath.field_io.folder_files import AnyGeometry, Feature, Features, read_features

Array = NDArray[np.float64]
Lines = Features[Feature[AnyGeometry, dict[str, Any] | None]]


def read_line(origin: Origin | None, file: str, index: int) -> Array:
    """The n-th line, in the order in which they stand in the file: points (n, 2) of the field's frame [m].

    origin: of the field on Earth. InputError where there is none, or no such line
    """
    if origin is None:
        raise InputError("file", file, "expected a field that lies on Earth, with an origin")
    lines: list[Any] = []
    for feature in read_features(Path(file), Lines).features:
        geometry: Any = feature.geometry
        if geometry.type == "LineString":
            lines.append(geometry.coordinates)
        elif geometry.type == "MultiLineString":
            lines += geometry.coordinates
    if index >= len(lines):
        raise InputError("line", index, f"expected less than the {len(lines)} lines of the file")
    return origin.to_local([position[:2] for position in lines[index]])
