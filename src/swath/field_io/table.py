"""A file of records as columns of text or numbers: CSV (plain or gzip), zipped point shapefile, ISOXML."""

import csv
import gzip
import io
import math
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, MissingExtra
from swath.field_io.isoxml import is_taskdata, read_taskdata
from swath.field_io.taskfiles import readable

Array = NDArray[np.float64]
LARGEST_BYTES = 1 << 30  # of an unpacked log; a season of one combine is about 1e8
_MAGIC = {
    b"\x89PNG": "a PNG image", b"\xff\xd8\xff": "a JPEG image", b"GIF8": "a GIF image", b"%PDF": "a PDF",
    b"II*\x00": "a TIFF image", b"MM\x00*": "a TIFF image", b"\x7fELF": "a program", b"SQLite": "a database",
    b"\xd0\xcf\x11\xe0": "an old office file", b"PAR1": "a Parquet file", b"7z\xbc\xaf": "a 7z archive",
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """Columns of a log as read. columns: name -> list of str or array of numbers, all as long as row_number.

    row_number: line of the text file, or record number of the shapefile, counted from 1
    points: (x, y) of each record, shape (n, 2), when the file has geometry; crs: of the points (WKT), or ''
    broken: reason -> rows left out while reading; notes: what could not be read, file and byte
    """

    columns: dict[str, Any]
    row_number: NDArray[np.int64]
    points: Array | None
    crs: str
    broken: dict[str, int]
    notes: tuple[str, ...] = ()

    def numbers(self, name: str) -> Array:
        """A column as numbers, nan where the text is none."""
        return to_numbers(self.columns[name])

    def texts(self, name: str) -> list[str]:
        """A column as text."""
        values = self.columns[name]
        if isinstance(values, np.ndarray):
            return [f"{v:g}" for v in values]
        return [str(v).strip() for v in values]


def read_table(path: Path) -> Table:
    """Read a log file. Raises InputError for what is none: missing, empty, binary, an image, a web page."""
    if is_taskdata(path):
        return _read_isoxml(path)
    try:
        head = _head(path)
        if head.startswith(b"PK\x03\x04"):
            return _read_shapefile(path)
        with gzip.open(path) if head.startswith(b"\x1f\x8b") else path.open("rb") as stream:
            text = stream.read(LARGEST_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error) or "it is damaged"
        raise InputError("log", None, f"expected a readable file: {reason}", file=path) from error
    if len(text) > LARGEST_BYTES:
        raise InputError("log", len(text), f"expected at most {LARGEST_BYTES} bytes unpacked", file=path)
    return _read_csv(text, path)


def _read_isoxml(path: Path) -> Table:
    """Time logs of ISO 11783-10 task data; of a single TLG file that log alone."""
    data = read_taskdata(path)
    places = sum(log.gaps for log in data.logs)
    return Table(data.columns(), np.arange(1, len(data) + 1), None, "", {"unreadable": places}, data.problems)


def _head(path: Path) -> bytes:
    if path.is_dir():
        raise InputError("log", None, "expected a file, this is a folder", file=path)
    with path.open("rb") as stream:
        head = stream.read(64)
    if not head:
        raise InputError("log", None, "expected a yield log, the file is empty", file=path)
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            raise InputError(
                "log", None, f"expected a yield log (CSV or zipped shapefile), this is {kind}", file=path
            )
    return head


def _read_csv(data: bytes, path: Path) -> Table:
    if b"\x00" in data[:65536]:
        raise InputError(
            "log", None, "expected a yield log (CSV or zipped shapefile), this is binary", file=path
        )
    text = data.decode("utf-8-sig", errors="replace")
    if text.lstrip()[:15].lower().startswith(("<!doctype", "<html", "<?xml")):
        raise InputError(
            "log", None, "expected a yield log (CSV or zipped shapefile), this is a web page", file=path
        )
    first = next((line for line in text.splitlines() if line.strip()), "")
    separator = max(",;\t|", key=first.count)
    if first.count(separator) < 2:
        raise InputError("log.header", first[:80], "expected at least three named columns", file=path, line=1)
    rows, lines, header = _rows(text, separator, path)
    right = [i for i, row in enumerate(rows) if len(row) == len(header)]
    broken = {"wrong_field_count": len(rows) - len(right)}
    columns = {name: [rows[i][k] for i in right] for k, name in enumerate(header)}
    if separator == ";":
        columns = {name: _decimal_points(values) for name, values in columns.items()}
    return Table(columns, np.array([lines[i] for i in right], dtype=np.int64), None, "", broken)


def _rows(text: str, separator: str, path: Path) -> tuple[list[list[str]], list[int], list[str]]:
    reader = csv.reader(io.StringIO(text.replace("\x00", "\ufffd"), newline=""), delimiter=separator)
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError("log", None, f"expected CSV: {error}", file=path, line=reader.line_num) from error
    header = [name.strip() for name in rows[0]]
    twice = sorted({name for name in header if name and header.count(name) > 1})
    if twice:
        raise InputError("log.header", twice[0], "expected each column name once", file=path, line=lines[0])
    return rows[1:], lines[1:], header


def _decimal_points(values: list[str]) -> list[str]:
    return [v.replace(",", ".") if v.count(",") == 1 and "." not in v else v for v in values]


def _read_shapefile(path: Path) -> Table:
    try:
        import shapefile
    except ImportError as error:
        raise MissingExtra("geo", "reading a shapefile") from error
    with readable("log", "a zipped point shapefile", path), zipfile.ZipFile(path) as archive:
        parts = shapefile_parts(archive, path)
        if "dbf" not in parts:
            raise InputError("log", None, "expected a .dbf beside the .shp in the archive", file=path)
        files = {kind: io.BytesIO(archive.read(parts[kind])) for kind in ("shp", "dbf")}
        reader = shapefile.Reader(**files, encoding="utf-8", encodingErrors="replace")
        crs = archive.read(parts["prj"]).decode("utf-8", "replace") if "prj" in parts else ""
        names = [field[0] for field in reader.fields[1:]]
        points = np.array([_point(shape) for shape in reader.iterShapes()], dtype=float).reshape(-1, 2)
        records = [tuple(record) for record in reader.iterRecords()]
    if not records or len(records) != len(points):
        raise InputError(
            "log", None, f"expected as many points as records: {len(points)}, {len(records)}", file=path
        )
    columns = dict(zip(names, (list(c) for c in zip(*records, strict=True)), strict=True))
    return Table(columns, np.arange(1, len(points) + 1), points, crs, {})


def shapefile_parts(archive: zipfile.ZipFile, path: Path, key: str = "log") -> dict[str, str]:
    """Extension -> name of the one shapefile in the archive."""
    infos = [i for i in archive.infolist() if not i.is_dir() and "__MACOSX" not in i.filename]
    if sum(i.file_size for i in infos) > LARGEST_BYTES:
        raise InputError(key, None, f"expected at most {LARGEST_BYTES} bytes unpacked", file=path)
    shapes = [i.filename for i in infos if i.filename.lower().endswith(".shp")]
    if len(shapes) != 1:
        raise InputError(key, None, f"expected one .shp in the archive, found {len(shapes)}", file=path)
    stem = shapes[0][:-4]
    parts = {i.filename[-3:].lower(): i.filename for i in infos if i.filename[:-4] == stem}
    return parts


def _point(shape: Any) -> tuple[float, float]:
    points: Sequence[Any] = shape.points
    return (float(points[0][0]), float(points[0][1])) if len(points) == 1 else (math.nan, math.nan)


def to_numbers(values: Iterable[Any]) -> Array:
    """Numbers of cells, nan where a cell is none. Dates and truth values are not numbers."""
    values = list(values)
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array([_number(v) for v in values], dtype=float)


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
