"""Where the wheels and the gyroscope say the machine went, over the last seconds."""

from collections import deque
from collections.abc import Sequence
from math import cos, isfinite, sin
from typing import NamedTuple

from swath.control.pose.standing import Standing
from swath.core.component import KeepsState, Port
from swath.core.schedule import NS
from swath.signals import Fix, Inertial, Odometry, PoseEstimate

# of every level of `pose`
INPUTS = (
    Port("fix", Fix),
    Port("odometry", Odometry, history=True),
    Port("inertial", Inertial, history=True, optional=True),
)
OUTPUTS = (Port("pose", PoseEstimate),)
REACH = 3 * NS  # how far back it is remembered [ns]


class Step(NamedTuple):
    """A pose in the frame of the dead reckoning, and how it goes on. t [ns]; x, y [m]; heading [rad].

    speed [m/s], yaw_rate [rad/s]: from t on
    """

    t: int
    x: float
    y: float
    heading: float
    speed: float
    yaw_rate: float


class DeadReckoning(KeepsState):
    """Poses by odometry, in a frame of its own, which does not turn while the wheels stand.

    distance: driven since the start [m]
    """

    kept = ("_steps", "_standing", "distance")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Nothing known."""
        self._steps: deque[Step] = deque()
        self._standing = Standing()
        self.distance = 0.0

    def take(self, samples: Sequence[Odometry]) -> None:
        """Samples since the last call, oldest first."""
        for sample in samples:
            if not isfinite(sample.speed) or not isfinite(sample.yaw_rate):
                continue
            here = self._steps[-1] if self._steps else Step(sample.t, 0.0, 0.0, 0.0, 0.0, 0.0)
            gone = _gone_on(here, sample.t)
            self.distance += abs(here.speed) * max(sample.t - here.t, 0) / NS
            stands = self._standing.take(sample.speed, (sample.t - here.t) / NS)
            yaw_rate = 0.0 if stands else sample.yaw_rate
            self._steps.append(gone._replace(speed=sample.speed, yaw_rate=yaw_rate))
        while len(self._steps) > 2 and self._steps[1].t < self._steps[-1].t - REACH:
            self._steps.popleft()

    @property
    def is_known(self) -> bool:
        """Whether a sample came."""
        return bool(self._steps)

    @property
    def latest(self) -> Step:
        """The newest sample."""
        return self._steps[-1]

    def at(self, t: int) -> Step:
        """The pose at a time [ns]; before what is remembered, the oldest."""
        before = self._steps[0]
        for step in reversed(self._steps):
            if step.t <= t:
                before = step
                break
        return _gone_on(before, t)


def seen_from(a: Step, b: Step) -> tuple[float, float, float]:
    """x, y [m] and heading [rad] of the pose b in the frame of a."""
    c, s = cos(a.heading), sin(a.heading)
    dx, dy = b.x - a.x, b.y - a.y
    return c * dx + s * dy, c * dy - s * dx, b.heading - a.heading


def _gone_on(step: Step, t: int) -> Step:
    """Go on along the same arc until t [ns]."""
    seconds = max(t - step.t, 0) / NS
    turn = step.yaw_rate * seconds
    middle, travel = step.heading + 0.5 * turn, step.speed * seconds
    x, y = step.x + travel * cos(middle), step.y + travel * sin(middle)
    return step._replace(t=t, x=x, y=y, heading=step.heading + turn)
