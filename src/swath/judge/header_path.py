"""The way of the header end that follows the edge, as evaluators keep it."""

from collections.abc import Callable
from weakref import ref

import numpy as np

from swath.core.blocks import Block
from swath.core.packed_state import saved_type
from swath.judge.evaluator import KeptRows
from swath.record.message_factory import RecordedMachine
from swath.signals import F64

PATH_M = 0.02  # spacing of the stored path


@saved_type("end", "_end", "_rows", "_next")
class HeaderPath:
    """Places of a machine's header end, one every PATH_M. end: in the machine frame [m].

    Evaluators of a machine may keep one together: what each of them gives it is noted once.
    """

    _taken: Callable[[], Block | None] = staticmethod(lambda: None)  # what it was given last

    def __init__(self, machine: RecordedMachine) -> None:
        self.end = np.array([*machine.geometry.header_end(machine.edge_side), 0.0])
        self._end: list[float] = self.end.tolist()
        self._rows = KeptRows(4)
        self._next = float("-inf")  # distance from which on the next place is noted [m]

    def take(self, states: Block) -> None:
        """Note where the machine was."""
        if self._taken() is states:
            return
        self._taken = ref(states)
        found, after = [], self._next
        for k, way in enumerate(states["distance"].tolist()):
            if way >= after:
                found.append(k)
                after = way + PATH_M
        if found:
            self._next, rows = after, np.empty((len(found), 4))
            p, (a, b, _) = states["pose"][found].T, self._end
            rows[:, 0], rows[:, 1] = states["t"][found] * 1e-9, states["distance"][found]
            rows[:, 2], rows[:, 3] = p[3] * a + p[4] * b + p[0], p[6] * a + p[7] * b + p[1]
            self._rows.add(rows)

    def arrays(self, most: int | None = None) -> tuple[F64, F64, F64, F64]:
        """Time [s], distance driven [m], x and y in the world [m], (n,) each. most: as in `KeptRows`."""
        t, distance, x, y = self._rows.table(most).T
        return t, distance, x, y
