"""Journals of finished runs: a line of JSON each, one file per worker, and the table that they come to.

A line is on the disk before the run counts as done. A line that a killed worker left half written is not
read, and the run is done again. The table holds nothing that depends on who did a run or how long it took: it
is the same bytes however the work was split and interrupted.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from swath.core.whole_file import write_whole
from swath.documents.packed import readable

Result = dict[str, Any]
PRIVATE = ("cpu_s", "worker")  # of a line: not in the table
TABLE = "results.parquet"


class Journal:
    """The journal of one worker, opened for appending."""

    def __init__(self, folder: Path, worker: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.worker = worker
        path = folder / f"{worker}.jsonl"
        is_torn = path.is_file() and path.stat().st_size > 0 and path.read_bytes()[-1:] != b"\n"
        self._file = path.open("ab")
        if is_torn:
            self._file.write(b"\n")

    def add(self, result: Result) -> None:
        """Write a result; it is on the disk when this returns."""
        line = json.dumps({**result, "worker": self.worker}, allow_nan=False)
        self._file.write(line.encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_journals(folder: Path) -> Iterator[Result]:
    """Every whole line of all journals; of runs that were done twice both."""
    for path in sorted(folder.glob("*.jsonl")):
        with path.open("rb") as file:
            for line in file:
                if line.endswith(b"\n"):
                    try:
                        yield json.loads(line)
                    except ValueError:
                        continue  # torn by a kill, ended by the next one who wrote


def finished(folder: Path) -> set[str]:
    """Names of the runs that are in a journal."""
    return {result["id"] for result in read_journals(folder)}


def results_of(folder: Path, wanted: Iterable[str]) -> list[Result]:
    """The results of runs by name, each once, in the order of `wanted`, without those that are missing."""
    by_id: dict[str, Result] = {}
    names = list(wanted)
    known = set(names)
    for result in read_journals(folder):
        if result["id"] in known:
            by_id.setdefault(result["id"], result)
    return [by_id[name] for name in names if name in by_id]


def write_table(folder: Path, results: Iterable[Mapping[str, Any]]) -> Path:
    """Write results.parquet, a row per run sorted by name; every metric is a column `metric.NAME`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = sorted(results, key=lambda r: str(r["id"]))
    metrics = sorted({name for row in rows for name in row["metrics"]})
    columns: dict[str, Any] = {
        name: pa.array([row[name] for row in rows], pa.string())
        for name in ("id", "case", "candidate", "verdict", "reason", "digest")
    }
    columns["seed"] = pa.array([row["seed"] for row in rows], pa.int64())
    for name in ("point", "expect", "incidents"):
        columns[name] = pa.array([json.dumps(row[name], sort_keys=True) for row in rows], pa.string())
    for name in metrics:
        columns[f"metric.{name}"] = pa.array([row["metrics"].get(name) for row in rows], pa.float64())
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(columns), sink, compression="zstd")
    return write_whole(folder / TABLE, sink.getvalue().to_pybytes())


def read_table(path: Path) -> list[Result]:
    """The rows of a results.parquet. InputError for another file."""
    import pyarrow.parquet as pq

    with readable("results", "a results.parquet", path):
        rows: list[Result] = pq.read_table(path).to_pylist()
        for row in rows:
            row |= {name: json.loads(row[name]) for name in ("point", "expect", "incidents")}
            names = [name for name in row if name.startswith("metric.")]
            row["metrics"] = {name.removeprefix("metric."): row.pop(name) for name in names}
    return rows
