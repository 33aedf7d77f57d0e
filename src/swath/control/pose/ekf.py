"""Pose level `ekf`: receiver, wheels, gyroscope and, of two antennas, their heading in one filter.

A fix comes late. The filter stands at the newest fix; from there the stored steps of wheels and gyroscope
bring it to the present, and another fix is taken in at the time when it was measured. A position that is
further off than its covariance allows is left out; if that goes on for `gate_s`, the filter is wrong and
takes the receiver's word. Wheels that stand do not turn the machine: the gyroscope reads its bias then. Where
the receiver says that the machine moves, standing wheels are taken for faulty and left out.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, exp, fsum, hypot, isfinite, sin, tan
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.inclination import CRAB
from swath.control.pose.dead_reckoning import INPUTS, OUTPUTS, DeadReckoning
from swath.control.pose.kalman import (
    BIAS,
    EAST,
    HEADING,
    NORTH,
    SCALE,
    SIZE,
    SLIP,
    SPEED,
    Kalman,
    Motion,
    Noise,
    Wander,
    X,
    Y,
)  # fmt: skip
from swath.control.pose.receiver import AntennaPlace, ChordHeading
from swath.control.pose.standing import AT_ONCE, GroundVelocity, Standing
from swath.core.component import Inputs, KeepsState, Outputs
from swath.core.frames import wrapped
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG, PERCENT
from swath.signals import FIX_QUALITIES, Fix, Inertial, Odometry, PoseEstimate
from swath.signals.setup import ControlSetup

NAN = float("nan")
NEVER = -(10**18)  # ns
FAULTY_AFTER = NS // 2  # ns, that the receiver has to say that a machine moves whose wheels stand
OLDEST = NS  # a fix that was measured longer ago is left out [ns]
# Share of the reported variance that is white, and correlation time of the rest [s], by the quality of the
# fix: what the filter assumes of a receiver (docs/explanation/sensors.md).
ASSUMED: Mapping[str, tuple[float, float]] = {
    "single": (0.003, 3600.0),
    "dgps": (0.004, 10_800.0),
    "float": (0.01, 300.0),
    "fix": (0.38, 120.0),
}
# Standard deviations of a receiver that reports none [m], [m/s], [rad] (docs/explanation/sensors.md).
UNREPORTED_SD = {"single": 2.0, "dgps": 0.5, "float": 0.2, "fix": 0.012}
UNREPORTED_SPEED_SD = 0.05
UNREPORTED_HEADING_SD = 1.0 * DEG


@dataclass(frozen=True)
class Params:
    """What the filter assumes of its sensors, as 1 sigma; estimates where a data sheet says nothing.

    wheel_noise_m_s: noise of a sample of the wheels' speed
    wheel_scale_percent: slip and calibration error of the wheels at first
    slip_percent: how much faster the wheels are expected to turn than the ground passes
    gyro_noise_deg_s: noise of a sample of the gyroscope, beside what the sensor reports itself
    gyro_bias_deg_s: bias of the gyroscope at first
    crab: expected side slip per side slope, or per lateral acceleration in g [1]
    crab_deg: side slip beside the expected
    tilt_deg: inclination, by which an antenna above the ground stands aside (biases of the inertial unit); 0
        on a plane, the slope where there is no inertial unit
    tilt_s: time over which that inclination changes
    tilt_start_deg: inclination at first, while it settles and the machine sets off, reported beside what the
        filter knows; 0 on a plane
    tilt_start_s: time constant with which that inclination dies out
    gate: squared distance in standard deviations beyond which a position is left out, and the gyroscope of a
        standing machine [1]
    gate_s: longest time for which positions are left out
    course_from_m_s: speed from which on the course gives the first heading
    """

    wheel_noise_m_s: Annotated[float, Gt(0), Le(1)] = 0.03
    wheel_scale_percent: Annotated[float, Gt(0), Le(50)] = 4.0
    slip_percent: Annotated[float, Ge(0), Le(50)] = 3.0
    gyro_noise_deg_s: Annotated[float, Ge(0), Le(10)] = 0.1
    gyro_bias_deg_s: Annotated[float, Gt(0), Le(10)] = 0.15
    crab: Annotated[float, Ge(0), Le(1)] = CRAB
    crab_deg: Annotated[float, Gt(0), Le(10)] = 0.3
    tilt_deg: Annotated[float, Ge(0), Le(10)] = 0.3
    tilt_s: Annotated[float, Gt(0), Le(1000)] = 30.0
    tilt_start_deg: Annotated[float, Ge(0), Le(10)] = 2.0
    tilt_start_s: Annotated[float, Gt(0), Le(100)] = 4.0
    gate: Annotated[float, Gt(0), Le(1e6)] = 25.0
    gate_s: Annotated[float, Gt(0), Le(600)] = 10.0
    course_from_m_s: Annotated[float, Gt(0), Le(5)] = 0.5


def _complete(fix: Fix) -> Fix:
    """The fix with what the filter assumes where the receiver does not say how sure it is."""
    told: dict[str, Any] = {}
    if not isfinite(fix.horizontal_sd):
        told["horizontal_sd"] = UNREPORTED_SD[FIX_QUALITIES[fix.quality]]
    if not isfinite(fix.speed_sd):
        told["speed_sd"] = UNREPORTED_SPEED_SD
    if isfinite(fix.heading) and not isfinite(fix.heading_sd):
        told["heading_sd"] = UNREPORTED_HEADING_SD
    if not isfinite(fix.speed):
        told["course"] = NAN  # it says nothing without
    return replace(fix, **told) if told else fix


class EkfPose(KeepsState):
    """Extended Kalman filter."""

    kept = (
        "_filter",
        "_now",
        "_steps",
        "_fix_t",
        "_used_t",
        "_quality",
        "_tilt",
        "_is_known",
        "_wheels",
        "_standing",
        "_ground",
        "_moved_t",
        "_apart_t",
        "_are_faulty",
        "_reckoning",
        "_chord",
    )

    inputs, outputs = INPUTS, OUTPUTS

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._antenna = AntennaPlace(setup)
        self._tilt = self._antenna.inclination
        self._standing, self._ground, self._wheelbase = Standing(), GroundVelocity(), setup.machine.wheelbase
        self._leaning = self._antenna.height * params.tilt_deg * DEG
        mounting = setup.mountings.get("inertial")
        self._turn = np.eye(3).tolist() if mounting is None else mounting.rotation.tolist()
        self._noise = Noise(0.3, 0.003, 2e-5, params.crab_deg * DEG, 30.0)
        self._filter, self._now = Kalman(self._noise), Kalman(self._noise)
        self._reckoning, self._chord = DeadReckoning(), ChordHeading(self._antenna)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing known."""
        self._tilt.clear()
        self._steps: deque[Motion] = deque()
        self._fix_t, self._used_t, self._quality = -1, -1, 0
        self._is_known = False
        self._standing.clear()
        self._ground.clear()
        self._moved_t = NEVER  # the last fix that said that the machine moves
        self._apart_t = -1  # since then wheels stand and the receiver moves, -1: they do not
        self._are_faulty = False  # the wheels
        self._wheels = Odometry(0, 0.0, 0.0, 0.0)
        self._reckoning.clear()  # until a heading is known
        self._chord.clear()
        unknown = np.full((4, 4), NAN)
        return {"pose": PoseEstimate(0, NAN, NAN, NAN, 0.0, 0.0, unknown, NAN)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The pose at t + dt."""
        now = t + dt
        m = self._motion(now, dt, inputs["odometry"], inputs.get("inertial"))
        fix: Fix | None = inputs["fix"]
        self._steps.append(m)
        if self._is_known:
            self._go(self._now, m)
        else:
            self._reckoning.take(inputs["odometry"])
        if fix is not None and fix.has_place and fix.t > self._fix_t and now - fix.t <= OLDEST:
            self._fix_t = fix.t
            self._take(_complete(fix))
        while self._steps and self._steps[0].t <= now - OLDEST:
            old = self._steps.popleft()
            if self._is_known:
                self._go(self._filter, old)
        return {"pose": self._estimate(now, m)}

    def _motion(
        self, now: int, dt: int, wheels: Sequence[Odometry], samples: Sequence[Inertial] | None
    ) -> Motion:
        good = [w for w in wheels if isfinite(w.speed) and isfinite(w.yaw_rate)]
        last = self._wheels = good[-1] if good else self._wheels
        self._tilt.take(samples, last.speed)
        own = self._p.gyro_noise_deg_s * DEG
        rates = [v for s in samples or () if all(map(isfinite, v := (s.rate_x, s.rate_y, s.rate_z)))]
        turn, p, q = last.yaw_rate, 0.0, 0.0
        sd = hypot(own, 0.1 * DEG)
        if rates:
            x, y, z = (fsum(c) / len(rates) for c in zip(*rates, strict=True))
            p, q, r = (a * x + b * y + c * z for a, b, c in self._turn)
            up = self._tilt.up
            turn = p * float(up[0]) + q * float(up[1]) + r * float(up[2])
            said = (samples or ())[-1].rate_sd
            sd = hypot(own, (said if isfinite(said) else 0.0) / len(rates) ** 0.5)
        crab = self._tilt.crab(self._p.crab, last.speed * turn)
        rest = NAN
        if self._standing.take(last.speed, dt / NS):
            angle = last.steer_angle if isfinite(last.steer_angle) else 0.0
            rest = (self._standing.mean or 0.0) * tan(angle) / self._wheelbase
        return Motion(now, dt / NS, turn, sd, crab, last.speed, (p, q, turn), self._antenna.offset(), rest)

    def _go(self, filter_: Kalman, m: Motion) -> None:
        filter_.go(m)
        if self._are_faulty:
            return
        filter_.take_wheels(m.speed, self._p.wheel_noise_m_s, self._p.gate)
        if isfinite(m.rest) and m.t - self._moved_t > OLDEST:
            filter_.take_rest(m, self._p.gate)

    def _take(self, fix: Fix) -> None:
        """The filter goes to the time of the fix, takes it, and on to the present."""
        if not self._is_known:
            self._begin(fix)
            return
        m = self._steps[-1]
        while self._steps and self._steps[0].t <= fix.t:
            m = self._steps.popleft()
            self._go(self._filter, m)
        if self._steps:
            m = self._steps[0]
            share = m.seconds - (m.t - fix.t) / NS
            if share > 0.0:
                self._filter.go(m._replace(seconds=share))
                self._steps[0] = m._replace(seconds=m.seconds - share)
        self._correct(fix, m)
        self._now = self._filter.copy()
        for m in self._steps:
            self._go(self._now, m)

    def _begin(self, fix: Fix) -> None:
        """The first position with a direction."""
        m = self._steps[-1]
        heading, sd = fix.heading, fix.heading_sd
        if not isfinite(heading) and not isfinite(fix.course):
            if not self._reckoning.is_known:
                return
            here = self._reckoning.at(fix.t)
            if (found := self._chord.take(fix, here, fix.horizontal_sd)) is None:
                return
            heading = here.heading + found[0] + m.crab
            sd = hypot(found[1], self._p.crab_deg * DEG)
        elif not isfinite(heading):
            if fix.speed < self._p.course_from_m_s:
                return
            heading = fix.course - self._antenna.course_lead(fix.speed, m.yaw_rate) + m.crab
            sd = hypot(fix.speed_sd / fix.speed, self._p.crab_deg * DEG)
        self._is_known = True
        f = self._filter = Kalman(self._noise)
        x, y = self._antenna.axle(fix.x, fix.y, heading)
        f.state[:] = (x, y, heading, m.speed, 0.0, self._p.slip_percent * PERCENT, 0.0, 0.0, 0.0)
        scale = self._p.wheel_scale_percent * PERCENT
        own = {
            X: fix.horizontal_sd, Y: fix.horizontal_sd, HEADING: max(sd, 1e-3), SPEED: 0.3,
            BIAS: self._p.gyro_bias_deg_s * DEG, SCALE: scale, SLIP: self._p.crab_deg * DEG,
        }  # fmt: skip
        f.covariance = np.diag([max(own.get(i, 0.0), 1e-4) ** 2 for i in range(SIZE)])
        self._hear(fix)
        white = ASSUMED[FIX_QUALITIES[fix.quality]][0] ** 0.5 * fix.horizontal_sd
        for i, error in ((X, EAST), (Y, NORTH)):  # what the receiver is off by, the first position is
            f.covariance[i, i] = f.wander.sd**2 + max(white, 1e-3) ** 2
            f.covariance[i, error] = f.covariance[error, i] = -(f.wander.sd**2)
        self._used_t = fix.t
        while self._steps and self._steps[0].t <= fix.t:
            self._steps.popleft()
        self._now = f.copy()
        for step in self._steps:
            self._go(self._now, step)

    def _hear(self, fix: Fix) -> None:
        """The quality of the fix says how its error wanders."""
        share, time = ASSUMED[FIX_QUALITIES[fix.quality]]
        own, leaning = (1.0 - share) * fix.horizontal_sd**2, self._leaning**2
        both = max(own + leaning, 1e-12)
        wander = Wander(both**0.5, (own * time + leaning * self._p.tilt_s + 1e-12 * time) / (both + 1e-12))
        if fix.quality != self._quality:
            self._quality = fix.quality
            self._filter.roam(wander)
        self._filter.wander = wander

    def _correct(self, fix: Fix, m: Motion) -> None:
        f, p = self._filter, self._p
        self._hear(fix)
        shaken = 0.2 * self._leaning  # the part of the inclination that is no bias
        variance = ASSUMED[FIX_QUALITIES[fix.quality]][0] * fix.horizontal_sd**2 + shaken**2 + 1e-8
        x, y, *rows = f.expected_place(m.offset)
        east, north = rows
        is_far = f.distance(fix.x - x, fix.y - y, (east, north), variance) > p.gate
        are_found_faulty = self._compare(fix, m, f)
        if is_far:
            self._moved_t = fix.t
        if is_far and not are_found_faulty and (fix.t - self._used_t) / NS < p.gate_s:
            return
        if is_far:
            f.covariance[X, X] += (fix.x - x) ** 2 + fix.horizontal_sd**2
            f.covariance[Y, Y] += (fix.y - y) ** 2 + fix.horizontal_sd**2
        self._used_t = fix.t
        f.take(fix.x - x, east, variance)
        x, y, _, north = f.expected_place(m.offset)
        f.take(fix.y - y, north, variance)
        if isfinite(fix.heading):
            f.take(wrapped(fix.heading - float(f.state[HEADING])), {HEADING: 1.0}, fix.heading_sd**2 + 1e-8)
        if isfinite(fix.course):
            self._take_velocity(fix, m, f)

    def _compare(self, fix: Fix, m: Motion, f: Kalman) -> bool:
        """Wheels against receiver. Whether the wheels are found to be faulty, now."""
        if not isfinite(fix.course):
            return False
        before, gate = self._are_faulty, self._p.gate
        along, across, variance = self._lever(fix, m, f)
        if self._ground.take(fix) ** 2 > gate * (variance - (1.0 - self._ground.share) * fix.speed_sd**2):
            self._moved_t = fix.t
        apart = fix.speed - hypot(m.speed + along, across)
        stands_at_once = abs(m.speed) < AT_ONCE and apart**2 > gate * (variance + self._p.wheel_noise_m_s**2)
        if not (stands_at_once or (isfinite(m.rest) and self._moved_t == fix.t)):
            self._apart_t = -1
        elif self._apart_t < 0:
            self._apart_t = fix.t
        self._are_faulty = self._apart_t >= 0 and fix.t - self._apart_t >= FAULTY_AFTER
        if before or not self._are_faulty:
            return False
        f.covariance[SPEED, SPEED] += apart**2
        f.covariance[BIAS, BIAS] += (self._p.gyro_bias_deg_s * DEG) ** 2  # it was learned at no stand
        return True

    def _lever(self, fix: Fix, m: Motion, f: Kalman) -> tuple[float, float, float]:
        """What turning, rolling and pitching add to the antenna's velocity: along, across [m/s]; variance."""
        (ahead, left), (roll, pitch, _) = m.offset, m.rates
        turn, height = m.yaw_rate - float(f.state[BIAS]), self._antenna.height
        variance = fix.speed_sd**2 + (0.1 * DEG * height) ** 2 + 1e-8
        return pitch * height - turn * left, turn * ahead - roll * height, variance

    def _take_velocity(self, fix: Fix, m: Motion, f: Kalman) -> None:
        """Velocity of the antenna: that of the axle and what turning, rolling and pitching add."""
        along, across, variance = self._lever(fix, m, f)
        for axis, measured in ((0, fix.speed * cos(fix.course)), (1, fix.speed * sin(fix.course))):
            heading, travel, v = float(f.state[HEADING]), f.travel(m.crab), float(f.state[SPEED])
            c, s, ct, st = cos(heading), sin(heading), cos(travel), sin(travel)
            own_x, own_y, pace = c * along - s * across, s * along + c * across, f.pace
            dx, dy = pace * ct, pace * st
            if axis == 0:
                row = {HEADING: -dy - own_y, SLIP: -dy, SPEED: ct}
                f.take(measured - v * ct - own_x, row, variance)
            else:
                row = {HEADING: dx + own_x, SLIP: dx, SPEED: st}
                f.take(measured - v * st - own_y, row, variance)

    def _estimate(self, now: int, m: Motion) -> PoseEstimate:
        if not self._is_known:
            unknown = np.full((4, 4), NAN)
            return PoseEstimate(now, NAN, NAN, NAN, m.speed, m.yaw_rate, unknown, NAN)
        s, heading = self._now.state, float(self._now.state[HEADING])
        covariance = self._now.covariance[:4, :4].copy()
        settling = self._p.tilt_start_deg * DEG * exp(-now / NS / self._p.tilt_start_s)
        for i in (X, Y):
            covariance[i, i] += (self._antenna.height * settling) ** 2
        return PoseEstimate(
            now,
            float(s[X]),
            float(s[Y]),
            wrapped(heading),
            float(s[SPEED]),
            m.yaw_rate - float(s[BIAS]),
            covariance,
            (now - self._used_t) / NS,
        )


LEVEL = Level(
    EkfPose,
    Params,
    summary="extended Kalman filter over receiver, wheels, gyroscope and heading of two antennas",
    cost="0.5 ms per step",
    tolerance="within 2 mm with sensors without error on a straight line",
)
