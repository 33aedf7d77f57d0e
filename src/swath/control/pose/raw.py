"""Pose level `raw`: the receiver's newest position, brought forward by the odometry; heading by its course.

The heading goes on with the yaw rate and is drawn to the course over ground in `course_s`, at first as the
mean of all courses; so it is the direction of travel, with the crab on slopes in it. Where the receiver gives
no course, the way between its positions does. No filter joins the
sensors: what the receiver is off by, the pose is off by.
"""

from dataclasses import dataclass
from math import cos, isfinite, pi, sin
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.pose.dead_reckoning import INPUTS, OUTPUTS, DeadReckoning, Step, seen_from
from swath.control.pose.receiver import AntennaPlace, ChordHeading
from swath.core.component import Inputs, KeepsState, Outputs
from swath.core.frames import wrapped
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.signals import Fix, PoseEstimate
from swath.signals.setup import ControlSetup

NAN = float("nan")
UNKNOWN = np.full((4, 4), NAN)
LEAST_SD = 1e-3  # of any position, m


@dataclass(frozen=True)
class Params:
    """course_s: time over which the heading is drawn to the course over ground.

    course_from_m_s: speed from which on a course counts
    way_percent: what dead reckoning is off by, of the way since the last fix, 1 sigma; an estimate
    """

    course_s: Annotated[float, Gt(0), Le(60)] = 2.0
    course_from_m_s: Annotated[float, Gt(0), Le(5)] = 0.5
    way_percent: Annotated[float, Ge(0), Le(100)] = 5.0


class RawPose(KeepsState):
    """Position of the newest fix, heading of a complementary filter."""

    kept = ("_reckoning", "_heading", "_course_count", "_fix", "_fix_way", "_then", "_tilt", "_chord")

    inputs, outputs = INPUTS, OUTPUTS

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._antenna = AntennaPlace(setup)
        self._reckoning = DeadReckoning()
        self._tilt = self._antenna.inclination
        self._chord = ChordHeading(self._antenna)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing known."""
        self._reckoning.clear()
        self._tilt.clear()
        self._chord.clear()
        self._heading = NAN  # at the newest fix with a course, less the dead reckoning's
        self._course_count = 0
        self._fix: Fix | None = None
        self._then: Step | None = None  # of the dead reckoning at the time of the fix
        self._fix_way = 0.0
        return {"pose": PoseEstimate(0, NAN, NAN, NAN, 0.0, 0.0, UNKNOWN, NAN)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The pose at t + dt."""
        now = t + dt
        self._reckoning.take(inputs["odometry"])
        speed = self._reckoning.latest.speed if self._reckoning.is_known else 0.0
        self._tilt.take(inputs.get("inertial"), speed)
        fix: Fix | None = inputs["fix"]
        is_new = fix is not None and fix.has_place and (self._fix is None or fix.t > self._fix.t)
        if fix is not None and is_new and self._reckoning.is_known:
            self._take(fix)
        return {"pose": self._estimate(now)}

    def _take(self, fix: Fix) -> None:
        here = self._reckoning.at(fix.t)
        seconds = 0.0 if self._fix is None else (fix.t - self._fix.t) / NS
        self._fix, self._fix_way, self._then = fix, self._reckoning.distance, here
        if not isfinite(fix.course):
            if (found := self._chord.take(fix, here, 0.0)) is not None:
                self._draw(found[0], seconds)
            return
        self._chord.clear()
        if fix.speed < self._p.course_from_m_s:
            return
        lead = self._antenna.course_lead(here.speed, here.yaw_rate)
        backward = pi if here.speed < 0.0 else 0.0
        self._draw(wrapped(fix.course - lead - backward - here.heading), seconds)

    def _draw(self, turn: float, seconds: float) -> None:
        """Towards what a course says."""
        self._course_count += 1
        if not isfinite(self._heading):
            self._heading = turn
            return
        share = max(min(seconds / self._p.course_s, 1.0), 1.0 / self._course_count)
        self._heading += share * wrapped(turn - self._heading)

    def _estimate(self, now: int) -> PoseEstimate:
        if not self._reckoning.is_known:
            return PoseEstimate(now, NAN, NAN, NAN, 0.0, 0.0, UNKNOWN, NAN)
        gone = self._reckoning.at(now)
        fix, before = self._fix, self._then
        if fix is None or before is None or not isfinite(self._heading):
            return PoseEstimate(now, NAN, NAN, NAN, gone.speed, gone.yaw_rate, UNKNOWN, NAN)
        heading = gone.heading + self._heading
        then = before.heading + self._heading
        x, y = self._antenna.axle(fix.x, fix.y, then)
        ahead, left, _ = seen_from(before, gone)
        c, s = cos(then), sin(then)
        travel = self._reckoning.distance - self._fix_way
        sd = max(fix.horizontal_sd, LEAST_SD) + self._p.way_percent * PERCENT * travel
        turn = 0.01 + 0.1 * self._p.way_percent * PERCENT * travel
        pace = 0.02 + 0.03 * abs(gone.speed)
        return PoseEstimate(
            now,
            x + c * ahead - s * left,
            y + s * ahead + c * left,
            wrapped(heading),
            gone.speed,
            gone.yaw_rate,
            np.diag([sd**2, sd**2, turn**2, pace**2]),
            (now - fix.t) / NS,
        )


LEVEL = Level(
    RawPose,
    Params,
    summary="newest position brought forward by odometry, heading by course and yaw rate",
    cost="0.1 ms per step",
    tolerance="exact with sensors without error on a straight line",
)
