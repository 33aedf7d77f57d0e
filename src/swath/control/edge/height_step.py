"""The height step of one profile: stubble on one side, crop on the other.

A split rule scores every place at which the laterally ordered heights could be divided; this file orders
them, levels the ground, applies the gates and turns the scores into an edge point with a variance.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from math import fsum
from types import FunctionType

import numpy as np

from swath.control.edge.line_fit import Line
from swath.control.edge.profile import Profile
from swath.control.edge.shared import shared
from swath.core import portable
from swath.signals import F64

# of a ray's way through the upper half of the crop, from its end nearer to the crop: there it counts. 0.36
# for 4 to 10 mean free paths of crop and a way across three times the overhang, 0.5 for one along the edge
MET = 0.35
ERROR_ODDS = 3.0  # nat: log odds of an echo being on the right side of a threshold between heights, 95 %

# heights in lateral order [m], shape (n,), fewest points on a side -> log-likelihood of a split before each
# of the points 1..n-1, shape (n - 1,), -inf where a split is not allowed; the gain over "no step" [nat]
SplitRule = Callable[[F64, int], tuple[F64, float]]


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
class Rays:
    """How the rays of a profile come down through the canopy; all in one order, shape (echo_count,).

    upper, lower: lateral distance [m] from the edge as it was known before, where a ray is (or would have
    been) `top` and `limit` [m] above the foot of the stubble side, less the roll
    height [m]: of its echo above that foot
    top: of the canopy; limit: midway between both sides
    """

    upper: F64
    lower: F64
    height: F64
    top: float
    limit: float

    def at(self, height: float) -> F64:
        """Lateral distance [m] of every ray at a height [m] above the foot of the stubble side."""
        share = (height - self.limit) / max(self.top - self.limit, 0.01)
        return self.lower + share * (self.upper - self.lower)


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


def _key(
    profile: Profile,
    expected: Line | None,
    centre: float,
    split: SplitRule,
    gates: Gates,
    rise: float | None = None,
) -> Hashable:
    if not isinstance(split, FunctionType):  # a rule may have a memory
        return None
    echoes = profile.x.tobytes(), profile.u.tobytes(), profile.z.tobytes(), profile.sensor
    return echoes, expected, centre, split, gates, rise


@shared(_key)
def find_step(
    profile: Profile,
    expected: Line | None,
    centre: float,
    split: SplitRule,
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
    score, gain = split(z, gates.min_points)
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
    score, gain = split(met, gates.min_points)
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
