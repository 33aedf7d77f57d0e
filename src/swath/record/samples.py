"""Samples bit for bit, in blocks beside the standard messages: what a recorded slot is played back from.

Standard messages round (float32), rename (nan becomes inf), leave out and are thinned. A block
(`swath_msgs/msg/Samples`, topic `<topic of the output>_exact`) holds up to half a second of one output: two
columns of times and one per field. A field that is the same array in all samples of a block is stored once.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from swath.core.blocks import Block
from swath.core.errors import InputError, reason_of
from swath.core.frames import Pose
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
        self._samples: list[Any] = []
        self._pieces: list[tuple[Block, int, int]] = []  # in their place: of blocks of the run, from, to
        self._published: list[int] = []  # [ns]
        self._signal: type[Signal] | None = None
        self._poses: list[
            int
        ] = []  # places of whole poses among what is read of a sample, the last one first
        self._most = 1  # samples that fill a block by their size

    def add(self, t: int, signal: Signal) -> None:
        """Add a sample published at t [ns]. Raises TypeError for a field that cannot be recorded."""
        self._begin(signal)
        self._come_apart()
        self._samples.append(signal)
        self._published.append(t)

    def take(self, t: int, block: Block, k: int) -> None:
        """As `add`, one of the samples of a block of the run."""
        if not self._published or block.kind is not self._signal:
            self._begin(block.sample(k))
        if self._samples or not block.is_even:
            self.add(t, block.sample(k))
            return
        before = self._pieces[-1] if self._pieces else None
        if before is not None and before[0] is block:
            self._pieces[-1] = block, before[1], k + 1
        else:
            self._pieces.append((block, k, k + 1))
        self._published.append(t)

    def _begin(self, signal: Signal) -> None:
        if type(signal) is not self._signal:
            self.flush()
            self._signal = type(signal)
            self._names = leaf_names(signal)
            self._whole, self._poses = _taken(signal, self._names)
            self._values = attrgetter(*self._whole, "t", "t")  # a tuple also of no field
        if not self._published:
            row = [attrgetter(name)(signal) for name in self._names]
            for value in row:
                _kind(value)
            size = sum(v.nbytes if isinstance(v, np.ndarray) else 8 for v in row)
            self._most = max(1, -(-BLOCK_BYTES // max(size, 1)))

    def _come_apart(self) -> None:
        """Make samples of the pieces."""
        self._samples += [block.sample(k) for block, a, b in self._pieces for k in range(a, b)]
        self._pieces = []

    @property
    def is_full(self) -> bool:
        """The block has its length or its size, and is to be written."""
        at = self._published
        return bool(at) and (at[-1] - at[0] >= self._length or len(at) >= self._most)

    def save(self) -> dict[str, Any]:
        """Samples that wait for their block."""
        self._come_apart()
        waiting = {"samples": list(self._samples), "published": list(self._published)}
        return {**waiting, "most": self._most, "length": self._length}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from a saved state."""
        self._length = state["length"]
        for signal, t in zip(state["samples"], state["published"], strict=True):
            self.add(t, signal)
        self._most = state["most"]

    def flush(self) -> None:
        """Write what has been added, in blocks whose columns are each of one kind."""
        columns = self._joined()
        if columns is None:
            self._come_apart()
        samples, published = self._samples, self._published
        self._samples, self._pieces, self._published = [], [], []
        if not published:
            return
        self._length = BLOCK_NS
        if columns is not None:
            *taken, t = columns
            self._write(self._with_poses(taken), published, t.tolist())
            return
        *taken, t, _ = zip(*map(self._values, samples), strict=True)
        columns = self._with_poses(taken)
        if all(map(_is_even, columns)):
            self._write(columns, published, t)
            return
        forms = [[_form(value) for value in row] for row in zip(*columns, strict=True)]
        first = 0
        for i in range(1, len(forms) + 1):
            if i == len(forms) or forms[i] != forms[first]:
                self._write([c[first:i] for c in columns], published[first:i], t[first:i])
                first = i

    def _with_poses(self, taken: Sequence[_Column]) -> list[_Column]:
        """Columns of positions and rotations in place of whole poses."""
        columns: list[_Column] = [*taken]
        for place in self._poses:  # from the last one on
            columns[place : place + 1] = _of_poses(taken[place])
        return columns

    def _joined(self) -> list[Any] | None:
        """Columns of the pieces, at last that of `t`; None where they have none in common."""
        if not self._pieces or any("." in name for name in self._whole):
            return None
        found = []
        for name in (*self._whole, "t"):
            parts = [block[name][a:b] for block, a, b in self._pieces]
            if parts[0].dtype.kind not in "fiub" or len({(p.dtype, p.shape[1:]) for p in parts}) > 1:
                return None
            found.append(np.concatenate(parts))
        return found

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


def _taken(signal: Signal, names: Sequence[str]) -> tuple[list[str], list[int]]:
    """What is read of each sample: poses as a whole; and their places, the last one first."""
    taken: list[str] = []
    poses: list[int] = []
    for name in names:
        whole, _, part = name.rpartition(".")
        if part not in ("position", "rotation") or type(attrgetter(whole)(signal)) is not Pose:
            taken.append(name)
        elif part == "position":
            poses.insert(0, len(taken))
            taken.append(whole)
    return taken, poses


def _of_poses(poses: Any) -> tuple[_Column, _Column]:
    """Their positions and rotations; where their plain numbers are at hand, as mostly, in one array each."""
    if isinstance(poses, np.ndarray):
        return poses[:, :3], poses[:, 3:].reshape(-1, 3, 3)
    if all(type(pose) is Pose and pose.is_plain for pose in poses):
        numbers = [pose.numbers for pose in poses]
        return np.array([place for place, _ in numbers]), np.array([rows for _, rows in numbers])
    return tuple(pose.position for pose in poses), tuple(pose.rotation for pose in poses)


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
