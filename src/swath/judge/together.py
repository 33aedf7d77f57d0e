"""Evaluators of many worlds that are shown a sample of all of them at once.

A class that can do that has the class method `together(evaluators)`, one of each world; it gives an object
with the members of `Judges`, or None where these evaluators cannot. What it saw of a world so far it gives to
that world's evaluator before that is asked, who then says what it came to as in a run of its own.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swath.core.abilities import EndsRun
from swath.core.together import Samples, Sent, takes_all
from swath.judge.evaluation import Evaluation
from swath.judge.evaluator import Rests, WantsNewest
from swath.signals import Signal

Bits = NDArray[np.bool_]


class Judges(Protocol):
    """The evaluators of one class in all worlds. active: worlds that still run; give: at any time"""

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None: ...
    def give(self, world: int) -> None: ...


class Asleep:
    """Evaluators that have nothing to look at."""

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Nothing comes of it."""

    def give(self, world: int) -> None:
        """Nothing was seen."""


class EvaluationOfAll:
    """Shows samples of all worlds to their evaluators: to those of a class at once, or one by one.

    is_whole: False where only those count that may end a run or have a metric with a limit
    """

    def __init__(self, evaluations: Sequence[Evaluation], *, is_whole: bool = True) -> None:
        self._evaluations = evaluations
        first = evaluations[0]
        self._groups = {
            id(e): _Group(subject, [other.of(subject)[k] for other in evaluations])
            for subject in first.subjects
            for k, e in enumerate(first.of(subject))
        }
        self._shown: dict[tuple[Any, ...], list[_Group]] = {}
        self._ending = [group for group in self._groups.values() if group.may_end]
        self._limited = None if is_whole else {limit.name for limit in first.expect}

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Sent], active: Bits) -> None:
        """Samples that a slot of all worlds published at t [ns]."""
        kinds = tuple(sent.kind for sent in outputs.values())
        groups = self._shown.get((slot, *kinds))
        is_first = groups is None
        if groups is None:
            interested = self._evaluations[0].interested(slot, kinds)
            found = [self._groups[id(e)] for e in interested]
            groups = self._shown[slot, *kinds] = [group for group in found if self._counts(group)]
        if not groups:
            return
        for group in groups:
            group.see(slot, t, kinds, outputs, active, is_first=is_first)

    def _counts(self, group: "_Group") -> bool:
        return self._limited is None or group.may_end or group.has_any(self._limited)

    def reasons(self, t: int, worlds: Sequence[int]) -> dict[int, str]:
        """Why evaluators want some of these worlds to end before the tick at t [ns]."""
        found: dict[int, str] = {}
        for group in self._ending:
            for world in worlds if group.may_end_now else ():
                if world not in found and (reason := group.evaluators[world].end_reason(t)):
                    found[world] = f"{group.subject}: {reason}"
        return found

    def give(self, world: int, names: Collection[str] | None = None) -> None:
        """The evaluators of a world know what was seen of it. names: those of these metrics alone"""
        for group in self._groups.values():
            if names is None or group.has_any(names):
                group.give(world)


class _Group:
    """The evaluators of one place in all worlds. all: those that see all worlds at once, None = one by one"""

    def __init__(self, subject: str, evaluators: Sequence[Any]) -> None:
        self.subject, self.evaluators = subject, evaluators
        kind: Any = type(evaluators[0])
        self.all: Judges | None = None
        if takes_all(kind, "see") and all(type(e) is kind for e in evaluators):
            self.all = kind.together(evaluators)
        self.may_end = isinstance(evaluators[0], EndsRun)
        self._rests = isinstance(evaluators[0], Rests)
        self._newest = evaluators[0].NEWEST if isinstance(evaluators[0], WantsNewest) else ()
        self._waiting: dict[str, tuple[str, int, Mapping[str, Sent]]] = {}
        self._until = min(e.rests_until for e in evaluators) if self._rests else 0

    def has_any(self, names: Collection[str]) -> bool:
        """Whether one of these metrics is theirs."""
        return any(metric.name in names for metric in self.evaluators[0].METRICS)

    @property
    def may_end_now(self) -> bool:
        """False of those that saw nothing so far."""
        return not (isinstance(self.all, Asleep) or (isinstance(self.all, Woken) and not self.all.was_woken))

    def see(
        self,
        slot: str,
        t: int,
        kinds: Sequence[type],
        outputs: Mapping[str, Sent],
        active: Bits,
        *,
        is_first: bool,
    ) -> None:
        if self.all is not None:
            self.all.see(slot, t, {name: sent.all for name, sent in outputs.items()}, active)
            return
        if self._newest and all(issubclass(kind, self._newest) for kind in kinds) and not is_first:
            self._waiting[slot] = slot, t, outputs
            return
        if t < self._until:
            return
        for world in np.flatnonzero(active).tolist():
            evaluator = self.evaluators[world]
            if self._waiting:
                self._show(world)
            if not self._rests or t >= evaluator.rests_until:
                evaluator.see(slot, t, {name: sent.each[world] for name, sent in outputs.items()})
        self._waiting.clear()
        if self._rests:
            self._until = min(e.rests_until for e in self.evaluators)

    def give(self, world: int) -> None:
        if self.all is not None:
            self.all.give(world)
        self._show(world)

    def _show(self, world: int) -> None:
        for slot, t, outputs in self._waiting.values():
            own = {name: sent.of(world) for name, sent in outputs.items()}
            self.evaluators[world].see(slot, t, own)


class Woken:
    """Evaluators that are shown a sample where something about it asks for it.

    asks: worlds where it does, from samples of all of them
    """

    def __init__(
        self, evaluators: Sequence[Any], asks: Callable[[int, Mapping[str, Samples], Bits], Bits | None]
    ) -> None:
        self._evaluators, self._asks, self.was_woken = evaluators, asks, False

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Show it to those who ask."""
        wanted = self._asks(t, outputs, active)
        if wanted is not None:
            for world in np.flatnonzero(wanted & active).tolist():
                own = {name: samples.of(world) for name, samples in outputs.items()}
                self._evaluators[world].see(slot, t, own)
                self.was_woken = True

    def give(self, world: int) -> None:
        """They know already."""


def newest_of(outputs: Mapping[str, Samples], kind: type[Signal]) -> Samples | None:
    """The sample of a type among outputs."""
    return next((s for s in outputs.values() if issubclass(s.kind, kind)), None)


class Table:
    """Rows of numbers of each world, as many as come. rows: (worlds, room, width); count: (worlds,)"""

    def __init__(self, worlds: int, width: int) -> None:
        self._rows = np.zeros((worlds, 64, width))
        self.count, self._given = np.zeros((2, worlds), np.int64)

    def add(self, where: NDArray[np.int64], *columns: Any) -> None:
        """A row for each of these worlds."""
        at = self.count[where]
        if len(at) and int(at.max()) >= self._rows.shape[1]:
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)], axis=1)
        for k, column in enumerate(columns):
            self._rows[where, at, k] = column
        self.count[where] += 1

    def news(self, world: int) -> NDArray[np.float64]:
        """Those of a world that came since this was asked before, (n, width)."""
        begin, self._given[world] = self._given[world], self.count[world]
        return self._rows[world, begin : self.count[world]]
