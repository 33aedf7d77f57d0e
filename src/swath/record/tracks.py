"""tracks.parquet: one row per moment and machine, at a fixed rate, with units in the column metadata.

A row at t holds, of every signal, the newest sample published up to the end of the tick at t. Which columns a
signal has stands in its declaration. Where several outputs of a machine are of one type, the first has the
columns of that name, those of the others begin with the name of their slot: `gnss_right_fix_x_m`. Every
number that has no declared column has one by rule, behind all others (`sent_columns`).
"""

import json
from array import array
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.blocks import Block
from swath.core.errors import InputError, SwathError
from swath.core.files.unnamed_file import UnnamedFile
from swath.core.files.whole_file import new_file
from swath.core.layout import quantities
from swath.core.schedule import NS
from swath.core.signal import TrackColumn, signal_types
from swath.documents.packed import open_parquet
from swath.record.formats import TRACKS, check_format
from swath.record.message_factory import RecordedMachine
from swath.signals import MachineState, Signal
from swath.signals.flat import amounts, flat_fields, pose_number

Latest = Mapping[type[Signal], Any]  # newest sample of each type
NAN = float("nan")
Rows = Mapping[str, np.ndarray]  # columns of a table, or of a piece of it, (row_count,) each
STORED = 1 << 16  # numbers that are kept in memory; those before lie in a file that has no name
PIECE = 1 << 14  # rows that are read or written together
LENGTH = "dt"  # the amount that says how long a step is: over it the others are flows
SHOWN_ROWS = 1 << 14  # of a machine, of which pages are made: what they show has no more points


@dataclass(frozen=True)
class Column:
    """A column; unit as in the file; what it says.

    value: called for every row with the newest sample of every type
    later: called with the columns of `value` when the table is read, gives the whole column, (row_count,)
    is_by_row: `later` gives each value from its row alone
    source: what its value depends on alone, a key of the newest samples; None where it depends on more
    field: of the newest sample of the source, "" where the value is not of one
    number: from what it holds
    over: another field of the sample, by which it is divided
    """

    name: str
    unit: str
    meaning: str
    value: Callable[[Latest], float] = lambda _: NAN
    later: Callable[[Mapping[str, Any]], Any] | None = None
    source: Any = None
    is_by_row: bool = False
    field: str = ""
    number: Callable[[Any], float] = float
    over: str = ""


def _column(key: Any, field: str, column: TrackColumn, name: str, over: str = "") -> Column:
    def value(latest: Mapping[Any, Any]) -> float:
        if key not in latest:
            return NAN
        found = column.value(getattr(latest[key], field))
        return _over(found, getattr(latest[key], over)) if over else found

    return Column(
        name, column.unit, column.meaning, value, source=key, field=field, number=column.value, over=over
    )


def _over(value: float, dt: float) -> float:
    return value / dt if dt > 0.0 else NAN


def signal_columns(signal: type[Signal], key: Any, prefix: str = "") -> list[Column]:
    """The columns that a sample type declares. key: of its samples among the newest; prefix: of the names."""
    found = []
    if name := signal.about.time_column:
        meaning = "simulated time" if name == "t_s" else f"time the newest {signal.__name__} is valid for"
        found.append(_column(key, "t", TrackColumn(name, "s", meaning, lambda t: t / NS), prefix + name))
    for field, quantity in quantities(signal).items():
        found += [_column(key, field, c, prefix + c.name) for c in quantity.tracks]
    return found


def machine_columns(machine: RecordedMachine) -> list[Column]:
    """The columns of every table, then those of what else the machine publishes."""
    ordered = [kind for kind in signal_types() if kind.about.track_order is not None]
    ordered.sort(key=lambda kind: kind.about.track_order or 0)
    found = [column for kind in ordered for column in signal_columns(kind, kind)]
    found += header_end_columns(machine)
    known = set(ordered)
    for output, kind in machine.outputs.items():
        if kind not in known:
            found += signal_columns(kind, kind)
        elif output != _first(machine, kind):
            found += signal_columns(kind, output, f"{output.partition('.')[0]}_")
        known.add(kind)
    return found


def sent_columns(outputs: Mapping[str, type[Signal]]) -> list[Column]:
    """The columns by rule: of every number that outputs send and that has none by its declaration.

    The name is that of the slot, of the output where that is another, of the field and of its unit:
    `settings_drum_rad_s`, `crop_flow_loss_cleaning_kg_s`. Amounts of a step are divided by its length `dt`.

    outputs: `slot.output` -> type of its samples
    """
    found, known = [], set()
    for output, kind in outputs.items():
        key = output if kind in known else kind
        known.add(kind)
        begin = [*dict.fromkeys(output.split("."))]
        step_long = LENGTH if LENGTH in amounts(kind) else ""
        for name, field in flat_fields(kind).items():
            whole, _, part = name.partition(".")
            if field.kind == "array" or quantities(kind)[whole].tracks or name == step_long:
                continue
            over = step_long if name in amounts(kind) else ""
            unit = f"{field.unit or '1'}/s" if over else field.unit
            number = partial(pose_number, part=part) if part else float
            column = TrackColumn("", unit or "-", f"{output}: {field.quantity.meaning}", number)
            ends = [name.replace(".", "_"), unit.replace("/", "_").lower()]
            found.append(_column(key, whole, column, "_".join(filter(None, [*begin, *ends])), over))
    return found


def arrays_of(kind: type[Signal]) -> list[str]:
    """Fields of a sample type that are arrays of which no column is made: `seen_as` says where they are."""
    known = quantities(kind)
    return [name for name, f in flat_fields(kind).items() if f.kind == "array" and not known[name].tracks]


def _first(machine: RecordedMachine, kind: type[Signal]) -> str:
    return next((output for output, other in machine.outputs.items() if other is kind), "")


def header_end_columns(machine: RecordedMachine) -> tuple[Column, Column]:
    """World position of the header end that follows the edge."""
    x, y = machine.geometry.header_end(machine.edge_side)

    def at(axis: int) -> Callable[[Latest], float]:
        return lambda latest: latest[MachineState].pose.point(x, y, 0.0)[axis]

    side = machine.edge_side
    return (
        Column("header_end_x_m", "m", f"east of the header's {side} end", at(0)),
        Column("header_end_y_m", "m", f"north of the header's {side} end", at(1)),
    )


class EvenRows:
    """Rows spread evenly over a table that comes in pieces, and its last one.

    They are all up to `most`; where there are more, every second one goes, and again. most: None = no limit
    """

    def __init__(self, most: int | None = None) -> None:
        self._most, self._every = most, 1
        self._kept: list[dict[str, np.ndarray]] = []
        self._held = 0
        self._last: dict[str, np.ndarray] = {}
        self.row_count = 0  # of all rows so far

    def add(self, piece: Rows) -> None:
        """The next rows of the table."""
        count = len(next(iter(piece.values()), ()))
        if not count:
            return
        first = -self.row_count % self._every
        self._kept.append({name: values[first :: self._every].copy() for name, values in piece.items()})
        self._last = {name: values[-1:].copy() for name, values in piece.items()}
        self._held += len(range(first, count, self._every))
        self.row_count += count
        while self._most is not None and self._held > self._most:
            self._kept = [{name: values[::2].copy() for name, values in self._joined(self._kept).items()}]
            self._every, self._held = 2 * self._every, -(-self._held // 2)

    def columns(self) -> dict[str, np.ndarray]:
        """The rows so far; {} where there was none."""
        has_last = not self.row_count or (self.row_count - 1) % self._every == 0
        return self._joined([*self._kept, *([] if has_last else [self._last])])

    @staticmethod
    def _joined(pieces: Sequence[Rows]) -> dict[str, np.ndarray]:
        return {name: np.concatenate([piece[name] for piece in pieces]) for name in (pieces or [{}])[0]}


class _Newest(dict[Any, Any]):
    """The newest samples; one of a block, held as (block, place), is made where it is asked for."""

    def __getitem__(self, key: Any) -> Any:
        value = super().__getitem__(key)
        if isinstance(value, tuple):
            block, k = value
            value = self[key] = block.sample(k)
        return value

    def get(self, key: Any, default: Any = None) -> Any:
        value = super().get(key, default)
        return self[key] if isinstance(value, tuple) else value

    held = dict.get  # itself, or (block, place)


class Tracks:
    """Collects the rows of one machine.

    extra: further columns, e.g. of the evaluators; their `value` gets the newest samples too
    """

    def __init__(self, machine: RecordedMachine, period: int, extra: tuple[Column, ...] = ()) -> None:
        self.machine = machine
        self.columns = (*machine_columns(machine), *extra, *sent_columns(machine.outputs))
        keys = dict.fromkeys(column.source for column in self.columns if column.field)
        self._sources = {key: _Source(key, self.columns) for key in keys}
        self._others = [i for i, column in enumerate(self.columns) if not column.field]
        self._other_values, self._count = array("d"), 0  # of the rows that are not stored
        self._stored = UnnamedFile()
        self._changed: set[Any] = set()  # keys of samples that came after the newest row
        self._latest = _Newest()  # by type; of a further output of a type by its name
        self._further = {o for o, kind in machine.outputs.items() if o != _first(machine, kind)}
        self._period, self._due, self._is_open = period, 0, False

    def take(self, t: int, output: str, signal: Signal) -> None:
        """Note a sample of `slot.output` published at t [ns]."""
        if isinstance(signal, MachineState) and output not in self._further:
            self._next_row(t)
        self._put(output if output in self._further else type(signal), signal)

    def take_of(self, t: int, output: str, block: Block, k: int) -> None:
        """The same of one of the samples of a block."""
        if issubclass(block.kind, MachineState) and output not in self._further:
            self._next_row(t)
        self._put(output if output in self._further else block.kind, (block, k))

    def _put(self, key: Any, held: Any) -> None:
        self._latest[key] = held
        self._changed.add(key)

    def _next_row(self, t: int) -> None:
        self._finish_row()
        if t >= self._due:
            self._is_open = True
            self._due = (t // self._period + 1) * self._period

    def save(self) -> dict[str, Any]:
        """What is not in the rows so far, and how many these are. SwathError where rows do not say it all."""
        for column in self.columns:
            if column.later is not None and column.value is not Column.value:
                raise SwathError(f"column {column.name} is judged later, its rows cannot be read back")
        self._store()
        rows = self._stored.size // (8 * len(self.columns))
        latest = {key: self._latest[key] for key in self._latest}
        kept = {"latest": latest, "due": self._due, "is_open": self._is_open}
        return {"rows": rows, "columns": [c.name for c in self.columns], **kept}

    def load(self, state: Mapping[str, Any], table: Mapping[str, np.ndarray]) -> None:
        """Go on from a saved state. table: columns of a tracks.parquet that begins with the same rows.

        InputError where it has fewer of them.
        """
        rows, own = state["rows"], table.get("machine", np.array([])) == self.machine.name
        if state["columns"] != [c.name for c in self.columns] or int(own.sum()) < rows:
            raise InputError("tracks", self.machine.name, f"expected the first {rows} rows of the run")
        empty = np.full(rows, NAN)
        found = [table[c.name][own][:rows] if c.later is None else empty for c in self.columns]
        self._stored = UnnamedFile()
        self._stored.append(np.stack(found, axis=1).tobytes())
        self._latest, self._due, self._is_open = _Newest(state["latest"]), state["due"], state["is_open"]
        self._changed = {*self._latest}

    def newest(self, names: Container[str] | None = None) -> dict[str, np.ndarray]:
        """Columns of one row at present, (1,) each, kept or not; {} before there is one.

        names: of columns that are looked at; others that are worked out from the row are left out
        """
        if MachineState not in self._latest:
            return {}
        found = {c.name: np.array([c.value(self._latest)]) for c in self.columns}
        return self._later(found, is_over=False, names=names)

    def arrays(self, *, is_over: bool = True, most: int | None = None) -> dict[str, np.ndarray]:
        """Columns so far, shape (row_count,) each.

        is_over: False leaves out the row that is not complete, and columns that are judged at the end
        most: rows, spread evenly, where there are more
        """
        rows = EvenRows(most)
        for block in self._blocks(is_over=is_over):
            rows.add({"": block})
        table = rows.columns().get("", np.zeros((0, len(self.columns))))
        return self._later(self._split(table), is_over=is_over)

    def pieces(self) -> Iterator[dict[str, np.ndarray]]:
        """All columns of a run that is over, PIECE rows at a time."""
        for block in self._blocks(is_over=True):
            yield self._later(self._split(block), is_over=True)

    @property
    def by_column(self) -> Rows:
        """Columns of a run that is over, each read when it is asked for."""
        return _ByColumn(self)

    def column(self, name: str) -> np.ndarray:
        """One column of a run that is over. KeyError where there is none."""
        index = {c.name: i for i, c in enumerate(self.columns)}[name]
        if (later := self.columns[index].later) is not None:
            return np.asarray(later(self.by_column))
        return np.concatenate([np.zeros(0), *(b[:, index].copy() for b in self._blocks(is_over=True))])

    @property
    def row_count(self) -> int:
        """Rows so far that are complete."""
        return self._stored.size // (8 * len(self.columns)) + self._count

    def _blocks(self, *, is_over: bool) -> Iterator[np.ndarray]:
        """Rows as they are stored, PIECE at a time."""
        if is_over:
            self._finish_row()
        self._store()
        size = 8 * len(self.columns) * PIECE
        for at in range(0, self._stored.size, size):
            yield np.frombuffer(self._stored.read(at, size)).reshape(-1, len(self.columns))

    def _split(self, table: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip((c.name for c in self.columns), np.ascontiguousarray(table.T), strict=True))

    def _later(
        self, found: dict[str, np.ndarray], *, is_over: bool, names: Container[str] | None = None
    ) -> dict[str, np.ndarray]:
        return found | {
            c.name: c.later(found)
            for c in self.columns
            if c.later is not None and (is_over or c.is_by_row) and (names is None or c.name in names)
        }

    def _finish_row(self) -> None:
        latest = self._latest
        if self._is_open and MachineState in latest:
            self._other_values.extend([self.columns[i].value(latest) for i in self._others])
            for key in self._changed & self._sources.keys():
                self._sources[key].take(self._count, latest.held(key))
            self._changed.clear()
            self._count += 1
            self._is_open = False
            if self._count * len(self.columns) >= STORED:
                self._store()

    def _store(self) -> None:
        """Put the newest rows to those before."""
        if not self._count:
            return
        table = np.empty((self._count, len(self.columns)))
        table[:, self._others] = np.frombuffer(self._other_values).reshape(self._count, -1)
        for source in self._sources.values():
            table[:, source.places] = source.rows(self._count)
        self._stored.append(table.tobytes())
        self._other_values, self._count = array("d"), 0


class _Source:
    """Numbers of the samples of which columns are made, kept where a row has another sample than that before.

    key: of the newest samples; places: of its columns among all
    """

    def __init__(self, key: Any, columns: Sequence[Column]) -> None:
        self.places = [i for i, column in enumerate(columns) if column.field and column.source == key]
        own = [columns[i] for i in self.places]
        self._numbers = [column.number for column in own]
        self._is_plain = all(number is float for number in self._numbers)
        self._flows = [i for i, column in enumerate(own) if column.over]
        self._fields = *(column.field for column in own), next((c.over for c in own if c.over), "t")
        self._of_sample = attrgetter(*self._fields)
        self._begins, self._values = [0], array("d", [NAN] * len(self._fields))

    def take(self, row: int, held: Any) -> None:
        """Another sample, from a row on: itself, or the block that it is in and its place there."""
        block, k = held if isinstance(held, tuple) else (None, 0)
        found: Sequence[Any]
        if block is not None and block.is_even and self._is_plain:
            found = [block[name][k] for name in self._fields]
        else:
            found = self._of_sample(held if block is None else block.sample(k))
        if not self._is_plain:
            found = [*(n(v) for n, v in zip(self._numbers, found, strict=False)), found[-1]]
        self._begins.append(row)
        self._values.extend(found)

    def rows(self, count: int) -> np.ndarray:
        """The columns in so many rows, (count, columns), which are then forgotten."""
        values = np.array(self._values).reshape(len(self._begins), -1)
        last = self._values[-len(self._fields) :]
        if self._flows:
            step = values[:, -1:]
            flows = np.full((len(values), len(self._flows)), NAN)
            with np.errstate(all="ignore"):
                np.divide(values[:, self._flows], step, out=flows, where=step > 0.0)
            values[:, self._flows] = flows
        found = np.repeat(values[:, :-1], np.diff(self._begins, append=count), axis=0)
        self._begins, self._values = [0], last
        return found


@dataclass(frozen=True)
class _ByColumn(Mapping[str, np.ndarray]):
    tracks: Tracks

    def __getitem__(self, name: str) -> np.ndarray:
        return self.tracks.column(name)

    def __contains__(self, name: object) -> bool:
        return any(name == own for own in self)

    def __iter__(self) -> Iterator[str]:
        return (c.name for c in self.tracks.columns)

    def __len__(self) -> int:
        return len(self.tracks.columns)


def write_tracks(path: Path, tracks: list[Tracks]) -> None:
    """Write the table of all machines in one go; a half-written file is never left behind.

    Rows of a machine lie together, in groups of PIECE rows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns: dict[str, Column] = {c.name: c for t in tracks for c in t.columns}
    fields = [pa.field("machine", pa.string(), metadata={"unit": "-", "meaning": "name in the scenario"})]
    for name, column in columns.items():
        note = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pa.field(name, pa.float64(), metadata=note))
    about = {"format": TRACKS, "units": json.dumps({n: c.unit for n, c in columns.items()})}
    schema = pa.schema(fields, metadata=about)
    pieces = [t.pieces() for t in tracks]
    firsts = [next(of_one, {}) for of_one in pieces]
    busy = [name for name in columns if any(_is_busy(first[name]) for first in firsts if name in first)]
    with (
        new_file(path) as file,
        pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=[name for name in schema.names if name not in busy],
            column_encoding=dict.fromkeys(busy, "BYTE_STREAM_SPLIT"),
        ) as writer,
    ):
        for t, more in zip(tracks, pieces, strict=True):
            piece = firsts.pop(0)  # not kept while the others are written
            while piece:
                count = len(piece["t_s"])
                data = [_to_arrow(piece.get(name, np.full(count, NAN))) for name in columns]
                names = _repeated(t.machine.name, count)
                writer.write_table(pa.Table.from_arrays([names, *data], schema=schema))
                del piece, data
                piece = next(more, {})
    pa.default_memory_pool().release_unused()


def _to_arrow(values: np.ndarray) -> Any:
    """Numbers as an Arrow array; as `pa.array`, which loads pandas where that is installed."""
    import pyarrow as pa

    numbers = np.ascontiguousarray(values, dtype=np.float64)
    return pa.Array.from_buffers(pa.float64(), len(numbers), [None, pa.py_buffer(numbers)])


def _repeated(text: str, count: int) -> Any:
    """A text so many times as an Arrow array."""
    import pyarrow as pa

    letters = text.encode()
    ends = np.arange(count + 1, dtype=np.int32) * np.int32(len(letters))
    return pa.StringArray.from_buffers(count, pa.py_buffer(ends), pa.py_buffer(letters * count))


def _is_busy(values: np.ndarray) -> bool:
    """Whether values mostly differ from the one before, so that a dictionary of them is no shorter."""
    changes = np.count_nonzero((values[1:] != values[:-1]) & ~np.isnan(values[1:]))
    return bool(4 * changes > len(values))


def read_tracks(path: Path) -> dict[str, np.ndarray]:
    """Columns of a tracks.parquet as arrays, `machine` as strings.

    InputError for another or newer file, and for one without a column that every run writes.
    """
    with _opened(path) as file:
        return _arrays(file.read(use_threads=False))  # no threads of Arrow that a run would end with


def track_pieces(path: Path) -> Iterator[dict[str, np.ndarray]]:
    """As `read_tracks`, PIECE rows at a time."""
    with _opened(path) as file:
        for batch in file.iter_batches(PIECE, use_threads=False):
            yield _arrays(batch)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with open_parquet(path, "tracks", "a tracks.parquet") as file:
        schema = file.schema_arrow
        check_format((schema.metadata or {}).get(b"format", b"").decode(), TRACKS, path)
        written = ["machine", *(c.name for c in signal_columns(MachineState, MachineState))]
        if missing := [name for name in written if name not in schema.names]:
            raise InputError("tracks", ", ".join(missing), "expected this column, there is none", file=path)
        yield file


def _arrays(table: Any) -> dict[str, np.ndarray]:
    """Columns of an Arrow table or record batch."""
    return {name: _to_numpy(column) for name, column in zip(table.schema.names, table.columns, strict=True)}


def _to_numpy(column: Any) -> np.ndarray:
    """As `to_numpy`, which loads pandas where that is installed: numbers and texts without gaps need none."""
    import pyarrow as pa

    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if array.null_count == 0 and pa.types.is_floating(array.type):
        return np.from_dlpack(array)
    if array.null_count == 0 and pa.types.is_string(array.type):
        found = array.dictionary_encode()
        names: np.ndarray = np.array(found.dictionary.to_pylist(), dtype=object)
        texts: np.ndarray = names[np.from_dlpack(found.indices)]
        return texts
    values: np.ndarray = array.to_numpy(zero_copy_only=False)
    return values


def column_names() -> list[str]:
    """Names of all columns that tracks may have beside those of evaluators."""
    declared = [c.name for kind in signal_types() for c in signal_columns(kind, kind)]
    return list(dict.fromkeys([*declared, "header_end_x_m", "header_end_y_m"]))
