"""Sub-rays of beams before they are rays: a few numbers per beam, a few per sub-ray."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Spots:
    """Beams with sub-rays; what `RayCaster.cast_bundles` takes.

    origins: (n, 3) [m]; axes: (n, 3, 3), columns = beam direction, across, along, a frame
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
