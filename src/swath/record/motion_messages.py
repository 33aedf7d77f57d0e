"""Motion of a machine as ROS 2 messages: the truth with its frames, odometry, steering and wanted speed."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from swath.core.frames import Pose, wrap_angle
from swath.core.schedule import NS
from swath.field.projection import Origin
from swath.record.messages import Sent, Source
from swath.signals import Fix, MachineState, Odometry, SpeedCommand, SteerState

FIX_PERIOD = 100_000_000  # between two NavSatFix [ns]
GBAS_FIX, GPS = 2, 1  # sensor_msgs/NavSatStatus


class StateMessages:
    """nav_msgs/Odometry and /tf of the truth, /tf_static before the first.

    NavSatFix too, of a field on Earth, where no slot of the machine publishes a Fix.
    """

    def __init__(self, source: Source) -> None:
        self.source, self._next_fix, self._is_first = source, 0, True
        has_receiver = Fix in source.machine.outputs.values()
        self._origin = None if has_receiver else source.machine.origin

    def __call__(self, state: MachineState) -> Iterator[Sent]:
        """The messages of one sample."""
        source, make = self.source, self.source.make
        if self._is_first:
            self._is_first = False
            mounting = source.machine.mounting.items()
            frames = [make.transform(0, source.base, f"{source.machine.name}/{s}", p) for s, p in mounting]
            frames.append(make.transform(0, "map", source.odom, state.pose))
            yield Sent("/tf_static", make("tf2_msgs/msg/TFMessage", transforms=frames), "latched")
        twist = make.twist(state.speed, state.lateral_speed, state.yaw_rate)
        header = make.header(state.t, "map")
        yield Sent(source.topic, make.odometry(header, source.base, state.pose, twist))
        moved = [make.transform(state.t, "map", source.base, state.pose)]
        yield Sent("/tf", make("tf2_msgs/msg/TFMessage", transforms=moved))
        if self._origin is not None and state.t >= self._next_fix:
            self._next_fix = state.t + FIX_PERIOD
            yield Sent(f"{source.slot_topic}/fix", self._fix(state, self._origin))

    def _fix(self, state: MachineState, origin: Origin) -> Any:
        """sensor_msgs/NavSatFix of the true place, without covariance; height from the field's zero."""
        x, y, z = state.pose.position
        longitude, latitude = origin.to_lon_lat([[x, y]])[0]
        make = self.source.make
        return make(
            "sensor_msgs/msg/NavSatFix",
            header=make.header(state.t, self.source.base),
            status=make("sensor_msgs/msg/NavSatStatus", status=GBAS_FIX, service=GPS),
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(origin.height + z),
        )


class OdometryMessages:
    """Twist as measured; the pose is its dead reckoning from the start (midpoint rule), for viewing."""

    def __init__(self, source: Source) -> None:
        self.source, self._t = source, 0
        self._pose: Pose | None = None

    def __call__(self, sample: Odometry) -> Iterator[Sent]:
        """The message of one sample."""
        if self._pose is None:
            self._pose = Pose.identity()
        else:
            dt = (sample.t - self._t) / NS
            turn, advance = sample.yaw_rate * dt, sample.speed * dt
            yaw = self._pose.euler()[2]
            middle = yaw + 0.5 * turn
            ahead = np.array([np.cos(middle), np.sin(middle), 0.0]) * advance
            self._pose = Pose.from_euler(self._pose.position + ahead, yaw=float(wrap_angle(yaw + turn)))
        self._t = sample.t
        source, make = self.source, self.source.make
        twist = make.twist(sample.speed, 0.0, sample.yaw_rate)
        header = make.header(sample.t, source.odom)
        yield Sent(source.topic, make.odometry(header, source.base, self._pose, twist))


def steering_messages(source: Source, state: SteerState) -> Iterator[Sent]:
    """ackermann_msgs/AckermannDriveStamped of the angle and its rate."""
    make = source.make
    angle, rate = float(state.angle), float(state.rate)
    drive = make("ackermann_msgs/msg/AckermannDrive", steering_angle=angle, steering_angle_velocity=rate)
    header = make.header(state.t, source.base)
    yield Sent(source.topic, make("ackermann_msgs/msg/AckermannDriveStamped", header=header, drive=drive))


def speed_messages(source: Source, command: SpeedCommand) -> Iterator[Sent]:
    """geometry_msgs/TwistStamped of the wanted speed."""
    header, twist = source.make.header(command.t, source.base), source.make.twist(command.speed)
    yield Sent(source.topic, source.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist))
