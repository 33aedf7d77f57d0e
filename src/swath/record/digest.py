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
from swath.core.together import Samples
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

    def add(self, sample: bytes) -> None:
        """Take in the bytes of one sample."""
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

    def take(
        self, slot: str, t: int, outputs: Mapping[str, "Samples | Sequence[Signal]"], active: np.ndarray
    ) -> None:
        """Take in what `slot` published at t [ns]; of worlds that have ended nothing counts any more."""
        for output, sent in outputs.items():
            rows: Sequence[Any] | np.ndarray
            if isinstance(sent, Samples):
                columns = self._columns.get((slot, output))
                if columns is None:
                    columns = self._columns[slot, output] = Columns(slot, output, sent)
                rows = columns.bytes_of(t, sent)
            else:
                rows = [sample_bytes(slot, output, t, sample) for sample in sent]
                if self._is_even and len({len(row) for row in rows}) == 1:
                    rows = np.frombuffer(b"".join(rows), np.uint8).reshape(len(rows), -1)
            if self._is_even and isinstance(rows, np.ndarray):
                self._put(rows, active)
                continue
            if self._is_even:
                self._pass_on(np.flatnonzero(active).tolist())
                self._is_even = False
            for world in np.flatnonzero(active).tolist():
                self._digests[world].add(bytes(rows[world]))

    def give(self, world: int) -> None:
        """What has come so far counts in the digest of a world."""
        self._digests[world].add(self._block[world, : self._at].tobytes())

    def _put(self, rows: np.ndarray, active: np.ndarray) -> None:
        end = self._at + rows.shape[1]
        if end > self._block.shape[1]:
            more = np.zeros((len(rows), end), np.uint8)
            more[:, : self._at] = self._block[:, : self._at]
            self._block = more
        self._block[:, self._at : end] = rows
        self._at = end
        if end >= BLOCK_BYTES:
            self._pass_on(np.flatnonzero(active).tolist())

    def _pass_on(self, worlds: Sequence[int]) -> None:
        for world in worlds:
            self.give(world)
        self._at = 0


class Columns:
    """The bytes of the samples of an output in many worlds, as `sample_bytes` has them."""

    def __init__(self, slot: str, output: str, samples: Samples) -> None:
        kind = samples.kind
        names = [f.name for f in fields(kind)]
        parts: list[tuple[str, bytes | None, Any, tuple[int, ...]]] = [
            ("", "/".join((slot, output, kind.__name__, *names)).encode() + b"\n", None, ()),
            ("t", None, "<i8", ()),
        ]
        for name in names:
            if name == "t":
                parts += [("", b"i", None, ()), ("t again", None, "<i8", ())]
            elif name not in samples.arrays:
                parts.append(("", encode(getattr(samples.of(0), name)), None, ()))
            else:
                parts += _column(name, encode(samples.of(0).__dict__[name]), samples.arrays[name])
        offsets, formats, at = [], [], 0
        for _, constant, form, shape in parts:
            offsets.append(at)
            formats.append((form, shape) if constant is None else f"V{len(constant)}")
            at += len(constant) if constant is not None else np.dtype((form, shape)).itemsize
        count = len(next(iter(samples.arrays.values())))
        self._bytes = np.zeros((count, at), np.uint8)
        for (_, constant, _, _), offset in zip(parts, offsets, strict=True):
            if constant is not None:
                self._bytes[:, offset : offset + len(constant)] = np.frombuffer(constant, np.uint8)
        variable = [(p[0], f, o) for p, f, o in zip(parts, formats, offsets, strict=True) if p[1] is None]
        layout = {
            "names": [v[0] for v in variable], "formats": [v[1] for v in variable],
            "offsets": [v[2] for v in variable], "itemsize": at,
        }  # fmt: skip
        table = self._bytes.view(np.dtype(layout))[:, 0]  # type: ignore[call-overload]
        self._of = {v[0]: table[v[0]] for v in variable}

    def bytes_of(self, t: int, samples: Samples) -> np.ndarray:
        """(worlds, bytes) uint8, overwritten by the next call."""
        for name, place in self._of.items():
            if name in ("t", "t again"):
                place[:] = t if name == "t" else samples.t
                continue
            first, _, part = name.partition(" ")
            array = samples.arrays[first]
            if array.dtype == bool:
                array = np.where(array, ord("t"), ord("f"))
            if part:
                array = array[:, :3] if part == "place" else array[:, 3:].reshape(-1, 3, 3)
            place[:] = array
            if array.dtype.kind == "f" and _has_nan(array):
                place[place != place] = np.nan
        return self._bytes


def _column(
    name: str, of_one: bytes, array: np.ndarray
) -> list[tuple[str, bytes | None, Any, tuple[int, ...]]]:
    """Parts of the bytes of a field: name, bytes that are alike or None, format, shape."""
    kind, shape = array.dtype, array.shape[1:]
    if of_one[:1] == b"(":  # a pose
        place, turn = (f"{name} place", None, "<f8", (3,)), (f"{name} turn", None, "<f8", (3, 3))
        return [("", PLACE, None, ()), place, ("", TURN, None, ()), turn, ("", b")", None, ())]
    if kind.kind == "b":
        return [(name, None, "u1", ())]
    if not shape:
        letter, form = (b"d", "<f8") if kind.kind == "f" else (b"i", "<i8")
        return [("", letter, None, ()), (name, None, form, ())]
    form = kind.newbyteorder("<").str
    return [("", f"a{form}{shape}".encode(), None, ()), (name, None, form, shape)]


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
