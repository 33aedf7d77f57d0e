"""How a beam's measured height spreads over a canopy: the fitted table of the LiDAR level `empirical`.

Two grids, one of standing crop and one of its stubble: a spot that stubble fills by half measures the soil
between the stems, so its heights do not follow from those of the standing crop. Cells of a grid over stem
density, height, depression of the beam and spot diameter. Each holds the distribution of the measured height:
quantiles of the returns from crop, relative to the height, and the share of beams that see the ground.
Between the nodes of the grid, quantiles and log(-log(ground share)) go linearly in log density, height (over
stubble log height), log tan depression and log spot: for a thin ray -log(ground share) is
n A cot(depression), a straight line in these (closed form of first returns).
"""

from dataclasses import dataclass, field
from itertools import product
from math import exp, log, tan

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.errors import InputError

F64 = NDArray[np.float64]
SHARE_MIN = 1e-7  # ground shares are kept within [SHARE_MIN, 1 - SHARE_MIN]
NODES = 41  # quantiles per cell
AXES = ("stem density", "crop height", "depression", "spot diameter")


def quantile_nodes(count: int = NODES) -> F64:
    """Shares from the highest return (0) to the lowest (1), close together at both ends."""
    return 0.5 * (1.0 - np.cos(np.pi * np.arange(count) / (count - 1)))


@dataclass(frozen=True)
class Spread:
    """Nodes of a grid, rising: density [1/m2] (i,), height of crop or stubble [m] (j,), depression [rad]
    (k,), spot [m] (l,).

    quantile: (i, j, k, l, node_count) measured height over that height at `quantile_nodes`, falling; nan
        nowhere
    ground_share: (i, j, k, l)
    ground_lift: (i, j, k, l) mean measured height of ground returns [m]: crop in the spot hides its far part
    is_stubble: heights, too, go in logarithms: what a stem of stubble shades is proportional to them
    """

    density: F64
    height: F64
    depression: F64
    spot: F64
    quantile: F64
    ground_share: F64
    ground_lift: F64
    is_stubble: bool = False

    def __post_init__(self) -> None:
        shape = tuple(len(a) for a in self.axes)
        for name, axis in zip(AXES, self.axes, strict=True):
            if axis.ndim != 1 or len(axis) == 0 or np.any(np.diff(axis) <= 0) or not np.all(axis > 0):
                raise InputError(name, axis.tolist(), "expected rising positive nodes")
        if (
            self.quantile.shape[:-1] != shape
            or self.ground_share.shape != shape
            or self.ground_lift.shape != shape
        ):
            raise InputError("quantile", self.quantile.shape, f"expected cells of shape {shape}")
        numbers = (*self.axes, self.quantile, self.ground_share, self.ground_lift)
        if not all(np.isfinite(a).all() and a.size for a in numbers):
            raise InputError("table", None, "expected finite cells in every array")

    @property
    def axes(self) -> tuple[F64, F64, F64, F64]:
        """The four axes in the order of the array."""
        return self.density, self.height, self.depression, self.spot

    def scaled_axes(self) -> tuple[F64, F64, F64, F64]:
        """Axes in the coordinates in which the table is linear."""
        height = portable.log(self.height) if self.is_stubble else self.height
        depression = portable.log(portable.tan(self.depression))
        return portable.log(self.density), height, depression, portable.log(self.spot)

    def cell(self, density: float, height: float, depression: float, spot: float) -> tuple[F64, float, float]:
        """Quantiles (node_count,), ground share and lift [m] at one place; clamped outside the range."""
        value = (log(density), log(height) if self.is_stubble else height, log(tan(depression)), log(spot))
        base, share = [], []
        for v, axis in zip(value, self.scaled_axes(), strict=True):
            k = int(np.clip(np.searchsorted(axis, v, side="right") - 1, 0, max(len(axis) - 2, 0)))
            step = axis[k + 1] - axis[k] if len(axis) > 1 else 1.0
            base.append(k)
            share.append(float(np.clip((v - axis[k]) / step, 0.0, 1.0)) if len(axis) > 1 else 0.0)
        loglog, lift, quantile = 0.0, 0.0, np.zeros(self.quantile.shape[-1])
        for corner in product((0, 1), repeat=4):
            weight = float(np.prod([s if up else 1.0 - s for s, up in zip(share, corner, strict=True)]))
            if weight > 0.0:
                at = tuple(k + up for k, up in zip(base, corner, strict=True))
                loglog += weight * float(double_log(self.ground_share[at]))
                lift += weight * float(self.ground_lift[at])
                quantile += weight * self.quantile[at]
        return quantile, exp(-exp(loglog)), lift

    def heights(self, share: F64, density: float, height: float, depression: float, spot: float) -> F64:
        """Measured heights [m] of beams with drawn shares in [0, 1): small ones high up, the rest ground.

        Ground returns lie evenly between 0 and twice their mean lift.
        """
        quantile, ground, lift = self.cell(density, height, depression, spot)
        share = np.asarray(share)
        inside = np.clip(share / (1.0 - ground), 0.0, 1.0)
        found = np.interp(inside, quantile_nodes(len(quantile)), quantile) * height
        return np.where(share < 1.0 - ground, found, 2.0 * lift * (1.0 - share) / ground)


@dataclass(frozen=True)
class SideSpread:
    """How much less the depth at an echo varies where a beam enters standing crop below its top.

    height: (k,) rising, of the place where it first meets crop, over the crop's height; from the last on all
        is as from above
    spot: (m,) rising diameters [m]
    factor: (2, k, m) on how far the log depth lies below and above that of `median`
    median: (m,) of the optical depth at the echo
    """

    height: F64
    spot: F64
    factor: F64
    median: F64

    def __post_init__(self) -> None:
        shape = 2, len(self.height), len(self.spot)
        for name, axis in (("side height", self.height), ("side spot", self.spot)):
            if axis.ndim != 1 or len(axis) < 2 or np.any(np.diff(axis) <= 0) or not np.all(axis > 0):
                raise InputError(name, axis.tolist(), "expected two or more rising positive nodes")
        if self.factor.shape != shape or self.median.shape != shape[2:]:
            raise InputError("side factor", self.factor.shape, f"expected shape {shape}")
        if not (np.all(self.factor > 0) and np.all(self.median > 0)):
            raise InputError("side factor", None, "expected factors and medians > 0")


@dataclass(frozen=True)
class SpreadTable:
    """standing, stubble: the two grids.

    side: of beams that enter standing crop through its side

    silhouette: (k, m) what a stem stops of thin rays above equal steps `fine` of the crop's relative height
        [m2], from `view`, (k,) rising depressions [rad]: how crop adds up along a beam
    aside: (levels, n, 2) how far what is seen at a height stands aside of its foot, per crop height: along
        and across the beam's heading, n a power of two; levels every `aside_step` of the relative height
    cosine: mean |cos| of incidence on crop, sets the intensity
    correlation: (c0, c1) [m, 1]: beams d apart at the crop correlate as exp(-d / (c0 + c1 * spot))
    about: source, range of validity, fit quality, as in the YAML beside the npz
    """

    standing: Spread
    stubble: Spread
    side: SideSpread
    silhouette: F64
    view: F64
    fine: float
    aside: F64
    aside_step: float
    cosine: float
    correlation: tuple[float, float]
    about: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.stubble.quantile.shape[-1] != self.standing.quantile.shape[-1]:
            raise InputError("stubble", self.stubble.quantile.shape, "expected as many quantiles as standing")
        if self.silhouette.ndim != 2 or self.aside.ndim != 3 or self.aside.shape[2] != 2:
            shapes = self.silhouette.shape, self.aside.shape
            raise InputError("silhouette, aside", shapes, "expected shapes (k, m) and (levels, n, 2)")
        is_rising = np.all(np.diff(self.view) > 0) and np.all(self.view > 0)
        if self.view.shape != self.silhouette.shape[:1] or not is_rising:
            expected = "expected rising positive depressions, one per silhouette"
            raise InputError("view", self.view.tolist(), expected)
        if self.aside.shape[1].bit_count() != 1:
            raise InputError("aside", self.aside.shape, "expected a power of two of places at a level")
        if not all(np.isfinite(a).all() and a.size for a in (self.silhouette, self.aside)):
            raise InputError("table", None, "expected finite cells in every array")
        numbers = (self.fine, self.aside_step, self.cosine, *self.correlation)
        if not (self.fine > 0.0 and self.aside_step > 0.0 and np.isfinite(numbers).all()):
            raise InputError("table", None, "expected finite numbers, fine and aside_step > 0")


def double_log(ground_share: F64 | float) -> F64:
    """log(-log(g)) of ground shares, which are kept off 0 and 1."""
    return portable.log(-portable.log(np.clip(ground_share, SHARE_MIN, 1.0 - SHARE_MIN)))
