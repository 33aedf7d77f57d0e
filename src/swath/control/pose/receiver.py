"""From the antenna of a receiver to the machine below it."""

from math import atan2, cos, hypot, sin

from swath.control.inclination import Inclination
from swath.core.errors import InputError
from swath.signals.setup import ControlSetup


class AntennaPlace:
    """Where the antenna stands over the fixed axle, by its mounting and the inclination of the machine.

    height: above the ground [m]
    """

    def __init__(self, setup: ControlSetup, port: str = "fix") -> None:
        mounting = setup.mountings.get(port)
        if mounting is None:
            expected = f"expected a receiver whose place is known, wired as {port}: gnss.fix"
            raise InputError("wires", port, f"{expected}; of a log antenna_m or mount says it")
        self._at: tuple[float, float, float] = tuple(mounting.position.tolist())
        self.height = self._at[2]
        self.inclination = Inclination(setup.mountings.get("inertial"))

    def offset(self) -> tuple[float, float]:
        """The antenna ahead of the axle and to its left, measured level along the heading [m].

        A point p of the machine, with the vertical u in its frame, lies p - (p.u) u beside the vertical
        through the origin; ahead is x without its part along u.
        """
        ux, uy, uz = (float(v) for v in self.inclination.up)
        px, py, pz = self._at
        ahead_x, ahead_z = 1.0 - ux * ux, -ux * uz
        ahead_y = -ux * uy
        size = hypot(ahead_x, ahead_y, ahead_z)
        fx, fy, fz = ahead_x / size, ahead_y / size, ahead_z / size
        lx, ly, lz = uy * fz - uz * fy, uz * fx - ux * fz, ux * fy - uy * fx
        return px * fx + py * fy + pz * fz, px * lx + py * ly + pz * lz

    def course_lead(self, speed: float, yaw_rate: float) -> float:
        """Direction of travel of the antenna to the left of that of the axle [rad]."""
        ahead, left = self.offset()
        along = speed - yaw_rate * left
        return 0.0 if abs(along) < 0.05 else atan2(yaw_rate * ahead, along)

    def axle(self, x: float, y: float, heading: float) -> tuple[float, float]:
        """The axle's centre below an antenna at x, y [m], of a machine with that heading [rad]."""
        ahead, left = self.offset()
        c, s = cos(heading), sin(heading)
        return x - c * ahead + s * left, y - s * ahead - c * left
