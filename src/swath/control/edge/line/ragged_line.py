"""The line along an edge with bites: between its outermost and innermost points, smooth over the bites.

A least squares parabola in which points that lie further in the crop than the line count less (an expectile,
Newey and Powell 1987, Econometrica 55(4):819). Of bites whose depth is spread evenly from 0 to d, as that of
a saw is, it lies sqrt(INNER) / (1 + sqrt(INNER)) d = 0.37 d inside the outermost points. What stands out, the
scanner sees from afar, the bottom of a bite hides behind it: seen, the line lies at 0.1 to 0.2 d.
"""

from math import atan, cos, sin, sqrt

import numpy as np

from swath.control.edge.arc_track import Arc
from swath.control.edge.line.near_line import DISTANCE, VAGUE, VARIANCE
from swath.control.edge.profile import EVENLY
from swath.signals import F64

INNER = 0.35  # weight of a point inside the line, where one outside counts 1
LENGTH = 14.0  # m of the edge whose points count
LIKE = 0.33  # m, standard deviation of a point: bites of 0.6 m, five blocks of which show the same
TURN, BEND = 0.07, 0.01  # rad from the machine's heading, 1/m: prior standard deviations
WINDOW, FEWEST = 8.0, 8  # m, number of points in which bites are looked for
EVEN, TURNS, BENDS = 0.03, 0.3, 0.1  # m, rad, 1/m: scatter, angle and bend of an edge without bites
ROUNDS = 8


def bite_of(rows: F64, newest: Arc) -> float:
    """How deep the bites of the last metres of an edge are [m], from rows of `EdgePoints`.

    From what its points scatter about a parabola, beyond their own variance. A saw of depth d gives 0.5 d, as
    the parabola follows part of it, and blocks are longer than its steps; a bend that begins 0.13 m at most.
    """
    used = last_of(rows, newest.distance, WINDOW)
    if len(used) < FEWEST:
        return 0.0
    columns, beside = seen_from(used, newest, newest.angle)
    p, _ = fitted(columns, beside, np.ones(len(beside)), (EVEN / TURNS, EVEN / BENDS))
    away = beside - (p[0] + p[1] * columns[1] + p[2] * columns[2])
    return EVENLY * sqrt(max(0.0, float((away * away).mean() - used[:, VARIANCE].mean())))


def ragged_line(rows: F64, newest: Arc, heading: float) -> tuple[Arc, float]:
    """The line through rows of `EdgePoints`, abreast of the track's newest place; sd of its angle [rad].

    heading: of the machine [rad], in the frame at rest as all
    """
    used = last_of(rows, newest.distance, LENGTH)
    columns, beside = seen_from(used, newest, heading)
    weight = np.ones(len(beside))
    for _ in range(ROUNDS):
        p, inverse = fitted(columns, beside, weight, (LIKE / TURN, LIKE / BEND))
        inside = beside > p[0] + p[1] * columns[1] + p[2] * columns[2]
        weight = np.where(inside, INNER, 1.0)
    c, s = cos(heading), sin(heading)
    covariance = np.diag([0.1**2, 0.05**2, BEND**2])
    x, u, angle = newest.x - p[0] * s, newest.u + p[0] * c, heading + atan(p[1])
    return Arc(x, u, angle, p[2], covariance, newest.distance, newest.unseen), LIKE * sqrt(inverse[1][1])


def last_of(rows: F64, distance: float, length: float) -> F64:
    """The rows that show the edge, over a length [m] behind a distance along it [m]."""
    return rows[(rows[:, DISTANCE] > distance - length) & (rows[:, VARIANCE] < VAGUE**2)]


def seen_from(rows: F64, place: Arc, angle: float) -> tuple[tuple[F64, F64, F64], F64]:
    """(1, t, t^2 / 2), and the points beside a line through a place at an angle [rad]; t: along it [m]."""
    c, s = cos(angle), sin(angle)
    x, u = rows[:, 0] - place.x, rows[:, 1] - place.u
    along = c * x + s * u
    return (np.ones(len(along)), along, 0.5 * along * along), c * u - s * x


def fitted(
    columns: tuple[F64, F64, F64], beside: F64, weight: F64, prior: tuple[float, float]
) -> tuple[tuple[float, float, float], list[list[float]]]:
    """Weighted least squares: offset, slope and bend; their covariance over the variance of a point.

    prior: standard deviations of a point over those of slope and bend
    """
    weighed = [weight * column for column in columns]
    a = [[float((w * column).sum()) for column in columns] for w in weighed]
    b = [float((w * beside).sum()) for w in weighed]
    a[0][0] += 1e-3
    a[1][1] += prior[0] ** 2
    a[2][2] += prior[1] ** 2
    (a00, a01, a02), (_, a11, a12), (_, _, a22) = a
    c00, c01, c02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    c11, c12, c22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    det = a00 * c00 + a01 * c01 + a02 * c02
    p0 = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det
    p1 = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det
    p2 = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det
    inverse = (c00, c01, c02), (c01, c11, c12), (c02, c12, c22)
    return (p0, p1, p2), [[c / det for c in row] for row in inverse]
