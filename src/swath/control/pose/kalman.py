"""The filter behind pose level `ekf`: nine states, their covariance, and the updates by single numbers.

States: x, y of the fixed axle [m], heading [rad], speed [m/s], bias of the yaw rate [rad/s], scale error of
the wheels' speed (slip and calibration), side slip beyond what is expected [rad], and the receiver's
wandering error east and north [m], a first-order Gauss-Markov process: without these two the filter would
take the mean of an error that hardly moves for a better position. A speed says something about the scale,
the heading and the slip only while the machine moves: derivatives taken at the noise of a speed near 0 would
make the filter sure of a scale that is wrong. Extended Kalman filter in the form of
Bar-Shalom, Li and Kirubarajan 2001, ch. 10; updates in Joseph's form.
"""

from math import cos, exp, fsum, sin
from typing import NamedTuple

import numpy as np

from swath.core import portable
from swath.core.component import KeepsState
from swath.core.packed_state import saved_type
from swath.signals import F64

X, Y, HEADING, SPEED, BIAS, SCALE, SLIP, EAST, NORTH = range(9)
SIZE = 9
MOVES = 10.0  # standard deviations above which a speed is one
Row = dict[int, float]  # derivatives of a measurement by the states


class Noise(NamedTuple):
    """What drives the states.

    acceleration, scale: densities [m/s2, 1 per sqrt(Hz)]
    bias: of its walk [rad/s per sqrt(s)]
    slip [rad], slip_time [s]: of a first-order Gauss-Markov process
    """

    acceleration: float
    scale: float
    bias: float
    slip: float
    slip_time: float


@saved_type()
class Wander(NamedTuple):
    """The receiver's wandering error. sd [m], time [s]."""

    sd: float
    time: float


@saved_type()
class Motion(NamedTuple):
    """A step of the machine. seconds; yaw_rate: measured [rad/s], its sd over the step; crab: expected slip
    to the right [rad]; speed: by the wheels [m/s]; rest: yaw rate by the wheels while they stand [rad/s], nan
    while they roll.
    """

    t: int
    seconds: float
    yaw_rate: float
    yaw_rate_sd: float
    crab: float
    speed: float
    rates: tuple[float, float, float]
    offset: tuple[float, float]
    rest: float = float("nan")


class Kalman(KeepsState):
    """state (9,), covariance (9, 9)."""

    kept = ("state", "covariance", "wander")

    def __init__(self, noise: Noise) -> None:
        self._noise = noise
        self.wander = Wander(0.0, 100.0)
        self.state: F64 = np.zeros(SIZE)
        self.covariance: F64 = np.eye(SIZE)

    def copy(self) -> "Kalman":
        """Another one in the same state."""
        twin = Kalman(self._noise)
        twin.state, twin.covariance, twin.wander = self.state.copy(), self.covariance.copy(), self.wander
        return twin

    def travel(self, crab: float) -> float:
        """Direction of travel of the axle [rad]."""
        return float(self.state[HEADING] + self.state[SLIP]) - crab

    @property
    def pace(self) -> float:
        """Speed at which derivatives of measured speeds are taken [m/s]: 0 while it may be noise."""
        v = float(self.state[SPEED])
        return v if v * v > MOVES**2 * float(self.covariance[SPEED, SPEED]) else 0.0

    def go(self, m: Motion) -> None:
        """On by a step."""
        s, h, n = self.state, m.seconds, self._noise
        turn = (m.yaw_rate - float(s[BIAS])) * h
        along, v = self.travel(m.crab) + 0.5 * turn, float(s[SPEED])
        dx, dy = cos(along) * h, sin(along) * h
        fade, slip_fade = exp(-h / self.wander.time), exp(-h / n.slip_time)
        f = np.eye(SIZE)
        for angle in (HEADING, SLIP):
            f[X, angle], f[Y, angle] = -v * dy, v * dx
        f[X, SPEED], f[Y, SPEED], f[HEADING, BIAS] = dx, dy, -h
        f[SLIP, SLIP], f[EAST, EAST], f[NORTH, NORTH] = slip_fade, fade, fade
        s[X], s[Y], s[HEADING] = s[X] + v * dx, s[Y] + v * dy, s[HEADING] + turn
        s[SLIP], s[EAST], s[NORTH] = slip_fade * s[SLIP], fade * s[EAST], fade * s[NORTH]
        p = portable.product(portable.product(f, self.covariance), f.T)
        roams = self.wander.sd**2 * (1.0 - fade**2)
        gains = {
            HEADING: (m.yaw_rate_sd * h) ** 2,
            SPEED: n.acceleration**2 * h,
            BIAS: n.bias**2 * h,
            SCALE: n.scale**2 * h,
            SLIP: n.slip**2 * (1.0 - slip_fade**2),
            EAST: roams,
            NORTH: roams,
        }
        for i, more in gains.items():
            p[i, i] += more
        self.covariance = p

    def take(self, difference: float, row: Row, variance: float) -> None:
        """A measurement. difference: measured less expected; row: its derivatives by the states."""
        h = np.zeros(SIZE)
        h[list(row)] = list(row.values())
        ph = portable.product(self.covariance, h)
        gain = ph / (float(portable.product(h, ph)) + variance)
        self.state += gain * difference
        complement = np.eye(SIZE) - np.multiply.outer(gain, h)
        p = portable.product(portable.product(complement, self.covariance), complement.T)
        p += np.multiply.outer(gain, gain) * variance
        self.covariance = 0.5 * (p + p.T)

    def take_wheels(self, speed: float, sd: float, gate: float) -> None:
        """Speed by the wheels, (1 + scale) v.

        Beyond the gate, a squared distance, the speed has jumped: that says nothing about the scale.
        """
        scale, v = 1.0 + float(self.state[SCALE]), float(self.state[SPEED])
        row, difference = {SPEED: scale, SCALE: self.pace}, speed - scale * v
        if not self._is_within(gate, difference, row, sd**2):
            self.covariance[SPEED, SPEED] += difference**2
            row = {SPEED: scale}
        self.take(difference, row, sd**2)

    def take_rest(self, m: Motion, gate: float) -> None:
        """What the yaw rate is above that of standing wheels is its bias; left out beyond the gate."""
        difference, row = m.yaw_rate - m.rest - float(self.state[BIAS]), {BIAS: 1.0}
        if self._is_within(gate, difference, row, m.yaw_rate_sd**2):
            self.take(difference, row, m.yaw_rate_sd**2)

    def _is_within(self, gate: float, difference: float, row: Row, variance: float) -> bool:
        p = self.covariance
        spread = fsum(a * b * float(p[i, j]) for i, a in row.items() for j, b in row.items())
        return difference**2 <= gate * (spread + variance)

    def roam(self, wander: Wander) -> None:
        """Another receiver error from now on, that nothing is known of."""
        self.wander = wander
        for i in (EAST, NORTH):
            self.state[i] = 0.0
            self.covariance[i, :] = self.covariance[:, i] = 0.0
            self.covariance[i, i] = wander.sd**2

    def expected_place(self, offset: tuple[float, float]) -> tuple[float, float, Row, Row]:
        """x, y [m] at which an antenna is expected, `offset` ahead and to the left; and their derivatives."""
        c, s = cos(float(self.state[HEADING])), sin(float(self.state[HEADING]))
        ahead, left = c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]
        x = float(self.state[X] + self.state[EAST]) + ahead
        y = float(self.state[Y] + self.state[NORTH]) + left
        return x, y, {X: 1.0, HEADING: -left, EAST: 1.0}, {Y: 1.0, HEADING: ahead, NORTH: 1.0}

    def distance(self, dx: float, dy: float, rows: tuple[Row, Row], variance: float) -> float:
        """Squared Mahalanobis distance of a position from the expected one: chi-square, 2 freedoms."""
        h = np.zeros((2, SIZE))
        for i, row in enumerate(rows):
            h[i, list(row)] = list(row.values())
        spread = portable.product(portable.product(h, self.covariance), h.T)
        a, b, c = float(spread[0, 0]) + variance, float(spread[0, 1]), float(spread[1, 1]) + variance
        return (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / (a * c - b * b)
