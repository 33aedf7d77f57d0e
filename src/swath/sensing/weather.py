"""What floats between scanner and crop: dust, chaff and rain.

Extinction takes energy from every ray, exp(-2 b r) there and back (Beer-Lambert; within 10 % up to an optical
depth of 1.5 in dust chambers). Puffs of chaff or dust near the cover throw echoes back themselves: the case
of US 11,002,841, where echoes nearer than a limit count as disturbance and too few useful ones call for
cleaning.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.signals import F64


@dataclass(frozen=True)
class Weather:
    """Dust and rain, none by default.

    extinction_per_m: of the dust [1/m], 0.05 light to 1 dense
    rain_mm_h: adds 0.01 R^0.6 [1/m] (Goodin et al. 2019, doi:10.3390/electronics8010089)
    near_returns: puffs of dust, chaff or drops that a beam would meet on a free path, mean number per scan
    near_reach_m: how far they reach, mean distance beyond the sensor's least range
    near_share: of a beam's energy that meets the puff; near_reflectance: of the puff
    """

    extinction_per_m: Annotated[float, Ge(0), Le(10)] = 0.0
    rain_mm_h: Annotated[float, Ge(0), Le(300)] = 0.0
    near_returns: Annotated[float, Ge(0), Le(10)] = 0.0
    near_reach_m: Annotated[float, Gt(0), Le(50)] = 1.0
    near_share: Annotated[float, Gt(0), Le(1)] = 0.6
    near_reflectance: Annotated[float, Ge(0), Le(1)] = 0.3

    @property
    def extinction(self) -> float:
        """Of dust and rain together [1/m]."""
        return self.extinction_per_m + 0.01 * float(self.rain_mm_h**0.6)

    @property
    def is_clear(self) -> bool:
        """True when it changes nothing."""
        return self.extinction == 0.0 and self.near_returns == 0.0


def disturb(
    weather: Weather, distance: F64, albedo: F64, range_min: float, rng: np.random.Generator
) -> tuple[F64, F64]:
    """Distances [m] and albedos of sub-rays, (n, s), with the air between: new arrays.

    Puffs come at rate near_returns / near_reach * exp(-r / near_reach) per metre behind range_min; only the
    nearest of a beam counts, and only where the path there is free.
    """
    distance, albedo = distance.copy(), albedo.copy()
    n, s = distance.shape
    if weather.near_returns > 0.0:
        spent = rng.standard_exponential(n) / weather.near_returns  # of the rate's integral up to the puff
        with np.errstate(divide="ignore", invalid="ignore"):
            puff = range_min - weather.near_reach_m * portable.log1p(-np.where(spent < 1.0, spent, np.nan))
        meets = rng.uniform(size=(n, s)) < weather.near_share
        meets &= ~(distance <= puff[:, None]) & np.isfinite(puff)[:, None]
        distance = np.where(meets, puff[:, None], distance)
        albedo = np.where(meets, weather.near_reflectance, albedo)
    if weather.extinction > 0.0:
        albedo = albedo * portable.exp(-2.0 * weather.extinction * np.nan_to_num(distance))
    return distance, albedo
