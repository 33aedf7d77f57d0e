"""Air before a scanner that dims and sends back light: fog, and the dust of machines.

Along each beam extinction is taken in the middles of steps of half a pulse, c tau / 2. What floats in one of
them sends back, relative to a white target that fills the spot (the soft target of Rasshofer, Spies and Spies
2011, doi:10.5194/ars-9-49-2011),

    pi b c tau / 2 exp(-2 depth),    b = extinction / S

with S the lidar ratio of `ScannerWeather`.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.field import Field
from swath.kernels import start_warp
from swath.signals import F64

NEAR = 6.5  # puffs are looked for so many of their standard deviations beyond the reach


@dataclass(frozen=True)
class Haze:
    """The air along n beams, in k steps of `step` [m].

    depths: optical depth at the end of each, one way, (n, k)
    local: extinction in the middle of each [1/m], (n, k)
    """

    step: float
    depths: F64
    local: F64

    def depth(self, distance: F64, beam: NDArray[np.int64] | None = None) -> F64:
        """Optical depth of one way to distances [m], beyond the last step as in it; nan is no way at all.

        beam: of each distance, in its shape; None = distances are (n, s)
        """
        place = np.nan_to_num(distance) / self.step
        k = np.minimum(place.astype(np.int64), self.depths.shape[1] - 1)
        rows = np.arange(len(distance))[:, None] if beam is None else beam
        return np.asarray(self.depths[rows, k] - (k + 1 - place) * self.step * self.local[rows, k])

    def echo(self, nearest: float, lidar_ratio: float) -> tuple[F64, F64]:
        """Place of the strongest echo of the air from `nearest` [m] on, and its albedo, (n,) each."""
        middles = self.step * (np.arange(self.depths.shape[1]) + 0.5)
        depth = self.depths - 0.5 * self.step * self.local
        albedo = pi * self.step / lidar_ratio * self.local * portable.exp(-2.0 * depth)
        energy = np.where(middles >= nearest, albedo, 0.0) / middles**2
        best = energy.argmax(axis=1)
        rows = np.arange(len(best))
        return middles[best], np.where(energy[rows, best] > 0.0, albedo[rows, best], 0.0)


def haze_along(
    field: Field, origins: F64, directions: F64, uniform: float, reach: float, step: float
) -> Haze:
    """The air along beams.

    origins, directions: world (n, 3); uniform: extinction everywhere [1/m]; reach: how far to look [m]
    """
    wp = start_warp()
    from swath.sensing.native.dust_kernel import through_dust

    count = max(int(np.ceil(reach / step)), 1)
    place = origins.mean(axis=0)
    ground = float(field.ground_height(place[0], place[1]))
    puffs = np.concatenate([np.zeros((0, 6)), *(puffs.packed() for puffs in field.plumes.values())])
    away = np.hypot(puffs[:, 0] - place[0], puffs[:, 1] - place[1])
    puffs = puffs[away < reach + NEAR / np.sqrt(2.0 * puffs[:, 3])]
    depths, local = np.empty((len(origins), count)), np.empty((len(origins), count))
    arrays = [
        wp.array(np.ascontiguousarray(a), dtype=wp.vec3d, device="cpu", copy=False)
        for a in (origins, directions)
    ]
    dust, *found = (wp.array(a, dtype=wp.float64, device="cpu", copy=False) for a in (puffs, depths, local))
    inputs = [*arrays, dust, uniform, ground, step, *found]
    wp.launch(through_dust, dim=len(origins), inputs=inputs, device="cpu")
    return Haze(step, depths, local)
