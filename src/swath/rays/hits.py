"""What is cast and what comes of it: options, hits, and `Spots`, beams whose sub-rays are not yet rays."""

from dataclasses import dataclass, field
from typing import Any, Required, TypedDict

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Spots:
    """Beams with sub-rays; what `RayCaster.cast_bundles` takes.

    origins: (n, 3) [m]
    axes: (n, 3, 3), columns = beam direction, across, along, a frame
    offsets: (1 or n, s, 5) of each sub-ray: where it leaves, across and along [m]; its slope, across and
        along; 1 / length of (1, slopes)
    """

    origins: F64
    axes: F64
    offsets: F64

    @property
    def shape(self) -> tuple[int, int]:
        """Beams, sub-rays."""
        return len(self.origins), self.offsets.shape[1]

    def rays(self) -> tuple[F64, F64]:
        """Origins and unit directions, each (n, s, 3)."""
        out = [self.offsets[:, :, i] for i in range(5)]
        start = np.empty((*self.shape, 3))
        direction = np.empty_like(start)
        for k in range(3):  # by coordinate: numpy is slow over a last axis of three
            forward, across, along = (self.axes[:, k, i, None] for i in range(3))
            start[:, :, k] = self.origins[:, k, None] + out[0] * across + out[1] * along
            direction[:, :, k] = (forward + out[2] * across + out[3] * along) * out[4]
        return start, direction


F32 = NDArray[np.float32]


class CastOptions(TypedDict, total=False):
    """range_max: rays end there [m]; solids: what stands in the field besides crop; t: time [ns], default 0,
    which matters in wind alone; normals: whether hits have them, default no.
    """

    range_max: Required[float]
    solids: Solids | None
    t: int
    normals: bool


@dataclass(frozen=True)
class Hits:
    """Nearest hits of rays, all in the shape of the rays.

    distance [m], nan = nothing within range; organ: `memory_layout.Organ`; cosine: |cos| of the incidence
    angle; reflectance of what was hit at 905 nm; the last three are 0 where nothing was hit
    normal: unit normal on the side that was hit, world (..., 3), 0 where nothing was; (0, 3) unless asked for
    """

    distance: F32
    organ: NDArray[np.uint8]
    cosine: F32
    reflectance: F32
    normal: F32 = field(default_factory=lambda: np.empty((0, 3), np.float32))

    @staticmethod
    def uninitialised(shape: tuple[int, ...], normals: bool = False) -> "Hits":
        """Arrays that a kernel is about to fill."""
        distance, cosine, reflectance = (np.empty(shape, np.float32) for _ in range(3))
        normal = np.empty((*(shape if normals else (0,)), 3), np.float32)
        return Hits(distance, np.empty(shape, np.uint8), cosine, reflectance, normal)

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """True where something was hit."""
        result: NDArray[np.bool_] = self.organ > 0
        return result

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """distance, organ, cosine, reflectance, normal."""
        return self.distance, self.organ, self.cosine, self.reflectance, self.normal

    def reshaped(self, shape: tuple[int, ...]) -> "Hits":
        """The same hits in another shape."""
        shapes = *[shape] * 4, (*(shape if self.normal.size else (0,)), 3)
        return Hits(*(a.reshape(s) for a, s in zip(self.arrays, shapes, strict=True)))
