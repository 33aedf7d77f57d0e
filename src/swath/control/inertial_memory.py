"""Memory that a step over samples of an inertial unit shares with its compiled form."""

from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from swath.core.rows import Trail
from swath.kernels import Repeated, launch_on, repeatable, shared
from swath.signals import F64, Inertial

SAMPLES, ROOM = 21, 32  # where samples begin; how many there mostly are, at most
ROW = Struct("7d")
T = TypeVar("T", int, float, bool)


class HasNumbers(Protocol):
    """Goes on from numbers in shared memory."""

    @property
    def numbers(self) -> F64:
        """The numbers of the part, float64."""


class Number(Generic[T]):
    """An attribute that is one of the numbers."""

    def __init__(self, at: int, kind: type[T]) -> None:
        self._at = at
        self._kind: type[T] = kind

    def __get__(self, owner: HasNumbers, of: type) -> T:
        found: T = self._kind(owner.numbers[self._at])
        return found

    def __set__(self, owner: HasNumbers, value: T) -> None:
        owner.numbers[self._at] = value


class Numbers:
    """An attribute that is some of the numbers, one after the other."""

    def __init__(self, at: slice) -> None:
        self._at = at

    def __get__(self, owner: HasNumbers, of: type) -> list[float]:
        found: list[float] = owner.numbers[self._at].tolist()
        return found

    def __set__(self, owner: HasNumbers, values: Sequence[float]) -> None:
        owner.numbers[self._at] = values


class InertialMemory:
    """numbers: those of `Inclination`, (SAMPLES,), the first of them how many samples there are."""

    def __init__(self) -> None:
        self._all = np.zeros(SAMPLES + 7 * ROOM)
        self.numbers: F64 = self._all[:SAMPLES]
        self.bytes = self._all.data.cast("B")
        self._launch: Callable[[], Any] | None = None

    def step(self, samples: Sequence[Inertial]) -> None:
        """The compiled step over samples."""
        if len(samples) > ROOM:
            more = np.zeros(SAMPLES + 7 * len(samples))
            more[:SAMPLES] = self.numbers
            _lay(samples, more.data.cast("B"))
            self._on(more)()
            self.numbers[:] = more[:SAMPLES]
            return
        _lay(samples, self.bytes)
        if self._launch is None:
            self._launch = self._on(self._all)
        self._launch()

    def _on(self, memory: F64) -> Callable[[], Any]:
        from swath.control.inertial_kernel import take_inclination

        return launch_on(take_inclination, memory)


def _lay(samples: Sequence[Inertial], into: memoryview) -> None:
    at = 8 * SAMPLES
    for s in samples:
        turn, force = (s.rate_x, s.rate_y, s.rate_z), (s.force_x, s.force_y, s.force_z)
        ROW.pack_into(into, at, s.t, *turn, *force)
        at += ROW.size


FIELDS = ("rate_x", "rate_y", "rate_z", "force_x", "force_y", "force_z")


class AllInertial:
    """Such memories of many worlds. rows: (worlds, SAMPLES and samples)."""

    def __init__(self, worlds: int) -> None:
        self.rows = np.zeros((worlds, SAMPLES + 7 * ROOM))

    def clear(self) -> None:
        """Zeros."""
        self.rows[:] = 0.0

    def save(self, world: int) -> F64:
        """The memory of a world."""
        return self.rows[world, :SAMPLES].copy()

    def load(self, world: int, numbers: F64) -> None:
        """Take on the memory of one world."""
        self.rows[world, :SAMPLES] = numbers

    def launch(self, trail: Trail) -> Repeated:
        """What lies on a trail into the rows, which lie elsewhere from now on."""
        from swath.control import inertial_kernel

        rows = np.zeros((len(self.rows), SAMPLES + 7 * len(trail.times)))
        rows[:, :SAMPLES] = self.rows[:, :SAMPLES]
        self.rows = rows
        columns = [trail.head, trail.stamps, *(trail.memory[name] for name in FIELDS)]
        given = [*map(shared, columns), SAMPLES, shared(rows)]
        return repeatable(inertial_kernel.take_samples, given, threads=len(rows))
