"""What flows between components: frozen, typed samples, SI and radians.

Every sample carries `t`, the simulated time [ns] it is valid for. Arrays are read-only by convention.
Field names map one to one onto the ROS 2 messages of the recording.
"""

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.core.frozen import frozen
from swath.core.signal import Signal as Signal

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]


@frozen
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


@frozen
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


@frozen
class ScanTruth(Signal):
    """What a simulated scan really hit, for metrics and pictures only.

    points: world positions of the echoes [m], shape (beam_count, echo_count, 3), nan = no echo
    sensor_position: of each beam in the world [m], shape (beam_count, 3)
    """

    points: F64
    sensor_position: F64


@frozen
class Image(Signal):
    """One picture of a camera, all pixels at the time t. A channel that was not asked for has no pixels.

    Optical frame: x right, y down, z forward; the middle of the upper left pixel is (0, 0)
    width, height: of the image [px]; focal: focal length [px]; centre_x, centre_y: principal point [px]
    depth: along the optical axis [m], (height, width), nan = nothing within reach
    colour: sRGB, (height, width, 3); label: `field.layout.Organ` that was hit, 0 = none, (height, width)
    """

    width: int
    height: int
    focal: float
    centre_x: float
    centre_y: float
    depth: F32
    colour: U8
    label: U8


@frozen
class Odometry(Signal):
    """Measured motion: speed [m/s], yaw_rate [rad/s], steer_angle [rad] (> 0 turns left)."""

    speed: float
    yaw_rate: float
    steer_angle: float


@frozen
class Inertial(Signal):
    """What an inertial unit feels, in its own frame, the mean since its sample before.

    rate_x, rate_y, rate_z: angular rate about its axes [rad/s]
    force_x, force_y, force_z: specific force [m/s2], acceleration less gravity: +9.81 upward at rest
    rate_sd, force_sd: of the white noise of a sample, 1 sigma
    """

    rate_x: float
    rate_y: float
    rate_z: float
    force_x: float
    force_y: float
    force_z: float
    rate_sd: float = 0.0
    force_sd: float = 0.0


FIX_QUALITIES = ("none", "single", "dgps", "float", "fix")  # of a Fix, by number


@frozen
class Fix(Signal):
    """A satellite receiver's position. t: when it was measured; it comes out later.

    x, y, z: of the antenna in the world [m], nan = no position
    speed: over ground, horizontal [m/s]; course: where to, from east, > 0 left [rad]; nan = not known
    horizontal_sd (east and north, each), vertical_sd [m], speed_sd [m/s]: 1 sigma as the receiver reports it
    quality: number of its name in `FIX_QUALITIES`
    longitude, latitude [rad], height [m] of the same place in the field's geodetic system, nan where the
    field lies nowhere on Earth
    """

    x: float
    y: float
    z: float
    speed: float
    course: float
    horizontal_sd: float
    vertical_sd: float
    speed_sd: float
    quality: int
    longitude: float = float("nan")
    latitude: float = float("nan")
    height: float = float("nan")


@frozen
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


@frozen
class SteerCommand(Signal):
    """Wanted path curvature at the fixed axle [1/m], > 0 left. is_engaged: False = a person must steer."""

    curvature: float
    is_engaged: bool


@frozen
class SteerState(Signal):
    """Where the steered axle stands: equivalent single-wheel angle [rad], > 0 turns left, and its rate."""

    angle: float
    rate: float


@frozen
class SpeedCommand(Signal):
    """Wanted forward speed [m/s]."""

    speed: float


@frozen
class CropFlow(Signal):
    """What the header took in during its last step.

    grain, straw: masses in that step [kg]; area [m2]; stem_count; header_fill: cut width / header width
    dt: length of the step [s]
    lost_grain: cut but shed on the ground by the header; left_grain: on stems whose ear was below the knife;
    neither is part of `grain` [kg]
    """

    grain: float
    straw: float
    area: float
    stem_count: int
    header_fill: float
    dt: float
    lost_grain: float = 0.0
    left_grain: float = 0.0


@frozen
class HeaderState(Signal):
    """The header over the ground.

    heights: true ones of the knife above the ground at even steps from its left to its right end [m], (n,);
    below 0 it digs in
    readings: of the feelers from left to right [m], (feeler_count,), nan before the first
    wanted: cutting height; band: tolerated to both sides of it [m]
    lift: of the feeder, > 0 raised; tilt: of the header against the machine, > 0 left side up [rad]
    contact: share of the knife in the ground, 0..1
    """

    heights: F64
    readings: F64
    wanted: float
    band: float
    lift: float
    tilt: float
    contact: float


@frozen
class MachineLoad(Signal):
    """Where the crop is: tank_grain, lost_grain, dropped_straw, held_grain, held_straw [kg] since the start.

    grain_flow, straw_flow: leaving into tank and swath at this moment [kg/s]
    tank_grain counts what came into the tank; unloaded_grain [kg] has left it again; tank_start [kg] was in
    it before
    header_flow, feeder_flow, drum_flow: grain and straw at the knife, into the feeder house and into the
    threshing drum, there with returns [kg/s]
    rotor_flow: straw through the separation; shoe_flow: grain and chaff over the cleaning shoe [kg/s]
    chopper_flow: straw through the chopper, 0 when it lies in a swath; return_flow: back to the drum [kg/s]
    unload_flow: out of the tank [kg/s]
    threshing_loss, separation_loss, cleaning_loss: grain leaving over the rear [kg/s]
    loss_share: of the grain that was fed, for the crop that leaves now, 0..1
    tank_level: filled share of the tank, 0..1; 0 where the level of detail has no tank
    """

    tank_grain: float
    lost_grain: float
    dropped_straw: float
    held_grain: float
    held_straw: float
    grain_flow: float
    straw_flow: float
    unloaded_grain: float = 0.0
    tank_start: float = 0.0
    header_flow: float = 0.0
    feeder_flow: float = 0.0
    drum_flow: float = 0.0
    rotor_flow: float = 0.0
    shoe_flow: float = 0.0
    chopper_flow: float = 0.0
    return_flow: float = 0.0
    unload_flow: float = 0.0
    threshing_loss: float = 0.0
    separation_loss: float = 0.0
    cleaning_loss: float = 0.0
    loss_share: float = 0.0
    tank_level: float = 0.0

    @property
    def tank_content(self) -> float:
        """Grain in the tank now [kg]."""
        return self.tank_start + self.tank_grain - self.unloaded_grain


@frozen
class EngineState(Signal):
    """The engine and what it drives, as its controller reports it.

    speed [rad/s]; speed_ratio: over the rated speed
    load: torque asked over the largest torque at this speed; above 1 the speed falls
    power: given by the engine [W]; fuel [kg/s]; fuel_used [kg] since the start
    header_power, threshing_power (drum), separation_power, cleaning_power, chopper_power, unloading_power,
    propulsion_power, auxiliary_power: taken by each [W]
    speed_limit: largest ground speed the drive can give now [m/s]
    """

    speed: float
    speed_ratio: float
    load: float
    power: float
    fuel: float
    fuel_used: float
    header_power: float
    threshing_power: float
    separation_power: float
    cleaning_power: float
    chopper_power: float
    unloading_power: float
    propulsion_power: float
    auxiliary_power: float
    speed_limit: float


@frozen
class FeedReading(Signal):
    """Throughput as the layer sensor in the feeder house reads it: grain and straw [kg/s]."""

    flow: float


@frozen
class YieldReading(Signal):
    """Grain at the top of the elevator.

    flow [kg/s]; moisture: water, share of the wet mass; tank_level: filled share of the tank, 0..1
    """

    flow: float
    moisture: float
    tank_level: float


@frozen
class LossReading(Signal):
    """Grain over the rear as the impact sensors read it [kg/s]: separation (rotors), cleaning (shoe)."""

    separation: float
    cleaning: float


@frozen
class CropAhead(Signal):
    """The standing crop ahead of the header, averaged over its width.

    ahead: where in front of the fixed axle it was seen [m]
    height: top of the canopy above the ground [m], nan = nothing seen
    extinction: hits of a ray per metre of way through the canopy [1/m], nan = nothing seen
    """

    ahead: float
    height: float
    extinction: float

    @property
    def amount(self) -> float:
        """Surface of plants over ground, up to a factor: height * extinction; nan = nothing seen."""
        return self.height * self.extinction


def beam_directions(azimuth: F64, elevation: F64) -> F64:
    """Unit vectors in the sensor frame, shape (..., 3), from angles [rad]."""
    ce = np.cos(elevation)
    return np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.sin(elevation)], axis=-1)
