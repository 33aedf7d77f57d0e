"""What breaks a clean edge: gaps where the crop is missing and teeth that are bitten out of it."""

from dataclasses import dataclass
from functools import cached_property
from math import fsum, inf, pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swath.field.edges.track import EdgeShape
from swath.field.hashing import hash_uniform
from swath.field.memory_layout import STANDING

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gap:
    """Crop missing from `start` to `end` along the edge, `depth` deep [m]. code: what is there instead."""

    start: float
    end: float
    depth: float
    code: int


@dataclass(frozen=True)
class Teeth:
    """Bites out of the crop, 0 to `amplitude` deep, repeating every `wavelength` [m].

    kind: `sawtooth` (depth rises from 0 to the amplitude, then drops) or `random` (smooth, independent depths
        half a wavelength apart). seed: of phase and depths.
    """

    amplitude: float
    wavelength: float
    kind: Literal["sawtooth", "random"]
    seed: int

    def depth(self, s: Array) -> Array:
        """Depth of the bite [m] at s [m] along the edge."""
        if self.kind == "sawtooth":
            return np.asarray(self.amplitude * ((s / self.wavelength + hash_uniform(self.seed, 0)[0]) % 1.0))
        knot = 2.0 * s / self.wavelength
        k = np.floor(knot)
        blend = 0.5 - 0.5 * np.cos(np.pi * (knot - k))
        index = k.astype(np.int64)
        low, high = hash_uniform(self.seed, index), hash_uniform(self.seed, index + 1)
        return np.asarray(self.amplitude * (low + (high - low) * blend).reshape(s.shape))


@dataclass(frozen=True)
class BrokenEdge:
    """The edge as it stands in the field at the start.

    stubble: code of the cut side [cm]
    begin: where along the edge the crop begins [m], before it lies the headland, cut as the cut side is
    """

    shape: EdgeShape
    stubble: int
    gaps: tuple[Gap, ...] = ()
    teeth: Teeth | None = None
    begin: float = -np.inf

    def code(self, x: Array, y: Array) -> NDArray[np.int16]:
        """Code of world points: STANDING, or the height of what was left there [cm]."""
        s, offset = self.shape.project(x, y)
        inside = offset if self.shape.crop_side == "left" else -offset
        bite = self.teeth.depth(s) if self.teeth is not None else 0.0
        codes = np.where(inside >= bite, STANDING, self.stubble).astype(np.int16)
        for gap in self.gaps:
            codes[(inside >= 0.0) & (inside < gap.depth) & (s >= gap.start) & (s < gap.end)] = gap.code
        codes[s < self.begin] = self.stubble
        return codes

    def code_within(self, x: Array, y: Array, radius: float) -> NDArray[np.int16]:
        """The one code of all points within the radius [m], -1 where there may be several."""
        s, offset = self.shape.project(x, y)
        distance = offset if self.shape.crop_side == "left" else -offset
        deep = max([0.0, *(g.depth for g in self.gaps)])
        deep = max(deep, self.teeth.amplitude if self.teeth is not None else 0.0)
        codes = np.full(distance.shape, -1, np.int16)
        is_headland, is_near = s < self.begin, self._is_near_headland(x, y, radius)
        if self.is_plain:
            is_near |= np.abs(distance) > self._plain_within - radius
            codes[is_headland & ~is_near] = self.stubble
        codes[(distance > radius + deep) & ~is_headland & ~is_near] = STANDING
        codes[distance < -radius] = self.stubble
        return codes

    def _is_near_headland(self, x: Array, y: Array, radius: float) -> NDArray[np.bool_]:
        """True where the border between headland and crop is not farther away than the radius [m]."""
        if not np.isfinite(self.begin):
            return np.zeros(np.shape(x), dtype=bool)
        px, py, cos, sin = self._start
        return np.asarray(np.abs((x - px) * cos + (y - py) * sin) <= radius)

    @cached_property
    def _start(self) -> tuple[float, float, float, float]:
        """Where the crop begins: x, y [m], cosine and sine of the direction of the edge there."""
        heading = float(self.shape.heading_at(self.begin))
        px, py = self.shape.point_at(self.begin).tolist()
        return px, py, float(np.cos(heading)), float(np.sin(heading))

    @property
    def is_plain(self) -> bool:
        """True where `code_within` is exact: the edge has no corners and turns by a right angle at most."""
        return self._plain_within > 0.0

    @cached_property
    def _plain_within(self) -> float:
        """Distance from the edge [m] within which neighbours have neighbouring nearest points on it.

        The least radius of its arcs; -inf where it has corners, turns more than a right angle, or is closed.
        """
        pieces = self.shape.pieces
        turned = [abs(p.curvature) * p.length for p in pieces]
        corners = [abs(p.turn_in - p.heading) for p in pieces]
        if self.shape.is_closed or max(corners) > 1e-9 or fsum(turned) > 0.5 * pi:
            return -inf
        return 1.0 / max(max(abs(p.curvature) for p in pieces), 1e-9)
