"""CSV tables of numbers, read in blocks."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from csv import Error as CsvError
from csv import reader as rows_in
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.read_file import check_readable
from swath.documents.packed import readable
from swath.documents.text_file import LONGEST_LINE, text_lines

Array = NDArray[np.float64]
BLOCK_BYTES = 1 << 22


def column_names(path: Path) -> dict[str, str]:
    """Names of the columns without and with the blanks around them.

    InputError where there are none, two are alike, or no comma is between them.
    """
    from pyarrow import csv, input_stream

    with readable("table", "a table with a line of column names", path):
        with input_stream(check_readable(path, "table", "a table")) as file:
            head = file.read(LONGEST_LINE).partition(b"\n")[0].decode(errors="replace").strip()
        if "," not in head and (";" in head or "\t" in head):
            expected = "expected commas between columns, and points in numbers"
            raise InputError("table", head, expected, file=path, line=1)
        if head.startswith("#"):
            raise InputError("table", head, "expected the names of columns, no comment", file=path, line=1)
        with _first_wrong(path, {}):
            reader = csv.open_csv(path)
        names = [str(name) for name in reader.schema.names]
    found = {name.strip(): name for name in names}
    if len(found) < len(names):
        twice = next(name.strip() for name in names if found[name.strip()] != name or names.count(name) > 1)
        raise InputError("table", twice, "expected each column once", file=path, line=1)
    return found


def number_blocks(
    path: Path, names: Mapping[str, str], wanted: Collection[str]
) -> Iterator[dict[str, Array]]:
    """The wanted columns among the names, some rows at a time; empty cells are nan."""
    import pyarrow as pa
    from pyarrow import csv

    kept = {n: column for n, column in names.items() if n in wanted}
    types = dict.fromkeys(kept.values(), pa.float64())
    convert = csv.ConvertOptions(column_types=types, include_columns=list(types))
    with (
        readable("table", "numbers only", path),
        _first_wrong(path, kept),
        csv.open_csv(
            check_readable(path, "table", "a table"),
            csv.ReadOptions(block_size=BLOCK_BYTES),
            convert_options=convert,
        ) as reader,
    ):
        for batch in reader:
            columns = (batch.column(k).to_numpy(zero_copy_only=False) for k in range(len(kept)))
            yield dict(zip(kept, columns, strict=True))


@contextmanager
def _first_wrong(path: Path, columns: Mapping[str, str]) -> Iterator[None]:
    """Where a table cannot be read, the InputError of its first cell that is no number, or of its row."""
    from pyarrow import ArrowInvalid, csv

    try:
        yield
    except ArrowInvalid:
        if path.suffix == ".gz":  # lines of text are looked at alone
            raise
        with suppress(CsvError):
            rows = rows_in(text_lines(path, "table", "a table"))
            places = {column: place for place, column in enumerate(next(rows, ()))}
            for row in filter(None, rows):
                if len(row) != len(places):
                    expected = f"expected {len(places)} cells, with points in numbers"
                    raise InputError(
                        "table", ",".join(row), expected, file=path, line=rows.line_num
                    ) from None
                for name, column in columns.items():
                    text = row[places[column]].strip()
                    try:
                        float("nan" if text in csv.ConvertOptions().null_values else text)
                    except ValueError:
                        raise InputError(
                            name, text, "expected a number such as 10.5", file=path, line=rows.line_num
                        ) from None
        raise


def read_numbers(path: Path, needed: Collection[str], optional: Collection[str] = ()) -> dict[str, Array]:
    """The needed columns, and those of the optional ones that are there. InputError where one is missing."""
    names = column_names(path)
    if not set(needed) <= set(names):
        also = f" and optional {', '.join(optional)}" if optional else ""
        expected = f"expected columns {', '.join(needed)}{also}"
        raise InputError("columns", ", ".join(names), expected, file=path)
    wanted = (*needed, *optional)
    blocks = list(number_blocks(path, names, wanted)) or [{n: np.zeros(0) for n in names if n in wanted}]
    return {n: np.concatenate([b[n] for b in blocks]) for n in blocks[0]}
