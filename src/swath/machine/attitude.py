"""Where the machine stands on the ground: height, roll and pitch from the ground under its tyres.

No suspension. The front axle is rigid with the body; the rear one is a pendulum axle, it follows the ground
but does not roll the body. A tyre bridges what is shorter than itself: it stands at the mean ground height
over its contact patch, so a wave of length l along the path is damped by sinc(patch_length / l).
"""

from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.field import Field
from swath.kernels import Row, filled, of_worlds, repeatable
from swath.machine.machine_sheet import Axle, dynamics_of
from swath.signals.setup import MachineGeometry

ALONG, ACROSS = 4, 2  # ground samples of one contact patch
SAMPLES = ALONG * ACROSS


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
    """Reads the ground under four tyres. stance: the last one; footprint: what holds the ground."""

    def __init__(self, ground: Field, machine: MachineGeometry) -> None:
        self.footprint = ground.footprint(_tyre_points(machine))
        self._wheelbase = -machine.steered_x  # < 0 where the steered axle is ahead
        self._tracks = machine.front_track, machine.rear_track
        self.stance = Stance(0.0, 0.0, 0.0, 0.0, 0.0)
        self._launch: Any = None

    def at(self, x: float, y: float, yaw: float) -> Stance:
        """Stance at a place [m] and heading [rad].

        pitch = atan((rear - front) / wheelbase), roll = atan(front slope * cos(pitch)): on a plane the body's
        z axis is then exactly the plane's normal (intrinsic z-y'-x'' angles).
        """
        if self._launch is None or not self._stands(x, y, yaw):
            if not isfinite(x + y + yaw):
                raise InputError("place", (x, y, yaw), "expected a finite place and heading")
            self.footprint.take(x, y, yaw)
            self._compile()
            self._stands(x, y, yaw)
        self.stance = Stance(*self._found[4:9])
        return self.stance

    def pose(self) -> Pose:
        """pose_world_machine of the last stance."""
        a = self._found
        x, y = a[18:20]
        return Pose.of_numbers([x, y, a[4]], [[*a[9:12]], [*a[12:15]], [*a[15:18]]])

    def ground(self) -> Any:
        """What kernels know of the ground, as it is in memory now."""
        from swath.machine.attitude_kernel import Ground

        nodes, first, points, span = self.footprint.arguments()
        front, rear = self._tracks
        around = {"nodes": nodes, "first": first, "points": points, "span": span}
        return filled(Ground, **around, wheelbase=self._wheelbase, front_track=front, rear_track=rear)

    def _stands(self, x: float, y: float, yaw: float) -> bool:
        """Whether the ground there is in memory."""
        self._track.write(x, y, yaw, *[0.0] * 5)
        self._launch()
        self._found = self._stand.read()
        return self._found[0] == 1.0

    def _compile(self) -> None:
        from swath.machine import attitude_kernel as kernel

        self._ground, self._track, self._stand = self.ground(), Row(kernel.Track), Row(kernel.Stand)
        rows = of_worlds(kernel.Ground, [self._ground]), self._track.array, self._stand.array
        self._launch = repeatable(kernel.stand_at, [*rows]).launch


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
