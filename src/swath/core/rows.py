"""Samples as numbers at one place in memory: what compiled steps read and write.

A `Row` holds the newest sample of an output in every world; a `Trail` those before it, in order, until
somebody takes them. Compiled code finds both by their addresses (`core/ops.py`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import prod
from typing import Any, NamedTuple, get_args, get_type_hints
from weakref import finalize

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from swath.core.errors import SwathError
from swath.core.frames import Pose
from swath.core.signal import Signal, per_signal
from swath.core.together import Samples, field_of, plain

# Numbers by which compiled code knows a trail: address of its samples, how many there are and how many have
# room, addresses of times, stamps, orders.
HEAD, COUNT = 6, 1
FORMS: dict[Any, Any] = {
    float: np.float64,
    int: np.int64,
    bool: np.bool_,
    Pose: (np.float64, (12,)),  # position, then rows of the rotation
}
Ints = NDArray[np.int64]
LINE = 64  # bytes: fields that are arrays begin at such a place
SMALL = 1 << 17  # bytes: less comes from memory that the process has anyway, not in new pages
SPARE = 2  # memories that are kept: one is read while the next is filled


class Room(NamedTuple):
    """Of a field that is an array of one size: shape, and how long its first axis is where compiled code may
    write beyond that.
    """

    shape: tuple[int, ...]
    room: int = 0


class Row(Samples):
    """A sample in each world, the numbers of all fields in one memory that stays where it is.

    memory: (worlds,) of a struct with a member for each field; stamp: (1,) their time [ns]
    """

    def __init__(
        self, kind: type[Signal], memory: NDArray[Any], alike: Mapping[str, Any] | None = None
    ) -> None:
        self.memory, self.stamp = memory, np.zeros(1, np.int64)
        self._is_plain = can_be_row(kind)
        super().__init__(kind, 0, {name: memory[name] for name in memory.dtype.names or ()}, alike)

    @property
    def t(self) -> int:
        """Time of the samples [ns]."""
        return int(self.stamp[0])

    @t.setter
    def t(self, value: int) -> None:
        self.stamp[0] = value

    def take(self, samples: Samples) -> None:
        """Become the same as these."""
        for name, array in self.arrays.items():
            array[:] = field_of(samples, name)
        self.stamp[0] = samples.t

    def put(self, world: int, sample: Signal) -> None:
        """The sample of one world."""
        for name, array in self.arrays.items():
            array[world] = plain(getattr(sample, name))
        self.stamp[0] = sample.t

    def fits(self, sample: Samples | Signal) -> bool:
        """Whether the arrays of another sample have the same shapes."""
        if self._is_plain:
            return True
        if isinstance(sample, Signal):
            return all(getattr(sample, name).shape == a.shape[1:] for name, a in self.arrays.items())
        return all(
            (sample.arrays[name].shape[1:] if name in sample.arrays else np.shape(field_of(sample, name)))
            == array.shape[1:]
            for name, array in self.arrays.items()
        )

    def roomy(self, name: str, room: int) -> NDArray[Any]:
        """A field, (worlds, room, ...), with what lies behind it; see `Room`."""
        array = self.arrays[name]
        return as_strided(array, (len(array), room, *array.shape[2:]), array.strides)

    def copy(self) -> "Row":
        """One that nobody overwrites."""
        return row_at(self.kind, self.memory.copy(), self.t, self.alike)

    def each(self) -> list[Signal]:
        """The samples of all worlds."""
        if not self._is_plain:
            return super().each()
        return [self._made(values) for values in self.memory.tolist()]

    def of(self, world: int) -> Any:
        """The sample of one world."""
        return self._made(self.memory[world].tolist()) if self._is_plain else super().of(world)

    def _made(self, values: Sequence[Any]) -> Signal:
        kind, names, poses = self.kind, self.memory.dtype.names or (), _poses(self.kind)
        if poses:
            values = [_pose(v) if name in poses else v for name, v in zip(names, values, strict=True)]
        if names == _names(kind):
            return kind(int(self.stamp[0]), *values)
        return kind(int(self.stamp[0]), **dict(zip(names, values, strict=True)))


def _pose(numbers: Sequence[float]) -> Pose:
    x, y, z, a, b, c, d, e, f, g, h, i = numbers
    return Pose.of_numbers([x, y, z], [[a, b, c], [d, e, f], [g, h, i]])


def row_at(kind: type[Signal], memory: NDArray[Any], t: int, alike: Mapping[str, Any] | None = None) -> Row:
    """A row of what lies in a memory, of a time [ns]."""
    row = Row(kind, memory, alike)
    row.stamp[0] = t
    return row


def row_of(
    kind: type[Signal],
    worlds: int,
    names: Sequence[str] = (),
    *,
    rooms: Mapping[str, Room] | None = None,
    alike: Mapping[str, Any] | None = None,
) -> Row:
    """A new row, of zeros. names: fields that it holds, others have their default; () = all.

    rooms: of fields that are arrays; alike: fields that are the same in all samples
    SwathError where a field is no number, flag, pose or array of a known size.
    """
    forms, rooms, alike = _forms(kind), rooms or {}, alike or {}
    held = [name for name in names or forms if name not in alike]
    wrong = [name for name in held if forms[name] is None and name not in rooms]
    if wrong:
        raise SwathError(f"{kind.__name__}.{wrong[0]}: expected a number, a flag or a pose")
    members = [(name, *(f if isinstance(f := forms[name], tuple) else (f,))) for name in held]
    dtype = np.dtype(members, align=True) if not rooms else _with_arrays(kind, held, rooms)
    return Row(kind, np.zeros(worlds, dtype), alike)


def row_like(sample: Samples | Signal, worlds: int) -> Row:
    """A new row for samples of this form, arrays included."""
    kind = type(sample) if isinstance(sample, Signal) else sample.kind
    if can_be_row(kind):
        return row_of(kind, worlds)
    rooms = dict[str, Room]()
    for name, form in _forms(kind).items():
        if form is None and isinstance(sample, Samples) and name in sample.arrays:
            rooms[name] = Room(sample.arrays[name].shape[1:])
        elif form is None:
            value = field_of(sample, name) if isinstance(sample, Samples) else getattr(sample, name)
            rooms[name] = Room(np.shape(value))
    return row_of(kind, worlds, rooms=rooms)


def _with_arrays(kind: type[Signal], names: Sequence[str], rooms: Mapping[str, Room]) -> np.dtype[Any]:
    """The struct of a sample with arrays, with room behind them."""
    formats, offsets, size, forms = list[Any](), list[int](), 0, _forms(kind)
    for name in names:
        offsets.append(size)
        if name in rooms:
            shape, room = rooms[name]
            number = _number_of(kind, name)
            formats.append((number, shape))
            size += number.itemsize * int(np.prod((max(room, shape[0]), *shape[1:])))
        else:
            formats.append(forms[name])
            size += np.dtype(forms[name]).itemsize
        size = -(-size // LINE) * LINE
    return np.dtype({"names": [*names], "formats": formats, "offsets": offsets, "itemsize": size})


def _number_of(kind: type[Signal], name: str) -> np.dtype[Any]:
    """What an array field holds, as it is declared: NDArray[np.float64]."""
    (number,) = get_args(get_args(get_type_hints(kind)[name])[1])
    found: np.dtype[Any] = np.dtype(number)
    return found


def can_be_row(kind: type[Signal]) -> bool:
    """Whether all its fields are numbers, flags or poses."""
    return None not in _forms(kind).values()


@per_signal
def _forms(kind: type[Signal]) -> Mapping[str, Any]:
    hints = get_type_hints(kind)
    return {f.name: FORMS.get(hints[f.name]) for f in fields(kind) if f.name != "t"}


@per_signal
def _names(kind: type[Signal]) -> tuple[str, ...]:
    return tuple(_forms(kind))


@per_signal
def _poses(kind: type[Signal]) -> tuple[str, ...]:
    hints = get_type_hints(kind)
    return tuple(f.name for f in fields(kind) if hints[f.name] is Pose)


class Trail:
    """Samples of a row in the order in which they came.

    times: when each was sent [ns]; stamps: its own `t`; orders: its place among all that was sent
    head: (HEAD,) where the memories lie, and how many samples there are; compiled code adds to it
    spare: memories of earlier trails of this output
    """

    def __init__(self, row: Row, room: int, head: Ints | None = None, spare: "Spare | None" = None) -> None:
        self.row, self._spare = row, spare or Spare()
        self.head = np.zeros(HEAD, np.int64) if head is None else head
        self.head[COUNT] = 0
        self.memory: NDArray[Any]
        self.times: Ints
        self.stamps: Ints
        self.orders: Ints
        self._grow(room)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.head[COUNT])

    def reserve(self, more: int) -> None:
        """Room for so many more."""
        if self.count + more > len(self.times):
            self._grow(2 * self.count + more)

    def append(self, t: int, order: int = 0) -> None:
        """The row as it is, sent at t [ns]."""
        k = self.count
        if k == len(self.times):
            self._grow(2 * k)
        self.memory[k] = self.row.memory
        self.times[k], self.stamps[k], self.orders[k] = t, self.row.stamp[0], order
        self.head[COUNT] = k + 1

    def at(self, k: int) -> Row:
        """A copy of one of them."""
        return row_at(self.row.kind, self.memory[k].copy(), int(self.stamps[k]), self.row.alike)

    def forget(self, first: int) -> None:
        """Drop so many of the oldest."""
        rest = self.count - first
        if rest:
            for array in (self.memory, self.times, self.stamps, self.orders):
                array[:rest] = array[first : first + rest].copy()
        self.head[COUNT] = rest

    def _grow(self, room: int) -> None:
        count, row = self.count, self.row.memory
        memory, numbers = self._spare.empty((room, *row.shape), row.dtype), np.empty((3, room), np.int64)
        if count:
            memory[:count], numbers[0, :count] = self.memory[:count], self.times[:count]
            numbers[1, :count], numbers[2, :count] = self.stamps[:count], self.orders[:count]
        self.memory = memory
        self.times, self.stamps, self.orders = numbers
        first, size = numbers.ctypes.data, 8 * room
        self.head[:] = memory.ctypes.data, count, room, first, first + size, first + 2 * size


class Spare:
    """Memories that are used again once no array of them is left: new ones cost a page fault each 4 KiB."""

    def __init__(self) -> None:
        self._kept: list[NDArray[np.uint8]] = []

    def empty(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """An array that holds anything."""
        size = prod(shape) * dtype.itemsize
        if size < SMALL:
            return np.empty(shape, dtype)
        at = next((k for k, known in enumerate(self._kept) if len(known) >= size), None)
        memory = np.empty(size, np.uint8) if at is None else self._kept.pop(at)
        base = np.frombuffer(memory.data, np.uint8, size)  # of all views
        finalize(base, self._take_back, memory).atexit = False
        return base.view(dtype).reshape(shape)

    def _take_back(self, memory: NDArray[np.uint8]) -> None:
        self._kept = [memory, *self._kept[: SPARE - 1]]
