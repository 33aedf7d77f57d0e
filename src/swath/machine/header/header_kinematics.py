"""Header kinematics: points of it for any angle of feeder and header."""

from math import cos, sin

import numpy as np

from swath.core.frames import Array, Pose
from swath.machine.machine_sheet import MachineSheet
from swath.signals.setup import MachineGeometry

PIVOT = (0.0, 1.5)  # feeder pivot of a sheet without masses: x [m ahead of the fixed axle], z [m]
TILT_Z = 0.8  # height of the header's tilt pivot of such a sheet [m]


class HeaderKinematics:
    """Feeder turning about a cross axis, header turning about a long axis in front of it.

    With both angles 0 the knife lies level in the machine frame at the sheet's place and at `height` [m].
    arm: from the feeder pivot to the knife, along x [m]; knife_x: ahead of the fixed axle [m]
    """

    def __init__(self, machine: MachineGeometry, height: float) -> None:
        masses = machine.masses if isinstance(machine, MachineSheet) else None
        self._pivot = PIVOT if masses is None else (masses.feeder_x, masses.feeder_z)
        self._tilt_z = TILT_Z if masses is None else masses.header_z
        self.knife_x, self._y, self._height = machine.knife_x, machine.header_y, height
        self.half = 0.5 * machine.header_width
        self.arm = self.knife_x - self._pivot[0]

    @property
    def axes(self) -> tuple[float, float, float]:
        """Where it turns: x and z of the feeder pivot, z of the tilt pivot, in the machine frame [m]."""
        return self._pivot[0], self._pivot[1], self._tilt_z

    def points(self, behind: Array, across: Array, lift: float, tilt: float) -> Array:
        """Points at the knife's level in the machine frame [m], (n, 3).

        behind: behind the knife [m]; across: leftward from the header's middle [m]; both (n,)
        lift: > 0 raised; tilt: > 0 left side up [rad]
        """
        x, y = self.knife_x - behind, self._y + across
        ct, st, cl, sl = cos(tilt), sin(tilt), cos(lift), sin(lift)
        below = self._height - self._tilt_z
        z = self._tilt_z + y * st + below * ct - self._pivot[1]
        y = y * ct - below * st
        x = x - self._pivot[0]
        turned = (self._pivot[0] + x * cl - z * sl, y, self._pivot[1] + x * sl + z * cl)
        return np.stack(turned, axis=1)

    def pose(self, lift: float, tilt: float) -> Pose:
        """Of the header in the machine frame, identity with both angles [rad] 0."""
        leaning = Pose.from_euler([0.0, 0.0, self._tilt_z], roll=tilt)
        lifted = Pose.from_euler([self._pivot[0], 0.0, self._pivot[1]], pitch=-lift)
        to_tilt, to_pivot = (Pose(-p, np.eye(3)) for p in (leaning.position, lifted.position))
        return lifted @ to_pivot @ leaning @ to_tilt
