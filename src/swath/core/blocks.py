"""What outputs sent over a while, side by side: for those who look on, and need not look at every sample.

An observer of a graph with `take` is given what a world's slots sent since it looked last (`Seen`), at the
end of a beat and before it is asked for anything (`look`). How long a beat is changes no result. Parts of one
(`Looker`) are shown samples at their time beside that, made where they are asked for (`Shown`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.rows import HEAD, Row, Spare, Trail
from swath.core.signal import Signal
from swath.core.together import Samples, Sent, plain

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
    """What an output sent in every world, as long as it comes in one form.

    arrays: by field, (room, worlds, ...), where it came in arrays; alike: fields of all samples
    each: samples of all worlds otherwise
    trail: of a row, whose memory the arrays then are
    rows: their bytes, (samples, worlds, size), once somebody has made them
    """

    def __init__(
        self,
        slot: str,
        output: str,
        sent: Sent,
        room: int = ROOM,
        head: Ints | None = None,
        spare: Spare | None = None,
    ) -> None:
        self.slot, self.output, self.kind = slot, output, sent.kind
        self._orders: list[int] = []  # `list[int]()` takes twenty times as long
        self._times: list[int] = []
        self._stamps: list[int] = []
        self._count: int | None = None
        self._arrays: dict[str, NDArray[Any]] = {}
        self.alike: Mapping[str, Any] = {}
        self.each: list[Sequence[Signal]] = []
        self.rows: NDArray[np.uint8] | None = None
        self.trail: Trail | None = None
        if sent.is_of_all:
            samples = sent.all
            self.alike = samples.alike
            if isinstance(samples, Row):
                self.trail = Trail(samples, room, head, spare)
            else:
                self._arrays = {k: np.empty((room, *a.shape), a.dtype) for k, a in samples.arrays.items()}

    def add(self, order: int, t: int, sent: Sent) -> bool:
        """Take in a sample; False where it has another form."""
        if self.trail is not None:
            if not sent.is_of_all or sent.all is not self.trail.row:
                return False
            self.trail.append(t, order)
            return True
        k = len(self._orders)
        if not sent.is_of_all:
            if self._arrays or sent.kind is not self.kind:
                return False
            self.each.append(sent.each)
            self._stamps.append(0)
        else:
            samples = sent.all
            if isinstance(samples, Row) or not self._fits(samples):
                return False
            if k == len(next(iter(self._arrays.values()))):
                self._arrays = {n: np.concatenate([a, np.empty_like(a)]) for n, a in self._arrays.items()}
            for name, array in samples.arrays.items():
                self._arrays[name][k] = array
            self._stamps.append(samples.t)
        self._orders.append(order)
        self._times.append(t)
        return True

    def close(self) -> None:
        """No more come."""
        self._count = self.count

    @property
    def count(self) -> int:
        """How many samples there are of each world."""
        if self._count is not None:
            return self._count
        return len(self._orders) if self.trail is None else self.trail.count

    @property
    def orders(self) -> Sequence[int] | Ints:
        """Place of each among all samples that were sent."""
        return self._orders if self.trail is None else self.trail.orders[: self.count]

    @property
    def times(self) -> Sequence[int] | Ints:
        """When each was sent [ns]."""
        return self._times if self.trail is None else self.trail.times[: self.count]

    @property
    def stamps(self) -> Sequence[int] | Ints:
        """The `t` of each [ns], where it came in arrays."""
        return self._stamps if self.trail is None else self.trail.stamps[: self.count]

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Arrays by field, first axis the sample; some room may follow."""
        if self.trail is not None and not self._arrays:
            memory = self.trail.memory
            found = {name: memory[name] for name in self.trail.row.arrays}
            if self._count is None:  # the memory may still move
                return found
            self._arrays = found
        return self._arrays

    def array(self, name: str) -> NDArray[Any]:
        """One of these."""
        return self.arrays[name] if self.trail is None or self._arrays else self.trail.memory[name]

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.each[0]) if self.each else next(iter(self.arrays.values())).shape[1]

    def last(self, name: str, worlds: Sequence[int]) -> NDArray[Any]:
        """A field of the newest sample in some worlds, (n, ...)."""
        k = self.count - 1
        if self.each:
            return np.array([plain(getattr(self.each[k][world], name)) for world in worlds])
        if name == "t":
            return np.full(len(worlds), self.stamps[k])
        newest: NDArray[Any] = self.array(name)[k]
        return newest if len(worlds) == len(newest) else newest[worlds]

    def _fits(self, samples: Samples) -> bool:
        if samples.kind is not self.kind or samples.arrays.keys() != self._arrays.keys():
            return False
        alike = samples.alike
        if alike is not self.alike and not (
            alike.keys() == self.alike.keys() and all(v is self.alike[k] for k, v in alike.items())
        ):
            return False
        pairs = ((a, self._arrays[name]) for name, a in samples.arrays.items())
        return all(a.shape == held.shape[1:] and a.dtype == held.dtype for a, held in pairs)


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
        return np.array(self.pile.orders[: self._count], np.int64)

    @cached_property
    def times(self) -> Ints:
        """When each was sent [ns]."""
        return np.array(self.pile.times[: self._count], np.int64)

    @cached_property
    def is_even(self) -> bool:
        """Whether they came in arrays, of numbers or flags."""
        return not self.pile.each and all(a.dtype != object for a in self.pile.arrays.values())

    def __len__(self) -> int:
        return self._count

    def last(self, name: str) -> Any:
        """A field of the newest."""
        pile, k = self.pile, self._count - 1
        if pile.each:
            return plain(getattr(pile.each[k][self.world], name))
        return int(pile.stamps[k]) if name == "t" else pile.array(name)[k, self.world]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A field, (k, ...); a pose as (k, 12): position, then rows of the rotation."""
        found = self._columns.get(name)
        if found is None:
            found = self._columns[name] = self._column(name)
        return found

    def sample(self, k: int) -> Any:
        """One of them."""
        pile, world, k = self.pile, self.world, k % self._count
        if pile.each:
            return pile.each[k][world]
        arrays = {name: array[k, world : world + 1] for name, array in pile.arrays.items()}
        return Samples(pile.kind, int(pile.stamps[k]), arrays, pile.alike).each()[0]

    def before(self, orders: Ints) -> Ints:
        """The newest of these when others were sent, -1 where there was none."""
        return np.searchsorted(self.orders, orders, side="right") - 1

    def _column(self, name: str) -> NDArray[Any]:
        pile, count = self.pile, self._count
        if pile.each:
            return np.array([plain(getattr(each[self.world], name)) for each in pile.each[:count]])
        if name == "t":
            return np.array(pile.stamps[:count], np.int64)
        if name in pile.arrays:
            return pile.arrays[name][:count, self.world]
        value = pile.alike.get(name, next((f.default for f in fields(pile.kind) if f.name == name), None))
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
            sent = Sent(None, [signal])
            pile = Pile(slot, output, sent)
            pile.add(0, t, sent)
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

    def __init__(self, sent: Mapping[str, Sent], world: int, blocks: "Blocks | None" = None) -> None:
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
        return self._sent[output].each[self._world]

    def __iter__(self) -> Iterator[str]:
        return iter(self._sent)

    def __len__(self) -> int:
        return len(self._sent)

    def kinds(self) -> tuple[type[Signal], ...]:
        """Their types."""
        return tuple(sent.kind for sent in self._sent.values())

    def samples(self, kind: type[S]) -> list[S]:
        """The samples of a type."""
        found: list[Any] = [s.each[self._world] for s in self._sent.values() if issubclass(s.kind, kind)]
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
        self, sent: Mapping[str, Sent], worlds: Sequence[int], blocks: "Blocks | None" = None
    ) -> None:
        self._sent, self.worlds, self._blocks = sent, worlds, blocks

    @classmethod
    def of_one(cls, outputs: Mapping[str, Signal]) -> "ShownToAll":
        """What a slot sent in one world."""
        if isinstance(outputs, Shown):
            return outputs.to_all()
        return cls({output: Sent(None, [signal]) for output, signal in outputs.items()}, [0])

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
        return max((pile for pile in piles if pile.count), key=lambda pile: pile.orders[-1], default=None)


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

    def add(self, slot: str, t: int, outputs: Mapping[str, Sent]) -> None:
        """What a slot sent at t [ns]."""
        order = int(self.order[0]) + 1
        self.order[0] = order
        for output, sent in outputs.items():
            piles = self._piles.get((slot, output))
            if not piles or not piles[-1].add(order, t, sent):
                self._begin(slot, output, sent).add(order, t, sent)

    def head(self, wire: Wire) -> Ints:
        """The array by which compiled code knows the trail of an output, for life."""
        return self._heads.setdefault(wire, np.zeros(HEAD, np.int64))

    def reserve(self, wire: Wire, row: Row, more: int) -> None:
        """A trail of a row with room for so many more samples."""
        piles = self._piles.get(wire)
        trail = piles[-1].trail if piles else None
        if trail is None or trail.row is not row:
            self._begin(*wire, Sent(row), more)
        else:
            trail.reserve(more)

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

    def _begin(self, slot: str, output: str, sent: Sent, room: int = ROOM) -> Pile:
        """Another pile of an output."""
        wire = slot, output
        piles = self._piles.setdefault(wire, [])
        if piles:
            piles[-1].close()
        machine = slot.partition(".")[0]
        for key in [(kind, of) for kind, of in self._asked if of == machine and issubclass(sent.kind, kind)]:
            del self._asked[key]
        is_row = sent.is_of_all and isinstance(sent.all, Row)
        head, spare = (self.head(wire), self._spare.setdefault(wire, Spare())) if is_row else (None, None)
        piles.append(Pile(slot, output, sent, max(room, self._rooms.get(wire, 0)), head, spare))
        return piles[-1]
