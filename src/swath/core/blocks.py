"""What outputs sent over a while, side by side: for those who look on, and need not look at every sample.

An observer of a graph with `take` is given what a world's slots sent since it looked last (`Seen`), at the
end of a beat and before it is asked for anything (`look`). How long a beat is changes no result. Parts of one
(`Looker`) are shown samples at their time beside that, made where they are asked for (`Shown`).
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.rows import COUNT, HEAD, ROOM, Row, Spare, Trail, row_with
from swath.core.signal import Signal
from swath.core.together import field_of, plain

Wire = tuple[str, str]
Sent = tuple[tuple[str, type[Signal]], ...]
Ints = NDArray[np.int64]
S = TypeVar("S", bound=Signal)


@runtime_checkable
class TakesBlocks(Protocol, metaclass=ByMembers):
    """An observer that is given what was sent since it looked last.

    look: what has it look; is_late: False of one that has to be called with every sample
    beat: of one that cannot wait long, how long it may be from look to look [ns]
    """

    look: Callable[[], None]

    @property
    def is_late(self) -> bool:
        """Whether it may be given samples later than they were sent."""

    def take(self, seen: "Seen") -> None:
        """Take what was sent since the last call."""


@runtime_checkable
class TakesSome(Protocol, metaclass=ByMembers):
    """An observer that takes samples of some types or slots alone."""

    def takes(self, slot: str, kind: type[Signal]) -> bool:
        """Whether it takes samples of a type from a slot."""


class Looker(NamedTuple):
    """A part of an observer, which is shown samples at their time.

    see: takes (slot, t, `Shown`)
    rests: whether it need not be shown those of before its own `rests_until` [ns]
    """

    part: Any
    see: Callable[[str, int, Any], None]
    rests: bool = False


@runtime_checkable
class LooksOn(Protocol, metaclass=ByMembers):
    """An observer whose parts, or which itself, are shown samples of some types or slots alone."""

    def lookers(self, slot: str, kinds: tuple[type[Signal], ...]) -> Sequence[Looker]:
        """The observers that want samples of these types from a slot."""


def no_look() -> None:
    """Nothing waits."""


class Block:
    """Samples of outputs of one type in one world, in the order in which they were sent.

    count: how many; orders: place of each among all samples that were sent; times: when each was sent [ns]
    is_even: whether all fields are numbers, flags or arrays of one size
    """

    def __init__(self, trail: Trail, world: int, count: int | None = None) -> None:
        self.count = count = trail.count if count is None else count
        self.trail, self.world, self.kind = trail, world, trail.row.kind
        self.slot, self.output = trail.wire
        self.orders, self.times = trail.orders[:count], trail.times[:count]
        self.is_even = not trail.row.has_objects
        self._columns: dict[str, NDArray[Any]] = {}

    def __len__(self) -> int:
        return self.count

    def last(self, name: str) -> Any:
        """A field of the newest."""
        return self.values(name)[-1]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A field, (k, ...); a pose as (k, 12): position, then rows of the rotation."""
        found = self._columns.get(name)
        if found is None:
            is_plain = self.is_even and name in self.trail.row.names
            found = self.trail.memory[name][: self.count, self.world] if is_plain else self.values(name)
            found = self._columns[name] = found if found.dtype != object else np.array(found.tolist())
        return found

    def sample(self, k: int) -> Any:
        """One of them."""
        trail, world, k = self.trail, self.world, k % self.count
        return trail.row.made(trail.memory[k, world : world + 1], [int(trail.stamps[k])])[0]

    @cached_property
    def newest(self) -> Any:
        """The newest of them, made once for all who keep it."""
        return self.sample(-1)

    def before(self, orders: Ints) -> Ints:
        """The newest of these when others were sent, -1 where there was none."""
        return self.orders.searchsorted(orders, side="right") - 1

    def values(self, name: str) -> NDArray[Any]:
        """As a column, but what is no number as the object that was sent."""
        trail, count = self.trail, self.count
        if name in trail.row.names:
            held: NDArray[Any] = trail.memory[name][:count, self.world]
            return held
        if name == "t":
            return trail.stamps[:count]
        value = np.asarray(field_of(trail.row, name))
        return np.full((count, *value.shape), value)


class _Joined(Block):
    """Several of one type, by order."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self._blocks, self._columns, self.is_even = blocks, {}, False
        self.kind, self.slot, self.output = blocks[0].kind, "", ""
        self._order = np.argsort(np.concatenate([b.orders for b in blocks]), kind="stable")
        self.orders = np.concatenate([b.orders for b in blocks])[self._order]
        self.times = np.concatenate([b.times for b in blocks])[self._order]
        self.count = len(self._order)
        self._places = [(block, k) for block in blocks for k in range(len(block))]

    def sample(self, k: int) -> Any:
        block, own = self._places[self._order[k % self.count]]
        return block.sample(own)

    def values(self, name: str) -> NDArray[Any]:
        return np.concatenate([block[name] for block in self._blocks])[self._order]


class Seen:
    """What the slots of a world sent over a while.

    blocks: of each output, several where its form changed; sent: slot and type of each
    """

    def __init__(self, blocks: Sequence[Block], sent: Sent | None = None) -> None:
        self.blocks = blocks
        self.sent = (*((block.slot, block.kind) for block in blocks),) if sent is None else sent
        self._joined: dict[tuple[int, ...], Block] = {}

    @classmethod
    def of_one(cls, slot: str, t: int, outputs: Mapping[str, Signal]) -> "Seen":
        """One sample of each output that a slot sent at t [ns]."""
        blocks = []
        for output, signal in outputs.items():
            trail = Trail(row_with(signal), 1, (slot, output))
            trail.append(t)
            blocks.append(Block(trail, 0))
        return cls(blocks)

    def of(self, kind: type[Signal], machine: str = "") -> Block | None:
        """All of a type, of one machine or of all; None where none came."""
        places = _places(self.sent, kind, machine)  # type: ignore[arg-type]
        if len(places) < 2:
            return self.blocks[places[0]] if places else None
        if places not in self._joined:
            self._joined[places] = _Joined([self.blocks[k] for k in places])
        return self._joined[places]

    def machines(self, kind: type[Signal]) -> list[str]:
        """Machines whose samples of a type are among them."""
        places = _places(self.sent, kind, "")  # type: ignore[arg-type]
        return list(dict.fromkeys([self.sent[k][0].partition(".")[0] for k in places]))

    def of_machine(self, machine: str) -> "Seen":
        """The same for one machine, "" = for all."""
        places = _places(self.sent, Signal, machine)
        return self if len(places) == len(self.blocks) else Seen([self.blocks[k] for k in places])


@lru_cache(maxsize=4096)
def _places(sent: Sent, kind: type[Signal], machine: str) -> tuple[int, ...]:
    """Which of what was sent is of a type and a machine, "" = of any."""
    every = enumerate(sent)
    return tuple(
        k for k, (slot, own) in every if machine in ("", slot.partition(".")[0]) and issubclass(own, kind)
    )


class Shown(Mapping[str, Signal]):
    """What a slot sent at a time in a world: as a mapping, by output. Samples are made where asked for.

    blocks: what was sent since the last look
    """

    def __init__(self, sent: Mapping[str, Row], world: int = 0, blocks: "Blocks | None" = None) -> None:
        self._sent, self._world, self._blocks = sent, world, blocks

    @classmethod
    def of_one(cls, outputs: Mapping[str, Signal]) -> "Shown":
        """What a slot sent in one world."""
        if isinstance(outputs, Shown):
            return outputs
        return cls({name: row_with(signal) for name, signal in outputs.items()})

    def __contains__(self, output: object) -> bool:  # without making the sample
        return output in self._sent

    def __getitem__(self, output: str) -> Signal:
        signal: Signal = self._sent[output].view(self._world)
        return signal

    def __iter__(self) -> Iterator[str]:
        return iter(self._sent)

    def __len__(self) -> int:
        return len(self._sent)

    def waiting(self, kind: type[Signal], machine: str) -> Block | None:
        """What was sent since the last look, of a type and machine; None = nothing."""
        return None if self._blocks is None else self._blocks.waiting(self._world, kind, machine)

    def kinds(self) -> tuple[type[Signal], ...]:
        """Types of the samples."""
        return tuple(row.kind for row in self._sent.values())

    def samples(self, kind: type[S]) -> list[S]:
        """The samples of a type."""
        found: list[Any] = [row.view(self._world) for row in self._rows(kind)]
        return found

    def number(self, kind: type[Signal], name: str) -> Any:
        """A field of the sample of a type, a pose as 12 numbers; None without one."""
        return next((row.number(self._world, name) for row in self._rows(kind)), None)

    def _rows(self, kind: type[Signal]) -> Iterator[Row]:
        return (row for row in self._sent.values() if issubclass(row.kind, kind))


def number_of(outputs: Mapping[str, Signal], kind: type[Signal], name: str) -> Any:
    """As `Shown.number`, of any outputs."""
    if isinstance(outputs, Shown):
        return outputs.number(kind, name)
    return next((plain(getattr(s, name)) for s in outputs.values() if isinstance(s, kind)), None)


def samples_of(outputs: Mapping[str, Signal], kind: type[S]) -> list[S]:
    """The samples of a type; of `Shown` no others are made."""
    if isinstance(outputs, Shown):
        return outputs.samples(kind)
    return [signal for signal in outputs.values() if isinstance(signal, kind)]


class Blocks:
    """What all slots sent since the last look, in all worlds.

    order: (1,) how many times a slot sent anything
    """

    def __init__(self) -> None:
        self._trails: dict[Wire, list[Trail]] = {}  # several where the form of the samples changed
        self._heads: dict[Wire, Ints] = {}
        self._spare: defaultdict[Wire, Spare] = defaultdict(Spare)
        self._asked: dict[tuple[type[Signal], str], list[Trail]] = {}  # of `trails`
        self.order = np.zeros(1, np.int64)

    def add(self, slot: str, t: int, outputs: Mapping[str, Row]) -> None:
        """What a slot sent at t [ns]."""
        order = int(self.order[0]) + 1
        self.order[0] = order
        for output, row in outputs.items():
            self._trail((slot, output), row).append(t, order)

    def head(self, wire: Wire) -> Ints:
        """The array by which compiled code knows the trail of an output, for life."""
        return self._heads.setdefault(wire, np.zeros(HEAD, np.int64))

    def reserve(self, senders: Iterable[tuple[Wire, Row, int]], span: int) -> None:
        """Room for what is sent from rows within a time [ns], not more often than once in a period [ns]."""
        for wire, row, period in senders:
            known, more = self._trails.get(wire), span // period + 1
            trail = known[-1] if known and known[-1].row is row else self._trail(wire, row)
            if trail.head[COUNT] + more > len(trail.times):
                trail.reserve(more)

    def take(self) -> list[tuple[Trail, int]]:
        """Take everything, and how many samples there are; from now on it is empty."""
        found = list[tuple[Trail, int]]()
        for wire, trails in self._trails.items():
            for trail in trails:
                if count := int(trail.head[COUNT]):
                    found.append((trail, count))
            if found and (last := found[-1][0]) in trails:
                last.head, room = last.head.copy(), min(len(last.times), 2 * found[-1][1] + 2)
                self._trails[wire] = [Trail(trails[-1].row, room, wire, self._heads[wire], self._spare[wire])]
        self._asked = {}
        return found

    def waiting(self, world: int, kind: type[Signal], machine: str) -> Block | None:
        """Samples of a type and machine that nobody has looked at."""
        every = ((trail, trail.count) for trail in self.trails(kind, machine))
        own = [Block(trail, world, count) for trail, count in every if count]
        return (own[0] if len(own) == 1 else Seen(own).of(kind)) if own else None

    def trails(self, kind: type[Signal], machine: str) -> Sequence[Trail]:
        """Where the same lies, of all worlds."""
        found = self._asked.get((kind, machine))
        if found is None:
            every = (t for trails in self._trails.values() for t in trails if issubclass(t.row.kind, kind))
            found = [trail for trail in every if trail.wire[0].partition(".")[0] == machine]
            self._asked[kind, machine] = found
        return found

    def _trail(self, wire: Wire, row: Row) -> Trail:
        """Where the samples of a row come; another one where they came from another row."""
        trails = self._trails.setdefault(wire, [])
        if not trails or trails[-1].row is not row:
            if trails:
                trails[-1].close()
            self._asked.clear()
            trails.append(Trail(row, ROOM, wire, self.head(wire), self._spare[wire]))
        return trails[-1]
