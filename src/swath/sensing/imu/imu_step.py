"""A step of the level `error` in one compiled call, with the numbers it goes on from.

`Strapdown` and `ErrorImu` keep the same step in Python; it runs where states are missing, and where the
machine shakes.
"""

from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.kernels import launch_on
from swath.sensing.imu.strapdown import Strapdown, Triple
from swath.signals import F64, MachineState

STATE = Struct("13d")  # t [ns], position, rotation
PAIR = Struct("26d")
SAMPLE = Struct("6d")
# Doubles of the shared memory: number of new states (1, 2); the last state before; the two newest; place and
# rotation of the unit; time and value of the velocity; scale, bias, its steps and white noise of six axes;
# 12 normal numbers; out: the true reading, the sample.
FIRST, LAST_TWO, PLACE, VELOCITY, SCALE, BIAS, STEPS, WHITE, DRAW, READING, MADE, SIZE = (
    *(1, 14, 40, 52, 56, 62, 68, 74, 80, 92),
    *(98, 104),
)


class ImuStep(Strapdown):
    """Watches the states go by, and makes samples of them. mounting: pose_machine_sensor

    Velocity and reading lie in the shared memory. scale, bias, steps, white: (6,) of its memory, three
    gyroscopes, then three accelerometers; draw: (12,) normal numbers, of the white noise, then of the bias
    """

    def __init__(self, mounting: Pose) -> None:
        m = self._memory = np.zeros(SIZE)
        self._bytes = m.data.cast("B")
        m[PLACE:VELOCITY] = [*mounting.position, *mounting.rotation.ravel()]
        self.scale, self.bias, self.steps, self.white = (
            m[first : first + 6] for first in (SCALE, BIAS, STEPS, WHITE)
        )
        self.draw = m[DRAW:READING]
        self._held: MachineState | None = None  # whose numbers lie at FIRST
        self._launch: Callable[[], Any] | None = None
        super().__init__(mounting)

    def lie_in(self, row: F64) -> None:
        """Its memory is a row of that of many worlds from now on."""
        row[:] = self._memory
        self._memory, self._bytes = row, row.data.cast("B")
        self.scale, self.bias, self.steps, self.white = (
            row[first : first + 6] for first in (SCALE, BIAS, STEPS, WHITE)
        )
        self.draw, self._launch = row[DRAW:READING], None

    @property
    def moves(self) -> bool:
        """Whether a sample needs no more than the states."""
        return self._moves and self._last is not None

    def went_on(self, last: MachineState) -> None:
        """Others made samples of its memory, up to this state."""
        self._last = self._held = last

    @property
    def _velocity(self) -> tuple[float, Triple] | None:
        s, x, y, z = self._memory[VELOCITY:SCALE].tolist()
        return None if s != s else (s, (x, y, z))

    @_velocity.setter
    def _velocity(self, value: tuple[float, Triple] | None) -> None:
        s, v = (float("nan"), (0.0, 0.0, 0.0)) if value is None else value
        self._memory[VELOCITY:SCALE] = s, *v
        self._moves = value is not None

    @property
    def _reading(self) -> tuple[Triple, Triple]:
        p, q, r, x, y, z = self._memory[READING:MADE].tolist()
        return (p, q, r), (x, y, z)

    @_reading.setter
    def _reading(self, value: tuple[Triple, Triple]) -> None:
        self._memory[READING:MADE] = *value[0], *value[1]

    def sample(self, states: Sequence[MachineState]) -> tuple[float, ...] | None:
        """Rates [rad/s] and forces [m/s2] with their errors, of the new states, oldest first; the bias walks.

        None where that needs more than the states: then nothing has changed.
        """
        last = self._last
        if last is None or not self._moves or not states or states[0].t <= last.t:
            return None
        new = states[-1]
        place, (first, second, third) = new.pose.numbers
        if len(states) > 1:
            old = states[-2]
            at, (a, b, c) = old.pose.numbers
            pair = old.t, *at, *a, *b, *c, new.t, *place, *first, *second, *third
            PAIR.pack_into(self._bytes, 8 * LAST_TWO, *pair)
            self._memory[0] = 2.0
        else:
            at_second = 8 * LAST_TWO + STATE.size
            STATE.pack_into(self._bytes, at_second, new.t, *place, *first, *second, *third)
            self._memory[0] = 1.0
        if self._held is not last:
            place, (first, second, third) = last.pose.numbers
            STATE.pack_into(self._bytes, 8 * FIRST, last.t, *place, *first, *second, *third)
        if self._launch is None:
            from swath.sensing.imu.imu_step_kernel import sample_once

            self._launch = launch_on(sample_once, self._memory)
        self._launch()
        self._last = self._held = new
        return SAMPLE.unpack_from(self._bytes, 8 * MADE)
