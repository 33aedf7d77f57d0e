"""Shortest path of arcs of one radius and straights, without reversing (Dubins 1957, DOI 10.2307/2372560).

The closed forms of the six words are those of Shkel and Lumelsky 2001, DOI 10.1016/S0921-8890(00)00127-5.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

TURN = 2.0 * math.pi
Word = tuple[str, tuple[float, float, float]]


class Place(NamedTuple):
    """Place [m] and heading, counter-clockwise from east [rad]."""

    x: float
    y: float
    heading: float


def shortest(start: Place, end: Place, radius: float) -> list[tuple[str, float]]:
    """Turns (`L`, `R`) and straights (`S`) of the shortest path, each with its length [m]."""
    dx, dy = end.x - start.x, end.y - start.y
    direction = math.atan2(dy, dx)
    d = math.hypot(dx, dy) / radius
    a, b = (start.heading - direction) % TURN, (end.heading - direction) % TURN
    word, parts = min(_words(d, a, b), key=lambda w: w[1][0] + w[1][1] + w[1][2])
    return [(c, p * radius) for c, p in zip(word, parts, strict=True) if p > 1e-12]


def _words(d: float, a: float, b: float) -> Iterator[Word]:
    """Each word that reaches the end, with the lengths of its parts over the radius."""
    sa, sb, ca, cb, cab = math.sin(a), math.sin(b), math.cos(a), math.cos(b), math.cos(a - b)
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)
    if square >= 0.0:
        t = math.atan2(cb - ca, d + sa - sb)
        yield "LSL", (_turn(t - a), math.sqrt(square), _turn(b - t))
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)
    if square >= 0.0:
        t = math.atan2(ca - cb, d - sa + sb)
        yield "RSR", (_turn(a - t), math.sqrt(square), _turn(t - b))
    square = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        t = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, p)
        yield "LSR", (_turn(t - a), p, _turn(t - b))
    square = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        t = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, p)
        yield "RSL", (_turn(a - t), p, _turn(b - t))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) <= 1.0:
        p = TURN - math.acos(cosine)
        t = _turn(a - math.atan2(ca - cb, d - sa + sb) + 0.5 * p)
        yield "RLR", (t, p, _turn(a - b - t + p))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) <= 1.0:
        p = TURN - math.acos(cosine)
        t = _turn(-a + math.atan2(cb - ca, d + sa - sb) + 0.5 * p)
        yield "LRL", (t, p, _turn(b - a - t + p))


def _turn(angle: float) -> float:
    """Angle in [0, 2 pi); what rounding leaves below a full turn is none."""
    angle %= TURN
    return 0.0 if TURN - angle < 1e-9 else angle


def moved(at: Place, word: str, size: float, radius: float) -> Place:
    """A place after a turn (`L`, `R`) or a straight (`S`) of a length [m]."""
    if word == "S":
        return Place(at.x + size * math.cos(at.heading), at.y + size * math.sin(at.heading), at.heading)
    side = 1.0 if word == "L" else -1.0
    angle = at.heading + side * size / radius
    x = at.x + side * radius * (math.sin(angle) - math.sin(at.heading))
    y = at.y - side * radius * (math.cos(angle) - math.cos(at.heading))
    return Place(x, y, angle)
