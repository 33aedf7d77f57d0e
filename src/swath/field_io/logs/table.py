"""A file of records as columns: CSV (plain or gzip), point shapefile, ISOXML, MF4, BLF, ASC."""

import codecs
import csv
import gzip
import io
import math
import os
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, compress, islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, reason_of
from swath.core.files.read_file import open_to_read
from swath.core.registry import installed, installed_part
from swath.documents.foreign import refuse_foreign
from swath.documents.geojson import read_records
from swath.documents.packed import LARGEST_BYTES, most_unpacked, readable
from swath.field_io.logs.channels import Channels, open_channels
from swath.field_io.logs.columns import AG_LEADER, AG_LEADER_2000, unit_symbol
from swath.field_io.logs.held import Chosen, Held, at_rows, known_names, shown_names, times_of
from swath.field_io.logs.shapefiles import has_shapefile, read_points
from swath.field_io.task_data.isoxml import is_taskdata, read_taskdata
from swath.field_io.trade import sheet_of

Array = NDArray[np.float64]
LONGEST_ROW = 1 << 16  # characters
LONGEST_BLANK = 1 << 22  # characters between two rows: sheets are exported with blank ones at their end
MOST_COLUMNS = 1000
ROWS_AT_ONCE = 8192
SHAPES = b"\x00\x00\x27\x0a"  # of a .shp
LEAST_HEIGHT, FEWEST_HEIGHTS = (
    25.0,
    5,
)  # of a last column: a dilution of precision is below, a code one number
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
OR_CP1252 = "swath.or_cp1252"
_EXPECTED = "expected a log (CSV, shapefile, ISOXML, MF4, BLF or ASC)"
_MAGIC = {
    b"\x89PNG": "a PNG image", b"\xff\xd8\xff": "a JPEG image", b"GIF8": "a GIF image", b"%PDF": "a PDF",
    b"II*\x00": "a TIFF image", b"MM\x00*": "a TIFF image", b"\x7fELF": "a program", b"SQLite": "a database",
    b"\xd0\xcf\x11\xe0": "an old office file", b"PAR1": "a Parquet file", b"7z\xbc\xaf": "a 7z archive",
}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """Columns of a log as read. columns: name -> its cells as text, list or array; all as long as row_number.

    row_number: line of the text file, or record number of the shapefile, counted from 1
    points: (x, y) of each record, shape (n, 2), when the file has geometry
    crs: of the points (WKT), or ''
    broken: reason -> rows left out while reading
    stated: rows that the file says it has, None = it does not say
    notes: what could not be read, file and byte
    units: column -> unit, and crop: what the maker's metadata say beside the table
    stated_width: of the header [m], shape (n,), that the machines state and no record holds
    """

    columns: dict[str, Any]
    row_number: NDArray[np.int64]
    points: Array | None
    crs: str
    broken: dict[str, int]
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    crop: str = ""
    stated_width: Array | None = None
    stated: int | None = None

    def numbers(self, name: str) -> Array:
        """A column as numbers, nan where the text is none."""
        return to_numbers(self.columns[name])

    def texts(self, name: str) -> list[str]:
        """A column as text."""
        values = self.columns[name]
        if isinstance(values, np.ndarray):
            return [f"{v:g}" for v in values]
        return [str(v).strip() for v in values]


class Cells:
    """The text of a column in packed blocks: a cell takes about as many bytes as in the file."""

    def __init__(self) -> None:
        self._blocks: list[Any] = []

    def append(self, cells: Iterable[str]) -> None:
        """Append a block."""
        import pyarrow as pa

        self._blocks.append(pa.array(cells, pa.string()))

    def __iter__(self) -> Iterator[str]:
        return (cell for block in self._blocks for cell in block.to_pylist())

    def numbers(self) -> Array:
        """A column as numbers, nan where a cell is none."""
        return np.concatenate([_floats(block) for block in self._blocks] or [np.zeros(0)])


def read_table(path: Path) -> Table:
    """Read a log file. Raises InputError for what is none: missing, empty, binary, an image, a web page.

    An installed package may read files of an ending: its entry point `log.ENDING` gets the path and returns a
    Table.
    """
    ending = path.suffix.lstrip(".").lower()
    if (package := installed("log").get(ending)) is not None:
        table = installed_part("log", ending)(path)
        if not isinstance(table, Table):
            raise InputError("log", str(path), f"expected a Table of the reader of package {package}")
        return replace(table, notes=(*table.notes, f"form: read by the installed package {package}"))
    with readable("log", "a readable file", path):
        if (channels := open_channels(path)) is not None:
            return _read_channels(channels)
        if is_taskdata(path):
            return _read_isoxml(path)
        refuse_foreign(path, "log")
        if ending in ("geojson", "json"):
            columns, points, crs = read_records(path, "log")
            return Table(columns, np.arange(1, len(points) + 1), points, crs, {})
        head = _head(path)
        if not head or head.startswith((b"PK\x03\x04", SHAPES)):
            return _read_shapefile(path)
        is_packed = head.startswith(b"\x1f\x8b")
        file = open_to_read(path, "log", "a yield log")
        with file, gzip.open(file) if is_packed else file as stream:
            start = stream.read(65536)
            stream.seek(0)
            packed = most_unpacked(path.stat().st_size) if is_packed else LARGEST_BYTES
            encoding = "utf-16" if start.startswith(UTF_16) else "utf-8-sig"
            with io.TextIOWrapper(stream, encoding, OR_CP1252, newline="") as text:
                return _read_csv(start, _Lines(text, path, min(packed, LARGEST_BYTES)), path)


def _read_channels(log: Channels) -> Table:
    """A row at each sample of the position, else of the speed, else of the first channel that is known."""
    shown, known = shown_names(log), known_names(log)
    columns = {name: column for column, name in shown.items()}
    leader = next((known[key] for key in ("lat", "easting", "speed") if key in known), None)
    leader = leader or next(iter(known.values()), next(iter(shown.values()), ""))
    if not leader:
        raise InputError("log", None, "expected channels of numbers", file=log.path)
    columns, chosen = {name: column for column, name in shown.items()}, Chosen()

    def choose(names: Mapping[str, str]) -> None:
        chosen.add(log, names, lambda key, source: f'{key}: {{column: "{columns[source]}"}}')

    choose({leader: leader, **{name: key for key, name in known.items()}})
    lead = chosen.of(leader)
    rows = np.unique(np.concatenate([*times_of(log, lead).values()]))
    kept: dict[str, Array] = {}
    lost: dict[str, int] = {}

    def read(*names: str) -> None:
        found, more = at_rows(log, {name: chosen.of(name) for name in names}, dict.fromkeys(names, rows))
        kept.update(found)
        lost.update(more)

    def one(name: str) -> Array:
        if name not in kept:
            if name not in chosen.parts:
                choose({name: name})
            read(name)
        return kept[name]

    held: dict[str, Any] = {column: Held(name, one) for column, name in shown.items()}
    if "time" not in known:
        held = {"time [s]": rows / 1e9, **held}
    read(*(name for name in known.values() if name not in chosen.refused))
    counted = (f"{note} ({count})" for note, count in {**log.notes, **lost}.items())
    notes = (f"form: a row at each sample of {leader}", *counted, *dict.fromkeys(chosen.notes))
    stated = None if log.lacking is None else len(rows) + sum(log.lacking.get(part, 0) for part in lead)
    return Table(held, np.arange(1, len(rows) + 1), None, "", {}, notes, stated=stated)


def _read_isoxml(path: Path) -> Table:
    """Time logs of ISO 11783-10 task data; of a single TLG file that log alone."""
    data = read_taskdata(path)
    places = sum(log.gaps for log in data.logs)
    rows, broken = np.arange(1, len(data) + 1), {"unreadable": places}
    columns, width, notes = data.table()
    crop = "" if "crop" in columns else max(data.crops)
    all_notes = (*notes, *data.problems)
    return Table(columns, rows, None, "", broken, all_notes, crop=crop, stated_width=width)


def _or_cp1252(error: UnicodeError) -> tuple[str, int]:
    """Bytes that are not UTF-8, as Windows writes them."""
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("cp1252", "replace"), error.end


codecs.register_error(OR_CP1252, _or_cp1252)


def _head(path: Path) -> bytes:
    """The first bytes of a file, none of a folder that holds a shapefile."""
    if os.path.isdir(path):
        if has_shapefile(path):
            return b""
        expected = "expected a file, or a folder with a shapefile or TASKDATA.XML in it"
        raise InputError("log", None, expected, file=path)
    with open_to_read(path, "log", "a yield log") as stream:
        head = stream.read(64)
    if not head:
        raise InputError("log", None, "expected a yield log, the file is empty", file=path)
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            raise InputError("log", None, f"{_EXPECTED}, this is {kind}", file=path)
    return head


def _read_csv(start: bytes, lines: "_Lines", path: Path) -> Table:
    """Read it row by row; start: of the file, which shows what it is."""
    is_wide = start.startswith(UTF_16)
    if b"\x00" in start and not is_wide:
        raise InputError("log", None, f"{_EXPECTED}, this is binary", file=path)
    text = start.decode("utf-16" if is_wide else "utf-8-sig", errors="replace")
    if text.lstrip()[:15].lower().startswith(("<!doctype", "<html", "<?xml")):
        raise InputError("log", None, f"{_EXPECTED}, this is a web page", file=path)
    first = next((line for line in text.splitlines() if line.strip()), "")
    separator = max(",;\t|", key=first.count)
    if first.count(separator) < 2:
        raise InputError("log.header", first[:80], "expected at least three named columns", file=path, line=1)
    rows = _rows(lines, separator, path)
    line, names = next(rows)
    known = _without_header(names)
    if known:
        rows = chain([(line, names)], rows)
        names = known
    header = _header(names, line, path)
    cells = {name: Cells() for name in header}
    numbers, wrong = array("q"), 0
    while block := list(islice(rows, ROWS_AT_ONCE)):
        whole = [len(row) == len(header) for _, row in block]
        wrong += whole.count(False)
        kept = zip(*(block if all(whole) else compress(block, whole)), strict=True)
        numbers.extend(next(kept, ()))
        for name, column in zip(header, zip(*next(kept, ()), strict=True), strict=False):
            cells[name].append(_decimal_points(column) if separator != "," else column)
    notes: tuple[str, ...] = ()
    if known and (last := header[-1]) in ("GPS status", "PDOP"):
        values = to_numbers(cells[last])
        if np.median(values) > LEAST_HEIGHT and len(np.unique(values)) >= FEWEST_HEIGHTS:
            cells["Elevation"] = cells.pop(last)  # columns before it are left out
        else:
            notes = (f"form: no header line: column {len(header)} taken as {last}, not as the height",)
    return Table(cells, np.array(numbers, dtype=np.int64), None, "", {"wrong_field_count": wrong}, notes)


def _without_header(first: list[str]) -> list[str]:
    """Names of the columns of a file whose first row holds no names: those of Ag Leader, else numbers; empty
    for a header.
    """
    numbers = np.isfinite(to_numbers(first))
    if numbers.sum() < 3 or numbers.mean() <= 0.5:
        return []
    return _ag_leader(first) or [f"column {i + 1}" for i in range(len(first))]


def _ag_leader(first: list[str]) -> list[str]:
    """Names where the row is one of Ag Leader: 13 to 17 cells, eight of them these numbers, then the header's
    status.
    """
    if not 13 <= len(first) <= len(AG_LEADER):
        return []
    lon, lat, flow, _, interval, _, width, moisture = to_numbers(first[:8])
    limits = abs(lon) <= 180 and abs(lat) <= 90 and 0 <= flow < 300 and 0 < interval < 60
    if not (
        np.isfinite(to_numbers(first[:8])).all() and limits and 0 <= width < 1000 and 0 <= moisture < 100
    ):
        return []
    by_word = first[8].strip().lower() in ("up", "down")
    if not by_word and not to_numbers(first[8:9])[0] >= 0:
        return []
    names = list(AG_LEADER_2000 if by_word else AG_LEADER)
    usual = names.index("Crop")
    crop = next((i for i in range(9, len(first)) if sheet_of(first[i].strip(' "'))), usual)
    between = names[9:crop] if crop == usual else [f"column {i + 1}" for i in range(9, crop)]
    return [*names[:9], *between, *names[usual:]][: len(first)]


def _header(names: list[str], line: int, path: Path) -> list[str]:
    header = [name.strip() or f"column {i + 1}" for i, name in enumerate(names)]
    if len(header) > MOST_COLUMNS:
        raise InputError("log.header", len(header), f"expected at most {MOST_COLUMNS} columns", file=path)
    twice = sorted(name for name, count in Counter(header).items() if count > 1)
    if twice:
        raise InputError("log.header", twice[0], "expected each column name once", file=path, line=line)
    return header


def _rows(lines: "_Lines", separator: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of each row that is not blank."""
    reader = csv.reader(lines, delimiter=separator)
    read = until = 0  # characters, and those up to the last row that is not blank
    try:
        for row in reader:
            read += lines.since_row
            lines.since_row = 0
            if read > lines.most:
                raise InputError("log", None, "expected less unpacked from a file of its size", file=path)
            if "".join(row).strip():
                until = read
                yield reader.line_num, row
            elif read - until > LONGEST_BLANK:
                expected = f"expected rows, here are {LONGEST_BLANK} characters without one"
                raise InputError("log", None, expected, file=path, line=reader.line_num)
    except csv.Error as error:
        raise InputError(
            "log", None, f"expected CSV: {reason_of(error)}", file=path, line=reader.line_num
        ) from error


class _Lines:
    """Lines of a text; InputError for a row that is longer than a log's. most: characters of the whole.

    since_row: of the row that is being read
    """

    def __init__(self, text: TextIO, path: Path, most: int) -> None:
        self._text, self._path = text, path
        self.most, self.since_row = most, 0

    def __iter__(self) -> Iterator[str]:
        for number, line in enumerate(iter(partial(self._text.readline, LONGEST_ROW + 1), ""), 1):
            self.since_row += len(line)
            if self.since_row > LONGEST_ROW:
                expected = f"expected rows of at most {LONGEST_ROW} characters"
                raise InputError("log", None, expected, file=self._path, line=number)
            yield line.replace("\x00", "\ufffd")


def _decimal_points(values: Iterable[str]) -> list[str]:
    return [v.replace(",", ".") if v.count(",") == 1 and "." not in v else v for v in values]


def _read_shapefile(path: Path) -> Table:
    with readable("log", "a point shapefile", path):
        columns, points, crs, about, count = read_points(path, "log")
        stated = [a for a in about.get("DataAttributes") or [] if isinstance(a, dict)]
        units = {str(a.get("Name")): unit_symbol(str(a.get("Unit"))) for a in stated}
        crop = str(about.get("CropName") or "")
    return Table(columns, np.arange(1, len(points) + 1), points, crs, {}, (), units, crop, stated=count)


def to_numbers(values: Iterable[Any]) -> Array:
    """Numbers of cells, nan where a cell is none. Dates and truth values are not numbers."""
    if isinstance(values, Cells | Held):
        return values.numbers()
    values = list(values)
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array([_number(v) for v in values], dtype=float)


def _floats(block: Any) -> Array:
    """A block of cells as numbers; what only Python reads, blanks around them too, by Python."""
    import pyarrow as pa

    try:
        return np.array(block.cast(pa.float64()))
    except pa.ArrowInvalid:
        return to_numbers(block.to_pylist())


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
