"""Journals of finished runs: a line of JSON each, one file per worker, and the table that they come to.

A line is on the disk before the run counts as done. A line that a killed worker left half written is not
read, and the run is done again. The table holds nothing that depends on who did a run or how long it took: it
is the same bytes however the work was split and interrupted.
"""

import json
import os
import re
import sys
from array import array
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.files.whole_file import new_file, open_to_append
from swath.documents.contents import changed_since
from swath.documents.json_file import read_object
from swath.documents.packed import MIB, open_parquet, readable
from swath.tools.function_test.stored_line import Result, read_line, read_row

PLAN, TABLE = "plan.json", "results.parquet"
CHANGED = "changed"  # verdict of a run in which a file was changed: it is not written down
TEXTS = ("id", "case", "candidate", "verdict", "reason", "digest", "point", "expect", "incidents")  # columns
ROWS = 1024  # of the table that are in memory at a time
LONGEST_LINE, MOST_BYTES = 16 * MIB, 1 << 36  # of a journal
MOST_WRONG = 100_000  # lines of a journal that are no results
_NAMED = re.compile(rb'"id": ?"([0-9a-f]{1,16})"')  # in a line
_told = dict[Path, int]()  # how many wrong lines of a journal the user knows of


class Journal:
    """The journal of one worker, opened for appending."""

    def __init__(self, folder: Path, worker: str) -> None:
        self.worker, plan = worker, folder.parent / PLAN
        self._made_of = read_object(plan, PLAN, "a plan").get("made_of", {}) if os.path.isfile(plan) else {}
        path = folder / f"{worker}.jsonl"
        self._file = open_to_append(path)
        with open_to_read(path, "journal", "a journal") as before:
            if before.seek(0, os.SEEK_END) and before.seek(-1, os.SEEK_END) and before.read(1) != b"\n":
                self._file.write(b"\n")  # it was torn by a kill

    def add(self, result: Result) -> Result:
        """Write a result, which comes back; it is on the disk when this returns.

        One of a run in which a file of the plan was changed comes back as CHANGED: its name says what it was
        not made with.
        """
        if names := changed_since(self._made_of):
            return {**result, "verdict": CHANGED, "reason": names}
        line = json.dumps({**result, "worker": self.worker}, allow_nan=False)
        self._file.write(line.encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        return result

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_journals(folder: Path) -> Iterator[Result]:
    """Every whole line of all journals; of runs that were done twice both."""
    with Stored(folder) as stored:
        yield from stored.all()


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Every whole line of a journal with where it begins. InputError for what is no journal."""
    with open_to_read(path, "journal", "a journal", MOST_BYTES) as file:
        offset = number = 0
        while line := file.readline(LONGEST_LINE + 1):
            number += 1
            if len(line) > LONGEST_LINE:
                expected = f"expected a journal, lines of at most {LONGEST_LINE} bytes"
                raise InputError("journal", None, expected, file=path, line=number)
            if line.endswith(b"\n"):
                yield offset, line
            offset += len(line)


class Stored:
    """The results in the journals of a folder, found by name and read when they are asked for.

    Of each result 20 bytes are in memory: its name, which is a number of 64 bits in hexadecimal digits, and
    where its line begins. Of a run that was done twice the first line counts. A line that is no result counts
    as none, and the user is told how many there are.
    """

    def __init__(self, folder: Path) -> None:
        self._files = sorted(folder.glob("*.jsonl"))
        self._open: dict[int, BinaryIO] = {}
        self._wrong = dict[tuple[int, int], None]()
        names, files, offsets = array("Q"), array("L"), array("Q")
        for number, path in enumerate(self._files):
            for offset, line in _lines(path):
                if named := _NAMED.search(line):
                    names.append(int(named[1], 16))
                    files.append(number)
                    offsets.append(offset)
                elif line.strip():  # else the end of one that a kill tore off
                    self._leave(number, offset)
        order = np.argsort(np.array(names, np.uint64), kind="stable")
        self._names = np.array(names, np.uint64)[order]
        self._numbers, self._offsets = np.array(files, np.uint32)[order], np.array(offsets, np.uint64)[order]

    def _leave(self, number: int, offset: int) -> None:
        """Leave a line out."""
        self._wrong[number, offset] = None
        if len(self._wrong) > MOST_WRONG:
            expected = f"expected a journal, at most {MOST_WRONG} lines in it are no results"
            raise InputError("journal", None, expected, file=self._files[number])

    def __enter__(self) -> "Stored":
        return self

    def __exit__(self, *error: object) -> None:
        for file in self._open.values():
            file.close()
        for number, path in enumerate(self._files):
            count = sum(wrong == number for wrong, _ in self._wrong)
            if count > _told.get(path, 0):
                _told[path] = count
                print(f"swath: {path}: lines that are no results and left out: {count}", file=sys.stderr)

    def all(self) -> Iterator[Result]:
        """All that there are, also of runs that were done twice."""
        return filter(None, map(self._read, range(len(self._names))))

    def get(self, name: str) -> Result | None:
        """The result of a run; None where it is not done."""
        wanted = np.uint64(int(name, 16))
        place, end = (int(np.searchsorted(self._names, wanted, side)) for side in ("left", "right"))
        return next(filter(None, map(self._read, range(place, end))), None)

    def _read(self, place: int) -> Result | None:
        """The result in a line; None where it is none."""
        number, offset = int(self._numbers[place]), int(self._offsets[place])
        if number not in self._open:
            self._open[number] = open_to_read(self._files[number], "journal", "a journal")
        self._open[number].seek(offset)
        found = read_line(self._open[number].readline(LONGEST_LINE + 1))
        if found is None:
            self._leave(number, offset)
        return found


def results_of(folder: Path, wanted: Iterable[str]) -> list[Result]:
    """The results of runs by name, each once, in the order of `wanted`, without those that are missing."""
    with Stored(folder) as stored:
        return [found for name in wanted if (found := stored.get(name)) is not None]


def write_table(folder: Path, results: Iterable[Mapping[str, Any]]) -> Path:
    """Write results.parquet, a row per run; every metric is a column `metric.NAME`."""
    rows = list(results)
    return write_rows(folder, iter(rows), {name for row in rows for name in row["metrics"]})


def write_rows(folder: Path, rows: Iterator[Mapping[str, Any]], metrics: Iterable[str]) -> Path:
    """Write results.parquet. InputError where the one that is there holds more."""
    import pyarrow as pa

    names = sorted(metrics)
    fields = [(name, pa.string()) for name in TEXTS[:6]] + [("seed", pa.int64())]
    fields += [(name, pa.string()) for name in TEXTS[6:]] + [(f"metric.{m}", pa.float64()) for m in names]
    schema = pa.schema(fields)
    path = folder / TABLE
    least = 0
    with suppress(InputError), open_parquet(path, "results", "a results.parquet") as there:
        least = there.metadata.num_rows  # a damaged one is made anew
    flat = (
        {**{n: row[n] for n in (*TEXTS[:6], "seed")},
         **{n: json.dumps(row[n], sort_keys=True) for n in TEXTS[6:]},
         **{f"metric.{n}": row["metrics"].get(n) for n in names}}
        for row in rows
    )  # fmt: skip
    return write_parquet(path, schema, flat, least)


def write_parquet(path: Path, schema: Any, rows: Iterator[Mapping[str, Any]], least: int = 0) -> Path:
    """Write rows, ROWS of them at a time. InputError, and the file stays, where they are fewer than these."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = 0
    with new_file(path) as file, pq.ParquetWriter(file, schema, compression="zstd") as writer:
        while some := list(islice(rows, ROWS)):
            writer.write_table(pa.Table.from_pylist(some, schema))
            count += len(some)
        if count < least:
            expected = f"expected {least} runs, as it holds, the journals have {count}: it stays as it is"
            raise InputError("results", None, expected, file=path)
    return path


def read_table(path: Path) -> list[Result]:
    """The rows of a results.parquet. InputError for another file."""
    with open_parquet(path, "results", "a results.parquet") as file, readable("results", "results", path):
        return [read_row(row) for row in file.read().to_pylist()]
