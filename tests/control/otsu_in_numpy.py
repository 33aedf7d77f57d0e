"""The level `otsu` in numpy, a function a step: what its kernel is held against.

Profile of a scan, height step, track over several scans, overhang of the canopy (`CanopyOffset`).
"""

from dataclasses import dataclass
from math import atan, fsum, log, tan
from typing import ClassVar, NamedTuple

import numpy as np

from swath.control.edge.otsu import Params, footprint
from swath.control.edge.profile import crop_sign
from swath.control.inclination import CRAB, Inclination
from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.frames import Pose
from swath.core.portable import median, product, solve
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG, MM
from swath.signals import F64, CropEdge, Inertial, Odometry, Scan, beam_directions
from swath.signals.setup import ControlSetup
from tests.control.canopy_learned import CanopyOffset, Rays


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


def finite(value):
    """A measured value, zero where there is none."""
    return float(value) if np.isfinite(value) else 0.0


def no_edge(t, reference):
    """No edge at t [ns]; one would be reported at the reference [m]."""
    return CropEdge(t, np.nan, np.nan, 0.0, reference, 0.0, np.nan, np.nan)


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


TUKEY = 4.685  # 95 % efficiency on normal errors; Beaton & Tukey 1974, doi:10.1080/00401706.1974.10489171
MAD = 1.4826  # normal standard deviation / median absolute deviation


class Line(NamedTuple):
    """u(x) = offset + slope (x - x0) + bend (x - x0)^2 / 2, all in metres of the (x, u) frame."""

    x0: float
    offset: float
    slope: float
    bend: float

    def at(self, x: F64 | float) -> F64 | float:
        """u [m] at x [m]."""
        ahead = x - self.x0
        return self.offset + ahead * (self.slope + 0.5 * self.bend * ahead)

    def slope_at(self, x: F64 | float) -> F64 | float:
        """du/dx [1] at x [m]."""
        return self.slope + self.bend * (x - self.x0)

    def moved(self, distance: float, turn: float) -> "Line":
        """The same edge after the machine drove `distance` [m] and turned `turn` [rad] toward +u.

        First order in `turn`: for steps of a scan period.
        """
        offset = self.offset + distance * (self.slope + 0.5 * self.bend * distance)
        slope = self.slope + self.bend * distance
        turned = offset - self.x0 * turn + slope * offset * turn
        return Line(self.x0, turned, slope - turn * (1.0 + slope * slope), self.bend)


@dataclass(frozen=True)
class Prior:
    """How far an edge may be from straight ahead: standard deviations of slope [1] and bend [1/m]."""

    slope: float = 0.07
    bend: float = 0.02


def fit_line(x: F64, u: F64, variance: F64, x0: float, prior: Prior, start: Line | None) -> tuple[Line, F64]:
    """Weighted robust parabola through edge points, and each point's remaining weight (0 = outlier).

    x, u [m], variance [m2], shape (point_count,), at least one point. Iteratively reweighted least squares
    with Tukey's biweight around `start` (around the weighted median when there is none). The prior keeps
    slope and bend near zero while the points are too few or too close together to tell.
    """
    ahead = x - x0
    base = 1.0 / variance
    ridge = np.diag([0.0, 1.0 / prior.slope**2, 1.0 / prior.bend**2])
    if start is None:
        line = Line(x0, median(u), 0.0, 0.0)
    else:
        line = start
    robust = np.ones_like(u)
    basis = np.stack([np.ones_like(ahead), ahead, 0.5 * ahead * ahead])
    for _ in range(4):
        residual = u - line.at(x)
        spread = np.sqrt(variance + (MAD * median(np.abs(residual))) ** 2)
        robust = np.maximum(1.0 - (residual / (TUKEY * spread)) ** 2, 0.0) ** 2
        if float(robust.sum()) < 0.5:
            robust = np.ones_like(u)
        weighted = basis * (base * robust)
        normal = product(weighted, basis.T) + ridge
        offset, slope, bend = solve(normal, product(weighted, u))
        line = Line(x0, float(offset), float(slope), float(bend))
    return line, robust


# of a ray's way through the upper half of the crop, from its end nearer to the crop: there it counts. 0.36
# for 4 to 10 mean free paths of crop and a way across three times the overhang, 0.5 for one along the edge
MET = 0.35
ERROR_ODDS = 3.0  # nat: log odds of an echo being on the right side of a threshold between heights, 95 %


@dataclass(frozen=True)
class Gates:
    """When a step is an edge.

    min_step [m]: of the mean heights; min_points on each side; min_gain [nat] of two populations over one
    min_separation: mean step / root sum of the two variances; max_ground [m]: mean height of the stubble
    side above the machine's ground plane; window, search [m]: half width of the profile around a known edge,
    around the header end when there is none; resolution [m]: standard deviation no edge point is better than
    """

    min_step: float = 0.25
    min_points: int = 5
    min_gain: float = 15.0
    min_separation: float = 1.2
    max_ground: float = 0.6
    window: float = 3.0
    search: float = 5.0
    resolution: float = 0.02


@dataclass(frozen=True)
class Step:
    """An edge point. x, u [m]; variance [m2] of u; quality 0..1; crop_height, stubble_height [m].

    rays: of the profile; ground [m]: the foot of the stubble side in the machine frame
    separation: as in `Gates`
    """

    x: float
    u: float
    variance: float
    quality: float
    crop_height: float
    stubble_height: float
    rays: Rays
    ground: float
    separation: float


@dataclass(frozen=True)
class _Canopy:
    """Mean height of the stubble side, middle between both sides, top of the crop [m]."""

    low: float
    limit: float
    top: float


@dataclass(frozen=True)
class _Split:
    first: int  # index of the first crop point
    low: float
    high: float
    low_var: float
    high_var: float


def find_step(
    profile: Profile,
    expected: Line | None,
    centre: float,
    gates: Gates,
    rise: float | None = None,
) -> Step | None:
    """The edge point of one profile, None when it shows no edge.

    expected: the edge as known so far; lateral distances are taken from it, so that a heading error does not
    smear the step. centre [m]: u of the header end, where an edge is searched when none is known. rise: how
    far an upright plant's top stands toward +u of its foot, per height [1]; None = as the stubble side says
    """
    line = expected or Line(0.0, centre, 0.0, 0.0)
    lateral = profile.u - line.at(profile.x)
    inside = np.abs(lateral) < (gates.search if expected is None else gates.window)
    x, z, lateral = profile.x[inside], profile.z[inside], lateral[inside]
    if len(z) < 2 * gates.min_points:
        return None
    order = np.argsort(lateral, kind="stable")
    x, z, lateral = x[order], z[order], lateral[order]
    score, gain = split_by_otsu(z, gates.min_points)
    if not gain > 0.0:
        return None
    slope = _ground_slope(lateral, z, int(np.argmax(score)) + 1)
    level = z - slope * lateral
    canopy = _canopy(level, int(np.argmax(score)) + 1, profile.sensor[2])
    aside = -slope if rise is None else rise
    x, lateral, upper, lower = _through(x, lateral, level, canopy, aside, line, profile.sensor)
    order = np.argsort(lateral, kind="stable")
    x, level, lateral = x[order], level[order], lateral[order]
    met = np.where(level < canopy.limit, np.minimum(level, canopy.low), level)
    score, gain = split_by_otsu(met, gates.min_points)
    if not gain > gates.min_gain:
        return None
    found = _describe(level, int(np.argmax(score)) + 1)
    separation = (found.high - found.low) / np.sqrt(found.low_var + found.high_var + 1e-6)
    if found.high - found.low < gates.min_step or separation < gates.min_separation:
        return None
    if abs(found.low) > gates.max_ground:
        return None
    at, variance = _locate(lateral, score)
    ahead = _abreast(x, lateral - at, found.first)
    quality = float(min(max((separation - 0.5 * gates.min_separation) / gates.min_separation, 0.2), 1.0))
    crop, stubble, ground = _heights(level, found.first)
    return Step(
        ahead,
        float(line.at(ahead)) + at,
        variance + gates.resolution**2,
        quality,
        crop,
        stubble,
        Rays(upper[order], lower[order], level - ground, canopy.top - ground, canopy.limit - ground),
        ground,
        float(separation),
    )


def _describe(z: F64, first: int) -> _Split:
    low, high = z[:first], z[first:]
    return _Split(first, float(low.mean()), float(high.mean()), float(low.var()), float(high.var()))


def _ground_slope(lateral: F64, z: F64, first: int) -> float:
    """Lateral slope of the stubble side: the machine's roll against the ground ahead, unknown to control.

    Least squares, shrunk toward 0 by a roll of 2 deg standard deviation; points far from the mean count less.
    """
    w, h = lateral[:first], z[:first]
    middle = portable.median(h)
    weight = 1.0 / (1.0 + ((h - middle) / 0.1) ** 2)
    total = float(weight.sum())
    dw = w - float((weight * w).sum()) / total
    dh = h - float((weight * h).sum()) / total
    noise = float((weight * dh * dh).sum()) / total
    return float((weight * dw * dh).sum()) / (float((weight * dw * dw).sum()) + noise / 0.035**2 + 1e-9)


def _canopy(z: F64, first: int, sensor_z: float) -> _Canopy:
    """Of levelled heights in lateral order, the crop from `first` on; its top stays below the scanner."""
    low, high = float(z[:first].mean()), np.sort(z[first:])
    limit = 0.5 * (low + float(high.mean()))
    top = min(float(high[int(0.9 * len(high))]), sensor_z - 0.3)
    return _Canopy(low, limit, max(top, limit))


def _through(
    x: F64,
    lateral: F64,
    z: F64,
    canopy: _Canopy,
    rise: float,
    line: Line,
    sensor: tuple[float, float, float],
) -> tuple[F64, F64, F64, F64]:
    """(x, lateral) where each ray counts, its lateral at the top and at the lower limit of the canopy [m].

    A ray says one thing: it was stopped in the upper half of the crop, or not. Where beside the edge it says
    so must not depend on which of both it was, or rays that cross the edge at an angle, in a bend, would show
    it elsewhere than rays along it: stopped only after a mean free path, or free in the shadow of the stand.
    A ray that crosses is stopped mostly near that end of its way that lies deeper in the crop. In the frame
    of a rolled machine the crop leans by the rise: laterals are those of the feet.
    """
    upper_x, upper = _crossing(x, lateral, z, canopy.top, line, sensor)
    lower_x, lower = _crossing(x, lateral, z, canopy.limit, line, sensor)
    upper = upper - rise * (canopy.top - canopy.low)
    lower = lower - rise * (canopy.limit - canopy.low)
    share = np.where(upper > lower, 1.0 - MET, MET)
    at_x, at = share * upper_x + (1.0 - share) * lower_x, share * upper + (1.0 - share) * lower
    return at_x, at, upper, lower


def _crossing(
    x: F64, lateral: F64, z: F64, height: float, line: Line, sensor: tuple[float, float, float]
) -> tuple[F64, F64]:
    """(x, lateral) [m] where every ray is, or would have been without its echo, at a height [m]."""
    share = np.minimum(np.maximum((sensor[2] - height) / np.maximum(sensor[2] - z, 0.1), 0.0), 2.0)
    at_x = sensor[0] + share * (x - sensor[0])
    at_u = sensor[1] + share * (lateral + line.at(x) - sensor[1])
    return at_x, at_u - line.at(at_x)


def _locate(lateral: F64, score: F64) -> tuple[float, float]:
    """Mean and variance of the edge under the likelihood of all splits, uniform within each gap of beams."""
    gap = np.diff(lateral)
    middle = 0.5 * (lateral[1:] + lateral[:-1])
    chance = portable.exp(score - score.max()) * np.minimum(np.maximum(gap, 1e-3), 0.3)
    chance /= chance.sum()
    mean = float((chance * middle).sum())
    return mean, float((chance * ((middle - mean) ** 2 + gap * gap / 12.0)).sum())


def _abreast(x: F64, beside: F64, first: int) -> float:
    """x [m] at which the edge point holds: midway between the crop's and the stubble's echoes next to it.

    Not the x of the two echoes that happen to enclose the edge: it jumps by metres along the assumed heading,
    and the line through such points would confirm whatever heading was assumed.
    """
    close = np.abs(beside) < 1.0
    low, high = x[:first][close[:first]], x[first:][close[first:]]
    middle = [portable.median(side) for side in (low, high) if len(side)]
    return fsum(middle) / len(middle) if middle else portable.median(x)


def _heights(z: F64, first: int) -> tuple[float, float, float]:
    """(crop, stubble, ground) [m]: 90th percentiles of both sides above the 10th of the stubble side; it."""
    low, high = np.sort(z[:first]), np.sort(z[first:])
    ground = low[int(0.1 * len(low))]
    return float(high[int(0.9 * len(high))] - ground), float(low[int(0.9 * len(low))] - ground), float(ground)


def otsu_threshold(z: F64) -> tuple[float, float]:
    """(threshold [m], share of the variance that lies between the two classes) of values, shape (n,)."""
    n = len(z)
    ordered = np.sort(z)
    centred = np.cumsum(ordered - ordered.mean())[:-1]
    low_count = np.arange(1, n, dtype=np.float64)
    between = centred**2 / (low_count * (n - low_count))
    best = int(np.argmax(between))
    total = float(np.var(z))
    share = float(between[best]) / total if total > 0.0 else 0.0
    return 0.5 * float(ordered[best] + ordered[best + 1]), share


def split_by_otsu(z: F64, min_points: int) -> tuple[F64, float]:
    """`split_at` the threshold of these very heights."""
    return split_at(otsu_threshold(z)[0] if len(z) > 1 else 0.0, z, min_points)


def split_at(threshold: float, z: F64, min_points: int) -> tuple[F64, float]:
    """Log-odds of a step before each of the points 1..n-1 from the echoes it would leave on the wrong side.

    threshold [m]; z: heights in lateral order, stubble first [m], shape (n,). Shape (n - 1,), -inf where a
    side has fewer than `min_points`. The gain [nat] is the log-likelihood of the best split over no step,
    both with an echo's side as a coin of its observed chance.
    """
    n = len(z)
    if n < 2 * min_points:
        return np.full(max(n - 1, 0), -np.inf), 0.0
    is_high = z > threshold
    high_before = np.cumsum(is_high)[:-1]
    low_after = (n - is_high.sum()) - (np.arange(1, n) - high_before)
    wrong = high_before + low_after
    score = -ERROR_ODDS * wrong.astype(np.float64)
    count = np.arange(1, n)
    allowed = (count >= min_points) & (n - count >= min_points)
    score[~allowed] = -np.inf
    best = int(np.argmax(score))
    gain = _coin(int(is_high.sum()), n) - _coin(int(wrong[best]), n)
    return score, max(gain, 0.0)


def _coin(count: int, n: int) -> float:
    """Entropy [nat] of n draws of which `count` fell on one side."""
    share = min(max(count / n, 1e-9), 1.0 - 1e-9)
    return -n * (share * log(share) + (1.0 - share) * log(1.0 - share))


X, U, VARIANCE, QUALITY, AGE, IS_USED, SLOPE, COLUMNS = range(8)
SCANS_PER_SAMPLE = 8.0  # successive scans see the same stems: edge points per independent sample
LEVER = 1.2  # m, by which the place of an edge point in its scan is unsure along the assumed heading


@dataclass(frozen=True)
class Memory:
    """How a track remembers. Times [s], lengths [m].

    window: of travel whose points are fitted; window_s: and their greatest age; gate: lateral distance within
    which a point belongs to the edge; lost_s: without a point until the edge counts as lost; acquire_s: of
    consistent points until an edge counts as found; jump_s: the same when it lies beside the remembered one;
    forget_s: until a lost edge is forgotten; min_share: of scans that must show the edge
    """

    window: float = 7.5
    window_s: float = 6.0
    gate: float = 0.35
    lost_s: float = 0.4
    acquire_s: float = 0.2
    jump_s: float = 1.5
    forget_s: float = 4.0
    min_share: float = 0.6


class EdgeTrack(KeepsState):
    """The edge over time, in the (x, u) frame of the machine now."""

    kept = ("_rows", "line", "is_found", "_unseen")

    def __init__(self, memory: Memory, prior: Prior, x0: float) -> None:
        self._memory, self._prior, self._x0 = memory, prior, x0
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._rows: F64 = np.zeros((0, COLUMNS))
        self.line: Line | None = None
        self.is_found = False
        self._unseen = 0.0

    def move(self, distance: float, turn: float, dt: float, crab: float = 0.0) -> None:
        """The machine drove `distance` [m], turned `turn` [rad] toward +u, within `dt` [s].

        crab: its direction of travel toward +u of its heading [rad]
        """
        rows, course = self._rows, 0.5 * turn + crab
        x, u = rows[:, X] - distance * np.cos(course), rows[:, U] - distance * np.sin(course)
        cos, sin = np.cos(turn), np.sin(turn)
        rows[:, X], rows[:, U] = cos * x + sin * u, cos * u - sin * x
        rows[:, AGE] += dt
        rows[:, SLOPE] -= turn
        front = float(np.nanmax(rows[:, X])) if np.isfinite(rows[:, X]).any() else 0.0
        fresh = (rows[:, AGE] <= self._memory.window_s) & ~(rows[:, X] < front - self._memory.window)
        self._rows = rows[fresh]
        self._unseen += dt
        if self.line is not None:
            line = self.line.moved(distance, turn)
            self.line = line._replace(offset=line.offset - distance * crab)
            if self._unseen > self._memory.forget_s:
                self.line, self.is_found = None, False

    def update(self, step: Step | None) -> None:
        """Take the edge point of a new scan, or that it showed none."""
        row = np.full((1, COLUMNS), np.nan)
        row[0, AGE], row[0, IS_USED] = 0.0, 0.0
        if step is not None:
            row[0, :AGE] = step.x, step.u, step.variance, step.quality
            row[0, SLOPE] = 0.0 if self.line is None else self.line.slope_at(step.x)
            if self.is_found and self.line is not None:
                row[0, IS_USED] = float(abs(step.u - float(self.line.at(step.x))) < self._memory.gate)
        self._rows = np.concatenate([self._rows, row])
        if row[0, IS_USED] > 0.0:
            self._unseen = 0.0
            self._fit()
        elif self.is_found and self._unseen > self._memory.lost_s:
            self.is_found = False
            self._rows[:, IS_USED] = 0.0
        if not self.is_found:
            self._acquire()

    def confidence(self) -> float:
        """0..1: the share of the last half second's scans that show the edge, times their quality."""
        if not self.is_found:
            return 0.0
        recent = self._rows[self._rows[:, AGE] <= 0.5]
        used = recent[recent[:, IS_USED] > 0.0]
        if len(used) == 0:
            return 0.0
        share = len(used) / len(recent)
        fading = max(0.0, 1.0 - self._unseen / (self._memory.lost_s + 1e-9))
        return float(np.clip(share * used[:, QUALITY].mean() * fading, 0.01, 1.0))

    def _fit(self) -> None:
        used = self._rows[self._rows[:, IS_USED] > 0.0]
        slope = 0.0 if self.line is None else self.line.slope_at(used[:, X])
        variance = SCANS_PER_SAMPLE * used[:, VARIANCE] + (LEVER * (used[:, SLOPE] - slope)) ** 2
        self.line, _ = fit_line(used[:, X], used[:, U], variance, self._x0, self._prior, self.line)

    def _acquire(self) -> None:
        memory = self._memory
        if self._try(memory.acquire_s, near=self.line):
            return
        self._try(memory.acquire_s if self.line is None else memory.jump_s, near=None)

    def _try(self, span: float, near: Line | None) -> bool:
        """Found when enough scans of the last `span` [s] agree on one line (close to `near` if given)."""
        memory = self._memory
        recent = (self._rows[:, AGE] <= span + 1e-6) & np.isfinite(self._rows[:, X])
        asked = int((self._rows[:, AGE] <= span + 1e-6).sum())
        if self._unseen < span - 1e-6 and near is None:
            return False
        if float(self._rows[:, AGE].max()) < span - 1e-6 or recent.sum() < max(3, memory.min_share * asked):
            return False
        points = self._rows[recent]
        line, weight = fit_line(points[:, X], points[:, U], points[:, VARIANCE], self._x0, self._prior, near)
        reference = line if near is None else near
        agrees = (weight > 0.0) & (np.abs(points[:, U] - reference.at(points[:, X])) < memory.gate)
        if agrees.sum() < max(3, memory.min_share * asked):
            return False
        self._rows[:, IS_USED] = 0.0
        self._rows[np.flatnonzero(recent)[agrees], IS_USED] = 1.0
        self.is_found, self._unseen = True, 0.0
        self.line = line
        self._fit()
        return True


HEADROOM, ROOM = 1.25, 0.3  # [1], [m]: crop may stand this much above its 90th percentile, over uneven ground
TOPS = (1.5, 1.15)  # m, tried when the crop's height is not known and dust may hide the edge
CLEARER = 1.3  # times the separation that a lower top must reach to count


class OtsuInNumpy(KeepsState):
    """Scan and odometry in, crop edge out."""

    kept: ClassVar[tuple[str, ...]] = (
        "_track",
        "_canopy_offset",
        "_inclination",
        "_time",
        "_crop",
        "_stubble",
        "_ground",
    )

    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        p = params
        self._mounting = setup.mounting
        self._sign = crop_sign(setup.edge_side)
        self._centre = self._sign * setup.machine.header_end(setup.edge_side)[1]
        lean = p.lean_share * tan(p.lean_deg * DEG)
        self._learns = p.learn_m > 0.0
        self._canopy_offset = CanopyOffset(p.learn_m or 1.0, lean, 0.5 * p.spot_mm * MM, parts=p.echo_parts)
        self._gates = Gates(
            min_step=p.min_step_m,
            min_gain=p.min_gain,
            min_separation=p.min_separation,
            window=p.window_m,
            search=p.search_m,
        )
        self._reach = Reach()
        self._lost = round(p.lost_s * NS)
        memory = Memory(p.track_m, gate=p.gate_m, lost_s=p.lost_s, acquire_s=p.acquire_s, jump_s=p.jump_s)
        self._reference = p.reference_m or footprint(setup) - 0.2 * p.track_m
        self._track = EdgeTrack(memory, Prior(), self._reference)
        self._inclination = Inclination(setup.mountings.get("inertial"))
        self._time = 0
        self._crop, self._stubble, self._ground = float("nan"), float("nan"), 0.0

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._track.clear()
        self._canopy_offset.clear()
        self._canopy_offset.compile()
        self._inclination.clear()
        self._time = 0
        self._crop, self._stubble, self._ground = float("nan"), float("nan"), 0.0
        return {"edge": no_edge(0, self._reference)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take a new scan, if there is one, and report the edge in the machine frame of t + dt."""
        scan, odometry = inputs["scan"], inputs["odometry"]
        speed, yaw_rate = finite(odometry.speed), finite(odometry.yaw_rate)
        self._inclination.take(inputs.get("inertial"), speed)
        if scan is not None and scan.t > self._time:
            self._take(scan, speed, yaw_rate)
        return {"edge": self._report(t + dt, speed, yaw_rate)}

    def _take(self, scan: Scan, speed: float, yaw_rate: float) -> None:
        elapsed = (scan.t - self._time) / NS
        self._time = scan.t
        crab = -self._sign * self._inclination.crab(CRAB, speed * yaw_rate)
        self._track.move(speed * elapsed, self._sign * yaw_rate * elapsed, elapsed, crab)
        self._canopy_offset.move(speed * elapsed)
        profile = make_profile(scan, self._mounting, self._sign, speed, yaw_rate, self._reach)
        line = self._track.line if self._track.is_found else None
        found = self._look(profile)
        self._track.update(found)
        if found is not None:
            self._remember_heights(found)
            if line is not None:
                lateral = found.u - float(line.at(found.x))
                if self._learns and abs(lateral) <= 0.12:
                    self._canopy_offset.add(found.rays, self._crop)

    def _look(self, profile: Profile) -> Step | None:
        """The step of a profile without what hangs above the crop: dust near the scanner.

        Once the crop's height is known all echoes above it go. Before that several tops are tried, and a
        lower one counts when it shows the step more clearly.
        """
        tops: tuple[float, ...] = (self._reach.high, *TOPS)
        if self._track.is_found and np.isfinite(self._crop):
            tops = (self._ground + HEADROOM * max(self._crop, 0.0) + ROOM,)
        rise = self._sign * self._inclination.rise[1] if self._inclination.is_known else None
        best: Step | None = None
        line = self._track.line
        for top in tops:
            step = find_step(profile.below(top), line, self._centre, self._gates, rise)
            if step is not None and (best is None or step.separation > CLEARER * best.separation):
                best = step
        return best

    def _remember_heights(self, found: Step) -> None:
        share = 0.1 if np.isfinite(self._crop) else 1.0
        old_crop, old_stubble = (self._crop, self._stubble) if share < 1.0 else (0.0, 0.0)
        self._crop = (1.0 - share) * old_crop + share * found.crop_height
        self._stubble = (1.0 - share) * old_stubble + share * found.stubble_height
        self._ground = (1.0 - share) * (self._ground if share < 1.0 else 0.0) + share * found.ground

    def _report(self, now: int, speed: float, yaw_rate: float) -> CropEdge:
        line, age = self._track.line, now - self._time
        if line is None or not self._track.is_found or age > self._lost:
            return no_edge(now, self._reference)
        line = line.moved(speed * age / NS, self._sign * yaw_rate * age / NS)
        return self._as_edge(now, line)

    def _as_edge(self, now: int, line: Line) -> CropEdge:
        sign, steep = self._sign, 1.0 + line.slope**2
        shift = self._canopy_offset.shift(self._crop)
        return CropEdge(
            t=now,
            offset=sign * (line.offset + shift * float(np.sqrt(steep))),
            heading=sign * atan(line.slope),
            curvature=sign * float(line.bend / steep**1.5),
            reference_x=line.x0,
            confidence=self._track.confidence(),
            crop_height=self._crop,
            stubble_height=self._stubble,
        )
