"""What the crop of the field takes from a radar's wave on its way.

Extinction of the wave = Q x geometric extinction. The geometric one, hits of a ray per metre, comes from the
very plants of the field: the area that they turn to the ray, by height, times density, height and lean of the
tile, where crop stands. Q is derived, not measured: stems as hollow dielectric cylinders (series of two
layers) at 500 stems/m2. No measurement of ripe wheat at 24 or 77 GHz was found.
"""

from math import exp, hypot, log, pi

import numpy as np

from swath.field.field import Field
from swath.field.memory_layout import PAGE_TILES, PlantLibrary, Shape
from swath.signals import F64

STEP = 0.01  # of the way through the crop [m]
BIN = 0.02  # of height, over which plants are averaged [m]
AZIMUTHS = 8  # directions in half a turn that they are averaged over
PARTS = 16  # of a primitive along its length
DB = 10.0 / log(10.0)  # dB of one neper of power
STEMS = 500 * 0.0035  # geometric extinction of the stems that the table holds for [1/m]
MOISTURE = (0.08, 0.12, 0.20, 0.35)  # water over wet mass of the straw
# dB/m one way of thin and thick walls, by band [GHz] and polarisation, over MOISTURE.
STRAW = {
    (24.1, "V"): ((0.9, 1.6, 4.9, 15.0), (1.6, 2.8, 8.2, 23.0)),
    (24.1, "H"): ((0.4, 0.7, 1.9, 5.0), (0.7, 1.2, 3.5, 10.0)),
    (76.5, "V"): ((5.5, 7.9, 14.0, 21.0), (9.7, 13.3, 22.0, 26.0)),
    (76.5, "H"): ((2.7, 3.7, 7.1, 14.0), (5.6, 7.9, 14.0, 23.0)),
}


def wave_factor(frequency: float, polarisation: str, moisture: float, wall: float = 0.5) -> float:
    """Q of straw: extinction of the wave over the geometric one.

    frequency [Hz], logarithms of Q are linear in its own; moisture: held outside the table;
    wall: 0 thin to 1 thick
    """
    logs = []
    for band in (24.1, 76.5):
        thin, thick = (np.interp(moisture, MOISTURE, row) for row in STRAW[band, polarisation])
        logs.append((1.0 - wall) * log(float(thin)) + wall * log(float(thick)))
    share = log(frequency / 24.1e9) / log(76.5 / 24.1)
    return exp(logs[0] + share * (logs[1] - logs[0])) / DB / STEMS


class StandLoss:
    """Optical depths through the stand of a field, as it is now."""

    def __init__(self, field: Field) -> None:
        self._field = field
        self.profile = silhouettes(field.library)
        self.heights = (np.arange(len(self.profile)) + 0.5) * BIN

    def depth(self, eye: F64, ends: F64) -> F64:
        """Integral of the geometric extinction from a point (3,) to points (n, 3) that lie in one upright
        plane with it at one distance [m]: (n,). Stubble and straw on the ground take nothing.
        """
        ray = ends[0, :2] - eye[:2]
        far = hypot(*ray.tolist())
        if far < STEP:
            return np.zeros(len(ends))
        count = int(far / STEP) + 1
        share = (np.arange(count) + 0.5) / count
        x, y = eye[0] + ray[0] * share, eye[1] + ray[1] * share
        stands = self._field.standing(x, y)
        if not stands.any():
            return np.zeros(len(ends))
        x, y, share = x[stands], y[stands], share[stands]
        scale, lean_x, lean_y, density = self.tiles(x, y)
        above = eye[2] + (ends[:, 2:] - eye[2]) * share - self._field.ground_height(x, y)
        k = density * np.interp(above / scale, self.heights, self.profile, right=0.0)
        rise = ends[:, 2] - eye[2]
        length = np.sqrt(far**2 + rise**2)
        ux, uy = (a / length[:, None] for a in self._field.to_stand(*(ray[:, None])))
        uz = (rise / length)[:, None]
        along = (lean_x * ux + lean_y * uy + scale * uz) / scale
        stem = (lean_x**2 + lean_y**2 + scale**2) / scale**2  # length of a stem per height, squared
        turned = np.sqrt(np.maximum(stem - along**2, 0.0))
        return np.asarray((k * turned).sum(axis=1) * length / count)

    def turned(self, ways: F64) -> tuple[F64, F64]:
        """Directions (n, 2) of the world in the frame of the stand: two of (n,)."""
        return self._field.to_stand(ways[:, 0], ways[:, 1])

    def tiles(self, x: F64, y: F64) -> F64:
        """Scale, lean_x, lean_y and density fraction of the tiles below points, (4, n)."""
        u, v = (
            np.floor(a / self._field.library.tile_size).astype(np.int64) for a in self._field.to_stand(x, y)
        )
        pages = self._field.pages
        slot = pages.slots_at(u // PAGE_TILES, v // PAGE_TILES)
        return pages.tile_stand[slot, v % PAGE_TILES, u % PAGE_TILES].astype(np.float64).T


def silhouettes(library: PlantLibrary) -> F64:
    """Hits per metre of a level ray through upright plants at full density, by height in steps of `BIN`.

    The area that all parts of the plants turn to a level ray, mean over its directions, per volume; where
    parts overlap each counts.
    """
    inside = ((library.base >= 0.0) & (library.base < library.tile_size)).all(axis=1)  # no copies
    a, b, w = (v[inside].astype(np.float64) for v in (library.a, library.b, library.width))
    radius, shape = library.radius[inside].astype(np.float64), library.shape[inside]
    along = b - a
    normal = np.stack(
        [
            w[:, 1] * along[:, 2] - w[:, 2] * along[:, 1],
            w[:, 2] * along[:, 0] - w[:, 0] * along[:, 2],
        ]
    )
    area = np.zeros(len(a))
    for k in range(AZIMUTHS):
        x, y = np.cos(pi * k / AZIMUTHS), np.sin(pi * k / AZIMUTHS)
        aside = np.hypot(along[:, 1] * x - along[:, 0] * y, along[:, 2])
        flat = 2.0 * np.abs(normal[0] * x + normal[1] * y)
        flat = np.where(shape == Shape.TRIANGLE, 0.5 * flat, flat)
        rod = radius * (2.0 * aside + pi * radius)
        area += np.where(shape == Shape.CAPSULE, rod, flat) / AZIMUTHS
    share = (np.arange(PARTS) + 0.5) / PARTS
    height = a[:, 2:] + along[:, 2:] * share
    bins = np.clip((height / BIN).astype(np.int64), 0, None)
    total = np.bincount(bins.ravel(), weights=np.repeat(area / PARTS, PARTS))
    return np.asarray(total / (library.tile_count * library.tile_size**2 * BIN))
