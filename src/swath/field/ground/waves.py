"""Surfaces as sums of plane waves: gentle waves of the ground and ISO 8608 roughness.

Roughness. A profile along any line shall have the one-sided spectrum G(n) = G(n0) (n / n0)^-w, n in cycles/m,
n0 = 0.1 (ISO 8608:2016, eq. for displacement). The field is isotropic: waves with directions spread evenly
and variance P(k) dk in wave numbers k..k + dk. A wave of wave number k that crosses the line at an angle a
appears in the profile at n = k |cos a|; with a uniform, n has the density 2 / (pi sqrt(k^2 - n^2)) below k:

    G(n) = 2 / pi * int_n^inf P(k) / sqrt(k^2 - n^2) dk

With P(k) = C G(k) the integral is G(n) C Gamma(w / 2) / (sqrt(pi) Gamma((w + 1) / 2)), hence

    C = sqrt(pi) Gamma((w + 1) / 2) / Gamma(w / 2)          (pi / 2 for w = 2)

Waves reach from 0.05 to 4 cycles/m, the finest the ground lattice can carry. Shorter ones would also show in
profiles below 2 cycles/m (13 % of the density there at w = 2), where they cross the line at a slant. Waves of
3 to 4 cycles/m stand in for them, made stronger so that the density at 1.4 cycles/m is right.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from math import gamma, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.random import Stream
from swath.kernels import start_warp

Array = NDArray[np.float64]
Factor = Callable[[bytes, float], Array]

ROUGHNESS_CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6, "F": 16384e-6}
"""Geometric mean of Gd(n0) per class [m3]. ISO 8608:2016, table C.2."""
N0 = 0.1  # reference wave number of ISO 8608 [cycles/m]
ROUGHNESS_BAND = (0.05, 4.0)  # wave numbers in the surface [cycles/m]
WAVE_COUNT = 256
FEW = 20_000  # products that need no compiled sum
KEPT, LINE = 16, 65  # lines of a lattice in memory, a quarter of a MB each; of up to so many nodes, a page's
GOLDEN = 0.5 * (sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Waves:
    """Sum of amplitude * sin(2 pi k.r + phase). kx, ky [cycles/m], amplitude, phase [rad]; all (n,)."""

    kx: Array
    ky: Array
    amplitude: Array
    phase: Array

    @staticmethod
    def none() -> "Waves":
        """A sum without waves."""
        return Waves(*(np.zeros(0) for _ in range(4)))

    def __add__(self, other: "Waves") -> "Waves":
        names = (field.name for field in fields(self))
        return Waves(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))

    def height(self, x: Any, y: Any) -> Array:
        """Value at world points, in the shape of x and y broadcast."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        z = np.zeros(x.shape)
        for kx, ky, a, phase in zip(self.kx, self.ky, self.amplitude, self.phase, strict=True):
            z += a * np.sin(2 * pi * (kx * x + ky * y) + phase)
        return z

    def lattice(self, u: Array, v: Array, yaw: float) -> Array:
        """Value at the crossings of u (n,) and v (m,) of a frame turned by yaw, shape (m, n).

        sin(a + b) = sin a cos b + cos a sin b. Sums go row after row of `across`, wave by wave, as those
        of einsum, so that a crossing has the same bits in every lattice that holds it (a matrix product need
        not; tested).
        """
        is_kept = len(u) <= LINE and len(v) <= LINE
        along, across = self._along[is_kept](v.tobytes(), yaw), self._across[is_kept](u.tobytes(), yaw)
        if along.shape[1] * len(v) * len(u) < FEW:
            return np.asarray(np.einsum("vk,ku->vu", along, across, optimize=False))
        start_warp()
        from swath.field.ground.waves_kernel import sum_products

        return sum_products(along, across)

    @cached_property
    def _across(self) -> tuple[Factor, Factor]:
        """Sines and cosines of a of the waves by u, a row each; kept, as pages side by side share them."""
        kx, ky, amplitude, phase = self.kx, self.ky, self.amplitude[:, None], self.phase[:, None]

        def across(u: bytes, yaw: float) -> Array:
            ku = kx * np.cos(yaw) + ky * np.sin(yaw)
            a = 2 * pi * ku[:, None] * np.frombuffer(u) + phase
            return np.concatenate([amplitude * np.sin(a), amplitude * np.cos(a)])

        return across, lru_cache(maxsize=KEPT)(across)

    @cached_property
    def _along(self) -> tuple[Factor, Factor]:
        """Cosines and sines of b of the waves by v, a column each; kept as those of `_across`."""
        kx, ky = self.kx, self.ky

        def along(v: bytes, yaw: float) -> Array:
            kv = -kx * np.sin(yaw) + ky * np.cos(yaw)
            b = 2 * pi * kv[:, None] * np.frombuffer(v)
            return np.asarray(np.concatenate([np.cos(b), np.sin(b)]).T.copy())

        return along, lru_cache(maxsize=KEPT)(along)


def make_wave(amplitude: float, wavelength: float, direction: float, phase: float = 0.0) -> Waves:
    """One plane wave. amplitude, wavelength [m], direction it runs in and phase [rad]."""
    k = 1.0 / wavelength
    one = np.ones(1)
    return Waves(k * np.cos(direction) * one, k * np.sin(direction) * one, amplitude * one, phase * one)


def make_roughness(gd_n0: float, waviness: float, stream: Stream) -> Waves:
    """Isotropic roughness whose profiles follow ISO 8608. gd_n0: Gd(0.1 cycles/m) [m3]; waviness w > 0."""
    correction = sqrt(pi) * gamma(0.5 * (waviness + 1.0)) / gamma(0.5 * waviness)
    low, high = ROUGHNESS_BAND
    edges = portable.geomspace(low, high, WAVE_COUNT + 1)
    variance = _power_integral(edges, -waviness)
    top = edges[:-1] >= 3.0
    variance[top] *= 1.0 + _missing(waviness, high) / variance[top].sum()
    variance *= correction * gd_n0 * N0**waviness
    return _spread(edges, np.sqrt(2.0 * variance), stream)


def make_random_field(deviation: float, length: float, stream: Stream, count: int = 64) -> Waves:
    """Smooth isotropic random field of a standard deviation, Gaussian correlation exp(-(r / length)^2).

    Its radial spectrum is 2 pi^2 length^2 k exp(-(pi k length)^2), cut at k = 1 / length.
    """
    edges = np.linspace(0.0, 1.0 / length, count + 1)
    share = -np.diff(portable.exp(-((pi * edges * length) ** 2)))
    return _spread(edges, deviation * np.sqrt(2.0 * share / share.sum()), stream)


def _spread(edges: Array, amplitude: Array, stream: Stream) -> Waves:
    """One wave per band, at a random place in it; directions by the golden ratio, so even in any range."""
    count = len(amplitude)
    rng = stream.at(0)
    k = edges[:-1] + rng.random(count) * np.diff(edges)
    direction = pi * ((rng.random() + GOLDEN * np.arange(count)) % 1.0)
    phase = 2 * pi * rng.random(count)
    return Waves(k * np.cos(direction), k * np.sin(direction), amplitude, phase)


@lru_cache
def _missing(waviness: float, high: float, n: float = 1.4, stand_in: float = 3.5) -> float:
    """Variance that waves at `stand_in` need to show at n what k^-waviness beyond `high` shows there."""
    k = portable.geomspace(high, 1e4 * high, 20_001)
    share = portable.power(k, -waviness) * np.sqrt((stand_in**2 - n**2) / (k**2 - n**2))
    return float(np.trapezoid(share, k))


def _power_integral(edges: Array, exponent: float) -> Array:
    """Integral of k^exponent over each band."""
    if abs(exponent + 1.0) < 1e-9:
        return np.diff(portable.log(edges))
    return np.diff(portable.power(edges, exponent + 1.0)) / (exponent + 1.0)
