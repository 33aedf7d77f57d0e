"""The way of the header end that follows the edge, as evaluators keep it."""

import numpy as np

from swath.core.packed_state import saved_type
from swath.judge.kept_rows import KeptRows
from swath.record.messages import RecordedMachine
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

    def arrays(self) -> tuple[F64, F64, F64, F64]:
        """t [s], distance driven [m], x and y in the world [m], shape (n,) each."""
        t, distance, x, y = self._rows.table().T
        return t, distance, x, y
