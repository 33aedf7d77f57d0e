"""What flows between components: frozen, typed samples, SI and radians.

Every sample carries `t`, the simulated time [ns] it is valid for. Arrays are read-only by convention.
Field names map one to one onto the ROS 2 messages of the recording.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Signal:
    """Base of all samples. t: simulated time [ns]."""

    t: int


@dataclass(frozen=True)
class MachineState(Signal):
    """Truth about a machine's motion. Sensors and the header read it; control never does.

    pose: pose_world_machine, origin at the middle of the fixed (front) axle on the ground
    speed: forward speed of that origin [m/s]; lateral_speed: leftward [m/s]
    yaw_rate [rad/s]; steer_angle: equivalent single-wheel angle of the steered axle [rad], > 0 when the
    machine turns left
    distance: travelled path length [m]
    """

    pose: Pose
    speed: float
    lateral_speed: float
    yaw_rate: float
    steer_angle: float
    distance: float


@dataclass(frozen=True)
class Scan(Signal):
    """One sweep of a LiDAR, in beam order. t is the end of the sweep.

    beam_t: time of each beam relative to t [s], <= 0, shape (beam_count,)
    azimuth, elevation: nominal beam angles in the sensor frame [rad], shape (beam_count,); the direction is
    (cos e cos a, cos e sin a, sin e)
    ranges [m], shape (beam_count, echo_count), nan = no echo
    intensity: received, relative to a white diffuse target that fills the spot at the same range, shape
    (beam_count, echo_count), nan = no echo
    """

    beam_t: F64
    azimuth: F64
    elevation: F64
    ranges: F32
    intensity: F32

    def points(self) -> F64:
        """Echo points in the sensor frame [m], shape (beam_count, echo_count, 3), nan = no echo.

        What the sensor itself believes: nominal angles, no correction for its own motion.
        """
        directions = beam_directions(self.azimuth, self.elevation)
        return self.ranges[:, :, None].astype(np.float64) * directions[:, None, :]


@dataclass(frozen=True)
class ScanTruth(Signal):
    """What a simulated scan really hit, for metrics and pictures only.

    points: world positions of the echoes [m], shape (beam_count, echo_count, 3), nan = no echo
    sensor_position: of each beam in the world [m], shape (beam_count, 3)
    """

    points: F64
    sensor_position: F64


@dataclass(frozen=True)
class Odometry(Signal):
    """Measured motion: speed [m/s], yaw_rate [rad/s], steer_angle [rad] (> 0 turns left)."""

    speed: float
    yaw_rate: float
    steer_angle: float


@dataclass(frozen=True)
class CropEdge(Signal):
    """The crop edge as detected, in the machine frame (x forward, y left, on the ground).

    offset: y of the edge line at x = reference_x [m], nan = no edge
    heading: angle of the edge line against the x axis [rad], > 0 when it bears left, nan = no edge
    curvature [1/m], > 0 when the edge bends left; 0 when not estimated
    reference_x: where ahead of the fixed axle the offset holds [m]
    confidence: 0..1; 0 when there is no edge
    crop_height, stubble_height [m] above ground on both sides, nan where unknown
    """

    offset: float
    heading: float
    curvature: float
    reference_x: float
    confidence: float
    crop_height: float
    stubble_height: float

    @property
    def is_found(self) -> bool:
        """True when there is an edge to steer by."""
        return self.confidence > 0.0 and np.isfinite(self.offset)


@dataclass(frozen=True)
class SteerCommand(Signal):
    """Wanted path curvature at the fixed axle [1/m], > 0 left. is_engaged: False = a person must steer."""

    curvature: float
    is_engaged: bool


@dataclass(frozen=True)
class SteerState(Signal):
    """Where the steered axle stands: equivalent single-wheel angle [rad], > 0 turns left, and its rate."""

    angle: float
    rate: float


@dataclass(frozen=True)
class SpeedCommand(Signal):
    """Wanted forward speed [m/s]."""

    speed: float


@dataclass(frozen=True)
class CropFlow(Signal):
    """What the header took in during its last step.

    grain, straw: masses in that step [kg]; area [m2]; stem_count; header_fill: cut width / header width
    dt: length of the step [s]
    """

    grain: float
    straw: float
    area: float
    stem_count: int
    header_fill: float
    dt: float


@dataclass(frozen=True)
class MachineLoad(Signal):
    """Where the crop is: tank_grain, lost_grain, dropped_straw, held_grain, held_straw [kg] since the start.

    grain_flow, straw_flow: leaving into tank and swath at this moment [kg/s]
    """

    tank_grain: float
    lost_grain: float
    dropped_straw: float
    held_grain: float
    held_straw: float
    grain_flow: float
    straw_flow: float


def beam_directions(azimuth: F64, elevation: F64) -> F64:
    """Unit vectors in the sensor frame, shape (..., 3), from angles [rad]."""
    ce = np.cos(elevation)
    return np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.sin(elevation)], axis=-1)
