"""Motion of a machine as ROS 2 messages: the truth with its frames, odometry, steering and wanted speed.

`gone` says how far off a dead reckoning is: covariance of x, y and heading as speed and yaw rate with errors
add up. Errors that stay during a run are followed by their sensitivities, those that are new with every
sample as a covariance: first-order propagation through x += v dt cos, y += v dt sin, heading += w dt (Thrun,
Burgard, Fox 2005, Probabilistic Robotics, 5.4), in plain numbers.

A viewer shows a machine and its field without any set-up: the machine's body, the field, the edge. The body
is a URDF of one link, the frame `<machine>/base_link`, so that it moves with /tf alone: box of the chassis,
header and wheels from the data sheet. It has no joints and no mass: no viewer has to simulate it.
"""

from collections.abc import Iterator
from math import cos, hypot, sin
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from swath.core.frames import Pose, wrap_angle
from swath.core.schedule import NS
from swath.field.maps.projection import Origin
from swath.record.message_factory import EXACT, UNKNOWN, Draft, Sent, Source, place_of
from swath.record.positioning_messages import nav_sat_fix
from swath.signals import F64, Fix, MachineState, Odometry
from swath.signals.setup import MachineGeometry

CHASSIS, HEADER, RUBBER = (0.42, 0.56, 0.14, 1.0), (0.8, 0.8, 0.78, 1.0), (0.15, 0.15, 0.15, 1.0)
WHEEL_WIDTH, WHEEL_RADIUS = 0.6, 0.75  # [m], for the eye: data sheets of geometry alone hold no tyres
LINE_STRIP, TRIANGLE_LIST = 4, 11  # visualization_msgs/Marker
COLOURS = {"edge": (0.0, 0.45, 0.7)}


def urdf(name: str, machine: MachineGeometry) -> str:
    """The machine as URDF, one link `<name>/base_link` with boxes and wheels."""
    robot = Element("robot", name=name)
    link = SubElement(robot, "link", name=f"{name}/base_link")
    rear, front, half, bottom, top = machine.body
    chassis = (front - rear, 2.0 * half, top - bottom)
    _box(link, "chassis", chassis, (0.5 * (rear + front), 0.0, 0.5 * (bottom + top)), CHASSIS)
    if machine.has_header:
        size = (machine.header_depth, machine.header_width, machine.header_height)
        at = (machine.knife_x - 0.5 * size[0], machine.header_y, 0.15 + 0.5 * size[2])
        _box(link, "header", size, at, HEADER)
    for axle, x, track in (
        ("fixed", 0.0, machine.front_track),
        ("steered", machine.steered_x, machine.rear_track),
    ):
        for side, y in (("left", 0.5 * track), ("right", -0.5 * track)):
            visual = _visual(link, f"{axle}_{side}_wheel", (x, y, WHEEL_RADIUS), RUBBER, turn="1.570796 0 0")
            SubElement(visual, "cylinder", radius=f"{WHEEL_RADIUS}", length=f"{WHEEL_WIDTH}")
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode")


def scene_messages(source: Source) -> Iterator[Sent]:
    """Before the first sample of a machine's motion: frames, body and lines on the field; all latched.

    The body of the first machine goes where viewers look for it, `/robot_description`.
    """
    make, machine = source.make, source.machine
    frames = [make.transform(0, source.base, f"{machine.name}/{s}", p) for s, p in machine.mounting.items()]
    frames.append(make.transform(0, "map", source.odom, Pose.identity()))
    yield Sent("/tf_static", make("tf2_msgs/msg/TFMessage", transforms=frames), "latched")
    body = make("std_msgs/msg/String", data=urdf(machine.name, machine.geometry))
    topic = "/robot_description" if machine.is_first else f"/{machine.name}/robot_description"
    yield Sent(topic, body, "latched")
    if len(machine.triangles):
        marked = make("visualization_msgs/msg/MarkerArray", markers=[_triangles(make, source)])
        yield Sent(f"/{machine.name}/body_markers", marked, "latched")
    if machine.lines:
        markers = [_line(make, name, points) for name, points in machine.lines.items()]
        marked = make("visualization_msgs/msg/MarkerArray", markers=markers)
        yield Sent(f"/{machine.name}/field_markers", marked, "latched")


def _line(make: Any, name: str, points: F64) -> Any:
    colour = (*COLOURS.get(name, (0.9, 0.9, 0.9)), 1.0)
    return make.marker(make.header(0, "map"), name, LINE_STRIP, colour, (0.08,), points=points.tolist())


def _triangles(make: Any, source: Source) -> Any:
    """The machine's body from its file, with a level header."""
    header, size = make.header(0, source.base), (1.0, 1.0, 1.0)
    corners = source.machine.triangles.reshape(-1, 3).tolist()
    return make.marker(header, "body", TRIANGLE_LIST, CHASSIS, size, points=corners, frame_locked=True)


def _box(link: Element, name: str, size: tuple[float, ...], at: tuple[float, ...], colour: Any) -> None:
    SubElement(_visual(link, name, at, colour), "box", size=_text(size))


def _visual(link: Element, name: str, at: tuple[float, ...], colour: Any, turn: str = "0 0 0") -> Element:
    """The geometry of a new visual."""
    visual = SubElement(link, "visual", name=name)
    SubElement(visual, "origin", xyz=_text(at), rpy=turn)
    geometry = SubElement(visual, "geometry")
    SubElement(SubElement(visual, "material", name=name), "color", rgba=_text(colour))
    return geometry


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)


LEAST = 1e-12  # variance at the start: a covariance of zeros would say that it is unknown
Doubt = tuple[float, ...]
"""x, y [m] by what stays of the speed; x, y, heading by what stays of the yaw rate; covariance of the noise:
xx, xy, yy, xh, yh, hh.
"""
EXACT_START: Doubt = (0.0, 0.0, 0.0, 0.0, 0.0, LEAST, 0.0, LEAST, 0.0, 0.0, LEAST)
Spread = tuple[float, float]  # standard deviation of each sample, and of what stays


def gone(doubt: Doubt, heading: float, speed: float, dt: float, speed_sd: Spread, rate_sd: Spread) -> Doubt:
    """The doubt after dt [s] at the middle heading [rad]. speed_sd [m/s]; rate_sd [rad/s]."""
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
    """Covariance of (x, y, heading), row by row, (9,)."""
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
    """nav_msgs/Odometry and /tf of the truth, before the first what a viewer needs (`scene_messages`).

    NavSatFix too, of a field on Earth, where no slot of the machine publishes a Fix.
    """

    def __init__(self, source: Source) -> None:
        self.source, self._next_fix, self._is_first = source, 0, True
        has_receiver = Fix in source.machine.outputs.values()
        self._origin = None if has_receiver else source.machine.origin

    @property
    def takes_many(self) -> bool:
        """Whether it makes the messages of many samples at once."""
        return not self._is_first and self._origin is None

    def __call__(self, state: Any) -> Iterator[Sent]:
        """The messages of one sample, or of many."""
        source = self.source
        if self._is_first:
            self._is_first = False
            yield from scene_messages(source)
        place = place_of(state.pose)
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


def steering_messages(source: Source, state: Any) -> Iterator[Sent]:
    """ackermann_msgs/AckermannDriveStamped of the angle and its rate."""
    make = source.make

    def build() -> Any:
        drive = make(
            "ackermann_msgs/msg/AckermannDrive",
            steering_angle=float(state.angle),
            steering_angle_velocity=float(state.rate),
        )
        header = make.header(state.t, source.base)
        return make("ackermann_msgs/msg/AckermannDriveStamped", header=header, drive=drive)

    yield Sent(source.topic, Draft(state.t, STEERING, (state.angle, state.rate), build))


def speed_messages(source: Source, command: Any) -> Iterator[Sent]:
    """geometry_msgs/TwistStamped of the wanted speed."""

    def build() -> Any:
        header, twist = source.make.header(command.t, source.base), source.make.twist(command.speed)
        return source.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist)

    yield Sent(source.topic, Draft(command.t, SPEED, (command.speed,), build))
