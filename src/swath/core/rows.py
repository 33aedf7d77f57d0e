"""Samples as numbers at one place in memory: what compiled steps read and write.

A `Row` holds the newest sample of an output in every world; a `Trail` those before it, in order, until
somebody takes them. Compiled code finds both by their addresses (`core/ops.py`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import SwathError
from swath.core.frames import Pose
from swath.core.signal import Signal, per_signal
from swath.core.together import Samples, field_of, plain

HEAD = 6  # numbers by which compiled code knows a trail
PLACE, COUNT, ROOM, TIMES, STAMPS, ORDERS = range(HEAD)  # addresses but for COUNT and ROOM
FORMS: dict[Any, Any] = {
    float: np.float64,
    int: np.int64,
    bool: np.bool_,
    Pose: (np.float64, (12,)),  # position, then rows of the rotation
}
Ints = NDArray[np.int64]


class Row(Samples):
    """A sample in each world, the numbers of all fields in one memory that stays where it is.

    memory: (worlds,) of a struct with a member for each field; stamp: (1,) their time [ns]
    """

    def __init__(self, kind: type[Signal], memory: NDArray[Any]) -> None:
        self.memory, self.stamp = memory, np.zeros(1, np.int64)
        super().__init__(kind, 0, {name: memory[name] for name in memory.dtype.names or ()})

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

    def copy(self) -> "Row":
        """One that nobody overwrites."""
        return row_at(self.kind, self.memory.copy(), self.t)

    def each(self) -> list[Signal]:
        """The samples of all worlds."""
        return [self._made(values) for values in self.memory.tolist()]

    def of(self, world: int) -> Signal:
        """The sample of one world."""
        return self._made(self.memory[world].tolist())

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


def row_at(kind: type[Signal], memory: NDArray[Any], t: int) -> Row:
    """A row of what lies in a memory, of a time [ns]."""
    row = Row(kind, memory)
    row.stamp[0] = t
    return row


def row_of(kind: type[Signal], worlds: int, names: Sequence[str] = ()) -> Row:
    """A new row, of zeros. names: fields that it holds, others have their default; () = all.

    SwathError where a field is no number, flag or pose.
    """
    forms = _forms(kind)
    wrong = [name for name in names or forms if forms[name] is None]
    if wrong:
        raise SwathError(f"{kind.__name__}.{wrong[0]}: expected a number, a flag or a pose")
    members = [(name, *(f if isinstance(f := forms[name], tuple) else (f,))) for name in names or forms]
    return Row(kind, np.zeros(worlds, np.dtype(members, align=True)))


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
    """

    def __init__(self, row: Row, room: int, head: Ints | None = None) -> None:
        self.row = row
        self.head = np.zeros(HEAD, np.int64) if head is None else head
        self.head[COUNT] = 0
        self.memory = np.empty((0, *row.memory.shape), row.memory.dtype)
        self.times, self.stamps, self.orders = (np.empty(0, np.int64) for _ in range(3))
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
        return row_at(self.row.kind, self.memory[k].copy(), int(self.stamps[k]))

    def forget(self, first: int) -> None:
        """Drop so many of the oldest."""
        rest = self.count - first
        if rest:
            for array in (self.memory, self.times, self.stamps, self.orders):
                array[:rest] = array[first : first + rest].copy()
        self.head[COUNT] = rest

    def _grow(self, room: int) -> None:
        count = self.count

        def grown(array: NDArray[Any]) -> NDArray[Any]:
            larger = np.empty((room, *array.shape[1:]), array.dtype)
            larger[:count] = array[:count]
            return larger

        self.memory, self.times, self.stamps, self.orders = map(
            grown, (self.memory, self.times, self.stamps, self.orders)
        )
        self.head[PLACE], self.head[ROOM] = self.memory.ctypes.data, room
        self.head[TIMES], self.head[STAMPS], self.head[ORDERS] = (
            array.ctypes.data for array in (self.times, self.stamps, self.orders)
        )
