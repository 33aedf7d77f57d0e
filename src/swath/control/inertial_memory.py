"""Memory that a step over samples of an inertial unit shares with its compiled form."""

from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any

import numpy as np

from swath.kernels import repeatable, start_warp
from swath.signals import F64, Inertial

SAMPLES, ROOM = 20, 32  # where samples begin; how many there may be
ROW = Struct("7d")


class InertialMemory:
    """numbers: those of the step, (SAMPLES,), the first of them how many samples there are; what they mean is
    the step's own. kernel: name of the compiled step.
    """

    def __init__(self, kernel: str) -> None:
        self._kernel = kernel
        self._all = np.zeros(SAMPLES + 7 * ROOM)
        self.numbers: F64 = self._all[:SAMPLES]
        self.bytes = self._all.data.cast("B")
        self._launch: Callable[[], Any] | None = None

    def put(self, samples: Sequence[Inertial]) -> bool:
        """Take samples over; False where they are too many."""
        if len(samples) > ROOM:
            return False
        at = 8 * SAMPLES
        for s in samples:
            turn, force = (s.rate_x, s.rate_y, s.rate_z), (s.force_x, s.force_y, s.force_z)
            ROW.pack_into(self.bytes, at, s.t, *turn, *force)
            at += ROW.size
        return True

    def step(self) -> None:
        """The compiled step."""
        if self._launch is None:
            from swath.control import inertial_kernel

            memory = start_warp().array(self._all, dtype=start_warp().float64, device="cpu", copy=False)
            recorded = repeatable(getattr(inertial_kernel, self._kernel), [memory])
            self._launch = recorded.launch
        self._launch()
