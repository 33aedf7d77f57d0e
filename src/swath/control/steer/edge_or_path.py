"""Steering level `edge_or_path`: along the crop edge, and by the machine's own pose where it is not seen.

The third way when the edge is lost, beside holding the bend driven last (`preview`) and stopping (the speed
law). What leads then is the path of the scenario, or, without one, the straight line that the machine drove
last along the edge, by its own pose: the least squares line through the fixed axle's places. When the edge is
seen again it leads again. Both laws go along all the time and know what was really commanded.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from math import atan2, cos, fsum, hypot, isfinite, sin
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le

from swath.control.steer.guidance_line import GuidanceLine
from swath.control.steer.path import BesidePath, PathSteer
from swath.control.steer.path import Params as PathParams
from swath.control.steer.preview import Params as EdgeParams
from swath.control.steer.preview import Preview
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import (
    CropEdge,
    GuidanceState,
    Inertial,
    Odometry,
    PoseEstimate,
    SteerCommand,
)
from swath.signals.setup import ControlSetup

APART = 0.5  # between the places that are kept [m]
ANGLE, BEND = 0.06, 0.02  # rad, 1/m: of the edge against the path of the scenario
AHEAD = 2000.0  # how far the line driven last goes on [m]
NAN = float("nan")


@dataclass(frozen=True)
class Params:
    """The edge leads, or a path where no edge is seen.

    edge: keys of level `preview`
    path: keys of level `path`; where it names no path the line driven last leads
    lost_s: time without an edge until the path leads
    found_s: time with an edge until it leads again
    learn_m: distance over which the line driven last is taken; at least half of it has to be driven
    stray_m: how far beside the scenario's path the edge may lead, and only where it lies so near and along
        it; none = wherever it is seen
    """

    edge: EdgeParams = field(default_factory=EdgeParams)
    path: PathParams = field(default_factory=PathParams)
    lost_s: Annotated[float, Ge(0), Le(10)] = 0.2
    found_s: Annotated[float, Ge(0), Le(60)] = 0.6
    learn_m: Annotated[float, Gt(2), Le(500)] = 30.0
    stray_m: Annotated[float, Gt(0), Le(20)] | None = None


class EdgeOrPath(KeepsState):
    """Preview along the edge, and along a path while there is none."""

    kept = ("_edge", "_path", "_is_led", "_lost", "_found", "_places", "_is_near")

    inputs = (
        Port("edge", CropEdge),
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("command", SteerCommand), Port("guidance", GuidanceState))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._edge, self._path = Preview(params.edge, setup), PathSteer(params.path, setup)
        self._has_line = self._path.has_line
        if params.stray_m is not None and not self._has_line:
            raise InputError("stray_m", params.stray_m, "expected a path, too: it is a bound beside that")
        self.overlap = self._edge.overlap
        self._forget()

    def _forget(self) -> None:
        self._is_led, self._lost, self._found = False, 0.0, 0.0
        self._is_near = True
        self._places: deque[tuple[float, float]] = deque(maxlen=max(int(self._p.learn_m / APART), 4))

    def reset(self, stream: Stream) -> Outputs:
        """Straight ahead, not engaged, until an edge is seen."""
        self._forget()
        self._path.reset(stream)
        guidance = GuidanceState(0, False, NAN, NAN, NAN, NAN)
        return {**self._edge.reset(stream), "guidance": guidance}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The wanted curvature, valid at t + dt."""
        edge: CropEdge | None = inputs["edge"]
        pose: PoseEstimate | None = inputs.get("pose")
        stray = self._p.stray_m
        is_seen = edge is not None and edge.is_found
        if edge is not None and is_seen and stray is not None and self._has_line:
            path = self._path_beside(edge, pose) if self._is_near else None
            is_seen = self._is_near and (path is None or abs(path.left) <= stray)
            if path is not None and is_seen:
                inputs = {**inputs, "edge": along_path(edge, path)}
        self._lost = 0.0 if is_seen else self._lost + dt / NS
        self._found = self._found + dt / NS if is_seen else 0.0
        if not self._is_led and self._lost >= self._p.lost_s:
            self._is_led = self._lead()
        elif self._is_led and self._found >= self._p.found_s:
            self._is_led = False
        if is_seen and not self._is_led and pose is not None:
            self._remember(pose)
        by_edge: dict[str, Any] = self._edge.step(t, dt, inputs)
        by_path: dict[str, Any] = self._path.step(t, dt, inputs)
        guidance: GuidanceState = by_path["guidance"]
        if stray is not None and self._has_line:
            self._is_near = abs(guidance.lateral) <= (stray if self._is_near else 0.5 * stray)
        if self._is_led and guidance.is_following:
            command = by_path["command"]
        else:
            command = by_edge["command"]
            guidance = replace(guidance, is_following=False)
        self._edge.was_commanded(command.curvature)
        self._path.was_commanded(command.curvature)
        return {"command": command, "guidance": guidance}

    def _path_beside(self, edge: CropEdge, pose: PoseEstimate | None) -> BesidePath | None:
        """The path where the edge leads the machine to; None where it is not known."""
        if pose is None or not isfinite(pose.x):
            return None
        return self._path.beside(pose, edge.reference_x, self._edge.beside(edge))

    def _remember(self, pose: PoseEstimate) -> None:
        """A place of the way along the edge."""
        if not isfinite(pose.x) or pose.position_sd > self._p.path.accuracy_m:
            return
        last = self._places[-1] if self._places else None
        if last is None or hypot(pose.x - last[0], pose.y - last[1]) >= APART:
            self._places.append((pose.x, pose.y))

    def _lead(self) -> bool:
        """Whether there is something to follow now."""
        if self._has_line:
            return True
        places = list(self._places)
        if len(places) * APART < 0.5 * self._p.learn_m:
            return False
        self._path.lead_along(line_through(places))
        return True


def along_path(edge: CropEdge, path: BesidePath) -> CropEdge:
    """The edge with no other direction and curvature than the path has there, but for ANGLE and
    BEND: a jag of the crop shows others, and the next pass would have a larger one.
    """
    angle = min(max(edge.heading, path.course - ANGLE), path.course + ANGLE)
    bend = min(max(edge.curvature, path.curvature - BEND), path.curvature + BEND)
    return replace(edge, heading=angle, curvature=bend)


def line_through(places: list[tuple[float, float]]) -> GuidanceLine:
    """The straight line of least squared distances from places [m], the way that they were driven."""
    n = len(places)
    mx, my = fsum(x for x, _ in places) / n, fsum(y for _, y in places) / n
    xx = fsum((x - mx) ** 2 for x, _ in places)
    yy = fsum((y - my) ** 2 for _, y in places)
    xy = fsum((x - mx) * (y - my) for x, y in places)
    angle = 0.5 * atan2(2.0 * xy, xx - yy)
    c, s = cos(angle), sin(angle)
    if c * (places[-1][0] - places[0][0]) + s * (places[-1][1] - places[0][1]) < 0.0:
        c, s = -c, -s
    back = hypot(places[0][0] - mx, places[0][1] - my)
    return GuidanceLine([(mx - c * back, my - s * back), (mx + c * AHEAD, my + s * AHEAD)])


LEVEL = Level(
    EdgeOrPath,
    Params,
    summary="along the crop edge; while it is lost along a path, or on as driven last, by the measured pose",
    cost="about 90 us per step",
    tolerance="2 cm RMS at 7 km/h on a straight edge known to 3 cm",
)
