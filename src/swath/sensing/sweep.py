"""Where the beams of a sweep start: `poses_at` of `mount.py` and the mounting in one native function."""

from collections.abc import Sequence
from struct import Struct
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.kernels import repeatable, shared, start_warp
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
        self.mounting = np.concatenate([mounting.position, mounting.rotation.ravel()])
        self.beam_t = np.ascontiguousarray(beam_t)
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
        self._sizes[:] = end, len(states), self._count
        if self._launch is None:
            self._launch = self._prepare()
        self._launch.launch()
        return self._origins.copy(), self._rotations.copy()

    def _prepare(self) -> Any:
        from swath.sensing.native.kernel import sweep

        before = map(shared, (self._states.reshape(-1), self.mounting, self.beam_t, self._sizes))
        origins = shared(self._origins, start_warp().vec3d)
        return repeatable(sweep, [*before, origins, shared(self._rotations.reshape(-1))])
