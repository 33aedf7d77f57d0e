"""Motion and commands of a machine from messages of poses, twists, drives and plain numbers.

Steering angles and turn rates follow from each other by the kinematic single track: tan(angle) = wheelbase *
yaw rate / speed (Rajamani, Vehicle Dynamics and Control, eq. 2.4 without slip).
"""

from collections.abc import Callable
from math import atan2, tan
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.core.portable import product
from swath.core.schedule import NS
from swath.record.read.fields import Context, Maker, Makers
from swath.signals import MachineState, Odometry, SpeedCommand, SteerCommand, SteerState

STANDING = 0.05  # below this speed a turn rate says nothing about the steering [m/s]


class _States:
    """MachineState from poses, with the way that was driven; speeds by difference where there are none."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.last: tuple[int, Pose] | None = None
        self.distance = 0.0

    def __call__(self, message: Any, t: int) -> MachineState | None:
        at, pose = self.context.stamp(message, t), self.context.pose(message)
        if not (np.isfinite(pose.position).all() and np.isfinite(pose.rotation).all()):
            self.context.note("lost: poses that are not finite left out")
            return None
        ahead = side = turn = 0.0
        if self.last is not None and at > self.last[0]:
            before, dt = self.last[1], (at - self.last[0]) / NS
            moved = product(before.rotation.T, pose.position - before.position)
            self.distance += float(np.hypot(moved[0], moved[1]))
            ahead, side = float(moved[0]) / dt, float(moved[1]) / dt
            turned = product(before.rotation.T, pose.rotation)
            turn = atan2(turned[1, 0], turned[0, 0]) / dt
        self.last = (at, pose)
        if (twist := getattr(message, "twist", None)) is not None:
            ahead, side, turn = _motion(twist.twist, self.context.below(message))
        steer = steer_angle(self.context.wheelbase, ahead, turn)
        return MachineState(at, pose, ahead, side, turn, steer, self.distance)


def steer_angle(wheelbase: float, speed: float, yaw_rate: float) -> float:
    """Equivalent steering angle of a turn [rad], > 0 left; nan while it stands."""
    if abs(speed) < STANDING:
        return float("nan")
    return atan2(wheelbase * yaw_rate, abs(speed)) * (1.0 if speed > 0 else -1.0)


def _motion(twist: Any, below: Pose | None = None) -> tuple[float, float, float]:
    """Forward and leftward speed [m/s], yaw rate [rad/s] of a geometry_msgs/Twist, stamped or not.

    below: the machine's own frame, in that whose motion it is
    """
    inner = getattr(twist, "twist", twist)
    if below is None:
        return float(inner.linear.x), float(inner.linear.y), float(inner.angular.z)
    linear, turn = (np.array([v.x, v.y, v.z], float) for v in (inner.linear, inner.angular))
    ahead, side, _ = product(below.rotation.T, linear + np.cross(turn, below.position))
    return float(ahead), float(side), float(product(below.rotation.T, turn)[2])


def _odometry(context: Context) -> Maker:
    def make(message: Any, t: int) -> Odometry:
        speed, _, turn = _motion(getattr(message, "twist", message), context.below(message))
        return Odometry(context.stamp(message, t), speed, turn, steer_angle(context.wheelbase, speed, turn))

    return make


def _drive(message: Any) -> Any:
    return getattr(message, "drive", message)


def _speed(of: Callable[[Any], float]) -> Callable[[Context], Maker]:
    return lambda context: lambda message, t: SpeedCommand(context.stamp(message, t), float(of(message)))


def _steer_state(of: Callable[[Any], tuple[float, float]]) -> Callable[[Context], Maker]:
    return lambda context: lambda message, t: SteerState(context.stamp(message, t), *map(float, of(message)))


def _curvature(of: Callable[[Any, Context], float]) -> Callable[[Context], Maker]:
    return lambda context: (
        lambda message, t: SteerCommand(context.stamp(message, t), float(of(message, context)), True)
    )


def _angle_and_rate(message: Any) -> tuple[float, float]:
    return _drive(message).steering_angle, _drive(message).steering_angle_velocity


def _makers() -> Makers:
    made: Makers = {}
    for name in ("Odometry", "PoseStamped", "PoseWithCovarianceStamped"):
        made[MachineState, name] = _States
    for name in ("Odometry", "TwistStamped", "Twist"):
        made[Odometry, name] = _odometry
    for name in ("TwistStamped", "Twist"):
        made[SpeedCommand, name] = _speed(lambda m: _motion(m)[0])
    for name in ("AckermannDriveStamped", "AckermannDrive"):
        made[SpeedCommand, name] = _speed(lambda m: _drive(m).speed)
        made[SteerState, name] = _steer_state(_angle_and_rate)
        made[SteerCommand, name] = _curvature(lambda m, c: tan(_drive(m).steering_angle) / c.wheelbase)
    for name in ("Float64", "Float32"):
        made[SpeedCommand, name] = _speed(lambda m: m.data)
        made[SteerState, name] = _steer_state(lambda m: (m.data, 0.0))
        made[SteerCommand, name] = _curvature(lambda m, c: m.data)
    return made


MAKERS = _makers()
