"""The fingerprint of a run: the same bytes for the same scenario and seed, on any number of threads.

A chained SHA-256 (FIPS 180-4): value_k = sha256(value_{k-1} || bytes of samples), over blocks that end with
the first sample that fills them. What is kept between two samples is the value and the block so far: a run
saved in the middle and resumed ends on the digest of an uninterrupted one.
"""

import hashlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from math import isnan
from operator import attrgetter
from struct import Struct
from typing import Any, cast

import numpy as np

from swath.core.frames import Pose
from swath.core.frozen import define
from swath.core.schedule import NS
from swath.core.together import Samples, Sent
from swath.kernels import repeatable, shared
from swath.signals import Signal

BLOCK_BYTES = 64 * 1024
LATEST = NS // 10  # that a sample waits, where it may wait
TIME, INTEGER, FLOAT = Struct("<q"), Struct("<cq"), Struct("<cd")
PLAIN = {int: "cq", float: "cd", bool: "c"}  # layout of a number with its letter
LETTERS = {int: b"i", float: b"d"}
REAL = np.dtype(float)
PLACE, TURN = b"(a<f8(3,)", b"a<f8(3, 3)"  # before the arrays of a pose
Packer = Callable[[int, Any], "bytes | None"]
_Published = tuple[str, int, tuple[tuple[str, Signal], ...]]  # slot, time [ns], output and sample
FEW = 16  # numbers of an array that are looked at one by one
_LAYOUTS: dict[tuple[str, str, Any], "_Layout"] = {}
_PACKERS: dict[tuple[str, str, Any], Packer] = {}  # of those that have one
_PREFIXES: dict[tuple[Any, tuple[int, ...]], bytes] = {}  # of arrays


class Digest:
    """Observer of a graph that folds every sample of every slot, in order, into one value.

    Wall clock, threads and the files that are written do not enter. NaNs count as one value.
    """

    def __init__(self) -> None:
        self._value = bytes(32)
        self._block = bytearray()
        self._waiting: deque[_Published] | None = None  # what is to be taken in, None = nothing may wait

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what `slot` published at t [ns]."""
        waiting = self._waiting
        if waiting is None:
            self._take(slot, t, outputs.items())
            return
        waiting.append((slot, t, tuple(outputs.items())))
        while waiting[0][1] <= t - LATEST:
            self.take_next()

    def defer(self) -> None:
        """From now on `take_next` takes samples in, a slot at a time; none waits longer than LATEST."""
        self._waiting = deque()

    def take_next(self) -> bool:
        """Take in the oldest of what waits; False where nothing does."""
        if not self._waiting:
            return False
        self._take(*self._waiting.popleft())
        return True

    def _take(self, slot: str, t: int, outputs: Iterable[tuple[str, Signal]]) -> None:
        block = self._block
        for output, signal in outputs:
            pack = _PACKERS.get((slot, output, type(signal)))
            block += (pack and pack(t, signal)) or sample_bytes(slot, output, t, signal)
            if len(block) >= BLOCK_BYTES:
                self._fold()

    def add(self, sample: bytes | memoryview) -> None:
        """Take in the bytes of one sample, or of all that ends with the one that fills a block."""
        if not self._block and len(sample) >= BLOCK_BYTES:  # as below, without a copy
            value = hashlib.sha256(self._value)
            value.update(sample)
            self._value = value.digest()
            return
        self._block += sample
        if len(self._block) >= BLOCK_BYTES:
            self._fold()

    def _take_waiting(self) -> None:
        while self.take_next():
            pass

    def _fold(self) -> None:
        self._value = hashlib.sha256(self._value + self._block).digest()
        self._block.clear()

    @property
    def hex(self) -> str:
        """The digest so far, 64 hexadecimal digits."""
        self._take_waiting()
        return hashlib.sha256(self._value + self._block).hexdigest()

    def save(self) -> dict[str, Any]:
        """State between two samples."""
        self._take_waiting()
        return {"value": np.frombuffer(self._value + self._block, dtype=np.uint8).copy()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Go on from a saved state."""
        kept = np.asarray(state["value"], dtype=np.uint8).tobytes()
        self._value, self._block = kept[:32], bytearray(kept[32:])


def sample_bytes(slot: str, output: str, t: int, signal: Signal) -> bytes:
    """Canonical bytes of a sample published at t [ns]."""
    key = slot, output, type(signal)
    layout = _LAYOUTS.get(key)
    if layout is None:
        layout = _LAYOUTS[key] = _Layout(*key)
    return layout.bytes_of(t, signal)


class _Layout:
    """The bytes of the samples of an output: numbers and poses go through one Struct while types stay.

    pack: that does it, None where other fields are among them
    """

    def __init__(self, slot: str, output: str, kind: Any) -> None:
        self._names = tuple(f.name for f in fields(kind))
        self._values = attrgetter(*self._names, self._names[0])  # a tuple also of a single field
        self._head = "/".join((slot, output, kind.__name__, *self._names)).encode() + b"\n"
        self._key = slot, output, kind
        self._types: tuple[type, ...] = ()
        self.pack: Packer | None = None
        self._kept: dict[int, tuple[Any, bytes]] = {}  # arrays that do not change, by field, and their bytes

    def bytes_of(self, t: int, signal: Signal) -> bytes:
        if self.pack is not None and (packed := self.pack(t, signal)) is not None:
            return packed
        values = self._values(signal)[:-1]
        types = tuple(map(type, values))
        if types != self._types:
            self._types = types
            self.pack = _packer(self._head, self._names, types)
            if self.pack is not None:
                _PACKERS[self._key] = self.pack
        return b"".join([self._head, TIME.pack(t), *map(self._encode, range(len(values)), values)])

    def _encode(self, place: int, value: Any) -> bytes:
        """As `encode`; of an array that nobody can write to and that comes again, the bytes as before."""
        if type(value) is not np.ndarray or value.flags.writeable or value.base is not None:
            return encode(value)
        kept = self._kept.get(place)
        if kept is None or kept[0] is not value:
            kept = self._kept[place] = value, encode(value)
        return kept[1]


def _packer(head: bytes, names: Sequence[str], types: Sequence[type]) -> Packer | None:
    """Packs samples whose fields are of these types, numbers and poses; None where others are among them.

    A packer gives None for a sample with other types. Letters come before numbers, nothing before a flag.
    """
    if not all(kind in PLAIN or kind is Pose for kind in types):
        return None
    layout, packed = f"<{len(head)}sq", ["head", "t"]
    lines, right, reals = [], [], []  # `right`: what has to hold; `reals`: what may be nan
    for i, (name, kind) in enumerate(zip(names, types, strict=True)):
        v = f"v{i}"
        lines.append(f"{v} = s.{name}")
        right.append(f"type({v}) is k{i}")
        if kind is Pose:
            right.append(f"('rotation' not in {v}.__dict__ or is_usual({v}))")
            place, turn = [f"{v}p{k}" for k in range(3)], [f"{v}r{k}" for k in range(9)]
            layout += f"{len(PLACE)}s3d{len(TURN)}s9dc"
            packed += ["place", *place, "turn", *turn, "b')'"]
            reals += place + turn
        else:
            layout += PLAIN[kind]
            packed += [f"b't' if {v} else b'f'"] if kind is bool else [repr(LETTERS[kind]), v]
            reals += [v] if kind is float else []
    lines.append(f"if not ({' and '.join(right)}): return None")
    lines += [line for i, kind in enumerate(types) if kind is Pose for line in _unpacked(f"v{i}")]
    if reals:
        lines += [f"x = {' + '.join(reals)}", "if x != x:", *(f" if {v} != {v}: {v} = nan" for v in reals)]
    lines.append(f"return pack({', '.join(packed)})")
    known = {"head": head, "is_usual": _is_usual, "place": PLACE, "turn": TURN, "nan": np.nan}
    kinds = {f"k{i}": kind for i, kind in enumerate(types)}
    return cast("Packer", define("packer", "t, s", lines, {**known, **kinds, "pack": Struct(layout).pack}))


class Digests:
    """Those of many worlds, fed with samples of all of them.

    While the bytes of a sample are as many in all worlds, they lie side by side until a block is full.
    """

    def __init__(self, digests: Sequence[Digest]) -> None:
        self._digests = digests
        self._columns: dict[tuple[str, str], Columns] = {}
        self._block = np.zeros((len(digests), BLOCK_BYTES), np.uint8)
        self._at, self._is_even = 0, True

    def take(self, slot: str, t: int, outputs: Mapping[str, Sent], active: np.ndarray) -> None:
        """Take in what `slot` published at t [ns]; of worlds that have ended nothing counts any more."""
        for output, sent in outputs.items():
            if sent.is_of_all:
                columns = self._columns.get((slot, output))
                if columns is None:
                    columns = self._columns[slot, output] = Columns(slot, output, sent.all)
                if self._is_even:
                    columns.put(t, sent.all, self._room(columns.size))
                    self._grow(columns.size, active)
                    continue
                rows: Sequence[Any] | np.ndarray = columns.bytes_of(t, sent.all)
            else:
                rows = [sample_bytes(slot, output, t, sample) for sample in sent.each]
            if self._is_even and len({len(row) for row in rows}) == 1:
                size = len(rows[0])
                self._room(size)[:] = np.frombuffer(b"".join(rows), np.uint8).reshape(len(rows), size)
                self._grow(size, active)
                continue
            if self._is_even:
                self._pass_on(np.flatnonzero(active).tolist())
                self._is_even = False
            for world in np.flatnonzero(active).tolist():
                self._digests[world].add(bytes(rows[world]))

    def give(self, world: int) -> None:
        """What has come so far counts in the digest of a world."""
        self._digests[world].add(self._block[world, : self._at].data)

    def _room(self, size: int) -> np.ndarray:
        """Where the next bytes of all worlds go, (worlds, size)."""
        end = self._at + size
        if end > self._block.shape[1]:
            more = np.zeros((len(self._block), end), np.uint8)
            more[:, : self._at] = self._block[:, : self._at]
            self._block = more
        return self._block[:, self._at : end]

    def _grow(self, size: int, active: np.ndarray) -> None:
        self._at += size
        if self._at >= BLOCK_BYTES:
            self._pass_on(np.flatnonzero(active).tolist())

    def _pass_on(self, worlds: Sequence[int]) -> None:
        for world in worlds:
            self.give(world)
        self._at = 0


class Columns:
    """The bytes of the samples of an output in many worlds, as `sample_bytes` has them. size: of one"""

    def __init__(self, slot: str, output: str, samples: Samples) -> None:
        from swath.record import digest_kernel as kernel

        kind = samples.kind
        names = [f.name for f in fields(kind)]
        row = bytearray("/".join((slot, output, kind.__name__, *names)).encode() + b"\n" + bytes(8))
        table = [[0, 0, len(row) - 8, 8, kernel.ALIKE]]
        self._arrays: list[tuple[str, np.dtype[Any], int]] = []  # field, type, first number of each
        for name in names:
            if name == "t":
                row += b"i" + bytes(8)
                table.append([samples.t, 0, len(row) - 8, 8, kernel.ALIKE])
                self._t_again = len(table) - 1
                continue
            if name not in samples.arrays:
                row += encode(getattr(samples.of(0), name))
                continue
            for before, dtype, first, shape, after in _column(
                encode(samples.of(0).__dict__[name]), samples.arrays[name]
            ):
                row += before
                count, how = int(np.prod(shape)), _kind(dtype)
                size = count * dtype.itemsize
                table.append([0, 0, len(row), size if how == kernel.COPIED else count, how])
                row += bytes(size) + after
                self._arrays.append((name, dtype, first))
        self._row, self.size = np.frombuffer(bytes(row), np.uint8), len(row)
        count = len(next(iter(samples.arrays.values())))
        head = [self._row.ctypes.data, self.size, 0, 0, count, len(table)]
        self._job = np.array([*head, *(v for line in table for v in line)], np.int64)
        self._table = self._job[len(head) :].reshape(-1, 5)
        self._launch = repeatable(kernel.lay_rows, [shared(self._job)]).launch
        self._varies = [k for k, line in enumerate(table) if line[4] != kernel.ALIKE]

    def put(self, t: int, samples: Samples, rows: np.ndarray) -> None:
        """Into rows, (worlds, size) uint8."""
        table, kept = self._table, []
        table[0, 0], table[self._t_again, 0] = t, samples.t
        for k, (name, dtype, first) in zip(self._varies, self._arrays, strict=True):
            array = samples.arrays[name]
            if array.dtype != dtype or not (array.ndim == 1 or array[0].flags.c_contiguous):
                array = np.ascontiguousarray(array, dtype)
                kept.append(array)
            at = array.__array_interface__["data"][0]  # in half the time of `ctypes`
            table[k, 0], table[k, 1] = at + first * dtype.itemsize, array.strides[0]
        self._job[2], self._job[3] = rows.ctypes.data, rows.strides[0]
        self._launch()

    def bytes_of(self, t: int, samples: Samples) -> np.ndarray:
        """(worlds, size) uint8."""
        rows = np.empty((int(self._job[4]), self.size), np.uint8)
        self.put(t, samples, rows)
        return rows


def _kind(dtype: "np.dtype[Any]") -> Any:
    """How numbers of a type become bytes."""
    from swath.record import digest_kernel as kernel

    if dtype.kind == "f":
        return kernel.DOUBLES if dtype.itemsize == 8 else kernel.FLOATS
    return kernel.FLAGS if dtype.kind == "b" else kernel.COPIED


def _column(
    of_one: bytes, array: np.ndarray
) -> list[tuple[bytes, "np.dtype[Any]", int, tuple[int, ...], bytes]]:
    """Of a field: bytes before, type of numbers, first of them, their shape, bytes after."""
    kind, shape = array.dtype, array.shape[1:]
    if of_one[:1] == b"(":  # a pose
        return [(PLACE, REAL, 0, (3,), b""), (TURN, REAL, 3, (3, 3), b")")]
    prefix, is_flag = f"a{kind.newbyteorder('<').str}{shape}".encode(), kind.kind == "b"
    if shape:
        return [(prefix, np.dtype(np.uint8) if is_flag else kind, 0, shape, b"")]
    if is_flag:
        return [(b"", kind, 0, (), b"")]
    letter, form = (b"d", REAL) if kind.kind == "f" else (b"i", np.dtype(np.int64))
    return [(letter, form, 0, (), b"")]


def _unpacked(v: str) -> list[str]:
    """Lines that take the numbers out of a pose."""
    rows = ", ".join(f"({', '.join(f'{v}r{first + k}' for k in range(3))})" for first in (0, 3, 6))
    return [f"({v}p0, {v}p1, {v}p2), ({rows}) = {v}.numbers"]


def _is_usual(pose: Pose) -> bool:
    """Whether the arrays of a pose are of its kind and shape."""
    p, r = pose.position, pose.rotation
    return p.dtype is REAL and r.dtype is REAL and p.shape == (3,) and r.shape == (3, 3)


def encode(value: Any) -> bytes:
    """Canonical bytes of a field: a letter for its kind, then little-endian content."""
    if encoder := ENCODERS.get(type(value)):
        return encoder(value)
    if isinstance(value, np.generic):
        return encode(value.item())
    if is_dataclass(value):
        return b"(" + b"".join(encode(getattr(value, f.name)) for f in fields(value)) + b")"
    for kind, encoder in ENCODERS.items():
        if isinstance(value, kind):
            return encoder(value)
    raise TypeError(f"a sample field of type {type(value).__name__} has no canonical bytes")


def _encode_float(value: float) -> bytes:
    return FLOAT.pack(b"d", value if value == value else np.nan)


def _encode_text(value: str) -> bytes:
    data = value.encode()
    return INTEGER.pack(b"s", len(data)) + data


def _encode_items(value: tuple[Any, ...] | list[Any]) -> bytes:
    return INTEGER.pack(b"[", len(value)) + b"".join(encode(v) for v in value)


def _encode_array(array: np.ndarray) -> bytes:
    kind, shape = array.dtype, array.shape
    prefix = _PREFIXES.get((kind, shape))
    if prefix is None:
        prefix = _PREFIXES[kind, shape] = f"a{kind.newbyteorder('<').str}{shape}".encode()
    if kind.kind == "f" and _has_nan(array):
        array = array.copy()
        array[array != array] = np.nan
    return prefix + (array if kind.isnative else array.astype(kind.newbyteorder("<"))).tobytes()


def _has_nan(array: np.ndarray) -> bool:
    if array.size <= FEW:
        return any(map(isnan, array.ravel().tolist()))
    return b"\x01" in (array != array).tobytes()  # in a third of the time of `np.isnan(array).any()`


def _encode_pose(pose: Pose) -> bytes:
    return b"(" + _encode_array(pose.position) + _encode_array(pose.rotation) + b")"


ENCODERS: dict[type, Callable[[Any], bytes]] = {
    bool: lambda value: b"t" if value else b"f",
    int: lambda value: INTEGER.pack(b"i", value),
    float: _encode_float,
    np.ndarray: _encode_array,
    type(None): lambda value: b"n",
    str: _encode_text,
    tuple: _encode_items,
    list: _encode_items,
    Pose: _encode_pose,
}
