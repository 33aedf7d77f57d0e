"""Steps of compiled parts as launches over rows, and the program that walks from one to the next.

Parts of a slot in all worlds (`core.together`) whose step is a list of launches over rows are an `Op`. The
ops of a graph are walked by compiled code, which comes back to Python where a part in Python is due, where an
op needs something that is not in memory, where a world has reached its goal, or at the end of a beat.
"""

import time
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.errors import SwathError
from swath.core.rows import Row, Trail
from swath.core.schedule import Plan

Wire = tuple[str, str]
Ints = NDArray[np.int64]
Call = tuple[int, int, int]  # addresses of a compiled function and of what it is given

LINE = 6  # numbers of a line of a program: what it does, and five that it needs for that
CALL, NEED, CLEAR, SEND, STAMP, KEEP, REACH = range(7)
# What the walker reads, and writes: ticks from, to, begin of their round [ns]; part and line to go on from,
# part to end before in the last tick (-1 = its own); slot that needs something (-1 = none), and after which
# of its launches; whether a goal is reached; addresses of the clock and of the number of samples sent so far.
FIRST, LAST, BASE, PART, FROM, STOP, NEEDS, STAGE, REACHED, CLOCK, ORDER = range(11)


@runtime_checkable
class Op(Protocol, metaclass=ByMembers):
    """Parts of a slot in all worlds, stepped by launches over rows.

    sent: by output
    heard: trails that it takes samples of inputs with a history from
    walks: whether launches are all that a step takes
    active: worlds that still run
    needs: (1,) int32, set by a launch that lacks something: `supply` then does what it did not
    """

    sent: Mapping[str, Row]
    heard: Mapping[str, Trail]
    walks: bool
    needs: NDArray[np.int32]
    errors: dict[int, SwathError]
    active: NDArray[np.bool_]

    def link(self, rows: Mapping[str, Row], trails: Mapping[str, Trail], clock: Ints) -> None:
        """Take the rows and trails of all slots, and the clock."""

    def calls(self) -> Sequence[Call] | None:
        """Compiled calls of a step; None where Python has to step."""

    def supply(self, stage: int) -> None:
        """Fill in what the calls from a stage on read."""

    def make_walk(self, tables: Sequence[Ints]) -> Callable[[], Any]:
        """The function that walks through the calls."""


@dataclass(frozen=True)
class Goal:
    """Worlds are over once a number of one of these outputs is as large as theirs. least: of each world."""

    wires: tuple[Wire, ...]
    name: str
    least: NDArray[np.float64]


@dataclass
class Member:
    """An op among the slots of a program. place: of its slot.

    keeps: heads of the trails that a sample of an output is added to
    about: steps since they were counted last, and processor cycles that they took
    """

    place: int
    op: Op
    keeps: Mapping[str, Sequence[Ints]]
    about: Ints = field(default_factory=lambda: np.zeros(2, np.int64))


class Program:
    """What of the ticks of a plan is ops, for compiled code to walk.

    by_place: its ops; spans: of each tick, the tick after the last of those from there on at which nothing
    but ops is due; pieces: of each tick, what is due in order: places of slots, or (parts from, to)
    places: of the slots of the parts; sends: by place, what an op sends
    begun: time [ns] after which all slots have begun; seconds: of walking, since they were counted last
    """

    def __init__(
        self, plan: Plan, members: Sequence[Member], clock: Ints, goal: Goal | None, order: Ints
    ) -> None:
        self.members, self.goal, self.seconds, self._has_reached = members, goal, 0.0, False
        self.times = [at for at, _ in plan.ticks]
        self.begun = max((slot.offset for slot in plan.slots), default=0)
        self._plan, self.by_place = plan, {member.place: member for member in members}
        self.sends = {member.place: member.op.sent for member in members}
        sent = {(plan.slots[place].name, output) for place, own in self.sends.items() for output in own}
        self._is_told = goal is not None and sent.issuperset(goal.wires)  # by the walk that a goal is reached
        self.least = np.zeros(0) if goal is None else goal.least.copy()
        self._lines: list[list[int]] = []
        ranges = {member.place: self._write(member) for member in members}
        parts, self.places = list[tuple[int, int]](), list[int]()
        self._dues: dict[int, list[int]] = {place: [] for place in self.by_place}
        ticks, count = list[tuple[int, int, int]](), len(plan.ticks)
        self.pieces = list[list[Any]]()
        for at, due in plan.ticks:
            begin, pieces = len(parts), list[Any]()
            for place in due:
                if place not in ranges:
                    pieces.append(place)
                    continue
                if pieces and isinstance(pieces[-1], tuple):
                    pieces[-1] = pieces[-1][0], len(parts) + 1
                else:
                    pieces.append((len(parts), len(parts) + 1))
                parts.append(ranges[place])
                self._dues[place].append(len(ticks))
                self.places.append(place)
            self.pieces.append(pieces)
            ticks.append((at, begin, len(parts)))
        self.spans = [*range(count)]
        for number in reversed(range(count)):
            if all(isinstance(piece, tuple) for piece in self.pieces[number]):
                self.spans[number] = self.spans[number + 1] if number + 1 < count else count
                self.spans[number] = max(self.spans[number], number + 1)
        self._state = np.array([0] * CLOCK + [address(clock), address(order)], np.int64)
        tables = [np.array(table or [[0]], np.int64) for table in (self._lines, parts, ticks)]
        self._kept = clock, order  # their addresses stand in the state
        self._walk = members[0].op.make_walk([*tables, self._state]) if members else None

    def aim(self, goal: Goal | None, active: NDArray[np.bool_]) -> bool:
        """Stop where a world that still runs reaches a goal; False where this program cannot."""
        if self.goal is None:
            return goal is None
        if goal is not None and (goal.wires, goal.name) != (self.goal.wires, self.goal.name):
            return False
        self.least[:] = np.inf if goal is None else np.where(active, goal.least, np.inf)
        return True

    def next_due(self, place: int, number: int) -> int:
        """The tick, from one on, at which an op is due; the one after the last where it is not again."""
        dues = self._dues[place]
        after = bisect_left(dues, number)
        return dues[after] if after < len(dues) else len(self.times)

    def walk(
        self, first: int, last: int, base: int, piece: tuple[int, int] = (-1, -1)
    ) -> tuple[Member, int] | None:
        """Walk ticks of the round that begins at `base` [ns], from one to one before another, or a piece
        of one.

        Gives the op that needs something and after which launch, None = nothing; `go_on` after that.
        """
        self._state[:CLOCK] = first, last, base, piece[0], -1, piece[1], -1, 0, 0
        return self.go_on()

    def may_have_reached(self) -> bool:
        """Whether a world may have reached its goal since this was asked last."""
        found = self._has_reached or not self._is_told
        self._has_reached = False
        return found

    def go_on(self) -> tuple[Member, int] | None:
        """Walk on after a need was supplied."""
        started = time.perf_counter()
        if self._walk is not None:
            self._walk()
        self.seconds += time.perf_counter() - started
        self._has_reached |= bool(self._state[REACHED])
        needs = int(self._state[NEEDS])
        return None if needs < 0 else (self.by_place[needs], int(self._state[STAGE]))

    def end_with_tick(self) -> None:
        """Walk no farther than to the end of the tick in which something was needed."""
        self._state[LAST] = self._state[FIRST] + 1

    def give_up(self) -> None:
        """The rest of the tick in which something was needed is not walked."""
        self._state[FIRST] += 1

    @property
    def reached(self) -> int:
        """The tick after the last that was walked: where a world reached its goal, or an op failed."""
        return int(self._state[FIRST])

    def _write(self, member: Member) -> tuple[int, int]:
        """The lines of an op; where they begin and end."""
        begin, slot, about = len(self._lines), self._plan.slots[member.place], address(member.about)
        for stage, call in enumerate(member.op.calls() or ()):
            self._line(CALL, *call, slot.period, about)
            self._line(NEED, address(member.op.needs), member.place, stage)
        for trail in member.op.heard.values():
            self._line(CLEAR, address(trail.head))
        self._line(SEND, about)
        for output, row in member.op.sent.items():
            self._line(STAMP, address(row.stamp))
            for head in member.keeps.get(output, ()):
                self._line(KEEP, address(head), address(row.memory), row.memory.nbytes, address(row.stamp))
            if self.goal is not None and (slot.name, output) in self.goal.wires:
                column = row.arrays[self.goal.name]
                self._line(REACH, address(column), column.strides[0], len(column), address(self.least))
        return begin, len(self._lines)

    def _line(self, *numbers: int) -> None:
        self._lines.append([*numbers, *[0] * (LINE - len(numbers))])


def address(array: NDArray[Any]) -> int:
    """Where an array begins in memory."""
    return int(array.ctypes.data)
