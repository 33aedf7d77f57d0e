"""Angular rate and specific force at a point of a machine, from its true poses.

Over the time from one sample to the next, as a unit reports that adds up its own fast readings:

    rate  = log(R0^T R1) / (t1 - t0)
    force = R^T ((v1 - v0) / (s1 - s0) + g up)

R0, R1: attitude of the sensor; v: last difference of two of its positions, valid half a state before, at s;
R: the attitude half way from s0 to s1; log: rotation vector of a rotation matrix. So turn rates add up to the
turn and accelerations to the speed; as a mean over T, a frequency f comes through with sinc(f T).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, hypot, sin
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.signals import MachineState

GRAVITY = 9.81  # [m/s2]
Length = Annotated[float, Ge(-30), Le(30)]
Angle = Annotated[float, Ge(-180), Le(180)]
Triple = tuple[float, float, float]
Rows = list[list[float]]  # of a rotation (3, 3)
Reading = tuple[Triple, Triple]  # rate [rad/s], specific force [m/s2]


@dataclass(frozen=True)
class Place:
    """Place of the unit on its machine.

    x_m: ahead of the fixed axle
    y_m: leftward
    z_m: above ground
    roll_deg: > 0 left side up
    pitch_deg: > 0 nose down
    yaw_deg: > 0 to the left
    """

    x_m: Length = 0.0
    y_m: Length = 0.0
    z_m: Length = 1.5
    roll_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    yaw_deg: Angle = 0.0

    def pose(self) -> Pose:
        """pose_machine_sensor."""
        angles = self.roll_deg * DEG, self.pitch_deg * DEG, self.yaw_deg * DEG
        return Pose.from_euler((self.x_m, self.y_m, self.z_m), *angles)


class Strapdown(KeepsState):
    """Watches the states go by. mounting: pose_machine_sensor."""

    kept = ("_last", "_velocity", "_reading")

    def __init__(self, mounting: Pose) -> None:
        self._at: Triple = tuple(mounting.position.tolist())
        self._turn: Rows = mounting.rotation.tolist()
        self.reset(Pose.identity())

    def reset(self, start: Pose) -> Reading:
        """Forget what was; rate [rad/s] and force [m/s2] of a machine that rests at `start`."""
        self._last: MachineState | None = None
        self._velocity: tuple[float, Triple] | None = None  # its time [s], value [m/s]
        self._reading = self._at_rest(start)
        return self._reading

    def take(self, states: Sequence[MachineState]) -> Reading:
        """(rate, force) in the sensor's frame, from the last state taken before to the newest.

        Without a newer one the reading stays; from a single one, that of rest.
        """
        last = self._last
        path = [] if last is None else [last]
        path += [s for s in states if last is None or s.t > last.t]
        if last is None and len(path) == 1:
            self._reading = self._at_rest(path[0].pose)
        if len(path) > 1:
            self._reading = self._between(path)
        self._last = path[-1] if path else None
        return self._reading

    def _at_rest(self, pose: Pose) -> Reading:
        return (0.0, 0.0, 0.0), back(self._turn, back(pose.rotation.tolist(), (0.0, 0.0, GRAVITY)))

    def _between(self, path: Sequence[MachineState]) -> Reading:
        first: Rows = path[0].pose.numbers[1]
        begin, span = path[0].t / NS, (path[-1].t - path[0].t) / NS
        turn = rotation_vector(first, path[-1].pose.numbers[1])
        s0, v0 = self._velocity or self._velocity_of(path[0], path[1])
        s1, v1 = self._velocity = self._velocity_of(path[-2], path[-1])
        per_s = 1.0 / (s1 - s0) if s1 > s0 else 0.0
        (xa, ya, za), (xb, yb, zb) = v0, v1
        x, y, z = (xb - xa) * per_s, (yb - ya) * per_s, (zb - za) * per_s
        way = (begin - 0.5 * (s0 + s1)) / span  # less than 0: back from half way to the first state
        p, q, r = turn
        force = turned((p * way, q * way, r * way), back(first, (x, y, z + GRAVITY)))
        return back(self._turn, (p / span, q / span, r / span)), back(self._turn, force)

    def _velocity_of(self, a: MachineState, b: MachineState) -> tuple[float, Triple]:
        (xa, ya, za), (xb, yb, zb) = a.pose.point(*self._at), b.pose.point(*self._at)
        per_s = NS / (b.t - a.t)
        return 0.5 * (a.t + b.t) / NS, ((xb - xa) * per_s, (yb - ya) * per_s, (zb - za) * per_s)


def back(rotation: Rows, vector: Triple) -> Triple:
    """A vector in the frame whose axes are the columns of a rotation (3, 3)."""
    x, y, z = vector
    (a, b, c), (d, e, f), (g, h, i) = rotation
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def rotation_vector(first: Rows, last: Rows) -> Triple:
    """Axis times angle [rad] of the turn from one rotation (3, 3) to another, less than half a turn, in the
    axes of the first.
    """
    (a, b, c), (d, e, f), (g, h, i) = first
    (j, k, s), (m, n, o), (p, q, r) = last
    x = 0.5 * (c * k + f * n + i * q - (b * s + e * o + h * r))  # axis times sine
    y = 0.5 * (a * s + d * o + g * r - (c * j + f * m + i * p))
    z = 0.5 * (b * j + e * m + h * p - (a * k + d * n + g * q))
    trace = a * j + d * m + g * p + (b * k + e * n + h * q) + (c * s + f * o + i * r)
    sine = hypot(x, y, z)
    size = atan2(sine, 0.5 * (trace - 1.0)) / sine if sine > 1e-12 else 1.0
    return x * size, y * size, z * size


def turned(about: Triple, vector: Triple) -> Triple:
    """A vector turned about an axis by its length [rad] (Rodrigues)."""
    p, q, r = about
    x, y, z = vector
    angle = hypot(p, q, r)
    a = sin(angle) / angle if angle > 0.0 else 1.0
    half = sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    b = 2.0 * (half * half)
    cx, cy, cz = q * z - r * y, r * x - p * z, p * y - q * x
    return (
        x + a * cx + b * (q * cz - r * cy),
        y + a * cy + b * (r * cx - p * cz),
        z + a * cz + b * (p * cy - q * cx),
    )
