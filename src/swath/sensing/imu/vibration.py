"""What engine, threshing drum and sieves add to an inertial unit: lines at their frequencies.

All three hang on the engine and turn with it. A unit reports the mean over its period T, so a line of
frequency f comes through with sinc(f T). Frequencies: engine half a turn (six cylinders, four strokes: the
strongest of the low orders on the frame), drum 9.2 Hz (550 1/min), sieves 4.5 Hz (270 1/min), all at rated
speed, from memory of machine data; sizes and axes are estimates within 0.5 to 2 m/s2 RMS at 2 to 30 Hz.
"""

from dataclasses import dataclass
from math import cos, pi, sqrt
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import KeepsState
from swath.sensing.imu.strapdown import Reading

Force = Annotated[float, Ge(0), Le(50)]
Rate = Annotated[float, Gt(0), Le(50)]
# How a line's force lies along x, y, z of the machine, and its rate about them; unit vectors.
AXES = {
    "engine": ((0.0, 0.6, 0.8), (1.0, 0.0, 0.0)),
    "drum": ((0.6, 0.0, 0.8), (0.0, 1.0, 0.0)),
    "sieves": ((0.8, 0.0, 0.6), (0.0, 1.0, 0.0)),
}
LINES = tuple(AXES)


@dataclass(frozen=True)
class Vibration:
    """engine_m_s2, drum_m_s2, sieves_m_s2: root mean square of each
    engine_hz, drum_hz, sieves_hz: at rated speed; arm_m: a force at frequency f is felt as a turn too,
    rate = force / (2 pi f arm)
    """

    engine_m_s2: Force = 0.4
    drum_m_s2: Force = 0.5
    sieves_m_s2: Force = 0.6
    engine_hz: Rate = 15.8
    drum_hz: Rate = 9.2
    sieves_hz: Rate = 4.5
    arm_m: Annotated[float, Gt(0), Le(100)] = 3.0


class Shaking(KeepsState):
    """Three lines whose phases run on with the engine."""

    kept = ("_phases",)

    def __init__(self, v: Vibration) -> None:
        self._v = v
        self._lines = [(name, getattr(v, f"{name}_m_s2"), getattr(v, f"{name}_hz")) for name in LINES]
        self._phases = [0.0] * len(LINES)

    def reset(self, draws: list[float]) -> None:
        """draws: uniform numbers of [0, 1), one for each line's phase."""
        self._phases = [2.0 * pi * d for d in draws]

    def take(self, seconds: float, share: float) -> Reading:
        """(rate [rad/s], force [m/s2]) of the machine's axes, the mean over so many seconds.

        share: engine speed over rated speed
        """
        rate, force = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        for i, (name, size, frequency) in enumerate(self._lines):
            turn = 2.0 * pi * frequency * share * seconds
            begin = self._phases[i]
            self._phases[i] = (begin + turn) % (2.0 * pi)
            if turn <= 0.0:
                continue
            mean = size * share**2 * sqrt(2.0) * (cos(begin) - cos(begin + turn)) / turn
            about = mean / (2.0 * pi * frequency * share * self._v.arm_m)
            for axis in range(3):
                force[axis] += AXES[name][0][axis] * mean
                rate[axis] += AXES[name][1][axis] * about
        return (rate[0], rate[1], rate[2]), (force[0], force[1], force[2])
