"""Air before a scanner that dims and sends back light: fog, and the dust of machines.

Along each beam extinction is taken in the middles of steps of half a pulse, c tau / 2. What floats in one of
them sends back, relative to a white target that fills the spot (the soft target of Rasshofer, Spies and Spies
2011, doi:10.5194/ars-9-49-2011),

    pi b c tau / 2 exp(-2 depth),    b = extinction / S

with S the lidar ratio of `ScannerWeather`.
"""

import threading
from dataclasses import dataclass
from functools import cached_property
from math import fsum, pi

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.field import Field
from swath.kernels import Numbered, address, numbered
from swath.signals import F64

NOTHING = 1e-9  # a puff that has less extinction there adds nothing [1/m]
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
        best, energy = np.empty(len(self.depths), np.int64), np.empty(len(self.depths))
        whole, real, launch = _LAUNCHES.echo
        whole[:] = *map(address, (self.depths, self.local, best, energy)), *self.depths.shape
        real[:] = self.step, nearest
        launch()
        place: F64 = np.asarray(self.step * (best + 0.5))
        albedo: F64 = np.asarray(pi * self.step / lidar_ratio * energy * place**2)
        return place, albedo


def haze_along(
    field: Field, origins: F64, directions: F64, uniform: float, reach: float | F64, step: float
) -> Haze:
    """The air along beams.

    origins, directions: world (n, 3); uniform: extinction everywhere [1/m]; reach: where each ends,
    nothing is beyond [m]
    """
    reach = np.broadcast_to(np.asarray(reach, np.float64), len(origins))
    place, most = origins.mean(axis=0), float(reach.max(initial=step))
    ground = float(field.ground_height(place[0], place[1]))
    puffs = np.concatenate([np.zeros((0, 6)), *(puffs.merged() for puffs in field.plumes.values())])
    away = np.hypot(puffs[:, 0] - place[0], puffs[:, 1] - place[1])
    puffs = puffs[away < most + NEAR / np.sqrt(2.0 * puffs[:, 3])]
    return _through(puffs, origins, directions, uniform, ground, reach, int(np.ceil(most / step)), step)


def plumes_at(field: Field, place: F64) -> float:
    """Extinction by the dust of machines at a world point (3,) [1/m]."""
    if not field.plumes:
        return 0.0
    above = place[None] - (0.0, 0.0, float(field.ground_height(*place[:2].tolist())))
    return fsum(extinction_at(puffs.packed(), above)[0] for puffs in field.plumes.values())


def extinction_at(puffs: F64, points: F64) -> F64:
    """Extinction [1/m] by packed puffs (n, 6) at points x, y and height above the ground (m, 3), (m,)."""
    reach = np.ones(len(points))
    return _through(puffs, points, np.zeros_like(points), 0.0, 0.0, reach, 1, 1.0).local[:, 0]


def _through(
    puffs: F64,
    origins: F64,
    directions: F64,
    uniform: float,
    ground: float,
    reach: F64,
    count: int,
    step: float,
) -> Haze:
    depths, local = np.empty((len(origins), count)), np.empty((len(origins), count))
    puffs = np.column_stack([puffs, portable.log(puffs[:, 5] / NOTHING)])
    arrays = [
        *(np.ascontiguousarray(a, np.float64) for a in (origins, directions, puffs, reach)),
        depths,
        local,
    ]
    whole, real, launch = _LAUNCHES.dust
    whole[:] = *map(address, arrays), *depths.shape, len(puffs)
    real[:] = uniform, ground, step
    launch()
    return Haze(step, depths, local)


class _Launches(threading.local):
    """The compiled kernels, each with the arrays that it reads its numbers from; every thread has its own."""

    @cached_property
    def dust(self) -> Numbered:
        from swath.sensing.native.dust_kernel import through_dust

        return numbered(through_dust, 9, 3)

    @cached_property
    def echo(self) -> Numbered:
        from swath.sensing.native.dust_kernel import air_echoes

        return numbered(air_echoes, 6, 2)


_LAUNCHES = _Launches()
