"""Samples bit for bit, in blocks beside the standard messages: what a recorded slot is played back from.

Standard messages round (float32), rename (nan becomes inf), leave out and are thinned. A block
(`swath_msgs/msg/Samples`, topic `<topic of the output>_exact`) holds up to half a second of one output: two
columns of times and one per field. A field that is the same array in all samples of a block is stored once.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from itertools import pairwise
from operator import attrgetter
from typing import Any

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.errors import InputError, reason_of
from swath.core.layout import layout
from swath.core.schedule import NS
from swath.core.signal import signal_types
from swath.record import packed_columns
from swath.signals import Signal

MSGTYPE = "swath_msgs/msg/Samples"
SUFFIX = "_exact"
DEFINITION = (
    "std_msgs/Header header\nstring signal\nuint32 count\nstring[] names\n"
    "string[] kinds\nbool[] held\nuint8[] data\n"
)
BLOCK_NS = NS // 2  # samples of this long share a block
BLOCK_BYTES = 96 * 1024  # or of about this much
PLAIN: dict[type, str] = {float: "float", int: "int", bool: "bool"}
CODES = {"float": "<f8", "int": "<i8", "bool": "|b1"}
_Column = tuple[Any, ...] | np.ndarray  # values of a field, one per sample
TIMES = ("published", "t")  # the first two columns of every block [ns]


class Blocks:
    """The samples of one output, collected into blocks of a file, an `McapFile`.

    first_ns: length of the first block, so that not all outputs write theirs in the same tick
    """

    def __init__(self, file: Any, topic: str, first_ns: int = BLOCK_NS) -> None:
        self._length = first_ns
        self.file, self.topic = file, topic + SUFFIX
        self._pieces: list[tuple[Block, int, int]] = []  # in their place: of blocks of the run, from, to
        self._published: list[int] = []  # [ns]
        self._signal: type[Signal] | None = None
        self._names: list[str] = []
        self._most = 1  # samples that fill a block by their size

    def add(self, t: int, signal: Signal) -> None:
        """Add a sample published at t [ns]. Raises TypeError for a field that cannot be recorded."""
        (block,) = Seen.of_one("", t, {"": signal}).blocks
        self.take(t, block, 0)

    def take(self, t: int, block: Block, k: int) -> None:
        """As `add`, one of the samples of a block of the run."""
        if block.kind is not self._signal:
            self.flush()
            self._signal = block.kind
        if not self._published:
            signal = block.sample(k)
            self._names = leaf_names(signal)
            row = [attrgetter(name)(signal) for name in self._names]
            for value in row:
                _kind(value)
            size = sum(v.nbytes if isinstance(v, np.ndarray) else 8 for v in row)
            self._most = max(1, -(-BLOCK_BYTES // max(size, 1)))
        first = k
        if self._pieces and self._pieces[-1][0] is block:
            _, first, _ = self._pieces.pop()
        self._pieces.append((block, first, k + 1))
        self._published.append(t)

    @property
    def is_full(self) -> bool:
        """The block has its length or its size, and is to be written."""
        at = self._published
        return bool(at) and (at[-1] - at[0] >= self._length or len(at) >= self._most)

    def save(self) -> dict[str, Any]:
        """Samples that wait for their block."""
        samples = [block.sample(k) for block, a, b in self._pieces for k in range(a, b)]
        waiting = {"samples": samples, "published": list(self._published)}
        return {**waiting, "most": self._most, "length": self._length}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from a saved state."""
        self._length = state["length"]
        for signal, t in zip(state["samples"], state["published"], strict=True):
            self.add(t, signal)
        self._most = state["most"]

    def flush(self) -> None:
        """Write what has been added, in blocks whose columns are each of one kind."""
        published = self._published
        if not published:
            return
        t, *columns = [self._column(name) for name in ("t", *self._names)]
        self._pieces, self._published, self._length = [], [], BLOCK_NS
        ends = [len(published)]
        if not all(map(_is_even, columns)):
            forms = [[_form(value) for value in row] for row in zip(*columns, strict=True)]
            ends = [k for k, form in enumerate(forms) if k and form != forms[k - 1]] + ends
        for first, end in pairwise([0, *ends]):
            self._write([c[first:end] for c in columns], published[first:end], [int(v) for v in t[first:end]])

    def _column(self, name: str) -> _Column:
        """Values of a field, one per sample: in one array where they are numbers of one form."""
        whole, _, part = name.partition(".")
        pieces = [block.values(whole)[a:b] for block, a, b in self._pieces]
        if pieces[0].dtype == object or len({(p.dtype, p.shape[1:]) for p in pieces}) > 1:
            values = [value for piece in pieces for value in piece]
            return tuple(map(attrgetter(part), values)) if part else tuple(values)
        found = np.concatenate(pieces)
        if not part:
            return found
        return found[:, :3] if part == "position" else found[:, 3:].reshape(-1, 3, 3)

    def _write(self, values: Sequence[_Column], published: list[int], t: Sequence[int]) -> None:
        assert self._signal is not None
        columns = _columns_of([tuple(published), tuple(t), *values])
        message = self.file.make(
            MSGTYPE,
            header=self.file.make.header(t[-1], ""),
            signal=self._signal.__name__,
            count=len(t),
            names=[*TIMES, *self._names],
            kinds=[kind for kind, _, _ in columns],
            held=np.array([held for _, held, _ in columns], dtype=bool),
            data=np.frombuffer(b"".join(data for _, _, data in columns), dtype=np.uint8),
        )
        self.file.write(self.topic, published[-1], message)


def _is_even(column: _Column) -> bool:
    """Whether values are of one type, arrays of one shape too; some such are only found by a closer look."""
    if isinstance(column, np.ndarray):
        return True
    if len(set(map(type, column))) > 1:
        return False
    first = column[0]
    if type(first) in PLAIN:
        return True
    kind, shape = first.dtype, first.shape
    return all(v.dtype is kind and v.shape == shape for v in column)


def _form(value: Any) -> Any:
    """Type, or type and shape of an array."""
    return (value.dtype, value.shape) if isinstance(value, np.ndarray | np.generic) else type(value)


def unpack(message: Any) -> Iterator[tuple[int, Signal]]:
    """(time it was published [ns], sample) of a block. InputError where it is not such a block."""
    try:
        kind = signal_type(message.signal)
        names, columns = [*message.names], list(_columns(message))
        if hasattr(message, "published"):  # format 2 and older
            columns[:0] = message.published.tolist(), message.t.tolist()
            names[:0] = TIMES
        named = dict(zip(names[2:], columns[2:], strict=True))
        stamps = zip(columns[0], columns[1], strict=True)
        yield from [(out, _build(kind, t, named, i)) for i, (out, t) in enumerate(stamps)]
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, MemoryError) as error:
        raise InputError("recording", MSGTYPE, f"expected a block of samples ({reason_of(error)})") from error


def is_same_block(a: Any, b: Any) -> bool:
    """Whether two blocks hold the same samples, of the same times, bit for bit."""
    names = ("signal", "count", "published", "t", "names", "kinds", "held", "data")
    return all(np.array_equal(getattr(a, n, ()), getattr(b, n, ())) for n in names)


def _columns(message: Any) -> Iterator[list[Any]]:
    """The values of every column, one per sample."""
    data, at = bytes(message.data), 0
    count = len(message.t) if hasattr(message, "t") else int(message.count)
    for text, held in zip(message.kinds, message.held, strict=True):
        code, dims, packing = _described(text)
        dtype = np.dtype(CODES.get(code, code))
        shape = dims if held else (count, *dims)
        size = dtype.itemsize * int(np.prod(shape, dtype=int))
        part = data[at : at + size]
        if packing:
            values = packed_columns.unpack(part, packing, dtype, shape)
        else:
            values = np.frombuffer(part, dtype=dtype).reshape(shape).copy()
        values.setflags(write=False)
        at += size
        yield [values] * count if held else values.tolist() if code in CODES else list(values)


def _described(text: str) -> tuple[str, tuple[int, ...], str]:
    """Type, shape and packing of the values of a column, from its entry in `kinds`."""
    code, *rest = text.split(" ")
    packing = rest.pop() if rest and rest[-1] in packed_columns.WAYS else ""
    return code, tuple(int(n) for n in "".join(rest).split(",") if n), packing


def leaf_names(signal: Signal) -> list[str]:
    """Names of the fields of a sample but `t`; those of a field that is a dataclass with a dot."""
    return [name for name in _leaves(signal) if name != "t"]


def is_recordable(signal: Signal) -> bool:
    """True when every field is a number, a flag or an array of such."""
    try:
        for name in leaf_names(signal):
            _kind(attrgetter(name)(signal))
    except TypeError:
        return False
    return True


def signal_type(name: str) -> type[Signal]:
    """The sample type of a name; also of a user's own, once its file has been loaded. KeyError otherwise."""
    return {kind.__name__: kind for kind in signal_types()}[name]


def _leaves(value: Any, prefix: str = "") -> list[str]:
    names = []
    for field in fields(value):
        inner = getattr(value, field.name)
        if is_dataclass(inner):
            names += _leaves(inner, f"{prefix}{field.name}.")
        else:
            names.append(prefix + field.name)
    return names


def _kind(value: Any) -> str:
    if (plain := PLAIN.get(type(value))) is not None:
        return plain
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "fiub":
        return f"{value.dtype.newbyteorder('<').str} {','.join(map(str, value.shape))}"
    raise TypeError(f"a sample field of type {type(value).__name__} cannot be recorded")


def _kind_of(column: _Column) -> str:
    if isinstance(column, np.ndarray) and column.ndim == 1:
        return {"f": "float", "b": "bool"}.get(column.dtype.kind, "int")
    return _kind(column[0])


def _columns_of(columns: Sequence[_Column]) -> list[tuple[str, bool, bytes]]:
    """For each column: entry in `kinds`, whether all values are one array, bit for bit, and its bytes."""
    kinds = [_kind_of(values) for values in columns]
    held = [isinstance(v[0], np.ndarray) and _are_same(v[0], v) for v in columns]
    arrays = []
    for values, kind, is_held in zip(columns, kinds, held, strict=True):
        code = kind.partition(" ")[0]
        arrays.append(np.asarray(values[0] if is_held else values, dtype=CODES.get(code, code)))
    packed = packed_columns.pack_all(arrays)
    named = zip(kinds, held, packed, strict=True)
    return [(f"{kind} {path}" if path else kind, is_held, data) for kind, is_held, (path, data) in named]


def _are_same(first: np.ndarray, values: _Column) -> bool:
    if isinstance(values, np.ndarray):
        return first.tobytes() * len(values) == values.tobytes()
    if all(v is first for v in values):
        return True
    data = first.tobytes()
    return all(v is first or v.tobytes() == data for v in values)


def _build(kind: Any, t: int, columns: dict[str, Any], index: int, prefix: str = "") -> Any:
    """A dataclass from its columns; a field that has none gets its default."""
    values: dict[str, Any] = {} if prefix else {"t": t}
    for own, field in layout(kind).items():
        name = prefix + own
        if name in columns:
            values[own] = columns[name][index]
        elif is_dataclass(field.declared):
            values[own] = _build(field.declared, t, columns, index, name + ".")
    return kind(**values)
