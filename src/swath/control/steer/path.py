"""Steering level `path`: along a path in the field's frame, by the machine's own measured pose.

With e the distance of the fixed axle to the left of the path, theta its direction of travel against it and k
the path's curvature, the machine goes by e' = sin(theta), theta' = kappa - k cos(theta) / (1 - k e) over the
distance driven. The law

    kappa = k cos(theta) / (1 - k e) - e / d^2 - 2 z sin(theta) / d

leaves e'' + 2 z e' / d + e / d^2 = 0 for small theta (after Samson 1995, doi:10.1109/9.362899). kappa is that
of the fixed axle: behind it a combine steers, ahead of it a tractor. It holds at the place where the machine
will stand when the command has taken hold (dead time and lag), and k is the mean over the way on which the
steering turns to the sharpest change of the path at its limited rate: half of that before the change, half
behind. Side slip and understeer are learnt as in `preview`.
"""

from dataclasses import dataclass, field
from math import cos, isfinite, sin, tan
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le

from swath.control.steer.guidance_line import Bend, GuidanceLine, along_bends, rounded
from swath.control.steer.plant_model import (
    CRAWL,
    SLIP_LIMIT,
    ActuatorModel,
    Learns,
    Share,
    SlipObserver,
    driven_curvature,
)
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.frames import wrapped
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import CM, DEG
from swath.signals import GuidanceState, Odometry, PoseEstimate, SteerCommand
from swath.signals.setup import ControlSetup

DAMPING = 0.9
NARROW = 0.5  # m, over which at least the path's curvature is taken, before and behind
LOST = 8.0  # m along the path within which the machine is looked for again
NAN = float("nan")
Coordinate = Annotated[float, Ge(-1e6), Le(1e6)]
Curvature = Annotated[float, Ge(-0.5), Le(0.5)]


@dataclass(frozen=True)
class Segment:
    """A piece of a path.

    length_m: length of the segment
    curvature_per_m: curvature, > 0 bends left
    to_per_m: curvature at its end, where it is a clothoid
    """

    length_m: Annotated[float, Gt(0), Le(100_000)]
    curvature_per_m: Curvature = 0.0
    to_per_m: Curvature | None = None

    @property
    def bend(self) -> Bend:
        """The same with both curvatures."""
        to = self.curvature_per_m if self.to_per_m is None else self.to_per_m
        return Bend(self.length_m, self.curvature_per_m, to)


@dataclass(frozen=True)
class Begin:
    """Where segments begin.

    x_m: east
    y_m: north
    heading_deg: heading from east, > 0 to the left
    """

    x_m: Coordinate = 0.0
    y_m: Coordinate = 0.0
    heading_deg: Annotated[float, Ge(-360), Le(360)] = 90.0


@dataclass(frozen=True)
class Params(Learns):
    """A path, given by one of points_m, segments and file.

    points_m: [x, y] in the field's frame; corners are rounded
    segments: lines, arcs and clothoids, from the place `begin` on
    file: GeoJSON file of lines, such as tracks.geojson of a field folder
    line: which line of the file, from 0
    begin: where segments begin
    corner_radius_m: radius of the rounded corners of points_m and file, 0 = as they are
    backwards: whether the path is driven from its end to its begin
    distance_m: least distance d over which an error dies out, the greater of distance_m and time_s times
        speed
    time_s: that distance over speed
    approach_deg: steepest angle at which a far path is approached
    share_of_lock: share of the full steering angle that is used [1]
    accuracy_m: standard deviation of the position beyond which the law lets go
    hold_s: time for which it keeps its last command without a position that good
    run_out_m: how far behind the path's end it goes straight on before it lets go
    engage_s: time to blend in
    """

    points_m: tuple[tuple[Coordinate, Coordinate], ...] = ()
    corner_radius_m: Annotated[float, Ge(0), Le(1000)] = 0.0
    segments: tuple[Segment, ...] = ()
    begin: Begin = field(default_factory=Begin)
    file: str | None = None
    line: Annotated[int, Ge(0), Le(1_000_000)] = 0
    backwards: bool = False
    distance_m: Annotated[float, Gt(0.5), Le(100)] = 3.0
    time_s: Annotated[float, Gt(0), Le(20)] = 1.2
    approach_deg: Annotated[float, Gt(0), Le(60)] = 20.0
    share_of_lock: Share = 0.95
    accuracy_m: Annotated[float, Gt(0), Le(100)] = 1.0
    hold_s: Annotated[float, Ge(0), Le(10)] = 1.0
    run_out_m: Annotated[float, Ge(0), Le(100)] = 2.0
    engage_s: Annotated[float, Ge(0), Le(10)] = 0.5

    def __post_init__(self) -> None:
        ways = {"points_m": self.points_m, "segments": self.segments, "file": self.file}
        given = [key for key, there in ways.items() if there]
        if len(given) > 1:
            raise InputError(given[1], None, f"expected one path, there is {given[0]} already")
        if len(self.points_m) == 1:
            raise InputError("points_m", self.points_m, "expected at least two points")


class BesidePath(NamedTuple):
    """Where a path lies beside a place.

    left: how far to the left of it the place is [m]
    course: its direction against the machine's [rad]; curvature [1/m]
    """

    left: float
    course: float
    curvature: float


class PathSteer(KeepsState):
    """The fixed axle is led along the path."""

    kept = ("_command", "_engaged", "_lost", "_way", "_actuator", "_observer", "_line")

    inputs = (
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
    )
    outputs = (Port("command", SteerCommand), Port("guidance", GuidanceState))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        machine = setup.machine
        self._p = params
        self._wheelbase = machine.wheelbase
        self._limit = tan(params.share_of_lock * machine.max_steer) / machine.wheelbase
        self._rate = params.rate_deg_s * DEG / machine.wheelbase
        self._actuator = ActuatorModel(params.dead_time_s, params.lag_s, setup.period, params.trim_m)
        self._observer = SlipObserver(params.slip_m, params.slip_step_cm * CM, SLIP_LIMIT)
        self._own = _own_line(params, setup)
        self._forget()

    def reset(self, stream: Stream) -> Outputs:
        """Straight ahead, not engaged, until the pose is known."""
        self._actuator.reset()
        self._observer.reset()
        self._forget()
        return {"command": SteerCommand(0, 0.0, False), "guidance": self._state(0, False)}

    def _forget(self) -> None:
        self._line = self._own
        self._way: float | None = None  # along the path, once it is known
        self._command, self._engaged, self._lost = 0.0, 0.0, float("inf")

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The wanted curvature from the newest pose, valid at t + dt."""
        pose: PoseEstimate | None = inputs.get("pose")
        odometry: Odometry = inputs["odometry"]
        seconds = dt / NS
        speed = max(odometry.speed, 0.0) if isfinite(odometry.speed) else 0.0
        driven = driven_curvature(odometry, self._wheelbase, self._limit)
        self._actuator.push(self._command, driven, speed * seconds)
        state, wanted = self._state(t + dt, False), 0.0
        if pose is not None and self._line is not None and isfinite(pose.x) and isfinite(pose.heading):
            state, wanted = self._follow(self._line, pose, speed, t + dt, seconds)
        if state.is_following:
            self._engaged, self._lost = self._engaged + seconds, 0.0
            blend = 1.0 if self._p.engage_s <= 0.0 else min(1.0, self._engaged / self._p.engage_s)
            wanted = self._command + blend * (wanted - self._command)
        else:
            self._engaged, self._lost = 0.0, self._lost + seconds
            self._observer.restart()
            wanted = self._command if self._lost <= self._p.hold_s else 0.0
        step = self._rate * seconds
        wanted = min(max(wanted, -self._limit), self._limit)
        self._command += min(max(wanted - self._command, -step), step)
        is_engaged = self._lost <= self._p.hold_s
        return {"command": SteerCommand(t + dt, self._command, is_engaged), "guidance": state}

    @property
    def has_line(self) -> bool:
        """Whether there is a path to follow."""
        return self._line is not None

    def beside(self, pose: PoseEstimate, ahead: float, left: float) -> BesidePath | None:
        """The path beside a place ahead and left of the machine [m]; None without one."""
        if self._line is None or self._way is None:
            return None
        c, s = cos(pose.heading), sin(pose.heading)
        x, y = pose.x + c * ahead - s * left, pose.y + s * ahead + c * left
        nearest = self._line.project(x, y, self._way + ahead, LOST)
        course = wrapped(self._line.heading(nearest.distance) - pose.heading)
        return BesidePath(nearest.left, course, self._line.curvature(nearest.distance, 1.0))

    def lead_along(self, line: GuidanceLine) -> None:
        """Another path of the own machine, instead of that of the scenario."""
        self._line, self._way = line, None
        self._observer.restart()

    def was_commanded(self, curvature: float) -> None:
        """What really went out last [1/m], where another law may have had its way."""
        self._command = curvature

    def _follow(
        self, line: GuidanceLine, pose: PoseEstimate, speed: float, now: int, seconds: float
    ) -> tuple[GuidanceState, float]:
        """How the machine lies to the path now, and the curvature [1/m] to drive from there on."""
        p, slip = self._p, self._observer.slip
        late = max((now - pose.t) / NS, 0.0) * speed
        x, y = pose.x + late * cos(pose.heading + slip), pose.y + late * sin(pose.heading + slip)
        heading = pose.heading + late * self._actuator.curvature
        here = line.project(x, y, self._way, LOST + late)
        self._way = here.distance
        turned = wrapped(heading - line.heading(here.distance))
        left = line.length - here.distance
        is_sure = pose.position_sd <= p.accuracy_m
        follows = is_sure and speed > 0.0 and left >= -p.run_out_m
        state = GuidanceState(now, follows, here.left, turned, here.distance, left)
        if speed > CRAWL and is_sure:
            self._observer.update(-here.left, -sin(turned), speed * seconds)
        then = self._actuator.ahead(speed, slip)
        c, s = cos(heading), sin(heading)
        ahead = x + c * then.x - s * then.y, y + s * then.x + c * then.y
        there = line.project(*ahead, here.distance, LOST + then.x)
        travel = wrapped(heading + then.heading - line.heading(there.distance)) + self._observer.slip
        return state, self._aim(line, there.distance, there.left, travel, speed) + self._actuator.deficit

    def _aim(self, line: GuidanceLine, way: float, left: float, travel: float, speed: float) -> float:
        """The law itself. left: of the path [m]; travel: direction of travel against it [rad]."""
        d = max(self._p.distance_m, self._p.time_s * speed)
        most = 2.0 * DAMPING * d * sin(self._p.approach_deg * DEG)
        swing = 0.5 * speed * line.sharpest_bend / self._rate
        curvature = line.curvature(way, max(NARROW, swing))
        bent = curvature * cos(travel) / max(1.0 - curvature * left, 0.3)
        back = min(max(left, -most), most) / d**2
        return bent - back - 2.0 * DAMPING * sin(travel) / d

    def _state(self, t: int, is_following: bool) -> GuidanceState:
        return GuidanceState(t, is_following, NAN, NAN, NAN, NAN)


def _own_line(params: Params, setup: ControlSetup) -> GuidanceLine | None:
    """The path of the scenario; None where it has none."""
    begin = params.begin
    if params.points_m:
        points = rounded(params.points_m, params.corner_radius_m)
    elif params.segments:
        bends = [segment.bend for segment in params.segments]
        points = along_bends(begin.x_m, begin.y_m, begin.heading_deg * DEG, bends)
    elif params.file is not None:
        if setup.line_of is None:
            raise InputError("file", params.file, "expected a machine on a field that lies on Earth")
        points = rounded(setup.line_of(params.file, params.line).tolist(), params.corner_radius_m)
    else:
        return None
    return GuidanceLine(points[::-1] if params.backwards else points)


LEVEL = Level(
    PathSteer,
    Params,
    summary="along a path in the field's frame by the measured pose, with the path's curvature fed forward",
    cost="about 60 us per step",
    tolerance="3 cm RMS at 7 km/h on a straight path with RTK",
)
