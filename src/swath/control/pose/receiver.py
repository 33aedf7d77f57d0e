"""From the antenna of a receiver to the machine below it."""

from math import atan2, cos, hypot, sin

from swath.control.inclination import Inclination
from swath.control.pose.dead_reckoning import Step
from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.frames import wrapped
from swath.signals import Fix
from swath.signals.setup import ControlSetup

CHORD_M = 1.0  # a way between two fixes at least this long has a direction
CHORD_SD = 0.1  # rad: so well at least, too
ALIKE = 2.0  # times: ways by fixes and by wheels that differ by more are not the same


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
        size = max(hypot(ahead_x, ahead_y, ahead_z), 1e-9)  # 0: its nose points up
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


class ChordHeading(KeepsState):
    """Heading of a machine whose receiver gives no course: the way between two fixes, against the same way by
    wheels and gyroscope, so that a curve between them does no harm.
    """

    kept = ("_from",)

    def __init__(self, antenna: AntennaPlace) -> None:
        self._antenna = antenna
        self.clear()

    def clear(self) -> None:
        """No fix yet."""
        self._from: tuple[float, float, float, float] | None = None

    def take(self, fix: Fix, here: Step, position_sd: float) -> tuple[float, float] | None:
        """What headings of the dead reckoning lack, and its sd, both [rad]; None until the way is long.

        here: the axle in the frame of the dead reckoning when the fix was measured; position_sd [m]
        """
        ahead, left = self._antenna.offset()
        c, s = cos(here.heading), sin(here.heading)
        x, y = here.x + c * ahead - s * left, here.y + s * ahead + c * left
        if self._from is None:
            self._from = fix.x, fix.y, x, y
            return None
        east, north = fix.x - self._from[0], fix.y - self._from[1]
        along, across = x - self._from[2], y - self._from[3]
        measured, driven = hypot(east, north), hypot(along, across)
        sd = 2.0**0.5 * position_sd / max(driven, CHORD_M)
        if driven < CHORD_M or sd > CHORD_SD:
            return None
        self._from = fix.x, fix.y, x, y
        if not driven / ALIKE < measured < driven * ALIKE:
            return None
        return wrapped(atan2(north, east) - atan2(across, along)), sd
