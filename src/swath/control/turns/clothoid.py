"""Turn with a steering that needs time: clothoids into and out of each arc.

A bend through an angle a is: curvature up at the sharpness, an arc at the radius, curvature down again; where
a is too small for the radius, up and down alone. Two bends and one straight are put together in three orders,

    bend - straight - bend       wide turns
    bend - bend - straight       a turn beyond the next pass and back to it, then in
    straight - bend - bend       the same after running on

each solved for the angle of its first bend; the shortest is taken. Fraichard and Scheuer 2004
(DOI 10.1109/TRO.2004.833789) describe such paths. Without a solution (too near) it is the Dubins path.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swath.control.steer.guidance_line import Bend
from swath.control.turns.dubins import Place, shortest
from swath.control.turns.limits import TurnLimits

Complex = NDArray[np.complex128]
TURN = 2.0 * math.pi
GRID = 360  # angles of the first bend that are looked at
SIMPSON = 32  # intervals of the integral over a clothoid: 1e-9 m


def plan(start: Place, end: Place, limits: TurnLimits) -> list[Bend]:
    """Bends of the shortest such path between two poses."""
    c, s = math.cos(start.heading), math.sin(start.heading)
    dx, dy = end.x - start.x, end.y - start.y
    goal = complex(c * dx + s * dy, c * dy - s * dx)
    heading = (end.heading - start.heading + math.pi) % TURN - math.pi
    found = _solve(round(goal.real, 9), round(goal.imag, 9), round(heading, 12), limits)
    return list(found) if found else bends_of(shortest(start, end, limits.radius), limits.radius)


def bends_of(way: Sequence[tuple[str, float]], radius: float) -> list[Bend]:
    """Turns (`L`, `R`) and straights (`S`) of a way as pieces of a path."""
    bend = {"L": 1.0 / radius, "S": 0.0, "R": -1.0 / radius}
    return [Bend(size, bend[word], bend[word]) for word, size in way]


@lru_cache(maxsize=4096)
def _solve(x: float, y: float, heading: float, limits: TurnLimits) -> tuple[Bend, ...]:
    """Bends from the origin, heading along x, to (x, y) with a heading; none where there is no solution."""
    goal = complex(x, y)
    best: tuple[float, tuple[Bend, ...]] = (math.inf, ())
    for first in (1, -1):
        for second in (1, -1):
            for pieces in _families(goal, heading, first, second, limits):
                total = math.fsum(p.length for p in pieces)
                if total < best[0] - 1e-9:
                    best = (total, tuple(pieces))
    return best[1]


def _families(
    goal: complex, heading: float, first: int, second: int, limits: TurnLimits
) -> Iterator[list[Bend]]:
    """Solutions with a bend to the side `first` (+1 left), then one to `second`."""
    grid = np.linspace(0.0, TURN, GRID + 1)
    table = _bends(limits)
    rest = (second * (heading - first * grid)) % TURN

    def ends(a: float) -> tuple[complex, complex, float, float]:
        b = (second * (heading - first * a)) % TURN
        return bend_end(a, first, limits), bend_end(b, second, limits), b, first * a

    def between(one: complex, two: complex, course: complex) -> complex:
        return goal - one - course * two

    one = table if first > 0 else table.conj()
    two = np.interp(rest, grid, table.real) + 1j * np.interp(rest, grid, table.imag)
    two = two if second > 0 else two.conj()
    course = np.cos(first * grid) + 1j * np.sin(first * grid)
    gap = goal - one - course * two
    final = complex(math.cos(heading), math.sin(heading))
    for kind, along in (("csc", course), ("ccs", np.full_like(course, final)), ("scc", np.ones_like(course))):
        across, ahead = (gap * along.conj()).imag, (gap * along.conj()).real
        jump = np.abs(np.diff(rest)) > math.pi  # the second bend goes from none to a full circle
        crossing = (across[:-1] * across[1:] <= 0.0) & ~jump & (np.maximum(ahead[:-1], ahead[1:]) > -1.0)
        for i in np.flatnonzero(crossing).tolist():
            low, high = float(grid[i]), float(grid[i + 1])

            def off(a: float, kind: str = kind) -> complex:
                e1, e2, _, turned = ends(a)
                unit = complex(math.cos(turned), math.sin(turned))
                way = {"csc": unit, "ccs": final, "scc": 1.0 + 0.0j}[kind]
                return between(e1, e2, unit) * way.conjugate()

            a = _root(off, low, high)
            left = off(a)
            if abs(left.imag) > 1e-6 or left.real < -1e-9:
                continue
            b = ends(a)[2]
            straight = [Bend(max(left.real, 0.0), 0.0, 0.0)]
            one_bend, other = bend(a, first, limits), bend(b, second, limits)
            order = {"csc": one_bend + straight + other, "ccs": one_bend + other + straight}
            yield order.get(kind, straight + one_bend + other)


def _root(off: Callable[[float], complex], low: float, high: float) -> float:
    """Where the sideways part of `off` is none: false position with the Illinois halving, to 1e-10 m.

    Signs at both ends can be the same, since the grid's are interpolated: then the place is outside them, but
    no angle is negative.
    """
    at_low, at_high = off(low).imag, off(high).imag
    side = 0
    for _ in range(60):
        if at_high == at_low:
            break
        middle = max((low * at_high - high * at_low) / (at_high - at_low), 0.0)
        at = off(middle).imag
        if abs(at) < 1e-10:
            return middle
        if (at < 0.0) == (at_high < 0.0):
            high, at_high = middle, at
            at_low, side = (0.5 * at_low if side == 1 else at_low), 1
        else:
            low, at_low = middle, at
            at_high, side = (0.5 * at_high if side == -1 else at_high), -1
    return 0.5 * (low + high)


def bend(angle: float, side: int, limits: TurnLimits) -> list[Bend]:
    """Bends of a bend through an angle >= 0 [rad] to a side (+1 left)."""
    if angle < 1e-12:
        return []
    peak = min(1.0 / limits.radius, math.sqrt(angle * limits.sharpness))
    ramp = peak / limits.sharpness
    arc = max(angle - peak * ramp, 0.0) / peak
    k = side * peak
    return [Bend(ramp, 0.0, k), Bend(arc, k, k), Bend(ramp, k, 0.0)]


def bend_end(angle: float, side: int, limits: TurnLimits) -> complex:
    """Where a bend ends, seen from its start (x ahead, y left) [m]."""
    end = complex(_bend_ends(np.array([angle]), limits)[0])
    return end if side > 0 else end.conjugate()


@lru_cache(maxsize=64)
def _bends(limits: TurnLimits) -> Complex:
    return _bend_ends(np.linspace(0.0, TURN, GRID + 1), limits)


def _bend_ends(angle: NDArray[np.float64], limits: TurnLimits) -> Complex:
    """Ends of bends to the left through angles [rad]: ramp, arc, and the ramp mirrored, exp(i a) conj(E)."""
    peak = np.minimum(1.0 / limits.radius, np.sqrt(angle * limits.sharpness))
    ramp = peak / limits.sharpness
    into = 0.5 * peak * ramp
    e = _ramp_end(ramp, limits.sharpness)
    arc = np.maximum(angle - 2.0 * into, 0.0)
    safe = np.where(peak > 0.0, peak, 1.0)
    turned = np.cos(into) + 1j * np.sin(into)
    over = turned * (np.sin(arc) + 1j * (1.0 - np.cos(arc))) / safe
    return np.asarray(e + over + (np.cos(angle) + 1j * np.sin(angle)) * e.conj())


def _ramp_end(length: NDArray[np.float64], sharpness: float) -> Complex:
    """Integral of exp(i c u^2 / 2) from 0 to each length [m], by Simpson's rule."""
    u = length[:, None] * (np.arange(SIMPSON + 1) / SIMPSON)
    weight = np.where(np.arange(SIMPSON + 1) % 2 == 1, 4.0, 2.0)
    weight[0] = weight[-1] = 1.0
    angle = 0.5 * sharpness * u * u
    scale = length / (3.0 * SIMPSON)
    real = (np.cos(angle) * weight).sum(axis=1) * scale
    return np.asarray(real + 1j * (np.sin(angle) * weight).sum(axis=1) * scale)
