"""The beam: how wide a spot is, and where the sub-rays lie that stand for it.

One convention inside: a spot is elliptic; its diameter at range r is exit + divergence * r with the FULL
angle, to the 1/e2 contour of a gaussian spot or to the edge of a uniform one. Sensor files name what their
data sheet means and are converted by `full_angle`. A gaussian spot is cut off at its 1/e2 contour.

Places in a spot are reported by the share e of the energy that lies further in: e = r2 for a uniform spot. In
e every spot is even, so one table of rings serves all profiles.
"""

from dataclasses import dataclass
from math import exp, fsum, log, sqrt
from typing import Literal

import numpy as np

from swath.core.errors import InputError
from swath.core.portable import log1p
from swath.signals import F64

Profile = Literal["uniform", "gaussian"]
Convention = Literal["full_angle", "half_angle"]
Contour = Literal["1/e2", "FWHM", "edge"]

FWHM_TO_E2 = float(sqrt(2.0 / log(2.0)))  # of a gaussian: exp(-2 (r/w)^2) = 1/2 at r = w sqrt(ln 2 / 2)

# Nested rings, as (sub-rays, share of energy further in, angle of the first in steps of the ring). The six of
# the 7-pattern are every second one of the twelve; 1/4 + 6/8 is the disc rule exact to degree 5 (Abramowitz &
# Stegun 25.4.61). 19 sub-rays hold the mean of e exactly with equal weights; 37 also that of e2, 61 that of
# e3, with the weights nearest to equal ones that do so. The places of 37 and 61 were chosen for the least
# error of the energy in half planes and strips across the spot.
_Ring = tuple[int, float, float]
_SIX: _Ring = (6, 2 / 3, 0.0)
_A: _Ring = (6, 1 / 4, 0.5)
_B: _Ring = (12, 2 / 3, 0.0)
_C: _Ring = (6, 1 / 8, 0.0)
_D: _Ring = (12, 5 / 6, 0.5)
_E: _Ring = (12, 0.42, 0.5)
_F: _Ring = (12, 0.94, 0.0)
_RINGS: dict[int, tuple[tuple[_Ring, float], ...]] = {
    # count: ((ring, energy share of the whole ring), ...); the middle has the rest
    7: ((_SIX, 3 / 4),),
    19: ((_A, 6 / 19), (_B, 12 / 19)),
    37: (
        (_A, 0.20179359462232965),
        (_B, 0.3319084956776457),
        (_C, 0.19229792800695944),
        (_D, 0.24509043587014062),
    ),
    61: (
        (_A, 0.1294337447357508),
        (_B, 0.19726406893121823),
        (_C, 0.1615755341442278),
        (_D, 0.15563575780932248),
        (_E, 0.2202319211103984),
        (_F, 0.099724862822431),
    ),
}


@dataclass(frozen=True)
class Beam:
    """Spot geometry. exit_diameter [m], divergence [rad, full angle]: (across, along) the sensor's y, z."""

    exit_diameter: tuple[float, float]
    divergence: tuple[float, float]
    profile: Profile

    def diameter(self, distance: F64 | float) -> F64:
        """Spot diameters (across, along) [m] at a distance [m], shape (..., 2)."""
        d = np.asarray(distance, dtype=float)[..., None]
        spot: F64 = np.asarray(self.exit_diameter) + np.asarray(self.divergence) * d
        return spot


@dataclass(frozen=True)
class Pattern:
    """Sub-rays of a spot.

    position: on the unit disc, shape (..., count, 2)
    weight: share of the beam's energy, shape (count,)
    """

    position: F64
    weight: F64

    @property
    def outermost(self) -> float:
        """Where the outermost sub-ray lies, in radii of the spot."""
        return float(np.hypot(self.position[..., 0], self.position[..., 1]).max())


def full_angle(value: float, convention: Convention, contour: Contour, profile: Profile) -> float:
    """A divergence or a diameter of a data sheet in the convention used here.

    half_angle: doubled (for a diameter: the sheet gives radii). FWHM of a gaussian: times 1.699. An `edge`
    that a sheet does not explain is taken as the 1/e2 contour. A uniform spot has one edge by any contour;
    taken at 1/e2 it has the second moment of the gaussian.
    """
    value = 2.0 * value if convention == "half_angle" else value
    return value * FWHM_TO_E2 if contour == "FWHM" and profile == "gaussian" else value


def spot_pattern(count: int, profile: Profile = "uniform") -> Pattern:
    """Fixed pattern of `count` sub-rays.

    1, 7, 19, 37, 61: the middle and rings, each pattern a part of the next, weights as needed. Any other
    count: a golden-angle spiral with equal weights. The outermost sub-ray stands for the energy around it and
    so lies inside the edge, at `Pattern.outermost`: 0.82 (7, 19), 0.91 (37), 0.97 (61) of a uniform radius.
    """
    if count < 1:
        raise InputError("sub_rays", count, "expected >= 1")
    if count == 1:
        return Pattern(np.zeros((1, 2)), np.ones(1))
    if count not in _RINGS:
        index = np.arange(count)
        energy, angle = (index + 0.5) / count, index * np.pi * (3 - np.sqrt(5))
        return Pattern(_places(energy, angle, profile), np.full(count, 1.0 / count))
    e, a, w = [0.0], [0.0], [1.0 - fsum(weight for _, weight in _RINGS[count])]
    for (n, share, first), weight in _RINGS[count]:
        e += [share] * n
        a += [2 * np.pi * (k + first) / n for k in range(n)]
        w += [weight / n] * n
    return Pattern(_places(np.asarray(e), np.asarray(a), profile), np.asarray(w))


def random_pattern(rng: np.random.Generator, beams: int, count: int, profile: Profile) -> Pattern:
    """Independent sub-rays for every beam, drawn from the spot's energy, position (beams, count, 2)."""
    energy, angle = rng.uniform(0.0, 1.0, (beams, count)), rng.uniform(0.0, 2 * np.pi, (beams, count))
    return Pattern(_places(energy, angle, profile), np.full(count, 1.0 / count))


def turned_pattern(rng: np.random.Generator, beams: int, pattern: Pattern) -> Pattern:
    """The pattern turned by a random angle for every beam, position (beams, count, 2)."""
    angle = rng.uniform(0, 2 * np.pi, beams)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = pattern.position[:, 0], pattern.position[:, 1]
    return Pattern(np.stack([c * x - s * y, s * x + c * y], axis=2), pattern.weight)


def _places(energy: F64, angle: F64, profile: Profile) -> F64:
    radius = _radius_of_energy(energy, profile)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def _radius_of_energy(share: F64, profile: Profile) -> F64:
    """Radius inside which a share of the spot's energy lies; gaussian I ~ exp(-2 r^2) cut at r = 1."""
    if profile == "uniform":
        return np.asarray(np.sqrt(share))
    return np.asarray(np.sqrt(-0.5 * log1p(-share * (1.0 - exp(-2.0)))))


def offsets_of(beam: Beam, pattern: F64) -> F64:
    """The offsets of `Spots`. pattern: (beam_count or 1, sub_count, 2) on the unit disc.

    A sub-ray leaves at its place in the exit aperture and diverges with it.
    """
    half_exit = 0.5 * np.asarray(beam.exit_diameter)
    half_angle = 0.5 * np.asarray(beam.divergence)
    u, v = pattern[:, :, 0], pattern[:, :, 1]
    length = np.sqrt(1.0 + (u * half_angle[0]) ** 2 + (v * half_angle[1]) ** 2)  # the axes are a frame
    offsets = (u * half_exit[0], v * half_exit[1], u * half_angle[0], v * half_angle[1], 1.0 / length)
    return np.stack(offsets, axis=-1)
