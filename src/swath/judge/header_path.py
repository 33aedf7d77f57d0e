"""The way of the header end that follows the edge, as evaluators keep it."""

from collections.abc import Sequence

import numpy as np

from swath.core.packed_state import saved_type
from swath.core.together import Samples
from swath.judge.evaluator import KeptRows
from swath.judge.together import Table
from swath.record.message_factory import RecordedMachine
from swath.signals import F64, MachineState

PATH_M = 0.02  # spacing of the stored path


@saved_type("end", "_end", "_rows", "_next")
class HeaderPath:
    """Places of a machine's header end, one every PATH_M. end: in the machine frame [m]."""

    def __init__(self, machine: RecordedMachine) -> None:
        self.end = np.array([*machine.geometry.header_end(machine.edge_side), 0.0])
        self._end: list[float] = self.end.tolist()
        self._rows = KeptRows(4)
        self._next = float("-inf")  # distance from which on the next place is noted [m]

    def see(self, state: MachineState) -> None:
        """Note where the machine is."""
        if state.distance >= self._next:
            x, y, _ = state.pose.point(*self._end)
            self._rows.add((state.t * 1e-9, state.distance, x, y))
            self._next = state.distance + PATH_M

    def take(self, rows: F64, following: float) -> None:
        """Rows that others noted, and from where on the next place is noted [m]."""
        self._rows.add(rows.ravel().tolist())
        self._next = following

    def arrays(self, most: int | None = None) -> tuple[F64, F64, F64, F64]:
        """t [s], distance driven [m], x and y in the world [m], shape (n,) each. most: as in `KeptRows`"""
        t, distance, x, y = self._rows.table(most).T
        return t, distance, x, y


class HeaderPaths:
    """Those of many worlds."""

    def __init__(self, paths: Sequence[HeaderPath]) -> None:
        self._paths, self._ends = paths, np.array([path.end for path in paths])
        self._table, self._next = Table(len(paths), 4), np.full(len(paths), -np.inf)

    def see(self, state: Samples) -> None:
        """Note where the machines are."""
        distance = state.arrays["distance"]
        where = np.flatnonzero(distance >= self._next)
        if len(where):
            p, (a, b, c) = state.arrays["pose"][where].T, self._ends[where].T
            x, y = p[3] * a + p[4] * b + p[5] * c + p[0], p[6] * a + p[7] * b + p[8] * c + p[1]
            driven = distance[where]
            self._table.add(where, state.t * 1e-9, driven, x, y)
            self._next[where] = driven + PATH_M

    def give(self, world: int) -> None:
        """The path of a world is as long as it drove."""
        self._paths[world].take(self._table.news(world), float(self._next[world]))
