"""In which frame samples of somebody else's recording are, by what they show: gravity, and the ground."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import cos, hypot, isfinite, nan

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.portable import product
from swath.core.units import DEG
from swath.signals import F64, Fix, Inertial, MachineState, Signal

GRAVITY = 9.81  # m/s2
NEAR_GRAVITY = 0.15  # of it, by which a mean force may be off: bias, scale, braking
UPRIGHT_DEG = 45.0  # no machine at work leans as far
DATUM_M = 0.5  # heights that differ by less from the terrain's differ by their errors
CONSTANT_M = 1.0  # from the 5th to the 95th percentile: what differs by more is no other datum
UNKNOWN_SD_M = 3.5  # of the height of a receiver without corrections (docs/explanation/sensors.md)
# Where the force of an upright machine points in the unit's axes -> what turns them to forward, left, up.
LIKELY = {
    (2, 1): "z up, but turned by `mount` or /tf_static: `mount: {at: axle, pitch_deg: 0}`",
    (2, -1): "z down, as in NED or forward, right, down: `mount: {at: axle, roll_deg: 180, pitch_deg: 0}`",
    (0, 1): "x up: `mount: {at: axle, pitch_deg: -90}`",
    (0, -1): "x down: `mount: {at: axle, pitch_deg: 90}`",
    (1, 1): "y up: `mount: {at: axle, roll_deg: 90, pitch_deg: 0}`",
    (1, -1): "y down: `mount: {at: axle, roll_deg: -90, pitch_deg: 0}`",
}


def check_gravity(key: str, samples: Iterable[Signal], rotation: F64 | None) -> None:
    """InputError where the mean specific force is none of a machine that stands upright.

    key: for the message; rotation: of pose_machine_sensor, (3, 3), None = the axes are the machine's. An
    inertial unit measures the force that carries it, upward: +9.81 in z of x forward, y left, z up (REP 145).
    """
    rows = [(s.force_x, s.force_y, s.force_z) for s in samples if isinstance(s, Inertial)]
    known = np.array([row for row in rows if np.isfinite(row).all()])
    if len(known) == 0:
        return
    own = known.mean(axis=0)
    force = own if rotation is None else product(rotation, own)
    size = hypot(*force)
    seen = "{:.2f}, {:.2f}, {:.2f}".format(*force)
    if abs(size - GRAVITY) > NEAR_GRAVITY * GRAVITY:
        raise InputError(f"{key}.force", seen, f"expected {GRAVITY} m/s2 upward in the mean; {_unit(size)}")
    if force[2] >= cos(UPRIGHT_DEG * DEG) * size:
        return
    axis = int(np.argmax(np.abs(own)))
    likely = LIKELY[axis, 1 if own[axis] > 0 else -1]
    if abs(own[axis]) < cos(UPRIGHT_DEG * DEG) * size:
        likely = "aslant: `mount` says how it sits"
    raise InputError(
        f"{key}.force", seen, f"expected +{GRAVITY} in z (x forward, y left, z up); it is {likely}"
    )


def _unit(size: float) -> str:
    if abs(size - 1.0) < NEAR_GRAVITY:
        return "it is in g: `scale: {inertial.force_x: 9.81, inertial.force_y: 9.81, inertial.force_z: 9.81}`"
    return "gravity is left out of it" if size < 1.0 else "it is in another unit: `scale`"


@dataclass(frozen=True)
class Lift:
    """How heights lie against the terrain. above: in the mean [m]; low, high: 5th and 95th percentile
    ground: height of the terrain at x, y
    """

    above: float
    low: float
    high: float
    ground: Callable[[F64, F64], F64]

    @property
    def is_constant(self) -> bool:
        """Whether another zero of heights explains it."""
        return self.high - self.low <= CONSTANT_M

    def note(self, *, is_mended: bool) -> str:
        """What the user should know; is_mended: samples are put where they belong by `lifted`."""
        side = "above" if self.above > 0 else "below"
        told = (
            f"the track lies {abs(self.above):.1f} m {side} the terrain ({self.low:.1f} to {self.high:.1f})"
        )
        if self.is_constant:
            done = "; taken off" if is_mended else ""
            return f"{told}: another datum of heights (ellipsoid, geoid), or the antenna's height{done}"
        done = "; put on the terrain" if is_mended else ""
        return f"{told}: it was not recorded on this terrain{done}"

    def lifted(self, sample: Signal) -> Signal:
        """A MachineState on the terrain."""
        if not isinstance(sample, MachineState):
            return sample
        x, y, z = sample.pose.position
        z = z - self.above if self.is_constant else self.ground(np.array([x]), np.array([y]))[0]
        return replace(sample, pose=Pose(np.array([x, y, z]), sample.pose.rotation))


def lift_of(
    samples: Iterable[Signal], ground: Callable[[F64, F64], F64], antenna: float = 0.0
) -> Lift | None:
    """How a track lies over the terrain; None where it lies on it, as far as its errors let that be seen.

    antenna: height above ground of what fixes are of [m]
    """
    rows = [row for s in samples if np.isfinite(row := _place(s, antenna)).all()]
    if not rows:
        return None
    x, y, z, sd = np.array(rows).T
    low, middle, high = (float(v) for v in np.percentile(z - ground(x, y), (5, 50, 95)))
    slack = 4.0 * float(np.median(sd))
    if abs(middle) <= DATUM_M + slack and high - low <= CONSTANT_M + 2.0 * slack:
        return None
    return Lift(middle, low, high, ground)


def _place(sample: Signal, antenna: float) -> tuple[float, float, float, float]:
    """x, y, z on the ground and sd of the height [m]; nan where there is none."""
    if isinstance(sample, Fix):
        sd = sample.vertical_sd if isfinite(sample.vertical_sd) else UNKNOWN_SD_M
        return sample.x, sample.y, sample.z - antenna, sd
    if isinstance(sample, MachineState):
        x, y, z = (float(v) for v in sample.pose.position)
        return x, y, z, 0.0
    return nan, nan, nan, nan
