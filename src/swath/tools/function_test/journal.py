"""Journals of finished runs: a line of JSON each, one file per worker, and the table that they come to.

A line is on the disk before the run counts as done. A line that a killed worker left half written is not
read, and the run is done again. The table holds nothing that depends on who did a run or how long it took: it
is the same bytes however the work was split and interrupted.
"""

import json
import os
from array import array
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import new_file, open_to_append
from swath.documents.contents import changed_since
from swath.documents.json_file import read_object
from swath.documents.packed import open_parquet
from swath.documents.text_file import MAX_BYTES

Result = dict[str, Any]
PLAN, TABLE = "plan.json", "results.parquet"
CHANGED = "changed"  # verdict of a run in which a file was changed: it is not written down
TEXTS = ("id", "case", "candidate", "verdict", "reason", "digest", "point", "expect", "incidents")  # columns
ROWS = 1024  # of the table that are in memory at a time


class Journal:
    """The journal of one worker, opened for appending."""

    def __init__(self, folder: Path, worker: str) -> None:
        self.worker, plan = worker, folder.parent / PLAN
        self._made_of = read_object(plan, PLAN, "a plan").get("made_of", {}) if plan.is_file() else {}
        path = folder / f"{worker}.jsonl"
        is_torn = path.is_file() and path.stat().st_size > 0 and path.read_bytes()[-1:] != b"\n"
        self._file = open_to_append(path)
        if is_torn:
            self._file.write(b"\n")

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
    for path in sorted(folder.glob("*.jsonl")):
        for _, result in _lines(path):
            yield result


def _lines(path: Path) -> Iterator[tuple[int, Result]]:
    """Every whole line of a journal with where it begins."""
    with path.open("rb") as file:
        offset = 0
        while line := file.readline(MAX_BYTES):
            if line.endswith(b"\n"):
                with suppress(ValueError):  # torn by a kill, ended by the next one who wrote
                    yield offset, json.loads(line)
            offset += len(line)


def finished(folder: Path) -> set[str]:
    """Names of the runs that are in a journal."""
    return {result["id"] for result in read_journals(folder)}


class Stored:
    """The results in the journals of a folder, found by name and read when they are asked for.

    Of each result 20 bytes are in memory: its name, which is a number of 64 bits in hexadecimal digits, and
    where its line begins. Of a run that was done twice the first line counts.
    """

    def __init__(self, folder: Path) -> None:
        self._files = sorted(folder.glob("*.jsonl"))
        self._open: dict[int, BinaryIO] = {}
        self.metrics: set[str] = set()
        names, files, offsets = array("Q"), array("L"), array("Q")
        for number, path in enumerate(self._files):
            for offset, result in _lines(path):
                names.append(int(result["id"], 16))
                files.append(number)
                offsets.append(offset)
                for entry in (result, *result.get("shadow", {}).values()):
                    self.metrics |= entry["metrics"].keys()
        self._names, first = np.unique(np.array(names, np.uint64), return_index=True)
        self._numbers = np.array(files, np.uint32)[first]
        self._offsets = np.array(offsets, np.uint64)[first]

    def _place(self, name: str) -> int | None:
        wanted = np.uint64(int(name, 16))
        place = int(np.searchsorted(self._names, wanted))
        return place if place < len(self._names) and self._names[place] == wanted else None

    def __contains__(self, name: str) -> bool:
        return self._place(name) is not None

    def __enter__(self) -> "Stored":
        return self

    def __exit__(self, *error: object) -> None:
        for file in self._open.values():
            file.close()

    def get(self, name: str) -> Result | None:
        """The result of a run; None where it is not done."""
        place = self._place(name)
        if place is None:
            return None
        number = int(self._numbers[place])
        file = self._open.get(number) or self._open.setdefault(number, self._files[number].open("rb"))
        file.seek(int(self._offsets[place]))
        found: Result = json.loads(file.readline())
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
    if path.is_file():
        with open_parquet(path, "results", "a results.parquet") as there:
            least = there.metadata.num_rows
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
    with open_parquet(path, "results", "a results.parquet") as file:
        rows: list[Result] = file.read().to_pylist()
        for row in rows:
            row |= {name: json.loads(row[name]) for name in ("point", "expect", "incidents")}
            names = [name for name in row if name.startswith("metric.")]
            row["metrics"] = {name.removeprefix("metric."): row.pop(name) for name in names}
    return rows
