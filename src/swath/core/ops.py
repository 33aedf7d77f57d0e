"""Steps of compiled parts as launches over rows, and the program that walks from one to the next.

Parts of a slot in all worlds (`core.together`) whose step is a list of launches over rows are an `Op`. The
ops of a graph are walked by compiled code, which comes back to Python where a part in Python is due, where an
op needs something that is not in memory, where a world has reached its goal, or at the end of a beat.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swath.core.ability import ByMembers
from swath.core.errors import SwathError
from swath.core.rows import Row, Trail, address
from swath.core.schedule import NEVER, Slot, due_after

Wire = tuple[str, str]
Ints = NDArray[np.int64]
Call = tuple[int, int, int]  # addresses of a compiled function and of what it is given

LINE = 5  # numbers of a line of a program: what it does, and four that it needs for that
CALL, NEED, CLEAR, SEND, STAMP, KEEP, REACH = range(7)
# What the walker knows of an op: place of its slot; lines from, to; when its next step begins and ends, and
# how it goes on after that, as `Slot.clockwork` says.
PLACE, BEGIN, END, SINCE, DUE, WHOLE, REST, MORE, OF = range(9)
# What the walker reads, and writes: it stops at a time [ns], before a place in the tick; op and line to go on
# from (-1 = the next that is due); which op needs something (-1 = none), and after which of its launches;
# whether a goal is reached; when the last step was due, and the next is [ns]; how many ops there are;
# addresses of the clock and of the number of samples sent so far.
UNTIL, BEFORE, OP, FROM, NEEDS, STAGE, REACHED, AT, NEXT, COUNT, CLOCK, ORDER = range(12)


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
    lookers: what looks at what it sent (`core/onlookers.py`), right after it
    about: steps since they were counted last, and processor cycles that they took; aside: those of lookers
    """

    place: int
    op: Op
    keeps: Mapping[str, Sequence[Ints]]
    lookers: Sequence[Op] = ()
    about: Ints = field(default_factory=lambda: np.zeros(2, np.int64))
    aside: Ints = field(default_factory=lambda: np.zeros(2, np.int64))


class Program:
    """What is due from a time [ns] on, and what of it is ops, for compiled code to walk.

    by_place: its ops; sends: by place, what an op sends; seconds: of walking, since they were counted last
    next: when anything is due [ns]; python_due: when a part in Python is; t: when what was walked last was
    """

    def __init__(
        self,
        t: int,
        slots: Sequence[Slot],
        members: Sequence[Member],
        clock: Ints,
        goal: Goal | None,
        order: Ints,
    ) -> None:
        self.members, self.goal, self.seconds, self._has_reached = members, goal, 0.0, False
        self._slots, self.by_place = slots, {member.place: member for member in members}
        self.sends = {member.place: member.op.sent for member in members}
        sent = {(slots[place].name, output) for place, own in self.sends.items() for output in own}
        self._is_told = goal is not None and sent.issuperset(goal.wires)  # by the walk that a goal is reached
        self.least = np.zeros(0) if goal is None else goal.least.copy()
        self._in_python = due_after(t, {k: slot for k, slot in enumerate(slots) if k not in self.by_place})
        self.t, (self.python_due, self._next_place) = t, next(self._in_python, (NEVER, -1))
        self._lines: list[list[int]] = []
        self._needs: list[tuple[Member, Op]] = []  # by number, as lines name them
        self._steps = np.array([self._write(member, t) for member in members], np.int64).reshape(-1, OF + 1)
        self._state = np.array([0] * COUNT + [len(members), address(clock), address(order)], np.int64)
        tables = [np.array(self._lines or [[0]], np.int64), self._steps, self._state]
        self._kept = clock, order  # their addresses stand in the state
        if members:
            self._walk = members[0].op.make_walk(tables)
        self._op_due = min(self._steps[:, DUE].tolist(), default=NEVER)
        self.next = min(self.python_due, self._op_due)

    def aim(self, goal: Goal | None, active: NDArray[np.bool_]) -> bool:
        """Stop where a world that still runs reaches a goal; False where this program cannot."""
        if self.goal is None:
            return goal is None
        if goal is not None and (goal.wires, goal.name) != (self.goal.wires, self.goal.name):
            return False
        self.least[:] = np.inf if goal is None else np.where(active, goal.least, np.inf)
        return True

    def pieces(self, t: int, stops: Collection[int]) -> list[list[int]]:
        """Places of slots that are due at the next tick, in order: ops up to one of `stops`, or one slot."""
        steps = self._steps
        due: list[int] = steps[steps[:, DUE] == t, PLACE].tolist() if self._op_due == t else []
        while self.python_due == t:
            due.append(self._next_place)
            self.python_due, self._next_place = next(self._in_python)
        self.next = min(self.python_due, self._op_due)
        found, goes_on = list[list[int]](), False
        for place in sorted(due):
            is_op = place in self.by_place
            if is_op and goes_on:
                found[-1].append(place)
            else:
                found.append([place])
            goes_on = is_op and place not in stops
        return found

    def walk(self, until: int, before: int = 0) -> tuple[Member, Op, int] | None:
        """Walk all ops that are due before a time [ns], and those at that time before a place.

        Gives the op that needs something, of a member or of its lookers, and after which launch, None =
        nothing; `go_on` after that.
        """
        self._state[:AT] = until, before, -1, -1, -1, 0, 0
        return self.go_on()

    def may_have_reached(self) -> bool:
        """Whether a world may have reached its goal since this was asked last."""
        found = self._has_reached or not self._is_told
        self._has_reached = False
        return found

    def go_on(self) -> tuple[Member, Op, int] | None:
        """Walk on after a need was supplied."""
        started = time.perf_counter()
        self._walk()
        self.seconds += time.perf_counter() - started
        needs, stage, has_reached, self.t, self._op_due = self._state[NEEDS:COUNT].tolist()
        self._has_reached |= bool(has_reached)
        self.next = min(self.python_due, self._op_due)
        return None if needs < 0 else (*self._needs[needs], stage)

    def end_with_tick(self) -> None:
        """Walk no farther than to the end of the tick in which something was needed."""
        if self._state[UNTIL] > self.t:
            self._state[: BEFORE + 1] = self.t + 1, 0

    def _write(self, member: Member, t: int) -> list[int]:
        """Write the lines of an op; what the walker knows of it after a time [ns]."""
        begin, slot, about = len(self._lines), self._slots[member.place], address(member.about)
        self._call(member, member.op, about)
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
        for op in member.lookers:
            self._call(member, op, address(member.aside))
        return [member.place, begin, len(self._lines), *slot.clockwork(t)]

    def _call(self, member: Member, op: Op, about: int) -> None:
        """Write the lines of the launches of an op."""
        for stage, call in enumerate(op.calls() or ()):
            self._line(CALL, *call, about)
            self._line(NEED, address(op.needs), len(self._needs), stage)
        self._needs.append((member, op))

    def _line(self, *numbers: int) -> None:
        self._lines.append([*numbers, *[0] * (LINE - len(numbers))])
