"""What the law assumes about the machine between its command and the path: dead time, then a lag."""

from collections import deque
from dataclasses import dataclass
from math import isfinite, tan
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le

from swath.core.component import KeepsState
from swath.core.units import DEG
from swath.signals import Odometry

CRAWL = 0.2  # m/s, below which the path curvature cannot be measured and the slip observer rests


PREVIEW, STANLEY, PURE_PURSUIT = range(3)  # laws of `preview_kernel`
Share = Annotated[float, Gt(0), Le(1)]


@dataclass(frozen=True)
class Learns:
    """How a law foresees the steering, and learns what of its commands the machine does not do.

    dead_time_s: dead time of the steering, bridged by prediction
    lag_s: time constant of the steering, bridged by prediction
    rate_deg_s: limit of the wanted steering angle's rate
    share_of_lock: share of the full steering angle that is used [1]
    trim_m: distance over which the machine's understeer is learned, 0 = never
    slip_m: distance over which side slip is learned, 0 = never
    slip_step_cm: error beyond which side slip is not learned
    """

    dead_time_s: Annotated[float, Ge(0), Le(2)] = 0.15
    lag_s: Annotated[float, Ge(0), Le(2)] = 0.2
    rate_deg_s: Annotated[float, Gt(0), Le(90)] = 15.0
    share_of_lock: Share = 0.8
    trim_m: Annotated[float, Ge(0), Le(1000)] = 12.0
    slip_m: Annotated[float, Ge(0), Le(1000)] = 6.0
    slip_step_cm: Annotated[float, Gt(0), Le(100)] = 10.0


def driven_curvature(odometry: Odometry, wheelbase: float, limit: float) -> float:
    """Curvature of the driven path [1/m]: yaw rate over speed, at a crawl from the steering angle.

    wheelbase [m]; limit: largest size of the answer [1/m]
    """
    curvature = 0.0
    if odometry.speed > CRAWL and isfinite(odometry.yaw_rate):
        curvature = odometry.yaw_rate / odometry.speed
    elif isfinite(odometry.steer_angle):
        curvature = float(tan(odometry.steer_angle)) / wheelbase
    return min(max(curvature, -limit), limit)


class Place(NamedTuple):
    """A later stand of the machine in its frame of now: x, y [m], heading [rad]."""

    x: float
    y: float
    heading: float


class ActuatorModel(KeepsState):
    """Path curvature that follows the commands after a dead time [s] with a first-order lag [s].

    What is driven less what was commanded is learned over a `distance` [m]: understeer, wheel slip, an offset
    of the steering angle. 0 = never.

    curvature: driven now; deficit: by which the commands exceed what is driven in the long run [1/m]
    """

    kept = ("curvature", "deficit", "_pending", "_model")

    def __init__(self, dead_time: float, lag: float, period: float, distance: float = 0.0) -> None:
        self._share = period / (lag + period)
        self._period = period
        self._pending: deque[float] = deque(maxlen=max(1, round(dead_time / period)))
        self._more = round(lag / period)
        self._rate = 1.0 / distance if distance > 0.0 else 0.0
        self.reset()

    @property
    def numbers(self) -> tuple[float, ...]:
        """Share of the lag in a period, the period, commands under way and after them, pace of learning."""
        return self._share, self._period, self._pending.maxlen or 1, self._more, self._rate

    def reset(self) -> None:
        """Everything at rest, straight ahead."""
        self._pending.extend([0.0] * (self._pending.maxlen or 1))
        self.curvature, self.deficit, self._model = 0.0, 0.0, 0.0

    def push(self, command: float, measured: float, travel: float) -> None:
        """A period of `travel` [m] passed with `command` [1/m] given at its start; `measured` is driven."""
        self._model += self._share * (self._pending[0] - self._model)
        self._pending.append(command)
        self.curvature = measured
        self.deficit += min(1.0, travel * self._rate) * (self._model - measured - self.deficit)

    def ahead(self, speed: float, slip: float) -> Place:
        """Where the machine will stand when the next command has taken hold: dead time and lag later.

        speed [m/s]; slip [rad]: its direction of travel to the left of what the steering
        explains.
        """
        x = y = heading = 0.0
        curvature = self.curvature
        for command in [*self._pending, *([self._pending[-1]] * self._more)]:
            curvature += self._share * (command - self.deficit - curvature)
            turn = speed * self._period * curvature
            x += speed * self._period
            y += speed * self._period * (heading + 0.5 * turn + slip)
            heading += turn
        return Place(x, y, heading)


SURE = 0.05  # m, standard deviation of an offset beyond which the slip observer listens less
SLIP_LIMIT = 4.0 * DEG  # rad, of the slip observer: a combine crabs by as much on a side slope of 28 %
STEEPEST = 1.2  # rad, direction of travel beyond which no curvature is sought
BETTER = 0.01  # m, sd of how far an edge moved that is reported better now, above which it is taken
# anew; estimate, with which the demo, a bend and a straight edge were driven
FORGET_M = 3.0  # m of travel over which it is forgotten how well the edge was known


class SlipObserver(KeepsState):
    """Side slip of the header end: its direction of travel against what the steering explains [rad].

    On a side slope a combine crabs by about slope / normalised cornering stiffness, 1.4 deg on 10 %. Observer
    of lateral error e and slip c over the travelled distance s, de/ds = angle - direction - c, both poles at
    1 / `distance` [1/m]; innovations are clipped to +-`clip` [m] so that a step of the edge is not taken for
    slip. Nor is what the edge moves by when it becomes better known: the error then begins anew.
    """

    kept = ("slip", "_error", "_sd")

    def __init__(self, distance: float, clip: float, limit: float) -> None:
        self._pole = 1.0 / distance if distance > 0.0 else 0.0
        self._clip, self._limit = clip, limit
        self.reset()

    @property
    def numbers(self) -> tuple[float, ...]:
        """The pole, its square [1/m], the clip [m]."""
        return self._pole, self._pole**2, self._clip

    def reset(self) -> None:
        """No slip."""
        self.slip = 0.0
        self.restart()

    def restart(self) -> None:
        """Keep the slip, forget the lateral error (the edge was lost)."""
        self._error: float | None = None
        self._sd = 0.0  # with which the edge was known lately [m]

    def update(self, error: float, drift: float, travel: float, weight: float = 1.0, sd: float = 0.0) -> None:
        """A period's `travel` [m] with lateral `error` [m] and the drift [rad] expected without slip.

        weight: 0..1, of the error as evidence; sd: standard deviation of the edge [m], 0 = not reported
        """
        if self._error is None or self._pole == 0.0 or self._sd**2 - sd**2 > BETTER**2:
            self._error, self._sd = error, sd
            return
        self._sd += min(1.0, travel / FORGET_M) * max(sd - self._sd, 0.0)
        self._error += (drift - self.slip) * travel
        missed = min(max(error - self._error, -self._clip), self._clip)
        self._error += missed * min(1.0, 2.0 * self._pole * weight * travel)
        self.slip -= missed * self._pole**2 * weight * travel
        self.slip = min(max(self.slip, -self._limit), self._limit)
        if abs(error - self._error) > 3.0 * self._clip:
            self._error = error
