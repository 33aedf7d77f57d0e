"""Motion of a machine as ROS 2 messages: the truth with its frames, odometry, steering and wanted speed.

`gone` says how far off a dead reckoning is: covariance of x, y and heading as speed and yaw rate with errors
add up. Errors that stay during a run are followed by their sensitivities, those that are new with every
sample as a covariance: first-order propagation through x += v dt cos, y += v dt sin, heading += w dt (Thrun,
Burgard, Fox 2005, Probabilistic Robotics, 5.4), in plain numbers.
"""

from collections.abc import Iterator
from math import cos, hypot, sin
from typing import Any

import numpy as np

from swath.core.frames import Pose, wrap_angle
from swath.core.schedule import NS
from swath.field.projection import Origin
from swath.record.messages import EXACT, UNKNOWN, Sent, Source
from swath.record.positioning_messages import nav_sat_fix
from swath.record.scene_messages import scene_messages
from swath.record.templates import Draft
from swath.signals import Fix, MachineState, Odometry, SpeedCommand, SteerState

LEAST = 1e-12  # variance at the start: a covariance of zeros would say that it is unknown
Doubt = tuple[float, ...]
"""x, y [m] by what stays of the speed; x, y, heading by what stays of the yaw rate; covariance of the noise:
xx, xy, yy, xh, yh, hh.
"""
EXACT_START: Doubt = (0.0, 0.0, 0.0, 0.0, 0.0, LEAST, 0.0, LEAST, 0.0, 0.0, LEAST)
Spread = tuple[float, float]  # standard deviation of each sample, and of what stays


def gone(doubt: Doubt, heading: float, speed: float, dt: float, speed_sd: Spread, rate_sd: Spread) -> Doubt:
    """The doubt after dt [s] at the middle heading [rad]. speed_sd [m/s]; rate_sd [rad/s]"""
    u, v, p, q, r, xx, xy, yy, xh, yh, hh = doubt
    c, s = cos(heading), sin(heading)
    a, b = -s * speed * dt, c * speed * dt  # of x, y per heading
    turn = rate_sd[1] * dt
    along, turned = (speed_sd[0] * dt) ** 2, (rate_sd[0] * dt) ** 2
    middle = hh + 0.25 * turned
    return (
        u + c * speed_sd[1] * dt,
        v + s * speed_sd[1] * dt,
        p + a * (r + 0.5 * turn),
        q + b * (r + 0.5 * turn),
        r + turn,
        xx + 2.0 * a * xh + a * a * middle + c * c * along,
        xy + a * yh + b * xh + a * b * middle + c * s * along,
        yy + 2.0 * b * yh + b * b * middle + s * s * along,
        xh + a * (hh + 0.5 * turned),
        yh + b * (hh + 0.5 * turned),
        hh + turned,
    )


def covariance(doubt: Doubt) -> tuple[float, ...]:
    """Of (x, y, heading), row by row, (9,)."""
    u, v, p, q, r, xx, xy, yy, xh, yh, hh = doubt
    xx, xy, yy = xx + u * u + p * p, xy + u * v + p * q, yy + v * v + q * q
    xh, yh, hh = xh + p * r, yh + q * r, hh + r * r
    return xx, xy, xh, xy, yy, yh, xh, yh, hh


FIX_PERIOD = 100_000_000  # between two NavSatFix [ns]
GBAS_FIX = 2  # sensor_msgs/NavSatStatus
PLACE = ("x", "y", "z")
ODOMETRY = (
    *(f"pose.pose.position.{axis}" for axis in PLACE),
    *(f"pose.pose.orientation.{axis}" for axis in (*PLACE, "w")),
    *("twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z"),
)
MEASURED = (
    *ODOMETRY[:7],
    *(f"pose.covariance.{6 * row + column}" for row in (0, 1, 5) for column in (0, 1, 5)),
    *(*ODOMETRY[7:], "twist.covariance.0", "twist.covariance.35"),
)
NOTHING_KNOWN = (UNKNOWN, 0.0, 0.0, 0.0, UNKNOWN, 0.0, 0.0, 0.0, UNKNOWN, UNKNOWN, UNKNOWN)  # as in MEASURED
TRANSFORM = (
    *(f"transforms.0.transform.translation.{axis}" for axis in PLACE),
    *(f"transforms.0.transform.rotation.{axis}" for axis in (*PLACE, "w")),
)
STEERING = ("drive.steering_angle", "drive.steering_angle_velocity")
SPEED = ("twist.linear.x",)


class StateMessages:
    """nav_msgs/Odometry and /tf of the truth, before the first what a viewer needs (`scene_messages.py`).

    NavSatFix too, of a field on Earth, where no slot of the machine publishes a Fix.
    """

    def __init__(self, source: Source) -> None:
        self.source, self._next_fix, self._is_first = source, 0, True
        has_receiver = Fix in source.machine.outputs.values()
        self._origin = None if has_receiver else source.machine.origin

    def __call__(self, state: MachineState) -> Iterator[Sent]:
        """The messages of one sample."""
        source = self.source
        if self._is_first:
            self._is_first = False
            yield from scene_messages(source)
        place = (*state.pose.position.tolist(), *state.pose.quaternion())
        motion = (state.speed, state.lateral_speed, state.yaw_rate)
        yield Sent(source.topic, Draft(state.t, ODOMETRY, place + motion, lambda: self._odometry(state)))
        yield Sent("/tf", Draft(state.t, TRANSFORM, place, lambda: self._moved(state), source.base))
        if self._origin is not None and state.t >= self._next_fix:
            self._next_fix = state.t + FIX_PERIOD
            yield Sent(f"{source.slot_topic}/fix", self._fix(state, self._origin))

    def _odometry(self, state: MachineState) -> Any:
        """nav_msgs/Odometry."""
        make = self.source.make
        twist = make.twist(state.speed, state.lateral_speed, state.yaw_rate)
        exact = np.diag([EXACT] * 6).ravel()
        return make.odometry(make.header(state.t, "map"), self.source.base, state.pose, twist, exact, exact)

    def _moved(self, state: MachineState) -> Any:
        """tf2_msgs/TFMessage."""
        make = self.source.make
        moved = [make.transform(state.t, self.source.odom, self.source.base, state.pose)]
        return make("tf2_msgs/msg/TFMessage", transforms=moved)

    def _fix(self, state: MachineState, origin: Origin) -> Any:
        """sensor_msgs/NavSatFix of the true place; height from the field's zero."""
        x, y, z = state.pose.position
        longitude, latitude = origin.to_lon_lat([[x, y]])[0]
        make, place = self.source.make, (latitude, longitude, origin.height + z)
        return nav_sat_fix(make, make.header(state.t, self.source.base), GBAS_FIX, place, [EXACT] * 3)


class OdometryMessages:
    """Twist as measured; the pose is its dead reckoning from the start (midpoint rule), for viewing.

    Covariances are those of `record/motion_messages.py`, of a slot that knows how far off it may be.
    """

    def __init__(self, source: Source) -> None:
        self.source, self._t = source, 0
        self._pose: Pose | None = None
        self._doubt = EXACT_START

    def __call__(self, sample: Odometry) -> Iterator[Sent]:
        """The message of one sample."""
        known = self.source.machine.errors.get(self.source.slot)
        errors = None if known is None else known(sample)
        if self._pose is None:
            self._pose = self.source.machine.start
        else:
            dt = (sample.t - self._t) / NS
            turn, advance = sample.yaw_rate * dt, sample.speed * dt
            yaw = self._pose.euler()[2]
            middle = yaw + 0.5 * turn
            ahead = np.array([np.cos(middle), np.sin(middle), 0.0]) * advance
            self._pose = Pose.from_euler(self._pose.position + ahead, yaw=float(wrap_angle(yaw + turn)))
            if errors is not None:
                given = errors["speed"], errors["yaw_rate"]
                self._doubt = gone(self._doubt, middle, sample.speed, dt, *given)
        self._t = sample.t
        pose = self._pose
        if errors is None:
            spread: tuple[float, ...] = NOTHING_KNOWN
        else:
            twist = (max(hypot(*errors[key]) ** 2, EXACT) for key in ("speed", "yaw_rate"))
            spread = (*covariance(self._doubt), *twist)
        values = (*pose.position.tolist(), *pose.quaternion(), *spread[:9])
        values += (sample.speed, 0.0, sample.yaw_rate, *spread[9:])
        draft = Draft(sample.t, MEASURED, values, lambda: self._message(sample, pose, spread))
        yield Sent(self.source.topic, draft)

    def _message(self, sample: Odometry, pose: Pose, spread: tuple[float, ...]) -> Any:
        """nav_msgs/Odometry."""
        source, make = self.source, self.source.make
        twist = make.twist(sample.speed, 0.0, sample.yaw_rate)
        place, motion = np.diag([UNKNOWN] * 6), np.diag([UNKNOWN] * 6)
        place[np.ix_([0, 1, 5], [0, 1, 5])] = np.reshape(spread[:9], (3, 3))
        motion[0, 0], motion[5, 5] = spread[9:]
        header = make.header(sample.t, source.odom)
        return make.odometry(header, source.base, pose, twist, place.ravel(), motion.ravel())


def steering_messages(source: Source, state: SteerState) -> Iterator[Sent]:
    """ackermann_msgs/AckermannDriveStamped of the angle and its rate."""
    make = source.make
    angle, rate = float(state.angle), float(state.rate)

    def build() -> Any:
        drive = make("ackermann_msgs/msg/AckermannDrive", steering_angle=angle, steering_angle_velocity=rate)
        header = make.header(state.t, source.base)
        return make("ackermann_msgs/msg/AckermannDriveStamped", header=header, drive=drive)

    yield Sent(source.topic, Draft(state.t, STEERING, (angle, rate), build))


def speed_messages(source: Source, command: SpeedCommand) -> Iterator[Sent]:
    """geometry_msgs/TwistStamped of the wanted speed."""

    def build() -> Any:
        header, twist = source.make.header(command.t, source.base), source.make.twist(command.speed)
        return source.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)

    yield Sent(source.topic, Draft(command.t, SPEED, (command.speed,), build))
