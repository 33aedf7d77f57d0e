"""From a scan to a profile: echoes in the machine frame, on one side of the mirror.

Detectors work in (x, u, z): x forward, u TOWARD THE CROP, z up from the machine's ground plane. With the edge
at the left header end the crop lies to the right, so u = -y; with the edge at the right end u = +y. All later
arithmetic is the same for both sides, so left and right give mirrored results exactly.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from math import isfinite

import numpy as np

from swath.control.edge.shared import shared
from swath.core.frames import Pose
from swath.signals import F64, CropEdge, Scan, beam_directions


@dataclass(frozen=True)
class Profile:
    """Usable echoes of one scan in the machine frame of the scan's time stamp.

    x, u, z [m], shape (echo_count,): ahead, toward the crop, above the machine's ground plane
    sensor: (x, u, z) of the sensor [m]
    """

    x: F64
    u: F64
    z: F64
    sensor: tuple[float, float, float]

    def below(self, top: float) -> "Profile":
        """Without the echoes above a height [m]."""
        keep = self.z < top
        return self if keep.all() else Profile(self.x[keep], self.u[keep], self.z[keep], self.sensor)


@dataclass(frozen=True)
class Reach:
    """Which echoes count. near, far: of the range [m]; low, high: of the height above ground [m]."""

    near: float = 1.0
    far: float = 25.0
    low: float = -1.5
    high: float = 2.2


def crop_sign(edge_side: str) -> float:
    """+1 when the crop lies to the left of the edge (y grows into it), -1 when it lies to the right."""
    return -1.0 if edge_side == "left" else 1.0


def finite(value: float) -> float:
    """A measured value, zero where there is none."""
    return float(value) if isfinite(value) else 0.0


def no_edge(t: int, reference: float) -> CropEdge:
    """That there is none at t [ns]; reference: where it would be told [m]."""
    nan = float("nan")
    return CropEdge(t, nan, nan, 0.0, reference, 0.0, nan, nan)


def _key(scan: Scan, mounting: Pose, sign: float, speed: float, yaw_rate: float, reach: Reach) -> Hashable:
    beams = (scan.ranges, scan.azimuth, scan.elevation, scan.beam_t)
    place = mounting.position.tobytes(), mounting.rotation.tobytes()
    return tuple(a.tobytes() for a in beams), scan.ranges.shape, place, sign, speed, yaw_rate, reach


@shared(_key)
def make_profile(
    scan: Scan, mounting: Pose, sign: float, speed: float, yaw_rate: float, reach: Reach
) -> Profile:
    """First echoes of the scan, moved to the time of its stamp (every beam has its own time).

    speed [m/s] and yaw_rate [rad/s] hold during the sweep. Beams without echo, with an echo nearer than
    `reach.near` (dust and chaff at the sensor: US 11,002,841) or outside the height range are left out.
    """
    ranges = scan.ranges[:, 0].astype(np.float64) if scan.ranges.size else np.zeros(0)
    usable = (ranges > reach.near) & (ranges < reach.far)
    usable &= np.isfinite(scan.azimuth) & np.isfinite(scan.elevation)
    directions = beam_directions(scan.azimuth[usable], scan.elevation[usable])
    points = mounting.apply(ranges[usable, None] * directions)
    ago = np.clip(np.nan_to_num(scan.beam_t[usable]), -0.5, 0.0)
    turn = yaw_rate * ago
    cos, sin = np.cos(turn), np.sin(turn)
    x = speed * ago + cos * points[:, 0] - sin * points[:, 1]
    y = 0.5 * speed * ago * turn + sin * points[:, 0] + cos * points[:, 1]
    z = points[:, 2]
    keep = (z > reach.low) & (z < reach.high)
    at = mounting.position
    return Profile(x[keep], sign * y[keep], z[keep], (float(at[0]), sign * float(at[1]), float(at[2])))
