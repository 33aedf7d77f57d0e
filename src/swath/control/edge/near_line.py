"""The edge beside the machine: a robust local parabola through the blocks around the place that is reported.

Interpolation, not extrapolation: the place lies just ahead of the knife, so that blocks stand on both sides.
"""

from dataclasses import dataclass
from math import atan

import numpy as np

from swath.control.edge.canopy_rays import EdgeFrame
from swath.core.component import KeepsState
from swath.core.portable import exp, inverse, product, solve
from swath.signals import F64

X, U, VARIANCE, WAY, COLUMNS = range(5)
BEHIND = 14.0  # m of the edge that are kept
REACH = 2.5  # m, standard deviation of the weight along the edge
TUKEY, MAD = 4.685, 1.4826
STRAIGHT, BENT = 0.0015, 0.05  # 1/m: prior standard deviation of a bend that nothing shows; of any
PROVEN = 3.0  # standard deviations from which on a bend is one


class EdgePoints(KeepsState):
    """Points of the accepted blocks, in the frame at rest. rows (n, COLUMNS)."""

    kept = ("rows",)

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """None."""
        self.rows: F64 = np.zeros((0, COLUMNS))

    def add(self, x: float, u: float, variance: float, way: float) -> None:
        """A block's edge point [m], its variance [m2], and its way along the edge [m]."""
        rows = self.rows[self.rows[:, WAY] > way - BEHIND - 10.0]
        self.rows = np.vstack([rows, [x, u, variance, way]])

    def doubt(self, way: float) -> None:
        """Forget those from a way along the edge [m] on."""
        self.rows = self.rows[self.rows[:, WAY] < way]


@dataclass(frozen=True)
class NearLine:
    """The edge near a place. frame: of the machine; offset_sd [m], angle_sd [rad]

    gap: way along the edge from the place to the nearest point [m]; spread: of the points about the line [m]
    seen_to: way along the edge from the place to the last point [m]
    """

    frame: EdgeFrame
    offset_sd: float
    angle_sd: float
    gap: float
    spread: float
    seen_to: float


def near_line(points: F64, place: EdgeFrame, way: float) -> NearLine | None:
    """A parabola through points (n, COLUMNS) in the machine's frame, for the place `way` along the edge.

    place: the edge there as the track has it, whose frame the fit uses
    """
    if len(points) < 2:
        return None
    s = points[:, WAY] - way
    nearest = float(np.abs(s).min())
    ahead = float(s.max())
    reach = max(REACH, 1.5 * nearest, 0.0)
    along, beside = EdgeFrame(place.x, place.u, place.angle, 0.0).place(points[:, X], points[:, U])
    weight = exp(-0.5 * (s / reach) ** 2) / (points[:, VARIANCE] + 1e-4)
    basis = np.stack([np.ones_like(along), along, 0.5 * along * along])
    fitted, covariance, spread = _fit(basis, beside, weight, place.bend, BENT)
    if abs(fitted[2]) < PROVEN * float(np.sqrt(covariance[2, 2])):
        fitted, covariance, spread = _fit(basis, beside, weight, 0.0, _straight(fitted, covariance))
    offset, slope, bend = (float(v) for v in fitted)
    angle = atan(slope)
    c, s0 = np.cos(place.angle), np.sin(place.angle)
    frame = EdgeFrame(
        place.x - offset * float(s0),
        place.u + offset * float(c),
        place.angle + angle,
        bend / (1.0 + slope * slope) ** 1.5,
    )
    return NearLine(
        frame, float(np.sqrt(covariance[0, 0])), float(np.sqrt(covariance[1, 1])), nearest, spread, ahead
    )


def _straight(fitted: F64, covariance: F64) -> float:
    """Prior of the bend [1/m] where the points prove none: the less they could, the straighter."""
    return float(max(STRAIGHT, min(abs(fitted[2]), 0.5 * np.sqrt(covariance[2, 2]))))


def _fit(basis: F64, beside: F64, weight: F64, bend: float, bend_sd: float) -> tuple[F64, F64, float]:
    ridge = np.diag([1e-4, 1.0 / 0.5**2, 1.0 / bend_sd**2])
    toward = np.array([0.0, 0.0, bend / bend_sd**2])
    robust = np.ones_like(weight)
    fitted, normal, spread = np.zeros(3), ridge, 0.0
    for _ in range(3):
        weighted = basis * (weight * robust)
        normal = product(weighted, basis.T) + ridge
        fitted = solve(normal, product(weighted, beside) + toward)
        residual = beside - product(fitted, basis)
        near = weight > 0.05 * weight.max()
        spread = MAD * float(np.median(np.abs(residual[near])))
        robust = np.clip(1.0 - (residual / (TUKEY * max(spread, 0.02))) ** 2, 0.0, None) ** 2
        if float((weight * robust)[near].sum()) < 0.2 * float(weight[near].sum()):
            robust = np.ones_like(weight)
    residual = beside - product(fitted, basis)
    kept = weight * robust
    worse = float((kept * weight * residual**2).sum()) / max(float(kept.sum()), 1e-9)  # chi squared per point
    return fitted, inverse(normal) * max(1.0, worse), spread
