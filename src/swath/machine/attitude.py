"""Where the machine stands on the ground: height, roll and pitch from the ground under its tyres.

No suspension. The front axle is rigid with the body; the rear one is a pendulum axle, it follows the ground
but does not roll the body. A tyre bridges what is shorter than itself: it stands at the mean ground height
over its contact patch, so a wave of length l along the path is damped by sinc(patch_length / l).
"""

from math import cos, isfinite, sin
from typing import Any, NamedTuple, Protocol

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.footprint import Footprint, make_ground
from swath.kernels import Row, numbers, repeatable, start_warp
from swath.machine.machine_sheet import Axle, dynamics_of
from swath.signals.setup import MachineGeometry

ALONG, ACROSS = 4, 2  # ground samples of one contact patch
SAMPLES = ALONG * ACROSS


class Ground(Protocol):
    """The part of a field that carries machines."""

    def ground_height(self, x: Any, y: Any, /) -> Any:
        """Height of the ground [m] at world x, y [m]."""
        ...


class Stance(NamedTuple):
    """How the machine stands. z of the fixed axle's middle on the ground [m]; roll, pitch [rad].

    front_slope, rear_slope: rise of the ground to the left under the two axles [m/m]
    """

    z: float
    roll: float
    pitch: float
    front_slope: float
    rear_slope: float


class TerrainFollower:
    """Reads the ground under four tyres; compiled where the ground is a field's.

    gear: for kernels of others, which call `_attitude.stand_at`
    """

    def __init__(self, ground: Ground, machine: MachineGeometry) -> None:
        from swath.machine.attitude_kernel import Gear, Stand, stand

        self._ground, self._points = ground, _tyre_points(machine)
        quick = getattr(ground, "footprint", None)
        self._footprint: Footprint | None = None if quick is None else quick(self._points, groups=4)
        under = self._footprint.ground if self._footprint else make_ground(np.zeros((0, 2)), 4, 2)
        self.gear = Gear()
        self.gear.wheelbase = -machine.steered_x
        self.gear.front_track, self.gear.rear_track = machine.front_track, machine.rear_track
        self._stand, self._place = Row(Stand), Row(start_warp().vec3d)
        self.gear.ground, self.gear.stand = under, self._stand.array
        self.gear.position, self.gear.rotation = numbers(3), numbers(3, 3)
        shared = under.means, self.gear.position, self.gear.rotation
        self._means, self._position, self._rotation = (a.numpy() for a in shared)
        self._launch = repeatable(stand, [self._place.array, self.gear]).launch

    def at(self, x: float, y: float, yaw: float) -> Stance:
        """Stance at a place [m] and heading [rad]."""
        if not (isfinite(x) and isfinite(y) and isfinite(yaw)):
            raise InputError("place", (x, y, yaw), "expected a finite place and heading")
        if self._footprint is None:
            self._look(x, y, yaw)
        self.hold(x, y)
        self._place.write(x, y, yaw)
        self._launch()
        return Stance(*self._stand.read())

    def hold(self, x: float, y: float) -> None:
        """Have the ground around x, y [m] at hand for a kernel that calls `stand_at` soon."""
        if self._footprint is not None:
            self._footprint.hold(x, y)

    def arrive(self, x: float, y: float, yaw: float) -> None:
        """After a kernel that called `stand_at` for this very place: complete where there are no pages."""
        if self._footprint is None or not isfinite(yaw):
            self.at(x, y, yaw)

    def pose(self) -> Pose:
        """pose_world_machine of the last stance."""
        return Pose(self._position.copy(), self._rotation.copy())

    def _look(self, x: float, y: float, yaw: float) -> None:
        """Mean heights under the tyres from a ground that has no pages."""
        (px, py), c, s = self._points.T, cos(yaw), sin(yaw)
        found = self._ground.ground_height(x + c * px - s * py, y + s * px + c * py)
        self._means[:] = np.asarray(found, dtype=float).reshape(4, SAMPLES).mean(axis=1)


def _tyre_points(machine: MachineGeometry) -> np.ndarray:
    """Points of the four contact patches, (4 * SAMPLES, 2): front left and right, rear left and right [m]."""
    d = dynamics_of(machine)
    front, rear = _patch(d.front), _patch(d.rear)
    half_f, half_r, back = 0.5 * machine.front_track, 0.5 * machine.rear_track, machine.steered_x
    places = np.array([(0.0, half_f), (0.0, -half_f), (back, half_r), (back, -half_r)])
    points: np.ndarray = (places[:, None, :] + np.stack([front, front, rear, rear])).reshape(-1, 2)
    return points


def _patch(axle: Axle) -> np.ndarray:
    """Sample points of a contact patch about its centre [m], shape (ALONG * ACROSS, 2): cell middles."""
    along = ((np.arange(ALONG) + 0.5) / ALONG - 0.5) * axle.patch_length
    across = ((np.arange(ACROSS) + 0.5) / ACROSS - 0.5) * axle.patch_width
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
