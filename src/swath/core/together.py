"""Parts of many worlds that are stepped together: arrays whose first axis is the world.

    all = type(part).together(parts)                   # the part of every world
    outputs = all.reset(streams)                       # output -> Samples, valid at t = 0
    outputs = all.step(t, dt, inputs)                  # input -> Samples, a tuple of them for a history, None
    state = all.save(world); all.load(world, state)

`InWorlds` makes a component of it: in a run of its own a part is a batch of one, the same code.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import fields
from itertools import compress
from typing import Any, ClassVar, Protocol, get_type_hints, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.component import Inputs, Outputs, State
from swath.core.errors import SwathError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.signal import Signal, per_signal

Given = Mapping[str, Any]  # by port: Samples, a tuple of them for a history, None


class Samples:
    """A sample of an output in each of n worlds, at one time t [ns].

    arrays: by field, first axis the world, a pose as (n, 12): position, then rows of the rotation; they may
        be overwritten when their sender sends anew. alike: fields that are the same in all worlds, and stay
        so
    """

    def __init__(
        self,
        kind: type[Signal],
        t: int,
        arrays: Mapping[str, NDArray[Any]],
        alike: Mapping[str, Any] | None = None,
    ) -> None:
        self.kind, self.t, self.arrays, self.alike = kind, t, arrays, alike or {}

    @property
    def count(self) -> int:
        """Number of worlds."""
        return len(next(iter(self.arrays.values())))

    def of(self, world: int) -> Any:
        """The sample of one world, of type `kind`; it stays what it is."""
        one = Samples(
            self.kind, self.t, {k: a[world : world + 1] for k, a in self.arrays.items()}, self.alike
        )
        return one.each()[0]

    def each(self) -> list[Signal]:
        """The samples of all worlds."""
        makers = _makers(self.kind)
        columns = [makers[name](array) for name, array in self.arrays.items()]
        names, kind, t, alike = tuple(self.arrays), self.kind, self.t, self.alike
        if not names:  # of one world, no field of which is written to
            return [kind(t, **alike)]
        return [kind(t, **dict(zip(names, row, strict=True)), **alike) for row in zip(*columns, strict=True)]

    def copy(self) -> "Samples":
        """One that its sender does not overwrite."""
        return Samples(self.kind, self.t, {k: a.copy() for k, a in self.arrays.items()}, self.alike)

    @staticmethod
    def joined(signals: Sequence[Signal], active: Sequence[bool] | None = None) -> "Samples":
        """The samples of all worlds as one; arrays that differ in shape become one array of objects.

        active: worlds that still run, None = all; others have an older sample, which nobody looks at any
        more. SwathError where the samples of those that run are not of one time.
        """
        first = signals[0]
        times = {signal.t for signal in (signals if active is None else compress(signals, active))}
        if len(times) > 1:
            text = f"{type(first).__name__}: t = {min(times)} ns in one world, {max(times)} ns in another"
            how = "swath.worlds(together=1), or vectorization_mode='sync' of an environment"
            raise SwathError(f"{text}: they cannot go in step; alone they can: {how}")
        arrays, alike = {}, {}
        for name in _makers(type(first)):
            values = [getattr(signal, name) for signal in signals]
            if _is_alike(values):
                alike[name] = values[0]
            else:
                arrays[name] = _stacked(values)
        return Samples(type(first), max(times, default=first.t), arrays, alike)


class Sent:
    """What an output sent in each world: in arrays (`all`), or one by one (`each`), made where asked for.

    active: of samples one by one, worlds that still run, None = all
    """

    __slots__ = ("_active", "_all", "_each", "_kept", "_origin", "is_of_all")

    def __init__(
        self,
        all: Samples | None,
        each: Sequence[Signal] | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> None:
        self._all, self._each, self._active = all, each, active
        self.is_of_all = all is not None  # whether they were sent in arrays
        self._kept: Sent | None = None
        self._origin: Sent | None = None  # of a copy: what it is one of

    @property
    def kind(self) -> type[Signal]:
        """Type of the samples."""
        return type(self._each[0]) if self._all is None else self._all.kind  # type: ignore[index]

    @property
    def names(self) -> Collection[str]:
        """Names of fields that may differ between worlds."""
        return _makers(self.kind).keys() if self._all is None else self._all.arrays.keys()

    @property
    def all(self) -> Samples:
        """In arrays, which their sender may overwrite when it sends anew."""
        if self._all is None:
            active = None if self._active is None else self._active.tolist()
            self._all = Samples.joined(self._each or (), active)
        return self._all

    @property
    def each(self) -> Sequence[Signal]:
        """Give them one by one."""
        if self._each is None and self._origin is not None:
            self._each = self._origin._each
        if self._each is None:
            self._each = self.all.each()
        return self._each

    def values(self, name: str) -> Sequence[Any]:
        """A number in each world."""
        if self._each is not None:
            return [getattr(signal, name) for signal in self._each]
        found: list[Any] = self.all.arrays[name].tolist()
        return found

    def column(self, name: str, worlds: Sequence[int]) -> Any:
        """A number in some worlds, or one for all."""
        if self._each is not None:
            return [getattr(self._each[world], name) for world in worlds]
        if name == "t":
            return self.all.t
        found = field_of(self.all, name)
        return found[worlds] if name in self.all.arrays and len(worlds) < len(found) else found

    def number(self, world: int, name: str) -> Any:
        """A field in one world, a pose as 12 numbers."""
        if self._each is not None:
            return plain(getattr(self._each[world], name))
        if name == "t":
            return self.all.t
        found = field_of(self.all, name)
        return found[world] if name in self.all.arrays else found

    def of(self, world: int) -> Any:
        """Sample of one world."""
        if self._each is None and self.all.count > 1:
            return self.all.of(world)
        return self.each[world]

    def kept(self) -> "Sent":
        """The same, which no sender overwrites."""
        if not self.is_of_all:
            return self
        if self._kept is None:
            self._kept = Sent(self.all.copy(), self._each)
            self._kept._kept, self._kept._origin = self._kept, self
        return self._kept


@per_signal
def _makers(kind: type[Signal]) -> dict[str, Any]:
    """How the fields of the samples of all worlds are made of an array, a list of them."""
    hints = get_type_hints(kind)
    known: dict[Any, Any] = {float: _numbers, int: _numbers, bool: _numbers, Pose: poses_of}
    return {f.name: known.get(hints[f.name], _arrays) for f in fields(kind) if f.name != "t"}


def _numbers(array: NDArray[Any]) -> list[Any]:
    found: list[Any] = array.tolist()
    return found


def _arrays(array: NDArray[Any]) -> list[NDArray[Any]]:
    return [np.array(own) for own in array]


def poses_of(array: NDArray[np.float64]) -> list[Pose]:
    """Poses of (n, 12) numbers: position, then rows of the rotation."""
    return [
        Pose.of_numbers([x, y, z], [[a, b, c], [d, e, f], [g, h, i]])
        for x, y, z, a, b, c, d, e, f, g, h, i in array.tolist()
    ]


def _is_alike(values: Sequence[Any]) -> bool:
    """Whether values are arrays that nobody writes to, alike in all worlds, such as the angles of beams."""
    first = values[0]
    if not isinstance(first, np.ndarray) or first.flags.writeable:
        return False
    return all(value is first or np.array_equal(value, first) for value in values[1:])


def _stacked(values: Sequence[Any]) -> NDArray[Any]:
    """Values of all worlds; arrays of different shapes, such as of objects, one by one."""
    if not isinstance(values[0], np.ndarray) or len({np.shape(value) for value in values}) == 1:
        return np.array([plain(value) for value in values])
    found = np.empty(len(values), object)
    for world, value in enumerate(values):
        found[world] = value
    return found


def plain(value: Any) -> Any:
    """What a field holds; of a pose its 12 numbers: position, then rows of the rotation."""
    if isinstance(value, Pose):
        place, (first, second, third) = value.numbers
        return (*place, *first, *second, *third)
    return value


def field_of(samples: Samples, name: str) -> Any:
    """Values of a field: of each world, or one for all."""
    if name in samples.arrays:
        return samples.arrays[name]
    return samples.alike.get(name, next(f.default for f in fields(samples.kind) if f.name == name))


def takes_all(kind: type, method: str) -> bool:
    """Whether a class says itself, or who wrote `method` for it, how all worlds are taken at once."""
    for known in kind.__mro__:
        if "together" in vars(known):
            return True
        if method in vars(known):
            return False
    return False


class Together(Protocol):
    """The parts of one slot in all worlds. errors: of worlds that cannot go on, by their number."""

    errors: dict[int, SwathError]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Begin all worlds; their outputs at t = 0."""

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Outputs of all worlds at t [ns]; dt [ns] is the time since the last step."""

    def save(self, world: int) -> State:
        """State of a world."""

    def load(self, world: int, state: State) -> None:
        """Take on the state of a world."""


@runtime_checkable
class EndsWorlds(Protocol, metaclass=ByMembers):
    """Parts that may want their worlds to end. reasons: why, by number of the world."""

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why worlds want to end, by their numbers."""


class KeepsRows:
    """`save` and `load` of parts whose state lies in what `kept` names.

    These are arrays whose first axis is the world, or objects that save a world themselves.
    """

    kept: ClassVar[tuple[str, ...]] = ()

    def save(self, world: int) -> State:
        """A copy of everything that is needed to go on exactly."""
        held = {name.lstrip("_"): getattr(self, name) for name in self.kept}
        return {n: v[world].copy() if isinstance(v, np.ndarray) else v.save(world) for n, v in held.items()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        for name in self.kept:
            held, saved = getattr(self, name), state[name.lstrip("_")]
            if isinstance(held, np.ndarray):
                held[world] = saved
            else:
                held.load(world, saved)


@runtime_checkable
class StepsTogether(Protocol, metaclass=ByMembers):
    """A class of parts that can be stepped together with those of other worlds; None: these parts cannot."""

    @classmethod
    def together(cls, parts: Sequence[Any]) -> Together | None:
        """The parts as one; None where they cannot be."""


@runtime_checkable
class GoesWith(Protocol):
    """A part that can be stepped together with those alone that have the same `goes_with`."""

    @property
    def goes_with(self) -> Hashable:
        """What parts that are stepped together have alike."""


def in_world(value: Any, world: int) -> Any:
    """An input as it is in one world."""
    if isinstance(value, Samples):
        return value.of(world)
    return tuple(sample.of(world) for sample in value) if isinstance(value, tuple) else value


class InWorlds(ABC):
    """A component whose step is that of `together`, for one world."""

    @classmethod
    @abstractmethod
    def together(cls, parts: Sequence[Any]) -> Together | None:
        """Make one object that steps these parts of many worlds together."""

    alone: Together | None = None  # the batch of one, once it is reset
    gains: ClassVar[bool] = True  # whether a step of many worlds costs less than one of each

    def reset(self, stream: Stream) -> Outputs:
        """The state at t = 0."""
        self.alone = self.together([self])
        return _first(self._begun().reset([stream]))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One step of a batch of one."""
        alone = self._begun()
        if not getattr(alone, "takes_signals", False):
            inputs = {name: _of_one(value) for name, value in inputs.items()}
        found = alone.step(t, dt, inputs)
        if alone.errors:
            raise alone.errors.pop(0)
        return _first(found)

    def save(self) -> State:
        """Everything that is needed to go on exactly."""
        return self._begun().save(0)

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        self._begun().load(0, state)

    def _begun(self) -> Together:
        if self.alone is None:
            raise SwathError("expected a part that was reset")
        return self.alone


def _first(outputs: Mapping[str, Samples]) -> Outputs:
    return {name: samples.of(0) for name, samples in outputs.items()}


def _of_one(value: Any) -> Any:
    if isinstance(value, Signal):
        return Samples.joined([value])
    return tuple(Samples.joined([v]) for v in value) if isinstance(value, tuple) else value
