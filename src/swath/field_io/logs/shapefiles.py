"""Shapefiles: bare, in a folder, or in a zip archive; with the units and crop that John Deere adds."""

import io
import json
import math
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError
from swath.documents.packed import LARGEST_BYTES, open_archive
from swath.field_io.logs.columns import FLOWS, guess

Array = NDArray[np.float64]
Parts = dict[str, Callable[[], bytes]]
METADATA = "-Deere-Metadata.json"
FEWEST_RECORDS = 100  # a farm has fewer fields, and none a yield of its own in its outline
KIND, POLYGONS = slice(32, 36), (5, 15, 25)  # of the shapes, in the head of a .shp (ESRI white paper of 1998)


@contextmanager
def shapefile_parts(path: Path, key: str) -> Iterator[Parts]:
    """Ending (`shp`, `dbf`, `prj`, `cpg`, METADATA) -> what reads it, of the one shapefile in a zip, folder,
    or of a bare .shp. InputError with this key where there is not exactly one.
    """
    if os.path.isdir(path) or path.suffix.lower() == ".shp":
        folder = path if os.path.isdir(path) else path.parent
        files = {
            str(p): p.read_bytes for p in sorted(folder.rglob("*")) if os.path.isfile(p) and _is_part(p.name)
        }
        yield _of_one(files, path, key, None if os.path.isdir(path) else path)
        return
    with open_archive(path, key) as archive:
        members = [
            i for i in archive.infolist() if not i.filename.endswith("/") and "__MACOSX" not in i.filename
        ]
        yield _of_one({i.filename: partial(archive.read, i) for i in members}, path, key, None)


def _is_part(name: str) -> bool:
    return name.lower().endswith((".shp", ".dbf", ".prj", ".cpg", METADATA.lower()))


def _of_one(files: Parts, path: Path, key: str, only: Path | None) -> Parts:
    shapes = [n for n in files if n.lower().endswith(".shp")] if only is None else [str(only)]
    if len(shapes) != 1:
        raise InputError(key, None, f"expected one .shp in it, found {len(shapes)}", file=path)
    stem = shapes[0][:-4]
    own = {n[len(stem) :]: read for n, read in files.items() if n.startswith(stem)}
    parts = {end[1:].lower(): read for end, read in own.items() if len(end) == 4 and end[0] == "."}
    return parts | ({METADATA: own[METADATA]} if METADATA in own else {})


def has_shapefile(folder: Path) -> bool:
    """True for a folder that holds a .shp, or one of its folders does."""
    return any(p.suffix.lower() == ".shp" for p in folder.rglob("*"))


def is_of_polygons(path: Path) -> bool:
    """True for one shapefile, bare, in a folder or in a zip, whose shapes are polygons and no records."""
    is_zip = path.suffix.lower() == ".zip"
    if not (is_zip or path.suffix.lower() == ".shp" or (os.path.isdir(path) and has_shapefile(path))):
        return False
    try:
        with shapefile_parts(path, "log") as parts:
            kind = int.from_bytes(parts["shp"]()[KIND], "little")
            table = _reader(dbf=io.BytesIO(parts["dbf"]())) if kind in POLYGONS and "dbf" in parts else None
            names = [] if table is None else [field[0] for field in table.fields[1:]]
            return kind in POLYGONS and not are_records(0 if table is None else table.numRecords, names, path)
    except (InputError, OSError):
        return False


def are_records(count: int, names: Sequence[str], path: Path) -> bool:
    """Whether so many polygons with these attributes are records of a harvest, not fields."""
    return count >= FEWEST_RECORDS and any(key in FLOWS for key in guess(names, path).columns)


def read_points(path: Path, key: str) -> tuple[dict[str, list[Any]], Array, str, dict[str, Any], int]:
    """Columns, points (n, 2), crs (WKT), the maker's metadata of a point shapefile, and how many records it
    states; of one that is cut off what is whole. Raises InputError.
    """
    with shapefile_parts(path, key) as parts:
        if "dbf" not in parts:
            raise InputError(key, None, "expected a .dbf beside the .shp", file=path)
        data = {kind: parts[kind]() for kind in ("shp", "dbf")}
        if sum(map(len, data.values())) > LARGEST_BYTES:
            raise InputError(key, None, f"expected at most {LARGEST_BYTES} bytes", file=path)
        reader = _reader(
            shp=io.BytesIO(data["shp"]), dbf=io.BytesIO(data["dbf"]), encoding=_encoding(parts, data)
        )
        points = [_point(shape) for shape in _whole(reader.iterShapes())]
        records = [list(record) for record in _whole(reader.iterRecords())]
        count = min(len(points), len(records))
        if not count:
            expected = f"expected as many points as records: {len(points)}, {len(records)}"
            raise InputError(key, None, expected, file=path)
        names = [field[0] for field in reader.fields[1:]]
        columns = {name: [record[i] for record in records[:count]] for i, name in enumerate(names)}
        made = np.array(points[:count], dtype=float).reshape(-1, 2)
        stated = max(len(points), len(records), reader.numRecords)
        return columns, made, _crs(parts), _metadata(parts), stated


def _whole(items: Iterator[Any]) -> Iterator[Any]:
    """Those of a file before it is cut off."""
    while True:
        try:
            yield next(items)
        except (StopIteration, struct.error, IndexError, ValueError, TypeError, OSError):
            return


def read_rings(path: Path, key: str) -> tuple[list[tuple[list[Any], dict[str, Any]]], str]:
    """The rings of each polygon, points (x, y), with what is said of it, and the crs (WKT)."""
    with shapefile_parts(path, key) as parts:
        shapes = _reader(shp=io.BytesIO(parts["shp"]())).shapes()
        said: list[dict[str, Any]] = [{}] * len(shapes)
        if "dbf" in parts:
            data = {"dbf": parts["dbf"]()}
            records = _reader(dbf=io.BytesIO(data["dbf"]), encoding=_encoding(parts, data)).records()
            said = [record.as_dict() for record in records] if len(records) == len(shapes) else said
        both = zip(shapes, said, strict=True)
        return [(_rings(s), about) for s, about in both if s.shapeType in POLYGONS], _crs(parts)


def _rings(shape: Any) -> list[Any]:
    ends = [*shape.parts[1:], len(shape.points)]
    points = [tuple(p[:2]) for p in shape.points]
    return [points[a:b] for a, b in zip(shape.parts, ends, strict=True)]


def _reader(**files: Any) -> Any:
    with Extra("geo", "reading a shapefile"):
        import shapefile
    return shapefile.Reader(**files, encodingErrors="replace")


def _encoding(parts: Parts, data: dict[str, bytes]) -> str:
    """Encoding by the .cpg file; without one UTF-8 where the table is that, else the code page of Windows."""
    stated = parts["cpg"]().decode("ascii", "replace").strip().lower() if "cpg" in parts else ""
    if stated in ("utf-8", "utf8", "65001"):
        return "utf-8"
    try:
        table, head = data["dbf"], int.from_bytes(data["dbf"][8:10], "little")
        b"".join([*(table[i : i + 11] for i in range(32, head, 32)), table[head:]]).decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _crs(parts: Parts) -> str:
    return parts["prj"]().decode("utf-8", "replace") if "prj" in parts else ""


def _metadata(parts: Parts) -> dict[str, Any]:
    try:
        found = json.loads(parts[METADATA]()) if METADATA in parts else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _point(shape: Any) -> tuple[float, float]:
    """Place of a shape; of a polygon, which is what a header cut in a step, the middle of its corners."""
    points: Sequence[Any] = shape.points[:-1] if shape.shapeType in POLYGONS else shape.points
    if not points or (len(points) > 1 and shape.shapeType not in POLYGONS):
        return math.nan, math.nan
    x, y = np.mean([p[:2] for p in points], axis=0).tolist()
    return float(x), float(y)
