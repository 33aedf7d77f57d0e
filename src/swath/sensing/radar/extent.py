"""How far the echoes of an extended thing lie apart, and how its apparent place wanders from look to look.

Seen from above, the two sides of its box that face the radar throw back evenly. Echoes of one resolution cell
have random phases; they shift its apparent place (glint) by a normal error with the standard deviation

    sd_of_the_echoes * sqrt(mean / (2 power))

for a look of this power: the quotient of two Gaussian sums (Delano 1953, A theory of target glint or angular
scintillation in radar tracking, Proc. IRE 41). It is never larger than the thing.
"""

from dataclasses import dataclass
from math import fsum, hypot, sqrt

from swath.field.site_setup import Body
from swath.signals import F64


@dataclass(frozen=True)
class Extent:
    """depth: of the mean echo behind the point where the line to the middle enters [m]

    depth_sd, across_sd: of the echoes [m]
    """

    depth: float = 0.0
    depth_sd: float = 0.0
    across_sd: float = 0.0


@dataclass(frozen=True)
class _Side:
    """Along the view and across it, from the middle of the box [m]: middle and half length."""

    along: float
    half_along: float
    across: float
    half_across: float


def extent_of(body: Body, eye: F64) -> Extent:
    """Of a body from a place (3,) in the world."""
    x, y, _ = (body.pose.inverse().apply(eye) - body.middle).tolist()
    far = hypot(x, y)
    if far == 0.0:
        return Extent()
    c, s = abs(x) / far, abs(y) / far
    long, wide = (float(half) for half in body.half[:2])
    sides = (
        _Side(-c * long, s * wide, s * long, c * wide),
        _Side(-s * wide, c * long, -c * wide, s * long),
    )
    seen = fsum(side.half_across for side in sides)
    shares = [side.half_across / seen for side in sides]
    along = fsum(share * side.along for share, side in zip(shares, sides, strict=True))
    across = fsum(share * side.across for share, side in zip(shares, sides, strict=True))
    squares = [
        (
            (side.along - along) ** 2 + side.half_along**2 / 3.0,
            (side.across - across) ** 2 + side.half_across**2 / 3.0,
        )
        for side in sides
    ]
    spread = [
        sqrt(fsum(share * square[k] for share, square in zip(shares, squares, strict=True))) for k in (0, 1)
    ]
    enters = min(half / cosine for half, cosine in ((long, c), (wide, s)) if cosine > 0.0)
    return Extent(along + enters, *spread)


def glint(mean: float, power: float) -> float:
    """Standard deviation of the apparent place over that of the echoes. mean, power: over noise."""
    return sqrt(min(1.0, mean / (2.0 * max(power, 1e-9))))
