"""Parts of many worlds that are stepped together: arrays whose first axis is the world.

    all = type(part).together(parts)                   # the part of every world
    outputs = all.reset(streams)                       # output -> Samples, valid at t = 0
    outputs = all.step(t, dt, inputs)                  # input -> Samples, a tuple of them for a history, None
    state = all.save(world); all.load(world, state)

`InWorlds` makes a component of it: in a run of its own a part is a batch of one, the same code.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.component import Inputs, Outputs, State
from swath.core.errors import SwathError
from swath.core.frames import Pose
from swath.core.layout import layout
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
    def joined(signals: Sequence[Signal]) -> "Samples":
        """The samples of all worlds as one; arrays that differ in shape become one array of objects."""
        first, arrays, alike = signals[0], {}, {}
        for name in _makers(type(first)):
            values = [getattr(signal, name) for signal in signals]
            if _is_alike(values):
                alike[name] = values[0]
            else:
                arrays[name] = _stacked(values)
        return Samples(type(first), max(signal.t for signal in signals), arrays, alike)


@per_signal
def _makers(kind: type[Signal]) -> dict[str, Any]:
    """How the fields of the samples of all worlds are made of an array, a list of them."""
    known = {"real": _numbers, "int": _numbers, "bool": _numbers, "pose": poses_of}
    return {name: known.get(field.kind, _arrays) for name, field in layout(kind).items()}


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
    return samples.alike.get(name, layout(samples.kind)[name].default)


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
