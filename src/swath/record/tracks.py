"""tracks.parquet: one row per moment and machine, at a fixed rate, with units in the column metadata.

A row at t holds, of every signal, the newest sample published up to the end of the tick at t. Which columns a
signal has stands in its declaration. Where several outputs of a machine are of one type, the first has the
columns of that name, those of the others begin with the name of their slot: `gnss_right_fix_x_m`. Every
number that has no declared column has one by rule, behind all others (`sent_columns`).
"""

import json
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.blocks import Block, Ints, Seen
from swath.core.errors import InputError, SwathError
from swath.core.files.unnamed_file import UnnamedFile
from swath.core.files.whole_file import new_file
from swath.core.frames import Pose, part_of
from swath.core.layout import layout, quantities
from swath.core.schedule import NS
from swath.core.signal import signal_types
from swath.core.together import poses_of
from swath.documents.packed import open_parquet
from swath.record.formats import TRACKS, check_format
from swath.record.message_factory import RecordedMachine
from swath.signals import MachineState, Signal
from swath.signals.flat import amounts, flat_fields

Latest = Mapping[Any, Any]  # newest sample of each type
NAN = float("nan")
Rows = Mapping[str, np.ndarray]  # columns of a table, or of a piece of it, (row_count,) each
STORED = 1 << 16  # numbers that are kept in memory; those before lie in a file that has no name
PIECE = 1 << 14  # rows that are read or written together
LENGTH = "dt"  # the amount that says how long a step is: over it the others are flows
SHOWN_ROWS = 1 << 14  # of a machine, of which pages are made: what they show has no more points
SAVED = ("present", "latest", "due", "is_open", "is_begun")  # of tracks, beside their rows
PRESENT = np.iinfo(np.int64).max  # an order behind those of all samples


@dataclass(frozen=True)
class Column:
    """A column; unit as in the file; what it says.

    value: called for every row with the newest sample of every type; the run then looks at every sample
    later: called with the columns that come from samples when the table is read, gives the whole column,
        (row_count,)
    is_by_row: `later` gives each value from its row alone
    source: of which samples it is made, a key of `Tracks`; None where of none
    field: what it is made from
    numbers: from what the field holds in some samples, as `Block.values` has it
    over: another field of the samples, by which it is divided
    """

    name: str
    unit: str
    meaning: str
    value: Callable[[Latest], float] | None = None
    later: Callable[[Mapping[str, Any]], Any] | None = None
    is_by_row: bool = False
    source: Any = None
    field: str = ""
    numbers: Callable[[Any], Any] = np.asarray
    over: str = ""


def _numbers(kind: type[Signal], field: str, value: Any = float, part: str = "") -> Callable[[Any], Any]:
    """What makes a column of a field. value, part: as in `TrackColumn`."""
    if part:
        return lambda held: part_of(held, part)
    if value is float:
        return np.asarray
    if layout(kind)[field].kind == "pose":
        return lambda held: [*map(value, poses_of(held))]
    return lambda held: [*map(value, held.tolist() if held.ndim == 1 else held)]


def signal_columns(signal: type[Signal], key: Any, prefix: str = "") -> list[Column]:
    """The columns that a sample type declares. key: of its samples among the newest; prefix: of the names."""
    found = []
    if name := signal.about.time_column:
        meaning = "simulated time" if name == "t_s" else f"time the newest {signal.__name__} is valid for"
        found.append(Column(prefix + name, "s", meaning, field="t", numbers=lambda t: t / NS))
    for field, quantity in quantities(signal).items():
        for c in quantity.tracks:
            numbers = _numbers(signal, field, c.value, c.part)
            found.append(Column(prefix + c.name, c.unit, c.meaning, field=field, numbers=numbers))
    return [replace(column, source=key) for column in found]


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
            full = "_".join([*begin, *name.split("."), *filter(None, [unit.replace("/", "_").lower()])])
            made = Column(full, unit or "-", f"{output}: {field.quantity.meaning}", source=key, field=whole)
            found.append(replace(made, numbers=_numbers(kind, whole, part=part), over=over))
    return found


def arrays_of(kind: type[Signal]) -> list[str]:
    """Fields of a sample type that are arrays of which no column is made: `seen_as` says where they are."""
    known = quantities(kind)
    return [name for name, f in flat_fields(kind).items() if f.kind == "array" and not known[name].tracks]


def _first(machine: RecordedMachine, kind: type[Signal]) -> str:
    return next((output for output, other in machine.outputs.items() if other is kind), "")


def header_end_columns(machine: RecordedMachine) -> tuple[Column, Column]:
    """World position of the header end that follows the edge."""
    (x, y), side = machine.geometry.header_end(machine.edge_side), machine.edge_side

    def at(axis: int) -> Callable[[Any], Any]:
        return lambda held: _as_one(held).point(x, y, 0.0)[axis]

    of_pose = partial(Column, unit="m", source=MachineState, field="pose")
    return (
        of_pose("header_end_x_m", meaning=f"east of the header's {side} end", numbers=at(0)),
        of_pose("header_end_y_m", meaning=f"north of the header's {side} end", numbers=at(1)),
    )


def _as_one(held: Any) -> Any:
    """Poses as one whose numbers are columns."""
    numbers = [*held.T]
    return Pose.of_numbers(numbers[:3], [numbers[3:6], numbers[6:9], numbers[9:]])


def first_in_each(period: int, times: Ints, due: int) -> tuple[NDArray[np.bool_], int]:
    """Which of some times [ns] are the first of their period, and when the next is due.

    period: 0 = all are; due: as it was for the times before
    """
    if not period:
        return np.ones(len(times), np.bool_), due
    ends = (times // period + 1) * period
    return ends > np.concatenate(([due], ends[:-1])), int(ends[-1])


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


class Tracks(Mapping[str, np.ndarray]):
    """Collects the rows of one machine; once the run is over, its columns, each read when it is asked for.

    A row is complete with the next state of the machine: it holds the newest sample of every output that was
    sent before. Samples have their type as a key, those of a further output of that type its name.

    extra: further columns, e.g. of the evaluators
    only: names of the columns that somebody reads, None = all; one that is made of others needs all
    """

    def __init__(
        self,
        machine: RecordedMachine,
        period: int,
        extra: tuple[Column, ...] = (),
        only: Collection[str] | None = None,
    ) -> None:
        self.machine = machine
        every = (*machine_columns(machine), *extra, *sent_columns(machine.outputs))
        asked = [column for column in every if only is None or column.name in only]
        self.columns = every if any(column.later for column in asked) else tuple(asked)
        self._places = {column.name: place for place, column in enumerate(self.columns)}
        self._sources: dict[Any, list[tuple[int, Column]]] = {}  # places and columns, by key
        for place, column in enumerate(self.columns):
            if column.field:
                self._sources.setdefault(column.source, []).append((place, column))
        self._live = [(i, c.value) for i, c in enumerate(self.columns) if c.value is not None]
        self._latest: dict[Any, Any] = {}  # by key, where a column is live
        further = (o for o, kind in machine.outputs.items() if o != _first(machine, kind))
        self._keys = {(f"{machine.name}.{o.partition('.')[0]}", o.partition(".")[2]): o for o in further}
        self._present = np.full(len(self.columns), NAN)  # a row of the newest samples
        self._waiting: dict[Any, Block] = {}  # whose last samples belong there
        self._rows: list[np.ndarray] = []  # those that are not stored
        self._count, self._stored = 0, UnnamedFile()
        self._period, self._due, self._is_open, self._is_begun = period, 0, False, False

    def take(self, seen: Seen) -> None:
        """Note what the slots of the machine sent since the last call."""
        ends, newest = self._ends(seen), dict[Any, Any]()
        row, last = self._present[None], len(ends) - 1
        if last:
            row = self._row() if self._is_begun else self._catch_up()
        table = row.repeat(len(ends), axis=0)
        for block in seen.blocks:
            key: Any = self._keys.get((block.slot, block.output), block.kind)
            self._is_begun |= key is MachineState
            if self._live:
                self._latest[key] = block.newest
            if key in self._sources:
                which, before = block.before(ends), newest.get(key, -1)
                orders = np.where(which < 0, -1, block.orders[which])
                rows, newest[key] = (orders > before).nonzero()[0], np.maximum(orders, before)
                if len(rows) and rows[-1] == last:
                    self._waiting.pop(key, None)
                if len(rows) and rows[0] == last:
                    self._waiting[key] = block
                elif len(rows):
                    self._fill(table, rows, key, block, which[rows])
        self._present = table[-1]
        if self._is_begun:
            self._add(table[:-1])

    def _fill(self, table: np.ndarray, rows: np.ndarray, key: Any, block: Block, which: np.ndarray) -> None:
        """Put what some samples say into rows."""
        with np.errstate(all="ignore"):
            for place, column in self._sources[key]:
                values = column.numbers(block.values(column.field)[which])
                step = block.values(column.over)[which] if column.over else None
                table[rows, place] = values if step is None else _over(values, step)

    def _catch_up(self) -> np.ndarray:
        """What samples say at present, (1, columns)."""
        row = self._present[None]
        for key, block in self._waiting.items():
            self._fill(row, np.zeros(1, int), key, block, np.array([len(block) - 1]))
        self._waiting = {}
        return row

    def _row(self) -> np.ndarray:
        """All columns at present, (1, columns)."""
        row = self._catch_up().copy()
        for place, value in self._live:
            row[0, place] = value(self._latest)
        return row

    def _ends(self, seen: Seen) -> np.ndarray:
        """The last orders of the rows that are complete now, and of the present."""
        every = [b for b in seen.blocks if issubclass(b.kind, MachineState)]
        states = [b for b in every if (b.slot, b.output) not in self._keys]
        if not states:
            return np.array([PRESENT])
        orders, times = states[0].orders, states[0].times
        if len(states) > 1:
            orders, times = np.concatenate([(b.orders, b.times) for b in states], axis=1)
            places = orders.argsort(kind="stable")
            orders, times = orders[places], times[places]
        begins, self._due = first_in_each(self._period, times, self._due)
        is_open = np.concatenate(([self._is_open], begins))
        self._is_open = bool(is_open[-1])
        return np.concatenate((orders[is_open[:-1]] - 1, [PRESENT]))

    def save(self) -> dict[str, Any]:
        """What is not in the rows so far, and how many these are. SwathError where rows do not say it all."""
        for column in self.columns:
            if column.later is not None and column.value is not None:
                raise SwathError(f"column {column.name} is judged later, its rows cannot be read back")
        self._catch_up()
        kept = {name: getattr(self, f"_{name}") for name in SAVED}
        return {"rows": self.row_count, "columns": [*self], **kept}

    def load(self, state: Mapping[str, Any], table: Mapping[str, np.ndarray]) -> None:
        """Go on from a saved state. table: columns of a tracks.parquet that begins with the same rows.

        InputError where it has fewer of them.
        """
        rows, own = state["rows"], table.get("machine", np.array([])) == self.machine.name
        if state["columns"] != [*self] or int(own.sum()) < rows:
            raise InputError("tracks", self.machine.name, f"expected the first {rows} rows of the run")
        empty = np.full(rows, NAN)
        found = [table[c.name][own][:rows] if c.later is None else empty for c in self.columns]
        self._rows, self._count, self._stored, self._waiting = [], 0, UnnamedFile(), {}
        self._add(np.stack(found, axis=1))
        for name in SAVED:
            setattr(self, f"_{name}", state[name])

    def newest(self, names: Container[str] | None = None) -> dict[str, np.ndarray]:
        """Columns of one row at present, (1,) each, kept or not; {} before there is one.

        names: of columns that are looked at; others that are worked out from the row are left out
        """
        return self._later(self._split(self._row()), is_over=False, names=names) if self._is_begun else {}

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

    def __getitem__(self, name: str) -> np.ndarray:
        """One column of a run that is over. KeyError where there is none."""
        index = self._places[name]
        if (later := self.columns[index].later) is not None:
            return np.asarray(later(self))
        return np.concatenate([np.zeros(0), *(b[:, index].copy() for b in self._blocks(is_over=True))])

    def __contains__(self, name: object) -> bool:  # without reading the column
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self.columns)

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
        return dict(zip(self, np.ascontiguousarray(table.T), strict=True))

    def _later(
        self, found: dict[str, np.ndarray], *, is_over: bool, names: Container[str] | None = None
    ) -> dict[str, np.ndarray]:
        return found | {
            c.name: c.later(found)
            for c in self.columns
            if c.later is not None and (is_over or c.is_by_row) and (names is None or c.name in names)
        }

    def _finish_row(self) -> None:
        if self._is_open and self._is_begun:
            self._add(self._row())
            self._is_open = False

    def _add(self, rows: np.ndarray) -> None:
        self._rows.append(rows)
        self._count += len(rows)
        if self._count * len(self.columns) >= STORED:
            self._store()

    def _store(self) -> None:
        """Put the newest rows to those before."""
        if self._count:
            self._stored.append(np.concatenate(self._rows).tobytes())
        self._rows, self._count = [], 0


def _over(values: Any, step: Any) -> np.ndarray:
    """Amounts of steps over their lengths, nan where that is 0."""
    found: np.ndarray = np.divide(values, step, out=np.full(len(step), NAN), where=step > 0.0)
    return found


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
