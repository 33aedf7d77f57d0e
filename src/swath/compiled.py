"""Parts whose step is a list of launches over rows, in any number of worlds: ops of `core/ops.py`."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import SwathError
from swath.core.ops import Call
from swath.core.rows import Row, Trail, row_like, row_of
from swath.core.signal import Signal
from swath.core.together import Given, Samples, field_of
from swath.kernels import Repeated, over_rows, repeatable, shared

Ints = NDArray[np.int64]
ROOM = 8  # samples of an input with a history for which there is room at first


class Compiled(ABC):
    """The parts of a slot in all worlds.

    reads: ports with the type of what they receive; one that is open is left out
    hears: the same of those with a history
    given: what they read, by port
    sent: what they send, by output: rows with one memory for life
    heard: trails of what came at inputs with a history since the last step
    active: (worlds,) those that still run
    clock: (3,) begin, end and length of a step [ns]
    needs: (1,), set by a launch that lacks something
    """

    reads: ClassVar[Mapping[str, type[Signal]]] = {}
    hears: ClassVar[Mapping[str, type[Signal]]] = {}
    walks = True  # whether launches are all that a step takes
    takes_signals = True

    def __init__(self, worlds: int, sent: Mapping[str, Row]) -> None:
        self.worlds, self.sent = worlds, sent
        self.given: dict[str, Row] = {}
        self.heard: dict[str, Trail] = {}
        self.errors: dict[int, SwathError] = {}
        self.active = np.ones(worlds, np.bool_)
        self.clock, self.needs = np.zeros(3, np.int64), np.zeros(1, np.int32)
        self._launches: Sequence[Repeated] | None = None

    @abstractmethod
    def launches(self) -> Sequence[Repeated]:
        """The step, over `given`, `heard`, `sent`, `clock` and `needs` as they are now."""

    def asking(self) -> Repeated:
        """A launch that does nothing but have `supply` called."""
        from swath.walk_kernel import ask

        return repeatable(ask, [shared(self.needs)])

    def launch(self, kernel: Any, *given: Any) -> Repeated:
        """A launch of a kernel, a thread for each world. given: arrays of Python or of Warp, structs."""
        return over_rows(self.worlds, kernel, *given)

    def supply(self, stage: int) -> None:
        """Do what a launch, by its place among them, did not that set `needs`."""
        raise SwathError(f"{type(self).__name__}: a step lacks something")

    def link(self, rows: Mapping[str, Row], trails: Mapping[str, Trail], clock: Ints) -> None:
        """Read these rows and trails from now on, and the time there."""
        self.given = {name: row for name, row in rows.items() if name in self.reads}
        self.heard, self.clock = {**trails}, clock
        self._launches = self.launches()

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """A step; inputs that lie elsewhere are copied, of one world signals, too."""
        if self._launches is None or not self._fits(inputs):
            rows = {
                name: self._own(name, inputs[name]) for name in self.reads if inputs.get(name) is not None
            }
            trails = {name: self._long(name, inputs[name]) for name in self.hears if name in inputs}
            self.link(rows, trails, self.clock)
        self.clock[:] = t, t + dt, dt
        for name, row in self.given.items():
            if inputs[name] is not row:
                row.take(inputs[name])
        for name, trail in self.heard.items():
            trail.lay(inputs[name] or ())
        self.go()
        for trail in self.heard.values():
            trail.clear()
        return self.sent_at(t + dt)

    def go(self, first: int = 0) -> None:
        """The launches from one on, with what they need."""
        for stage, launch in enumerate(self._launches or ()):
            if stage >= first:
                launch.launch()
            if self.needs[0]:
                self.needs[0] = 0
                self.supply(stage)

    def column(self, port: str, name: str, otherwise: float = np.nan) -> Any:
        """A field of what is read, for a kernel; its default where it is not sent.

        otherwise: of a port that is open
        """
        row = self.given.get(port)
        array = None if row is None else row.arrays.get(name)
        if array is None:
            array = np.full(self.worlds, otherwise if row is None else field_of(row, name))
        return shared(array)

    def _fits(self, inputs: Given) -> bool:
        """Whether inputs are connected as they were, and not longer."""
        is_same = all((inputs.get(name) is not None) == (name in self.given) for name in self.reads)
        is_same = is_same and all(
            inputs[name] is row or row.fits(inputs[name]) for name, row in self.given.items()
        )
        return is_same and all(
            (name in inputs) == (name in self.heard)
            and (name not in inputs or len(inputs[name] or ()) <= len(self.heard[name].times))
            for name in self.hears
        )

    def _own(self, name: str, sample: Samples | Signal) -> Row:
        """A row of their own, that inputs are copied to."""
        row = self.given.get(name)
        is_own = row is not None and row is not sample and row.fits(sample)
        return row if row is not None and is_own else row_like(sample, self.worlds)

    def _long(self, name: str, samples: Sequence[Samples] | None) -> Trail:
        """The same for a history."""
        count = len(samples or ())
        trail = self.heard.get(name)
        if trail is not None and count <= len(trail.times):
            return trail
        return Trail(row_of(self.hears[name], self.worlds), max(2 * count, ROOM))

    def sent_at(self, t: int) -> Mapping[str, Samples]:
        """What is sent, at t [ns]."""
        for row in self.sent.values():
            row.stamp[0] = t
        return self.sent

    def calls(self) -> Sequence[Call] | None:
        """The launches by their addresses; None where they cannot be called so."""
        every = [launch.addresses() for launch in self._launches or ()]
        found = [call for call in every if call is not None]
        return None if len(found) < len(every) or IS_WALKED_BY_PYTHON else found

    def make_walk(self, tables: Sequence[Ints]) -> Callable[[], Any]:
        """The walk through a program."""
        from swath.walk_kernel import walk

        flat = [shared(table.reshape(-1)) for table in tables]
        return repeatable(walk, flat).launch


IS_WALKED_BY_PYTHON = os.environ.get("SWATH_WALK") == "python"
