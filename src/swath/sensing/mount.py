"""Where a sensor sits on its machine, and where it is at every beam of a sweep."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from swath.core.frames import Pose, angles_of, rotation_matrices, wrap_angle
from swath.core.units import DEG
from swath.signals import F64, MachineState
from swath.signals.setup import MachineGeometry

Length = Annotated[float, Ge(-30), Le(30)]
Angle = Annotated[float, Ge(-180), Le(180)]


@dataclass(frozen=True)
class Mount:
    """Mounting of a sensor.

    at: the point the offsets count from. `edge_end`: the knife's end on the edge side; `left_end`,
        `right_end`: the knife's ends, y_m then counts outward, away from the machine; `axle`: the origin of
        the machine frame, y_m leftward
    x_m: forward
    y_m: sideways, as `at` says
    z_m: above ground
    roll_deg: > 0 left side up
    pitch_deg: > 0 nose down
    yaw_deg: > 0 outward, for `axle` to the left
    """

    at: Literal["edge_end", "left_end", "right_end", "axle"] = "edge_end"
    x_m: Length = 0.0
    y_m: Length = 0.0
    z_m: Length = 2.4
    roll_deg: Angle = 0.0
    pitch_deg: Angle = 16.0
    yaw_deg: Angle = 0.0

    def pose(self, machine: MachineGeometry, edge_side: str) -> Pose:
        """pose_machine_sensor."""
        x, y, yaw = self.x_m, self.y_m, self.yaw_deg
        if self.at != "axle":
            side = edge_side if self.at == "edge_end" else self.at.removesuffix("_end")
            outward = 1.0 if side == "left" else -1.0
            end = machine.header_end(side)
            x, y, yaw = x + end[0], end[1] + outward * y, outward * yaw
        return Pose.from_euler((x, y, self.z_m), self.roll_deg * DEG, self.pitch_deg * DEG, yaw * DEG)


@dataclass(frozen=True)
class LevelMount(Mount):
    """A mount that looks level from the axle.

    A sensor with another default place has a class of its own, so that a scenario that writes one key gets
    the others of that sensor.

    at: the point the offsets count from, as in `Mount`
    pitch_deg: > 0 nose down
    """

    at: Literal["edge_end", "left_end", "right_end", "axle"] = "axle"
    pitch_deg: Angle = 0.0


def poses_at(states: Sequence[MachineState], times: F64) -> tuple[F64, F64]:
    """Machine positions (n, 3) [m] and rotations (n, 3, 3) at times [ns], between recorded states.

    Positions and Euler angles are linear between neighbouring states (a few ms apart), and held outside.
    """
    t = np.array([s.t for s in states], dtype=float)
    position = np.array([s.pose.position for s in states])
    angle = angles_of(np.array([s.pose.rotation for s in states]))
    angle = angle[0] + np.cumsum(np.vstack([np.zeros(3), wrap_angle(np.diff(angle, axis=0))]), axis=0)
    at = np.stack([np.interp(times, t, position[:, k]) for k in range(3)], axis=1)
    roll, pitch, yaw = (np.interp(times, t, angle[:, k]) for k in range(3))
    return at, rotation_matrices(roll, pitch, yaw)
