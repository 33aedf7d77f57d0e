"""The beam: where the sub-rays of a spot lie, and which distance the sensor reports for them.

One place for every level that has rays. Conventions: a spot is elliptic; its diameter at range r is
exit + divergence * r with the FULL divergence angle to the edge that the data sheet names (`edge`, or the
1/e2 contour). `uniform` fills the spot evenly; `gaussian` has the 1/e2 contour at the spot's edge and is cut
off there. All sub-rays carry the same energy: a gaussian spot has them closer together in the middle.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from swath.core.errors import InputError
from swath.core.signals import F64

Profile = Literal["uniform", "gaussian"]
EchoRule = Literal["nearest", "percentile"]


@dataclass(frozen=True)
class Beam:
    """Spot geometry. exit_diameter [m], divergence [rad, full angle]: (across, along) the sensor's y, z."""

    exit_diameter: tuple[float, float]
    divergence: tuple[float, float]
    profile: Profile

    def diameter(self, distance: F64 | float) -> F64:
        """Spot diameters (across, along) [m] at a distance [m], shape (..., 2)."""
        d = np.asarray(distance, dtype=float)[..., None]
        return np.asarray(self.exit_diameter) + np.asarray(self.divergence) * d


def spot_pattern(count: int, profile: Profile = "uniform") -> F64:
    """Sub-ray positions on the unit disc, shape (count, 2), equal energy each, deterministic.

    One in the middle and rings of 6, 12, 18 ... around it (1, 7, 19, 37, 61); any other count spreads over
    a golden-angle spiral. The radius of a sub-ray splits the energy of its ring in half, so the outermost
    lies inside the spot's edge (at 0.87 of the radius for 19 uniform sub-rays).
    """
    if count < 1:
        raise InputError("sub_rays", count, "expected >= 1")
    rings = round((np.sqrt(12 * count - 3) - 3) / 6)
    if 1 + 3 * rings * (rings + 1) == count:
        energy, angle = [0.0], [0.0]
        inner = 1.0
        for ring in range(1, rings + 1):
            n = 6 * ring
            energy += [(inner + 0.5 * n) / count] * n
            angle += [2 * np.pi * (k + 0.5 * (ring % 2)) / n for k in range(n)]
            inner += n
    else:
        index = np.arange(count)
        energy = list((index + 0.5) / count)
        angle = list(index * np.pi * (3 - np.sqrt(5)))
    radius = _radius_of_energy(np.asarray(energy), profile)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _radius_of_energy(share: F64, profile: Profile) -> F64:
    """Radius inside which a share of the spot's energy lies; gaussian I ~ exp(-2 r^2) cut at r = 1."""
    if profile == "uniform":
        return np.sqrt(share)
    return np.sqrt(-0.5 * np.log1p(-share * (1.0 - np.exp(-2.0))))


def sub_rays(origins: F64, axes: F64, beam: Beam, pattern: F64) -> tuple[F64, F64]:
    """Rays of every beam: origins and unit directions, each shape (beam_count, sub_count, 3).

    origins: (beam_count, 3) [m]; axes: (beam_count, 3, 3), columns = beam direction, across, along;
    pattern: (beam_count or 1, sub_count, 2) on the unit disc. A sub-ray leaves at its place in the
    exit aperture and diverges with it.
    """
    half_exit = 0.5 * np.asarray(beam.exit_diameter)
    half_angle = 0.5 * np.asarray(beam.divergence)
    across, along = axes[:, None, :, 1], axes[:, None, :, 2]
    u, v = pattern[:, :, 0, None], pattern[:, :, 1, None]
    start = origins[:, None, :] + u * half_exit[0] * across + v * half_exit[1] * along
    direction = axes[:, None, :, 0] + u * half_angle[0] * across + v * half_angle[1] * along
    return start, direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def echo_index(distance: F64, rule: EchoRule, percentile: float) -> F64:
    """Which sub-ray's distance is reported, shape (beam_count,), -1 = no sub-ray hit anything.

    distance [m]: (beam_count, sub_count), nan = no hit. nearest: the smallest; percentile p: of the n
    sub-rays that hit something the ceil(p n / 100)-th nearest (at least the first).
    """
    order = np.argsort(distance, axis=1, kind="stable")  # nan sorts last
    hit_count = np.count_nonzero(~np.isnan(distance), axis=1)
    if rule == "nearest":
        rank = np.zeros_like(hit_count)
    else:
        rank = np.maximum(np.ceil(hit_count * (percentile / 100.0) - 1e-9).astype(int), 1) - 1
    rank = np.minimum(rank, np.maximum(hit_count - 1, 0))
    index = np.take_along_axis(order, rank[:, None], axis=1)[:, 0]
    return np.where(hit_count > 0, index, -1)
