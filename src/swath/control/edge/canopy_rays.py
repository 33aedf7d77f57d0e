"""Every beam of a scan as a ray through the canopy: the class of its answer, and where it counts.

A ray says one thing at one place. Where it was stopped, crop stands somewhere on its way from the top of the
canopy to its echo; where it went on, none stands between the top and the lower limit. Either is evidence at
that end of the way that lies deeper in the crop, less a part of a mean free path. The rays are followed in
compiled code (`canopy_kernel`).
"""

from dataclasses import dataclass
from math import atan2, cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.canopy_classes import GROUND_REACH, GROUND_SPREAD
from swath.control.edge.profile import Clears
from swath.control.edge.silent_beams import SilentBeams
from swath.core.component import KeepsState, State
from swath.core.frames import Pose
from swath.core.packed_state import saved_type
from swath.kernels import Row, filled, repeatable, shared, start_warp
from swath.signals import F64, Scan, beam_directions

FEW, MANY = 5, 20  # echoes near the plane before; so many elsewhere show that it was wrong
STEEP = 0.3  # slope of the plane at most
RELAX = 0.98  # part of the plane that is kept from scan to scan where the stubble sends no echoes


@dataclass(frozen=True)
class EdgeFrame:
    """An arc in the machine's (x, u): a point on it [m], its angle [rad] and bend [1/m] there."""

    x: float
    u: float
    angle: float
    bend: float


@saved_type()
@dataclass(frozen=True)
class RayAnswers:
    """What the rays of a scan say.

    cells: place and class of those that count, flat index of (PLACES, CLASSES)
    solid: which of them stand as they did in the scan before, and do not hang in the air
    along: sum of the places along the edge ahead of the frame's origin of `close` rays near it [m]
    ahead: of the same, echoes in the canopy along the edge ahead of the frame's origin [m], else nan
    height: of the echo above the stubble side [m], nan = none
    stands: as `solid`
    upper, lower: beside the edge at the crop's top and at the lower limit [m]; of every ray that falls, (n,)
    rise: of upright plants toward the crop, by which places were moved to the feet, per height [1]
    across: angle at which the rays to the edge cross it, > 0 into the crop [rad]
    """

    cells: NDArray[np.int64]
    solid: NDArray[np.bool_]
    ahead: F64
    along: float
    close: int
    height: F64
    stands: NDArray[np.bool_]
    upper: F64
    lower: F64
    rise: float = 0.0
    across: float = 0.0


class Ground(Clears):
    """The stubble side as a plane across the line of travel: z = level + slope (u - u0) [m].

    Weighted least squares on the echoes beside the edge; those far from the plane, weeds and straw, hardly
    count. The plane before is the prior, so that dust and gaps leave it.

    middle: x and u - u0 of the echoes near it [m], None where the last scan showed too few
    """

    kept = ("level", "slope", "is_known", "middle")

    OUTSIDE = (-3.5, -0.25)  # m beside the edge
    WORTH, FIRST_WORTH = (6.0, 60.0), (2.0, 2.0)  # echoes, and their m2, that the plane before is worth

    def clear(self) -> None:
        """Take the ground as level with the machine."""
        self.level, self.slope, self.is_known = 0.0, 0.0, False
        self.middle: tuple[float, float] | None = None

    def take(self, x: F64, u: F64, z: F64, fitted: tuple[float, float], close: int) -> None:
        """Echoes of the stubble side, u from the edge [m], `close` of them near the plane before.

        fitted: the plane (level, slope) through these, the one before being known
        """
        self._renew(u, z, fitted, close)
        near = np.abs(z - self.level - self.slope * u) < GROUND_SPREAD
        is_seen = self.is_known and np.count_nonzero(near) >= FEW
        self.middle = (float(x[near].mean()), float(u[near].mean())) if is_seen else None

    def _renew(self, u: F64, z: F64, fitted: tuple[float, float], close: int) -> None:
        if close < FEW and len(z) >= MANY:
            self.clear()
            self.level = float(np.percentile(z, 25.0))
        elif close < FEW:
            self.level, self.slope = RELAX * self.level, RELAX * self.slope
            if close == 0 or not self.is_known:
                return
        elif self.is_known:
            self._set(*fitted)
            return
        self._set(*self._fit(u, z))

    def _set(self, level: float, slope: float) -> None:
        self.level, self.slope, self.is_known = level, min(max(slope, -STEEP), STEEP), True

    def _fit(self, u: F64, z: F64) -> tuple[float, float]:
        near = np.abs(z - self.level) < GROUND_REACH
        if not near.any():
            return self.level, self.slope
        middle = float(u[near].mean())
        u, z = u[near] - middle, z[near]
        prior, steep = self.WORTH if self.is_known else self.FIRST_WORTH
        level, slope, spreads = self.level + self.slope * middle, self.slope, 2 * [GROUND_SPREAD]
        if not self.is_known:
            level = float(np.median(z))
            spreads.insert(0, GROUND_REACH)  # any slope, then the nearest plane
        before = level
        for spread in spreads:
            weight = 1.0 / (1.0 + ((z - level - slope * u) / spread) ** 2) ** 2
            s0, s1, s2 = (float(v.sum()) for v in (weight, weight * u, weight * u * u))
            s0, s2 = s0 + prior, s2 + steep
            b0 = float((weight * z).sum()) + prior * before
            b1 = float((weight * u * z).sum()) + steep * self.slope
            det = s0 * s2 - s1**2
            level, slope = (s2 * b0 - s1 * b1) / det, (s0 * b1 - s1 * b0) / det
            if spread == GROUND_REACH:
                level = before = float(np.percentile(z - slope * u, 25.0))
        return level - slope * middle, slope


class CanopyRays(KeepsState):
    """The rays of one scanner. mounting: pose_machine_sensor; sign: > 0 where the crop is on the left.

    silent: beams that are left out
    """

    kept = ("silent", "_seen")

    def __init__(self, mounting: Pose, sign: float) -> None:
        self._mounting, self._sign = mounting, sign
        self.silent = SilentBeams()
        self._beams: tuple[Any, ...] = ()
        self._good: Any = None
        self._count, self._room = 0, -1
        self._across = 0.0
        self._before: F64 = np.zeros(0)  # ranges in the last scan of the beams that fall [m], nan = no echo

    def clear(self) -> None:
        """Let all beams count again."""
        self.silent.clear()
        self._beams = ()
        self._before[:] = np.nan

    @property
    def _seen(self) -> F64:
        return self._before.copy()

    @_seen.setter
    def _seen(self, seen: F64) -> None:
        if len(seen) > len(self._before):
            self._compile(len(seen))
        self._before[: len(seen)] = seen

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self._beams = ()

    def take(
        self,
        scan: Scan,
        motion: tuple[float, float],
        frame: EdgeFrame,
        ground: Ground,
        low: float,
        high: float,
    ) -> None:
        """Follow the beams of a scan, each from its own time, and renew the ground.

        motion: speed [m/s], turn rate [rad/s] > 0 toward the crop; frame: where the edge is expected
        low, high: of what lies on the stubble side, beside the edge [m]
        """
        if scan.ranges.size and self.silent.take(scan.ranges[:, 0] > 0.0):
            self._beams = ()
        self._point(scan)
        if scan.ranges.size:
            ranges = scan.ranges[:, 0]
            self._ranges[: self._count] = ranges if self._good is None else ranges[self._good]
        else:
            self._ranges[: self._count] = np.nan
        speed, yaw_rate = motion
        arc = frame.x, frame.u, cos(frame.angle), sin(frame.angle), frame.bend
        plane = ground.level, ground.slope, *Ground.WORTH
        turning = self._sign, *self._mounting.position.tolist()
        self._way.write(self._count, speed, yaw_rate, *turning, *arc, low, high, *plane)
        self._trace()
        x, y, _ = self._mounting.position.tolist()
        self._across = atan2(frame.u - self._sign * y, frame.x - x) - frame.angle
        falling, beside, close = self._counts.tolist()
        self._falling = falling
        level, slope = self._plane.tolist()
        ground.take(self._x[:beside], self._u[:beside], self._z[:beside], (level, slope), close)

    def answers(
        self, ground: Ground, grade: float, crop_height: float, rise: tuple[float, float]
    ) -> RayAnswers:
        """Class and place of every ray of the scan taken last.

        grade: by which the stubble rises ahead [1]; crop_height [m]; rise: how far a plant's top stands ahead
        and toward the crop of its foot, per height [1]: places are those of the feet
        """
        n = self._falling
        x = ground.middle[0] if ground.middle is not None else 0.0
        self._crop.write(n, ground.level, ground.slope, x, grade, crop_height, *rise)
        self._answer()
        counted, close, _ = self._counts.tolist()
        height, upper, lower = (column[:n].copy() for column in self._columns)
        cells, ahead = self._cells[:counted].copy(), self._ahead[:counted].copy()
        along, solid, stands = float(self._along[0]), self._solid[:counted] > 0, self._stands[:n] > 0
        return RayAnswers(
            cells, solid, ahead, along, close, height, stands, upper, lower, rise[1], self._across
        )

    def _point(self, scan: Scan) -> None:
        """Directions in the machine frame and times of the beams, where they are not those before."""
        beams = scan.azimuth, scan.elevation, scan.beam_t
        if len(self._beams) == 3 and all(a is b for a, b in zip(beams, self._beams, strict=True)):
            return
        self._beams = beams
        good = np.isfinite(scan.azimuth) & np.isfinite(scan.elevation)
        if len(self.silent.is_dead) == len(good):
            good &= ~self.silent.is_dead
        self._count = int(np.count_nonzero(good))
        self._good = None if self._count == len(good) else good
        if self._count > self._room:
            self._compile(self._count)
        aim = self._mounting.turn(beam_directions(scan.azimuth[good], scan.elevation[good]))
        self._directions[: self._count] = aim
        self._ago[: self._count] = np.clip(np.nan_to_num(scan.beam_t[good]), -0.5, 0.0)

    def _compile(self, room: int) -> None:
        """Launches over memory for so many beams."""
        from swath.control.edge import canopy_kernel as kernel

        self._room = room
        self._way, self._crop = Row(kernel.Way), Row(kernel.Canopy)
        self._directions, start, aim = (np.zeros((room, 3)) for _ in range(3))
        self._ago, self._ranges, distance, self._x, self._u, self._z = (np.zeros(room) for _ in range(6))
        self._columns = tuple(np.zeros(room) for _ in range(3))
        self._cells, self._solid, self._ahead = (
            np.zeros(room, np.int64),
            np.zeros(room, np.int32),
            np.zeros(room),
        )
        self._before, self._stands = np.full(room, np.nan), np.zeros(room, np.int32)
        self._counts = np.zeros(3, np.int32)
        self._plane, self._along = np.zeros(2), np.zeros(1)
        seen = {"before": self._before, "stands": self._stands, "x": self._x, "u": self._u, "z": self._z}
        rays = filled(kernel.Traced, start=start, aim=aim, distance=distance, **seen)
        columns = dict(zip(("height", "upper", "lower"), self._columns, strict=True))
        answers = filled(kernel.Answers, cell=self._cells, solid=self._solid, ahead=self._ahead, **columns)

        directions = shared(self._directions, start_warp().vec3d)
        ago, ranges, plane, along, counts = (
            shared(a) for a in (self._ago, self._ranges, self._plane, self._along, self._counts)
        )
        inputs = [self._way.array, directions, ago, ranges, rays, plane, counts]
        self._trace = repeatable(kernel.trace, inputs).launch
        inputs = [self._way.array, self._crop.array, rays, answers, along, counts]
        self._answer = repeatable(kernel.answer, inputs).launch
