"""What outputs sent over a while, side by side: for those who look on, and need not look at every sample.

An observer of a graph with `take` is given what a world's slots sent since it looked last (`Seen`), at the
end of a beat and before it is asked for anything (`look`). How long a beat is changes no result. Parts of one
(`Looker`) are shown samples at their time beside that, made where they are asked for (`Shown`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.rows import HEAD, Row, Spare, Trail, row_with
from swath.core.signal import Signal
from swath.core.together import field_of, plain

ROOM = 16  # samples of an output for which there is memory at first
Wire = tuple[str, str]
Ints = NDArray[np.int64]
S = TypeVar("S", bound=Signal)


@runtime_checkable
class TakesBlocks(Protocol, metaclass=ByMembers):
    """An observer that is given what was sent since it looked last.

    look: what has it look; is_late: False of one that has to be called with every sample
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


class Pile:
    """What an output sent in every world, as long as it is one row. trail: the samples; some room may follow.

    rows: their bytes, (samples, worlds, size), once somebody has made them
    """

    def __init__(
        self,
        slot: str,
        output: str,
        row: Row,
        room: int = ROOM,
        head: Ints | None = None,
        spare: Spare | None = None,
    ) -> None:
        self.slot, self.output, self.kind, self.row = slot, output, row.kind, row
        self.trail, self._count = Trail(row, room, head, spare), -1
        self.rows: NDArray[np.uint8] | None = None

    def close(self) -> None:
        """No more come."""
        self._count = self.trail.count

    @property
    def count(self) -> int:
        """How many samples there are of each world."""
        return self.trail.count if self._count < 0 else self._count

    def array(self, name: str) -> NDArray[Any]:
        """A field, (samples, worlds, ...)."""
        found: NDArray[Any] = self.trail.memory[name][: self.count]
        return found

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.row.memory)

    def last(self, name: str, worlds: Sequence[int]) -> NDArray[Any]:
        """A field of the newest sample in some worlds, (n, ...)."""
        k = self.count - 1
        if name not in self.row.names:
            return np.full(len(worlds), self.trail.stamps[k])
        newest: NDArray[Any] = self.trail.memory[name][k]
        return newest if len(worlds) == len(newest) else newest[worlds]


class Block:
    """Samples of outputs of one type in one world, in the order in which they were sent."""

    def __init__(self, pile: Pile, world: int) -> None:
        self.pile, self.world, self.kind = pile, world, pile.kind
        self.slot, self.output = pile.slot, pile.output
        self._columns: dict[str, NDArray[Any]] = {}
        self._count = pile.count

    @cached_property
    def orders(self) -> Ints:
        """Place of each among all samples that were sent."""
        return self.pile.trail.orders[: self._count]

    @cached_property
    def times(self) -> Ints:
        """When each was sent [ns]."""
        return self.pile.trail.times[: self._count]

    @cached_property
    def is_even(self) -> bool:
        """Whether all fields are numbers, flags or arrays of one size."""
        return not self.pile.row.has_objects

    def __len__(self) -> int:
        return self._count

    def last(self, name: str) -> Any:
        """A field of the newest."""
        return self.pile.last(name, [self.world])[0]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A field, (k, ...); a pose as (k, 12): position, then rows of the rotation."""
        found = self._columns.get(name)
        if found is None:
            found = self._columns[name] = self._column(name)
        return found

    def sample(self, k: int) -> Any:
        """One of them."""
        trail, world, k = self.pile.trail, self.world, k % self._count
        return trail.row.made(trail.memory[k, world : world + 1], int(trail.stamps[k]))[0]

    def before(self, orders: Ints) -> Ints:
        """The newest of these when others were sent, -1 where there was none."""
        return np.searchsorted(self.orders, orders, side="right") - 1

    def _column(self, name: str) -> NDArray[Any]:
        trail, count = self.pile.trail, self._count
        if name in trail.row.names:
            found: NDArray[Any] = trail.memory[name][:count, self.world]
            return found if found.dtype != object else np.array(found.tolist())
        if name == "t":
            return trail.stamps[:count]
        value = field_of(trail.row, name)
        return np.broadcast_to(np.asarray(value), (count, *np.shape(value)))


class _Joined(Block):
    """Several of one type, by order."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self._blocks, self._columns = blocks, {}
        self.kind, self.slot, self.output = blocks[0].kind, "", ""
        self._order = np.argsort(np.concatenate([b.orders for b in blocks]), kind="stable")
        self.orders = np.concatenate([b.orders for b in blocks])[self._order]
        self.times = np.concatenate([b.times for b in blocks])[self._order]
        self._count = len(self._order)
        self._places = [(block, k) for block in blocks for k in range(len(block))]

    def last(self, name: str) -> Any:
        return self[name][-1]

    def sample(self, k: int) -> Any:
        block, own = self._places[self._order[k % self._count]]
        return block.sample(own)

    def _column(self, name: str) -> NDArray[Any]:
        return np.concatenate([block[name] for block in self._blocks])[self._order]


class Seen:
    """What the slots of a world sent over a while. blocks: of each output, several where its form changed."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self.blocks = blocks
        self._by_kind: dict[tuple[str, type[Signal]], Block | None] = {}
        self._of_machine: dict[str, Seen | None] = {}  # None: all that was seen

    @classmethod
    def of_one(cls, slot: str, t: int, outputs: Mapping[str, Signal]) -> "Seen":
        """One sample of each output that a slot sent at t [ns]."""
        blocks = []
        for output, signal in outputs.items():
            pile = Pile(slot, output, row_with(signal), 1)
            pile.trail.append(t)
            blocks.append(Block(pile, 0))
        return cls(blocks)

    def of(self, kind: type[Signal], machine: str = "") -> Block | None:
        """All of a type, of one machine or of all; None where none came."""
        key = machine, kind
        if key not in self._by_kind:
            found = [b for b in self.blocks if issubclass(b.kind, kind) and self._is_of(b, machine)]
            self._by_kind[key] = found[0] if len(found) == 1 else _Joined(found) if found else None
        return self._by_kind[key]

    def machines(self, kind: type[Signal]) -> list[str]:
        """Machines whose samples of a type are among them."""
        return list(dict.fromkeys(b.slot.partition(".")[0] for b in self.blocks if issubclass(b.kind, kind)))

    def kinds(self) -> Sequence[tuple[str, type[Signal]]]:
        """Machines and the types of what they sent."""
        return list(dict.fromkeys((b.slot.partition(".")[0], b.kind) for b in self.blocks))

    def of_machine(self, machine: str) -> "Seen":
        """The same for one machine, "" = for all."""
        if machine not in self._of_machine:
            own = [b for b in self.blocks if self._is_of(b, machine)]
            # not itself: a cycle would hold all samples until it is collected
            self._of_machine[machine] = None if len(own) == len(self.blocks) else Seen(own)
        return self._of_machine[machine] or self

    @staticmethod
    def _is_of(block: Block, machine: str) -> bool:
        return not machine or block.slot.partition(".")[0] == machine


class Shown(Mapping[str, Signal]):
    """What a slot of one world sent at a time; samples are made where they are asked for.

    blocks: what was sent since the last look
    """

    __slots__ = ("_blocks", "_sent", "_world")

    def __init__(self, sent: Mapping[str, Row], world: int, blocks: "Blocks | None" = None) -> None:
        self._sent, self._world, self._blocks = sent, world, blocks

    def waiting(self, kind: type[Signal], machine: str) -> Block | None:
        """What was sent since the last look, of a type and machine; None = nothing."""
        return None if self._blocks is None else self._blocks.waiting(self._world, kind, machine)

    def to_all(self) -> "ShownToAll":
        """The same, of one of several worlds."""
        return ShownToAll(self._sent, [self._world], self._blocks)

    def __contains__(self, output: object) -> bool:  # without making the sample
        return output in self._sent

    def __getitem__(self, output: str) -> Signal:
        signal: Signal = self._sent[output].view(self._world)
        return signal

    def __iter__(self) -> Iterator[str]:
        return iter(self._sent)

    def __len__(self) -> int:
        return len(self._sent)

    def kinds(self) -> tuple[type[Signal], ...]:
        """Their types."""
        return tuple(sent.kind for sent in self._sent.values())

    def samples(self, kind: type[S]) -> list[S]:
        """The samples of a type."""
        found: list[Any] = [r.view(self._world) for r in self._sent.values() if issubclass(r.kind, kind)]
        return found

    def number(self, kind: type[Signal], name: str) -> Any:
        """A field of the sample of a type, a pose as 12 numbers; None without one."""
        for sent in self._sent.values():
            if issubclass(sent.kind, kind):
                return sent.number(self._world, name)
        return None


class ShownToAll:
    """The same in several worlds. worlds: their numbers."""

    def __init__(
        self, sent: Mapping[str, Row], worlds: Sequence[int], blocks: "Blocks | None" = None
    ) -> None:
        self._sent, self.worlds, self._blocks = sent, worlds, blocks

    @classmethod
    def of_one(cls, outputs: Mapping[str, Signal]) -> "ShownToAll":
        """What a slot sent in one world."""
        if isinstance(outputs, Shown):
            return outputs.to_all()
        return cls({output: row_with(signal) for output, signal in outputs.items()}, [0])

    def of(self, k: int) -> Shown:
        """The samples of the k-th of these worlds."""
        return Shown(self._sent, self.worlds[k], self._blocks)

    def numbers(self, kind: type[Signal], name: str) -> Sequence[Any] | None:
        """A number of the sample of a type, in each world; None without one."""
        for sent in self._sent.values():
            if issubclass(sent.kind, kind):
                values = sent.values(name)
                return [values[world] for world in self.worlds]
        return None

    def columns(self, kind: type[Signal], names: Sequence[str]) -> NDArray[np.float64] | None:
        """Numbers of the sample of a type, (worlds, names); None without one."""
        for sent in self._sent.values():
            if issubclass(sent.kind, kind):
                found = np.empty((len(self.worlds), len(names)))
                for k, name in enumerate(names):
                    found[:, k] = sent.column(name, self.worlds)
                return found
        return None

    def newest(self, kind: type[Signal], machine: str) -> Pile | None:
        """Where the newest that nobody has looked at lies; None = nowhere."""
        piles = () if self._blocks is None else self._blocks.piles(kind, machine)
        return max(
            (pile for pile in piles if pile.count),
            key=lambda pile: pile.trail.orders[pile.count - 1],
            default=None,
        )


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
        self._piles: dict[Wire, list[Pile]] = {}
        self._rooms: dict[Wire, int] = {}  # how many samples came before a look
        self._heads: dict[Wire, Ints] = {}
        self._spare: dict[Wire, Spare] = {}
        self._asked: dict[tuple[type[Signal], str], list[Pile]] = {}  # of `piles`
        self.order = np.zeros(1, np.int64)

    def add(self, slot: str, t: int, outputs: Mapping[str, Row]) -> None:
        """What a slot sent at t [ns]."""
        order = int(self.order[0]) + 1
        self.order[0] = order
        for output, row in outputs.items():
            piles = self._piles.get((slot, output))
            pile = piles[-1] if piles and piles[-1].row is row else self._begin(slot, output, row)
            pile.trail.append(t, order)

    def head(self, wire: Wire) -> Ints:
        """The array by which compiled code knows the trail of an output, for life."""
        return self._heads.setdefault(wire, np.zeros(HEAD, np.int64))

    def reserve(self, wire: Wire, row: Row, more: int) -> None:
        """A trail of a row with room for so many more samples."""
        piles = self._piles.get(wire)
        if piles and piles[-1].row is row:
            piles[-1].trail.reserve(more)
        else:
            self._begin(*wire, row, more)

    def take(self) -> list[Pile]:
        """Take everything; from now on it is empty."""
        found = [pile for piles in self._piles.values() for pile in piles if pile.count]
        for pile in found:
            pile.close()
        self._rooms |= {wire: max(piles[-1].count, 1) for wire, piles in self._piles.items()}
        self._piles, self._asked = {}, {}
        return found

    def waiting(self, world: int, kind: type[Signal], machine: str) -> Block | None:
        """Samples of a type and machine that nobody has looked at."""
        own = [Block(pile, world) for pile in self.piles(kind, machine) if pile.count]
        return (own[0] if len(own) == 1 else Seen(own).of(kind)) if own else None

    def piles(self, kind: type[Signal], machine: str) -> Sequence[Pile]:
        """Where the same lies, of all worlds."""
        piles = self._asked.get((kind, machine))
        if piles is None:
            every = (p for piles in self._piles.values() for p in piles if issubclass(p.kind, kind))
            piles = [pile for pile in every if pile.slot.partition(".")[0] == machine]
            self._asked[kind, machine] = piles
        return piles

    def _begin(self, slot: str, output: str, row: Row, room: int = ROOM) -> Pile:
        """Another pile of an output."""
        wire = slot, output
        piles = self._piles.setdefault(wire, [])
        if piles:
            piles[-1].close()
        machine = slot.partition(".")[0]
        for key in [(kind, of) for kind, of in self._asked if of == machine and issubclass(row.kind, kind)]:
            del self._asked[key]
        spare = self._spare.setdefault(wire, Spare())
        piles.append(Pile(slot, output, row, max(room, self._rooms.get(wire, 0)), self.head(wire), spare))
        return piles[-1]
