"""What rays hit, and the options of every cast."""

from dataclasses import dataclass
from typing import Any, Required, TypedDict

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids

F32 = NDArray[np.float32]


class CastOptions(TypedDict, total=False):
    """range_max: rays end there [m]; solids: what stands in the field besides crop; t: time [ns], default 0,
    which matters in wind alone."""

    range_max: Required[float]
    solids: Solids | None
    t: int


@dataclass(frozen=True)
class Hits:
    """Nearest hits of rays, all in the shape of the rays.

    distance [m], nan = nothing within range; organ: `memory_layout.Organ`; cosine: |cos| of the incidence
    angle; reflectance of what was hit at 905 nm; the last three are 0 where nothing was hit
    """

    distance: F32
    organ: NDArray[np.uint8]
    cosine: F32
    reflectance: F32

    @staticmethod
    def uninitialised(shape: tuple[int, ...]) -> "Hits":
        """Arrays that a kernel is about to fill."""
        distance, cosine, reflectance = (np.empty(shape, np.float32) for _ in range(3))
        return Hits(distance, np.empty(shape, np.uint8), cosine, reflectance)

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """True where something was hit."""
        result: NDArray[np.bool_] = self.organ > 0
        return result

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """distance, organ, cosine, reflectance."""
        return self.distance, self.organ, self.cosine, self.reflectance

    def reshaped(self, shape: tuple[int, ...]) -> "Hits":
        """The same hits in another shape."""
        return Hits(*(a.reshape(shape) for a in self.arrays))
