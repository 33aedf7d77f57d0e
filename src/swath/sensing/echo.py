"""The receiver: which distances a sensor reports for a bundle of sub-rays.

Two families of rules. `nearest`, `percentile`, `mean` and `leading_edge` take the whole bundle for one echo,
however far apart its hits lie. `first`, `last`, `strongest` and `all` first sort the hits into echoes: hits
closer together than c tau / 2 (tau: length of the pulse) reach the receiver as one merged pulse; `within`
says where in such an echo its range lies. Phenomenological: energies per sub-ray, no waveform.

Energies: `percentile` counts the beam's own energy (the weights of the pattern, the paper's rule); `mean`,
`leading_edge` and `strongest` the received energy weight * reflectance * cos(incidence) * transmission / r2.
Pulses below the least detectable energy (a 10 % target that fills the spot at the reach given) are not seen,
by the rules for one echo neither. The rules themselves are compiled: native/receive.cpp.

What floats between scanner and crop is dust, chaff and rain. Extinction takes energy from every ray, exp(-2
b r) there and back (Beer-Lambert; within 10 % up to an optical depth of 1.5 in dust chambers). Puffs of
chaff or dust near the cover throw echoes back themselves: the case of US 11,002,841, where echoes nearer
than a limit count as disturbance and too few useful ones call for cleaning.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core import portable
from swath.core.asked import replaced
from swath.core.estimate import Estimate
from swath.field.field import Field
from swath.field.weather import RainLaw, SiteWeather, fog_extinction, rain_extinction
from swath.kernels import Numbered, address, numbered, repeatable, start_warp
from swath.rays.hits import Spots
from swath.sensing.haze import Haze, plumes_at
from swath.signals import F64


@dataclass(frozen=True)
class Weather:
    """Dust and rain before a sensor; fog is that of field.weather.

    extinction_per_m: extinction of the dust, 0.002 the air at a cab, 0.05 to 0.3 the core of a plume; none =
        that of field.weather
    rain_mm_h: rain; none = that of field.weather
    near_returns: mean number per scan of puffs of dust, chaff or drops that a beam would meet on a free path
        [1]
    near_reach_m: mean distance of the puffs beyond the sensor's least range
    near_share: share of a beam's energy that meets the puff [1]
    near_reflectance: reflectance of the puff [1]
    """

    extinction_per_m: Annotated[float, Ge(0), Le(10)] | None = None
    rain_mm_h: Annotated[float, Ge(0), Le(300)] | None = None
    near_returns: Annotated[float, Ge(0), Le(10)] = 0.0
    near_reach_m: Annotated[float, Gt(0), Le(50), Estimate(0.3, 3, decides="near_returns")] = 1.0
    near_share: Annotated[float, Gt(0), Le(1), Estimate(0.3, 1, decides="near_returns")] = 0.6
    near_reflectance: Annotated[float, Ge(0), Le(1), Estimate(0.1, 0.5, decides="near_returns")] = 0.3

    @property
    def law(self) -> RainLaw:
        """How rain dims light."""
        return "drops"

    @property
    def extinction(self) -> float:
        """Extinction of dust and rain together [1/m]."""
        return (self.extinction_per_m or 0.0) + rain_extinction(self.rain_mm_h or 0.0, self.law)

    def under(self, weather: SiteWeather | None, t: int, wavelength: float) -> Self:
        """The air before the sensor at a time of the run [ns]: what is left open is the site's weather.

        Fog dims light as dust does, so its extinction is added to that of the dust.

        wavelength: [m]
        """
        if weather is None:
            return self
        air = weather.at(t)
        dust = air.dust if self.extinction_per_m is None else self.extinction_per_m
        rain = air.rain if self.rain_mm_h is None else self.rain_mm_h
        return replaced(self, extinction_per_m=dust + fog_extinction(air.mor, wavelength), rain_mm_h=rain)

    def met(self, field: Field, place: F64) -> dict[str, float]:
        """Rain, and extinction with the dust of machines that drifts past a world point (3,)."""
        dust = (self.extinction_per_m or 0.0) + plumes_at(field, place)
        return {"rain_mm_h": self.rain_mm_h or 0.0, "dust_per_m": dust}

    @property
    def is_clear(self) -> bool:
        """True when it changes nothing."""
        return self.extinction == 0.0 and self.near_returns == 0.0


@dataclass(frozen=True)
class ScannerWeather(Weather):
    """Dust, chaff and rain before a scanner.

    lidar_ratio_sr: extinction of fog and dust over what they send back: 18 fog at 905 nm, 14 to 34 fine dust,
        70 and more coarse dust
    overlap_m: from here on the receiver sees all of the beam: nothing nearer sends an echo of the air; Hahner
        et al. 2021 (arXiv:2108.05249) take 1 m for a scanner of another make, measured it was not
    rain_law: how rain dims its light: `goodin`, 0.01 R^0.6 per m, the loss of one scanner (Goodin et al.
        2019, doi:10.3390/electronics8010089), or `drops` of Marshall and Palmer, a twenty-fifth of it
    """

    lidar_ratio_sr: Annotated[float, Ge(5), Le(1000), Estimate(14, 100, decides="dust_per_m")] = 30.0
    overlap_m: Annotated[float, Ge(0), Le(20), Estimate(0.3, 2, decides="dust_per_m")] = 1.0
    rain_law: RainLaw = "goodin"

    @property
    def law(self) -> RainLaw:
        """How rain dims light."""
        return self.rain_law


def disturb(
    weather: Weather,
    distance: F64,
    albedo: F64,
    range_min: float,
    rng: np.random.Generator,
    haze: Haze | None = None,
) -> tuple[F64, F64]:
    """Distances [m] and albedos of sub-rays, (n, s), with the air between: new arrays.

    haze: the air along the beams, where it is not the same everywhere

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
    if haze is not None:
        rain = rain_extinction(weather.rain_mm_h or 0.0, weather.law)
        depth = haze.depth(distance) + rain * np.nan_to_num(distance)
        albedo = albedo * portable.exp(-2.0 * depth)
    elif weather.extinction > 0.0:
        albedo = albedo * portable.exp(-2.0 * weather.extinction * np.nan_to_num(distance))
    return distance, albedo


Within = Literal["nearest", "percentile", "mean", "leading_edge"]
EchoRule = Literal["nearest", "percentile", "mean", "leading_edge", "first", "last", "strongest", "all"]
LIGHT_SPEED = 299_792_458.0  # [m/s]
_ONE_ECHO: dict[EchoRule, Within] = {
    "nearest": "nearest",
    "percentile": "percentile",
    "mean": "mean",
    "leading_edge": "leading_edge",
}
_RULES: dict[EchoRule, int] = {"first": 1, "last": 2, "strongest": 3, "all": 4}  # as in native/receive.cpp
_WITHIN: dict[Within, int] = {"nearest": 0, "percentile": 1, "mean": 2, "leading_edge": 3}


@dataclass(frozen=True)
class Bundle:
    """What the sub-rays of n beams met.

    distance [m]: (n, s), nan = nothing
    weight: share of the beam's energy, (s,)
    albedo: reflectance * cos(incidence) * transmission there and back, (n, s), anything where nothing was hit
    """

    distance: F64
    weight: F64
    albedo: F64


@dataclass(frozen=True)
class Receiver:
    """How a sensor turns bundles into echoes.

    within: where in an echo its range lies; percentile 0..100
    threshold: share of the echo's received energy at which `leading_edge` triggers, 0 = as soon as the energy
        is detectable
    gap: hits closer than this belong to one echo [m]
    count: most echoes per beam
    least_energy: albedo / r2 that is just detected [1/m2]
    """

    rule: EchoRule = "percentile"
    within: Within = "percentile"
    percentile: float = 50.0
    threshold: float = 0.1
    gap: float = 0.75
    count: int = 1
    least_energy: float = 0.0

    @property
    def echo_count(self) -> int:
        """Echoes per beam that `receive` returns."""
        return self.count if self.rule == "all" else 1


def with_air_echo(
    weather: ScannerWeather, bundle: Bundle, receiver: Receiver, haze: Haze, nearest: float, u: F64
) -> tuple[F64, F64]:
    """Distances [m] and albedos of sub-rays, (n, s), some beams with an echo of the air in place of what they
    met: by the rule `first` where it is detected, `last` and `all` where nothing else is, else where it is
    stronger.

    bundle: with the air between; nearest: least range [m]; u: places within a step, 0 to 1, (n,)
    """
    place, soft = haze.echo(max(nearest, weather.overlap_m), weather.lidar_ratio_sr)
    hard = bundle.albedo * bundle.weight / np.square(bundle.distance)
    met, energy = np.nansum(hard, axis=1), soft / np.square(place)
    least = receiver.least_energy
    rival = {"first": np.zeros(len(met)), "last": np.where(met >= least, np.inf, 0.0)}
    rival["all"] = rival["last"]
    taken = (energy > np.maximum(rival.get(receiver.rule, met), least))[:, None]
    there = place + (u - 0.5) * haze.step
    return np.where(taken, there[:, None], bundle.distance), np.where(taken, soft[:, None], bundle.albedo)


def with_false_echoes(
    distance: F64,
    albedo: F64,
    per_m: float,
    span: tuple[float, float],
    least: float,
    rng: np.random.Generator,
) -> tuple[F64, F64]:
    """Distances [m] and albedos of sub-rays, (n, s), with echoes that noise makes before what they met.

    per_m: how many on a metre; span: least range and reach [m]; least: energy of such an echo [1/m2]
    """
    place = span[0] + rng.standard_exponential(len(distance)) / per_m
    free = np.where(np.isnan(distance), span[1], distance).min(axis=1)
    taken = (place < free)[:, None]
    place = place[:, None]
    return np.where(taken, place, distance), np.where(taken, 1.001 * least * place**2, albedo)


@dataclass(frozen=True)
class AirBefore:
    """What is between a scanner and what the beams of one sweep meet.

    haze: the air along the beams, None where it is the same everywhere and sends nothing back
    glass: light that comes through the window before each beam, one way (n,), None = all
    false_per_m: echoes that noise makes on a metre of a beam
    nearest, reach: least and greatest range [m]
    rng: random numbers of the sweep
    """

    weather: ScannerWeather
    haze: Haze | None
    glass: F64 | None
    false_per_m: float
    nearest: float
    reach: float
    rng: np.random.Generator

    def between(self, bundle: Bundle, receiver: Receiver) -> tuple[F64, F64]:
        """Distances [m] and albedos of the sub-rays, (n, s)."""
        weather, haze, nearest, rng = self.weather, self.haze, self.nearest, self.rng
        distance, albedo = disturb(weather, bundle.distance, bundle.albedo, nearest, rng, haze)
        if haze is not None:
            bundle, u = Bundle(distance, bundle.weight, albedo), rng.uniform(size=len(distance))
            distance, albedo = with_air_echo(weather, bundle, receiver, haze, nearest, u)
        if self.glass is not None:
            albedo = albedo * (self.glass * self.glass)[:, None]
        if self.false_per_m > 0.0:
            distance, albedo = with_false_echoes(
                distance, albedo, self.false_per_m, (nearest, self.reach), receiver.least_energy, rng
            )
        return distance, albedo


@dataclass(frozen=True)
class Echoes:
    """Echoes of n beams, nearest first.

    distance [m], nan = none; intensity: received, relative to a white target that fills the spot at the same
    range, nan = none; signal: received energy over the least detectable, 0 = none; all (n, k)
    share: of each sub-ray in the echo's place, (n, k, s), sums to 1 for an echo; distance = sum share * hits
    """

    distance: F64
    intensity: F64
    signal: F64
    share: F64

    def places(self, spots: Spots, hits: F64) -> F64:
        """World points of the echoes (n, k, 3), nan = no echo; hits: of the sub-rays, (n, s) [m].

        The mean of the hits, each by its share.
        """
        n, k, s = self.share.shape
        points = np.empty((n, k, 3))
        given = (spots.origins, spots.axes, spots.offsets, hits, self.distance, self.share)
        arrays = (*(np.ascontiguousarray(a, np.float64) for a in given), points)
        whole, launch = _LAUNCHES.place
        whole[:] = *map(address, arrays), n, s, k, len(spots.offsets)
        launch()
        return points


def merging_gap(pulse: float) -> float:
    """Range difference [m] below which two echoes of a pulse of this length [s] merge: c tau / 2."""
    return 0.5 * LIGHT_SPEED * pulse


def least_energy(range_10: float) -> float:
    """Least albedo / r2 that is just detected [1/m2]: that of a 10 % target at the reach given for it [m]."""
    return 0.1 / range_10**2


def receive(bundle: Bundle, receiver: Receiver) -> Echoes:
    """Echoes of every beam; never raises on beams without a hit or on no beams at all."""
    n, s = bundle.distance.shape
    k = receiver.echo_count
    distance, intensity, signal = (np.empty((n, k)) for _ in range(3))
    share = np.empty((n, k, s))
    given = (np.ascontiguousarray(a, np.float64) for a in (bundle.distance, bundle.albedo, bundle.weight))
    arrays = (*given, distance, intensity, signal, share, np.empty(6 * s), np.empty(2 * s, np.int64))
    within = _ONE_ECHO.get(receiver.rule, receiver.within)
    whole, real, launch = _LAUNCHES.receive
    whole[:] = *map(address, arrays), n, s, k, _RULES.get(receiver.rule, 0), _WITHIN[within]
    real[:] = receiver.percentile / 100.0, receiver.threshold, receiver.gap, receiver.least_energy
    launch()
    return Echoes(distance, intensity, signal, share)


class _Launches(threading.local):
    """The compiled kernels, each with the arrays that it reads its numbers from; every thread has its own."""

    @cached_property
    def receive(self) -> Numbered:
        from swath.sensing.native.receive_kernel import receive

        return numbered(receive, 14, 4)

    @cached_property
    def place(self) -> tuple[NDArray[np.int64], Callable[[], Any]]:
        from swath.sensing.native.receive_kernel import place_echoes

        whole = np.zeros(11, np.int64)
        return whole, repeatable(place_echoes, [start_warp().array(whole, device="cpu", copy=False)]).launch


_LAUNCHES = _Launches()
