"""A step of the level `error` in one compiled call, with the numbers it goes on from.

`Strapdown` and `error.UnitStep` keep the same step in Python; it runs where states are missing, and where the
machine shakes.
"""

from swath.core.frames import Pose
from swath.sensing.imu.strapdown import Strapdown, Triple
from swath.signals import F64, MachineState

# Doubles of the memory of a unit: number of new states (0 = Python makes the sample, 1, 2); the last
# state before;
# the two newest; place and rotation of the unit; time and value of the velocity; scale, bias, its steps
# and white noise of six axes; 12 normal numbers; out: the true reading.
FIRST, LAST_TWO, PLACE, VELOCITY, SCALE, BIAS, STEPS, WHITE, DRAW, READING, SIZE = (
    *(1, 14, 40, 52, 56, 62, 68, 74, 80),
    *(92, 98),
)


class ImuStep(Strapdown):
    """Watches the states go by. mounting: pose_machine_sensor; memory: (SIZE,), of which it is a part.

    Velocity and reading lie in the memory. scale, bias, steps, white: (6,) of it, three gyroscopes, then
    three accelerometers; draw: (12,) normal numbers, of the white noise, then of the bias
    """

    def __init__(self, mounting: Pose, memory: F64) -> None:
        self._memory = m = memory
        m[PLACE:VELOCITY] = [*mounting.position, *mounting.rotation.ravel()]
        self.scale, self.bias, self.steps, self.white = (
            m[first : first + 6] for first in (SCALE, BIAS, STEPS, WHITE)
        )
        self.draw = m[DRAW:READING]
        super().__init__(mounting)

    @property
    def _last(self) -> MachineState | None:
        """The last state; of others than its time and place nothing is known."""
        t, x, y, z, a, b, c, d, e, f, g, h, i = self._memory[FIRST:LAST_TWO].tolist()
        if t != t:
            return None
        pose = Pose.of_numbers([x, y, z], [[a, b, c], [d, e, f], [g, h, i]])
        return MachineState(int(t), pose, 0.0, 0.0, 0.0, 0.0, 0.0)

    @_last.setter
    def _last(self, state: MachineState | None) -> None:
        if state is None:
            self._memory[FIRST] = float("nan")
        else:
            place, (first, second, third) = state.pose.numbers
            self._memory[FIRST:LAST_TWO] = state.t, *place, *first, *second, *third

    @property
    def _velocity(self) -> tuple[float, Triple] | None:
        s, x, y, z = self._memory[VELOCITY:SCALE].tolist()
        return None if s != s else (s, (x, y, z))

    @_velocity.setter
    def _velocity(self, value: tuple[float, Triple] | None) -> None:
        s, v = (float("nan"), (0.0, 0.0, 0.0)) if value is None else value
        self._memory[VELOCITY:SCALE] = s, *v

    @property
    def _reading(self) -> tuple[Triple, Triple]:
        p, q, r, x, y, z = self._memory[READING:SIZE].tolist()
        return (p, q, r), (x, y, z)

    @_reading.setter
    def _reading(self, value: tuple[Triple, Triple]) -> None:
        self._memory[READING:SIZE] = *value[0], *value[1]
