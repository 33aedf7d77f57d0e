"""The fingerprint of a run: the same bytes for the same scenario and seed, on any number of threads.

Of each output a chained SHA-256 (FIPS 180-4): value_k = sha256(value_{k-1} || the next 64 KiB of the bytes of
its samples, in order of time). The digest is the SHA-256 of these, in the order in which the outputs came
first. What is kept between two looks is the value and the bytes so far: a run saved in the middle and resumed
ends on the digest of an uninterrupted one.
"""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from math import isnan
from struct import Struct
from typing import Any

import numpy as np

from swath.core.blocks import Block, Seen, no_look
from swath.core.frames import Pose
from swath.core.rows import HEAD, STAMPS, TIMES, Trail, address
from swath.kernels import repeatable, shared
from swath.signals import Signal

BLOCK_BYTES = 64 * 1024
TIME, INTEGER, FLOAT = Struct("<q"), Struct("<cq"), Struct("<cd")
REAL = np.dtype(float)
PLACE, TURN = b"(a<f8(3,)", b"a<f8(3, 3)"  # before the arrays of a pose
AIMED = 4 + HEAD  # numbers of a job that change from look to look
LAID = 1 << 22  # bytes: so many are laid out at once, of as many worlds as that takes (estimated)
FEW = 16  # numbers of an array that are looked at one by one
_PREFIXES: dict[tuple[Any, tuple[int, ...]], bytes] = {}  # of arrays


class _Chain:
    """What came from an output so far."""

    def __init__(self, kept: bytes = bytes(32)) -> None:
        self.value, self.block = kept[:32], bytearray(kept[32:])

    def add(self, data: "bytes | memoryview") -> None:
        rest = memoryview(data).cast("B")
        while len(rest) >= (missing := BLOCK_BYTES - len(self.block)):
            hashed = hashlib.sha256(self.value)
            hashed.update(self.block)
            hashed.update(rest[:missing])
            self.value, rest = hashed.digest(), rest[missing:]
            self.block.clear()
        self.block += rest


class Digest:
    """Observer of a graph that folds every sample of every slot, in order, into one value.

    Wall clock, threads and the files that are written do not enter. NaNs count as one value.
    """

    is_late = True

    def __init__(self) -> None:
        self.look: Callable[[], None] = no_look
        self._chains: defaultdict[tuple[str, str], _Chain] = defaultdict(_Chain)
        self._columns: dict[tuple[str, str], Columns] = {}
        self._first = np.zeros(1, np.int64)

    @cached_property
    def _launch(self) -> Callable[[], Any]:
        from swath.record.digest_kernel import lay_rows

        return repeatable(lay_rows, [shared(self._first)]).launch

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what `slot` published at t [ns]."""
        self.take(Seen.of_one(slot, t, outputs))

    def take(self, seen: Seen) -> None:
        """Take in what all slots published."""
        rows = iter(self._laid([block for block in seen.blocks if block.is_even]))
        for block in seen.blocks:
            chain = self._chains[block.slot, block.output]
            if block.is_even:
                chain.add(next(rows))
            else:
                for k, t in enumerate(block.times.tolist()):
                    chain.add(sample_bytes(block.slot, block.output, t, block.sample(k)))

    def _laid(self, blocks: Sequence[Block]) -> list[memoryview]:
        """The bytes of blocks of a world; laid out for some worlds at once, by whoever comes first."""
        if not blocks:
            return []
        world, trails = (
            blocks[0].world,
            [id(block.trail) for block in blocks],
        )  # they live as long as the look
        laid = blocks[0].trail.laid
        if laid is None or laid[1] != trails or world not in laid[2]:
            by = self if laid is None else laid[0]
            laid = blocks[0].trail.laid = by, trails, *by._lay(blocks, world)
        _, _, worlds, data, places = laid
        k = world - worlds[0]
        return [data[at + k * size : at + (k + 1) * size] for at, size in places]

    def _lay(self, blocks: Sequence[Block], world: int) -> tuple[range, memoryview, list[tuple[int, int]]]:
        """Lay out those of some worlds, from one on: which these are, the bytes, where those of each block
        begin and how many there are of a world.
        """
        jobs, whole = [], 0
        for block in blocks:
            columns = self._columns.get(block.trail.wire)
            if columns is None or columns.row is not block.trail.row:
                columns = self._columns[block.trail.wire] = Columns(block.trail)
            jobs.append((columns, block.trail.head, block.count * columns.size))
            whole += jobs[-1][2]
        worlds = range(world, min(world + max(LAID // whole, 1), len(blocks[0].trail.row.memory)))
        rows, places, following, at = np.empty(len(worlds) * whole, np.uint8), [], 0, 0
        begin = address(rows)
        for columns, head, size in jobs:
            columns.job[:AIMED] = following, begin + at, worlds.start, worlds.stop, *head.tolist()
            places.append((at, size))
            following, at = columns.address, at + size * len(worlds)
        self._first[0] = following
        self._launch()
        return worlds, rows.data, places

    @property
    def hex(self) -> str:
        """The digest so far, 64 hexadecimal digits."""
        self.look()
        whole = hashlib.sha256()
        for chain in self._chains.values():
            whole.update(hashlib.sha256(chain.value + chain.block).digest())
        return whole.hexdigest()

    def save(self) -> dict[str, Any]:
        """State between two samples."""
        self.look()
        kept = {f"{slot}/{output}": c.value + c.block for (slot, output), c in self._chains.items()}
        return {name: np.frombuffer(data, dtype=np.uint8).copy() for name, data in kept.items()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Go on from a saved state."""
        for name, kept in state.items():
            slot, _, output = name.rpartition("/")
            self._chains[slot, output] = _Chain(np.asarray(kept, dtype=np.uint8).tobytes())


def sample_bytes(slot: str, output: str, t: int, signal: Signal) -> bytes:
    """Canonical bytes of a sample published at t [ns]."""
    values = [getattr(signal, f.name) for f in fields(signal)]
    return b"".join([_head(slot, output, type(signal)), TIME.pack(t), *map(encode, values)])


def _head(slot: str, output: str, kind: Any) -> bytes:
    """How each sample of an output begins."""
    return "/".join((slot, output, kind.__name__, *(f.name for f in fields(kind)))).encode() + b"\n"


class Columns:
    """How the bytes of the samples of an output are laid out, as `sample_bytes`.

    size: of one; row: whose samples they are; job: as the kernel reads it; address: where that lies
    """

    def __init__(self, trail: Trail) -> None:
        from swath.record import digest_kernel as kernel

        first, self.row, kind = Block(trail, 0).sample(0), trail.row, trail.row.kind
        stride, step, row = self.row.memory.nbytes, self.row.memory.dtype.itemsize, bytearray()
        row += _head(*trail.wire, kind)
        table = [[8, 0, len(row), 8, kernel.COPIED, TIMES, 0]]
        row += bytes(8)
        for name in [f.name for f in fields(kind)]:
            if name in self.row.names:
                value = encode(getattr(first, name))
                for before, number, begin, shape, after in _column(value, trail.memory[name][0]):
                    row += before
                    count, how = int(np.prod(shape)), _kind(number)
                    size = count * number.itemsize
                    length = size if how == kernel.COPIED else count
                    at = self.row.offset(name) + begin * number.itemsize
                    table.append([stride, step, len(row), length, how, 0, at])
                    row += bytes(size) + after
            elif name == "t":
                row += b"i"
                table.append([8, 0, len(row), 8, kernel.COPIED, STAMPS, 0])
                row += bytes(8)
            else:
                row += encode(getattr(first, name))
        self._alike, self.size = np.frombuffer(bytes(row), np.uint8), len(row)
        known = [*[0] * AIMED, address(self._alike), self.size, len(table)]
        self.job = np.array([*known, *(v for line in table for v in line)], np.int64)
        self.address = address(self.job)


def _kind(dtype: "np.dtype[Any]") -> Any:
    """How numbers of a type become bytes."""
    from swath.record import digest_kernel as kernel

    if dtype.kind == "f":
        return kernel.DOUBLES if dtype.itemsize == 8 else kernel.FLOATS
    return kernel.FLAGS if dtype.kind == "b" else kernel.COPIED


def _column(
    of_one: bytes, array: np.ndarray
) -> list[tuple[bytes, "np.dtype[Any]", int, tuple[int, ...], bytes]]:
    """Column of a field: bytes before, type of numbers, first of them, their shape, bytes after."""
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
