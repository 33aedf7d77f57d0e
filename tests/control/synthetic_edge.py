"""Scans of a crop edge from a closed-form canopy: no plants, only the chance that a ray gets through.

A ray that has passed a horizontal path in a stand of n stems/m2 is stopped with the hazard n(z) (d(z) + w)
per metre, n(z) the stems that reach the height z, d their width there (ear, stem), w the width of the spot in
which the nearest touched element counts (w = 0: a thin ray). That is the survival
S = exp(-cot(beta) * integral of n (d + w) dz) of a level stand, for any path and with an edge.
"""

from dataclasses import dataclass
from math import erf

import numpy as np

from swath.core.frames import Pose
from swath.signals import Scan

EAR, EAR_LENGTH, STEM = 0.012, 0.09, 0.0035
MOUNT_HEIGHT, MOUNT_AHEAD = 2.4, 8.0
RELIEF = 0.6  # m that rolling ground lies higher or lower than below the machine, where it is seen
_Z = np.linspace(-5.0, 5.0, 501)
NORMAL = _Z, np.array([0.5 * (1.0 + erf(z / np.sqrt(2.0))) for z in _Z])


def mounting(side="left", *, outside=0.3, ahead=MOUNT_AHEAD, height=MOUNT_HEIGHT, knife_x=4.0, half=6.0):
    """pose_machine_sensor at the header end, `outside` [m] beyond it, middle beam `ahead` [m]."""
    sign = 1.0 if side == "left" else -1.0
    return Pose.from_euler([knife_x, sign * (half + outside), height], pitch=np.arctan2(height, ahead))


def hazard_table(density, tip, cv, spot, heights):
    """Hazard per metre of horizontal path at `heights` [m], `density` stems/m2 with tips N(tip, cv)."""

    def above(z):
        return 0.5 * (1.0 - np.array([erf((v - tip) / (cv * tip * np.sqrt(2.0))) for v in z]))

    stems = above(heights + EAR_LENGTH)
    ears = above(heights) - stems
    return density * (stems * (STEM + spot) + ears * (EAR + spot))


@dataclass
class Stand:
    """inside(x, y) -> signed distance [m] to the edge, > 0 in the crop; gaps: no crop from x to x [m].

    lean: standard deviation of the stems' lean across the edge, aside per height: feet end at the edge, of
    what stands at a height z only the part Phi(distance / (lean z)) is there; tilt: mean lean into the crop
    ground(x) -> height of the ground [m], on which the machine stands with its slope
    """

    inside: object
    density: float = 500.0
    tip: float = 0.85
    cv: float = 0.08
    stubble: float = 0.15
    spot: float = 0.0
    soil: float = 0.012
    gaps: tuple = ()
    lean: float = 0.0
    tilt: float = 0.0
    ground: object = None


@dataclass
class Scanner:
    """A 2-D scanner at a machine pose (x, y, yaw) with roll and pitch the machine does not know."""

    stand: Stand
    mounting: Pose
    field_deg: float = 100.0
    step_deg: float = 0.5
    noise: float = 0.007
    sweep: float = 0.0

    def __post_init__(self):
        half = 0.5 * self.field_deg
        self.azimuth = np.deg2rad(np.arange(-half, half + 1e-6, self.step_deg))
        self.z = np.linspace(0.0, 1.5, 151)
        s = self.stand
        self.crop = hazard_table(s.density, s.tip, s.cv, s.spot, self.z)
        self.cut = hazard_table(s.density, s.stubble, 0.15, s.spot, self.z)

    def scan(self, t, pose, rng, roll=0.0, pitch=0.0):
        """Scan stamped t [ns] from the machine pose (x, y, yaw) [m, m, rad]."""
        s = self.stand
        below = 0.0
        if s.ground is not None:
            below, ahead = (float(s.ground(np.array(pose[0] + dx * np.cos(pose[2])))) for dx in (0.0, 0.1))
            pitch -= np.arctan2(ahead - below, 0.1)
        machine = Pose.from_euler([pose[0], pose[1], below], roll=roll, pitch=pitch, yaw=pose[2])
        origin = machine.apply(self.mounting.position)
        a = self.azimuth
        beams = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], axis=-1)
        directions = machine.turn(self.mounting.turn(beams))
        down = np.minimum(directions[:, 2], -1e-3)
        top = 1.3 if s.tip > 0.3 else 0.5
        level = np.linspace(top, 0.0, 120)
        if s.ground is not None:
            level = below + np.linspace(top + RELIEF, -RELIEF, 240)
        length = (level[None, :] - origin[2]) / down[:, None]
        x = origin[0] + length * directions[:, 0:1]
        y = origin[1] + length * directions[:, 1:2]
        level = level[None, :] - (0.0 if s.ground is None else s.ground(x))  # from here on above the ground
        depth = s.inside(x, y) - (s.tilt * level if s.tilt else 0.0)
        for start, stop in s.gaps:
            depth = np.where((x > start) & (x < stop), -1.0, depth)
        crop, cut = (np.interp(level, self.z, hazard) for hazard in (self.crop, self.cut))
        if s.lean > 0 or s.spot > 0:
            if s.lean > 0:
                share = np.interp(depth / np.maximum(s.lean * level, 1e-3), NORMAL[0], NORMAL[1])
            else:
                share = np.clip(depth / s.spot + 0.5, 0.0, 1.0)
            hazard = share * crop + (1 - share) * cut
        else:
            hazard = np.where(depth > 0, crop, cut)
        path = np.hypot(directions[:, 0], directions[:, 1])[:, None] * np.diff(length, axis=1)
        optical = np.cumsum(hazard[:, 1:] * path, axis=1)  # down to each level but the first
        drawn = rng.exponential(size=len(a))
        hit = 1 + np.count_nonzero(optical < drawn[:, None], axis=1)
        rows, last = np.arange(len(a)), level.shape[1] - 1
        lands = last + 1 if s.ground is None else np.minimum((level > 0.0).sum(axis=1), last)
        stopped = hit < lands
        hit = np.minimum(hit, last)
        within = rng.uniform(size=len(a))
        ranges = length[rows, hit] - within * (length[rows, hit] - length[rows, np.maximum(hit - 1, 0)])
        away = -origin[2] / down if s.ground is None else length[rows, lands]
        away = away + s.soil * rng.standard_normal(len(a)) / down
        ranges = np.where(stopped, ranges, away) + self.noise * rng.standard_normal(len(a))
        ranges = np.where((ranges > 0.2) & (ranges < 60.0), ranges, np.nan).astype(np.float32)[:, None]
        return Scan(t, np.linspace(-self.sweep, 0, len(a)), a, np.zeros_like(a), ranges, np.ones_like(ranges))
