"""Where the beams of a sweep start: `poses_at` of `mount.py` and the mounting in one native function."""

from collections.abc import Sequence
from struct import Struct
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.kernels import repeatable, start_warp
from swath.signals import F64, MachineState

ROOM = 64  # states between two sweeps; more are thinned out
ROW = Struct("13d")  # t, position, rotation of a state


class Sweep:
    """A scanner's beams. mounting: pose_machine_sensor; beam_t: of each beam, before the sweep's end [s]."""

    def __init__(self, mounting: Pose, beam_t: F64) -> None:
        n = len(beam_t)
        self._count = n
        self._states, self._sizes = np.zeros((ROOM, 13)), np.zeros(3)
        self._rows = self._states.data.cast("B")
        self._mounting = np.concatenate([mounting.position, mounting.rotation.ravel()])
        self._beam_t = np.ascontiguousarray(beam_t)
        self._origins, self._rotations = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self._launch: Any = None

    def __call__(self, states: Sequence[MachineState], end: int) -> tuple[F64, F64]:
        """Sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world, each beam at its own
        time of the sweep that ends at `end` [ns]; between states as `mount.poses_at`.
        """
        if len(states) > ROOM:
            states = [states[round(k)] for k in np.linspace(0, len(states) - 1, ROOM)]
        for k, state in enumerate(states):
            place, (first, second, third) = state.pose.numbers
            ROW.pack_into(self._rows, k * ROW.size, state.t, *place, *first, *second, *third)
        return self._at(end, len(states))

    def of(self, states: F64, end: int) -> tuple[F64, F64]:
        """The same of states as rows of t [ns], position and rotation, (n, 13), at most ROOM."""
        self._states[: len(states)] = states
        return self._at(end, len(states))

    def _at(self, end: int, count: int) -> tuple[F64, F64]:
        self._sizes[:] = end, count, self._count
        if self._launch is None:
            self._launch = self._prepare()
        self._launch.launch()
        return self._origins.copy(), self._rotations.copy()

    def _prepare(self) -> Any:
        wp = start_warp()
        from swath.sensing.native.kernel import sweep

        arrays = (self._states, self._mounting, self._beam_t, self._sizes, self._origins, self._rotations)
        inputs = [wp.array(a.reshape(-1), dtype=wp.float64, device="cpu", copy=False) for a in arrays]
        return repeatable(sweep, inputs)
