"""Who is shown what slots send at its time: in all worlds at once those of one class."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import attrgetter, is_
from typing import Any

from swath.core.abilities import EndsRun
from swath.core.blocks import Blocks, Looker, LooksOn, Shown, TakesBlocks, TakesSome
from swath.core.rows import Row
from swath.core.signal import Signal

Kinds = tuple[type[Signal], ...]
_rest = attrgetter("rests_until")


class Audience:
    """Those of one class, each in its world, that are shown what a slot sends; all of them rest, or none.

    A class with `looking(parts, slot, kinds)` may give an op (`core/ops.py`) that looks at samples of these
    types which a slot sends, right after it: the row of each type that it `reads` is the slot's own, else
    that of the only output of its machine that is one. `look()` has it tell its parts what it found, before
    these are given a block. Where not all worlds have such a part, or a row is missing, samples are shown.
    key: what it is known by among those of a slot; worlds: their numbers
    may_end: whether one of them may end a world
    """

    def __init__(self, key: tuple[Any, ...], worlds: Sequence[int], lookers: Sequence[Looker]) -> None:
        self.key = key
        self.worlds, self._lookers = worlds, lookers
        self._parts = [looker.part for looker in lookers]
        self._rests = lookers[0].rests
        self.may_end = any(isinstance(part, EndsRun) for part in self._parts)

    def looking(self, slot: str, kinds: Kinds) -> Any:
        """What looks for all of them, compiled; None = nothing."""
        make = getattr(type(self._parts[0]), "looking", None)
        return None if make is None else make(self._parts, slot, kinds)

    def sleeps(self) -> int:
        """Until when [ns] none of them has to be shown anything."""
        return min(map(_rest, self._parts)) if self._rests else 0

    def show(self, slot: str, t: int, sent: Mapping[str, Row], blocks: Blocks) -> bool:
        """Show what a slot sent at t [ns] to those that do not rest; whether there are any."""
        awake: Sequence[int] = range(len(self._parts))
        if self._rests:
            awake = [k for k, part in enumerate(self._parts) if t >= part.rests_until]
        for k in awake:
            self._lookers[k].see(slot, t, Shown(sent, self.worlds[k], blocks))
        return bool(awake)


class Onlookers:
    """The observers of a world: those that look now and then (`takers`), and those that may end it."""

    def __init__(self, observers: Sequence[Any], watches: Mapping[str, Callable[..., None]]) -> None:
        self._watches, self._known = watches, [*observers]
        self._able = [o for o in observers if isinstance(o, TakesBlocks)]
        self.takers = [o for o in self._able if o.is_late]
        self.enders = [o for o in observers if isinstance(o, EndsRun)]

    def is_same(self, observers: Sequence[Any], watches: Mapping[str, Callable[..., None]]) -> bool:
        """Whether nobody came or went since, and the same look now and then."""
        late = [o for o in self._able if o.is_late]
        return self._watches is watches and _are(observers, self._known) and _are(late, self.takers)

    def takes(self, slot: str, kind: type[Signal]) -> bool:
        """Whether one of them takes samples of a type from a slot."""
        return any(not isinstance(o, TakesSome) or o.takes(slot, kind) for o in self.takers)

    def lookers(self, slot: str, kinds: Kinds) -> Iterator[tuple[int, Looker]]:
        """Who is shown samples of these types that a slot sends, and the place among all in which order."""
        if (watch := self._watches.get(slot)) is not None:
            yield -1, Looker(watch, watch)
        for place, observer in enumerate(self._known):
            is_taker = any(observer is taker for taker in self.takers)
            if isinstance(observer, LooksOn) and (is_taker or not isinstance(observer, TakesBlocks)):
                for looker in observer.lookers(slot, kinds):
                    yield place, looker
            elif not is_taker:
                yield place, Looker(observer, _as_it_is(observer))


def _are(some: Sequence[Any], others: Sequence[Any]) -> bool:
    return len(some) == len(others) and all(map(is_, some, others))


def _as_it_is(observer: Callable[..., None]) -> Callable[[str, int, Shown], None]:
    """What shows samples that an observer may keep."""
    return lambda slot, t, outputs: observer(slot, t, dict(outputs))


def audiences(of_worlds: Mapping[int, Onlookers], slot: str, kinds: Kinds) -> list[Audience]:
    """Who in some worlds is shown samples of these types from a slot, in order."""
    found: dict[tuple[Any, ...], tuple[list[int], list[Looker]]] = {}
    for world, onlookers in of_worlds.items():
        for number, (place, looker) in enumerate(onlookers.lookers(slot, kinds)):
            key = place, number, type(looker.part), looker.rests
            worlds, lookers = found.setdefault(key, ([], []))
            worlds.append(world)
            lookers.append(looker)
    return [Audience(key, *found[key]) for key in sorted(found, key=lambda key: key[:2])]
