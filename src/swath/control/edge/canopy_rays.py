"""Every beam of a scan as a ray through the canopy: the class of its answer, and where it counts.

A ray says one thing at one place. Where it was stopped, crop stands somewhere on its way from the top of the
canopy to its echo; where it went on, none stands between the top and the lower limit. Either is evidence at
that end of the way that lies deeper in the crop, less a part of a mean free path.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.component import KeepsState
from swath.core.frames import Pose
from swath.core.portable import solve
from swath.signals import F64, Scan, beam_directions

I64 = NDArray[np.int64]

NEAR, FAR = 1.0, 25.0  # m: nearer echoes are dust or chaff at the scanner
LAYER, LOWEST, LAYERS = 0.06, -0.3, 46  # m, m, number: the layers of height that make the classes
DUST, NOTHING, CLASSES = LAYERS, LAYERS + 1, LAYERS + 2  # two more: above the crop or near, no echo at all
HEADROOM, ROOM = 1.25, 0.3  # [1], [m]: an echo this much above the crop's height is no crop
LIMIT = 0.3  # of the crop's height: a ray below it has gone on
INWARD = 0.03  # m at most, of its way that a ray going into the crop counts before its end
OUTWARD, OUTWARD_SHARE = 0.12, 0.35  # m at most, share of its way: the same of a ray coming out of it
FEW, MANY = 5, 20  # echoes near the plane before; so many elsewhere show that it was wrong
RELAX = 0.98  # part of the plane that is kept from scan to scan where the stubble sends no echoes
STEEPEST = -0.05  # a beam that falls less than this per metre never reaches the ground


@dataclass(frozen=True)
class Beams:
    """All beams in the (x, u, z) frame of the machine at the scan's time: x forward, u toward the crop, z up.

    start, aim: (3, n), where a beam begins [m] and its unit direction; ranges (n,) [m], nan = no echo
    """

    start: F64
    aim: F64
    ranges: F64

    def at(self, reach: F64) -> F64:
        """Points (3, n) at distances (n,) [m] along the beams."""
        return self.start + reach * self.aim


def make_beams(scan: Scan, mounting: Pose, sign: float, speed: float, yaw_rate: float) -> Beams:
    """Beams of a scan, each from its own time; speed [m/s], yaw_rate [rad/s] > 0 toward the crop."""
    good = np.isfinite(scan.azimuth) & np.isfinite(scan.elevation)
    aim = mounting.turn(beam_directions(scan.azimuth[good], scan.elevation[good])).T
    ranges = scan.ranges[good, 0].astype(np.float64) if scan.ranges.size else np.full(int(good.sum()), np.nan)
    ago = np.clip(np.nan_to_num(scan.beam_t[good]), -0.5, 0.0)
    turn = sign * yaw_rate * ago
    cos, sin = np.cos(turn), np.sin(turn)
    x, y, z = mounting.position
    start = np.stack(
        [
            speed * ago + cos * x - sin * y,
            sign * (0.5 * speed * ago * turn + sin * x + cos * y),
            z + 0.0 * ago,
        ]
    )
    aim = np.stack([cos * aim[0] - sin * aim[1], sign * (sin * aim[0] + cos * aim[1]), aim[2]])
    falls = aim[2] < STEEPEST
    with np.errstate(invalid="ignore"):
        ranges = np.where((ranges > 0.0) & (ranges < FAR), ranges, np.nan)
    return Beams(start[:, falls], aim[:, falls], ranges[falls])


class Ground(KeepsState):
    """The stubble side as a plane across the line of travel: z = level + slope (u - u0) [m].

    Weighted least squares on the echoes beside the edge; those far from the plane, weeds and straw, hardly
    count. The plane before is the prior, so that dust and gaps leave it.
    """

    kept = ("level", "slope", "is_known")

    OUTSIDE = (-3.5, -0.25)  # m beside the edge
    REACH, NEAR = 0.6, 1.5  # m: of the heights about the plane before; nearer echoes are puffs
    MOST = 1.0  # m above or below the machine's own ground plane: beyond are puffs
    SPREAD, MEMORY = 0.08, 6.0  # m; echoes that the plane before is worth, per m2 of spread

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Level with the machine."""
        self.level, self.slope, self.is_known = 0.0, 0.0, False

    def take(self, u: F64, z: F64) -> None:
        """Echoes of the stubble side, u from the edge [m]."""
        possible = np.abs(z) < self.MOST
        u, z = u[possible], z[possible]
        close = np.abs(z - self.level) < self.REACH
        count = np.count_nonzero(close)
        if count < FEW and len(z) >= MANY:
            self.clear()
            self.level = float(np.percentile(z, 25.0))
        elif count < FEW:
            self.level, self.slope = RELAX * self.level, RELAX * self.slope
            if count == 0 or not self.is_known:
                return
        close = np.abs(z - self.level) < self.REACH
        u, z = u[close], z[close]
        prior, steep = (self.MEMORY, 60.0) if self.is_known else (2.0, 20.0)
        level, slope = self.level, self.slope
        if not self.is_known:
            level = float(np.percentile(z - slope * u, 25.0))
        for _ in range(2):
            weight = 1.0 / (1.0 + ((z - level - slope * u) / self.SPREAD) ** 2) ** 2
            s0, s1, s2 = float(weight.sum()), float((weight * u).sum()), float((weight * u * u).sum())
            normal = np.array([[s0 + prior, s1], [s1, s2 + steep]])
            z0, z1 = float((weight * z).sum()), float((weight * u * z).sum())
            level, slope = solve(normal, np.array([z0 + prior * level, z1 + steep * self.slope])).tolist()
        self.level, self.slope = level, float(np.clip(slope, -0.3, 0.3))
        self.is_known = True


@dataclass(frozen=True)
class RayAnswers:
    """What the rays of a scan say, all (n,).

    along, beside: where a ray counts, along the edge ahead of the frame's origin and toward the crop [m]
    kind: class of the answer; height: of the echo above the stubble side [m], nan = none
    upper, lower: beside the edge at the crop's top and at the lower limit [m]
    """

    along: F64
    beside: F64
    kind: I64
    height: F64
    upper: F64
    lower: F64


@dataclass(frozen=True)
class EdgeFrame:
    """An arc in the machine's (x, u): a point on it [m], its angle [rad] and bend [1/m] there."""

    x: float
    u: float
    angle: float
    bend: float

    def place(self, x: F64, u: F64) -> tuple[F64, F64]:
        """(along, beside) the arc [m] of points; second order in the way along."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        dx, du = x - self.x, u - self.u
        along = c * dx + s * du
        return along, c * du - s * dx - 0.5 * self.bend * along * along


def answers(
    beams: Beams, frame: EdgeFrame, ground: Ground, crop_height: float, rise: tuple[float, float]
) -> RayAnswers:
    """Class and place of every ray.

    ground: the stubble side, u counted from the frame's; crop_height [m]; rise: how far a plant's top stands
    ahead and toward the crop of its foot, per height [1]: places are those of the feet
    """
    points = beams.at(beams.ranges)
    height = points[2] - ground.level - ground.slope * (points[1] - frame.u)
    limit = LIMIT * crop_height
    with np.errstate(invalid="ignore"):
        is_dust = (beams.ranges < NEAR) | (height > HEADROOM * crop_height + ROOM)
        is_stopped = ~is_dust & (height > limit)
        kind = np.clip((height - LOWEST) / LAYER, 0, LAYERS - 1)
    kind = np.where(np.isnan(height), NOTHING, np.where(is_dust, DUST, kind)).astype(np.int64)
    upper = _crossing(beams, frame, ground, crop_height, rise)
    lower = _crossing(beams, frame, ground, limit, rise)
    end = np.where(
        is_stopped,
        np.stack(frame.place(points[0] - rise[0] * height, points[1] - rise[1] * height)),
        lower,
    )
    way = end[1] - upper[1]
    back = np.where(way > 0.0, np.minimum(way, INWARD), np.minimum(-OUTWARD_SHARE * way, OUTWARD))
    inner = np.where(way > 0.0, end, upper)
    return RayAnswers(inner[0], inner[1] - back, kind, height, upper[1], lower[1])


def _crossing(
    beams: Beams, frame: EdgeFrame, ground: Ground, height: float, rise: tuple[float, float]
) -> F64:
    """(along, beside), (2, n), of where each ray is at a height above the stubble side, moved to the foot."""
    falls = beams.aim[2] - ground.slope * beams.aim[1]
    above = beams.start[2] - ground.level - ground.slope * (beams.start[1] - frame.u)
    points = beams.at(np.clip((height - above) / np.minimum(falls, -1e-3), 0.0, 2.0 * FAR))
    return np.stack(frame.place(points[0] - rise[0] * height, points[1] - rise[1] * height))
