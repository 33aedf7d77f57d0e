"""Scans of uniform stands by the LiDAR level `plants`, to which a spread table is fitted.

Spots are as wide at the canopy as the design says, with parallel sub-rays; the ground is level. A scan line
is a row of beams with gaps from 1 to 64 cm, at a random place and azimuth.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.memory_layout import Organ, PlantLibrary
from swath.field.plants import make_plants
from swath.field.prototypes import make_library
from swath.rays.engine import RayCaster
from swath.sensing.beam import Beam, Profile, spot_pattern, spots
from swath.sensing.echo import Bundle, Receiver, least_energy, merging_gap, receive
from swath.sensing.lidar_sheet import LidarSheet, load_lidar
from swath.tools.level_stand import level_stand

F64 = NDArray[np.float64]
LINE = 24  # beams of a scan line
GAPS = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64])  # between neighbouring beams [m]
HALF_AREA = 24.0  # beams enter the crop within this of the middle of the stand [m]
HALF_AREA_CUT = 12.0  # beams enter stubble within this [m]
NEAREST = 0.5  # the scanner is no nearer to the top of the crop than this [m]
THIN = ((0.2, 45.0), (0.2, 60.0), (0.4, 60.0), (0.7, 70.0))  # of the usual density; depression [deg]
SPOT_AT = 0.9  # share of the crop's height where the spot is taken, as in rays/kernel/bodies.py


@dataclass(frozen=True)
class Place:
    """Where a cell of the design lies: stems/m2, height of crop or stubble [m], depression [rad], spot
    diameter [m]."""

    density: float
    height: float
    depression: float
    spot: float


@dataclass(frozen=True)
class Returns:
    """Beams of one place, in scan lines of equal length (line_count, beams).

    height: measured along the middle of the beam, above the ground [m]; is_ground: the echo came from it
    gap: to the beam before [m]; albedo: reflectance * |cos| that came back, of all sub-rays
    """

    height: F64
    is_ground: NDArray[np.bool_]
    gap: F64
    albedo: F64


@dataclass(frozen=True)
class EchoSettings:
    """What makes an echo of a spot: sub_rays, profile of the spot, rule and percentile as in `echo.py`.

    sensor: whose receiver it is. Spots as wide as a place says lie where that scanner's are, and what of
    a spot comes back too far from the rest and too weakly to be detected there is lost.
    """

    sub_rays: int = 37
    profile: Profile = "gaussian"
    rule: Any = "percentile"
    percentile: float = 50.0
    sensor: str = "sick-lms111"

    @cached_property
    def sheet(self) -> LidarSheet:
        """The scanner."""
        return load_lidar(self.sensor)

    def receiver(self) -> Receiver:
        """As the level `plants` has it with this scanner."""
        weakest = least_energy(self.sheet.range_10)
        gap = merging_gap(self.sheet.pulse)
        return Receiver(rule=self.rule, percentile=self.percentile, gap=gap, least_energy=weakest)

    def distance(self, spot: float) -> float:
        """From where a spot is this wide [m]."""
        beam = self.sheet.beam
        return (spot - float(np.mean(beam.exit_diameter))) / float(np.mean(beam.divergence))


class SampleStands:
    """Uniform stands of one crop, drilled as its sheet says; every density has plants of its own.

    A stand thinned from a denser one would not do: drilled plants stand at even distances along their rows,
    what is left of them after thinning at random ones, and more beams reach the ground.
    tile_count: independent pieces of 1 m2
    is_cut: heights are those of stubble, of crop as high as its sheet says
    """

    def __init__(self, crop: Crop, stream: Stream, *, tile_count: int = 48, is_cut: bool = False) -> None:
        self.crop, self.stream, self.tile_count, self.is_cut = crop, stream, tile_count, is_cut
        self._half_area = HALF_AREA_CUT if is_cut else HALF_AREA
        self._library: tuple[float, PlantLibrary] | None = None
        self._caster: tuple[tuple[float, float], RayCaster] | None = None

    def library(self, density: float) -> PlantLibrary:
        """The plants of a density; the last one asked for is kept."""
        if self._library is None or self._library[0] != density:
            made = make_library(
                self.crop,
                density_max=density,
                row_spacing=self.crop.stand.row_spacing,
                seed=self.stream.child(f"library{density:g}"),
                tile_count=self.tile_count,
            )
            self._library = density, made
        return self._library[1]

    def caster(self, density: float, height: float) -> RayCaster:
        """Rays into a stand of this density and height; the last one asked for is kept."""
        if self._caster is None or self._caster[0] != (density, height):
            library = self.library(density)
            standing, cut = (None, height) if self.is_cut else (height, None)
            field = level_stand(self.crop, density, self.stream, library=library, height=standing, cut_at=cut)
            field.ensure(0.0, 0.0, 2.0 * self._half_area + (10.0 if self.is_cut else 40.0))
            self._caster = (density, height), RayCaster(field)
        return self._caster[1]

    def scan(self, place: Place, lines: int, settings: EchoSettings, stream: Stream) -> Returns:
        """Beams into the stand of a place."""
        rng = stream.at()
        caster = self.caster(place.density, place.height)
        tallest = 1.0 if self.is_cut else self.library(place.density).height_max / self.crop.stand.height
        top = tallest * place.height + 0.05
        azimuth = np.repeat(rng.uniform(-np.pi, np.pi, lines), LINE)
        gap = rng.choice(GAPS, (lines, LINE))
        aside = np.cumsum(gap, axis=1).ravel()
        start = np.repeat(rng.uniform(-self._half_area, self._half_area, (lines, 2)), LINE, axis=0)
        axes = _frames(azimuth, place.depression)
        width = 0.5 * place.spot * np.cos(place.depression)
        origin = np.c_[start, np.full(lines * LINE, top + width)] + aside[:, None] * axes[:, :, 1]
        beam = Beam((place.spot, place.spot), (0.0, 0.0), settings.profile)
        pattern = spot_pattern(settings.sub_rays, settings.profile)
        rays = spots(origin, axes, beam, pattern.position[None])
        hits = caster.cast_bundles(rays, range_max=100.0)
        albedo = (hits.reflectance * hits.cosine).astype(np.float64)
        to_spot = (top + width - SPOT_AT * place.height) / np.sin(place.depression)
        # the scanner lies so far behind where the rays start, for all the energy of a spot that matters
        back = max(settings.distance(place.spot) - to_spot, NEAREST)
        distance = hits.distance.astype(np.float64) + back
        echo = receive(Bundle(distance, pattern.weight, albedo), settings.receiver())
        z = origin[:, 2] + (echo.distance[:, 0] - back) * axes[:, 2, 0]
        share = np.where(hits.organ == Organ.GROUND, echo.share[:, 0], 0.0).sum(axis=1)
        line = (lines, LINE)
        return Returns(z.reshape(line), (share > 0.5).reshape(line), gap, echo.intensity[:, 0].reshape(line))

    def silhouette(self, stream: Stream, *, relative_max: float, fine: float, rays: int = 40_000) -> F64:
        """Silhouette per stem above equal steps of the relative height [m2], by thin rays.

        -log(share of rays that get below z) = n A(z) cot(depression); the mean over stands and angles of
        those heights that at least 5 % of the rays reach. Falls strictly, so that it can be turned around.
        Stands are much thinner than the crop's own, so that rays get down to the ground.
        """
        edges = fine * np.arange(round(relative_max / fine) + 1)
        total, weight = np.zeros(len(edges)), np.zeros(len(edges))
        full, usual = self.crop.stand.height, self.crop.stand.density
        for k, (part, degrees) in enumerate(THIN):
            density = part * usual
            place = Place(density, full, np.radians(degrees), 1e-4)
            seen = self.scan(
                place, rays // LINE // len(THIN), EchoSettings(sub_rays=1), stream.child(f"thin{k}")
            )
            relative = np.where(seen.is_ground, -1.0, seen.height / full).ravel()
            share = np.searchsorted(np.sort(relative), edges, side="left") / len(relative)
            ok = share > 0.05
            area = -np.log(np.maximum(share, 1e-9)) * np.tan(place.depression) / density
            total += np.where(ok, area, 0.0)
            weight += ok
        area = np.where(weight > 0, total / np.maximum(weight, 1), 0.0)
        known = np.flatnonzero(weight > 0)
        area[: known[0]] = area[known[0]]
        falling = np.maximum.accumulate(area[::-1])[::-1]
        return np.asarray(falling + 1e-7 * (edges[-1] - edges) / fine)

    def tips(self, stream: Stream, count: int = 64) -> F64:
        """Sideways places of tips per height of the plant, (count, 2)."""
        plants = make_plants(self.crop, count, stream.at())
        found = np.zeros((count, 3))
        for organ in (Organ.STEM, Organ.EAR):  # later pieces of a stem lie higher
            mine = plants.organ == organ
            found[plants.owner[mine]] = plants.b[mine]
        return found[:, :2] / plants.height[:, None]


def _frames(azimuth: F64, depression: float) -> F64:
    """Beam frames in the world, (n, 3, 3): columns forward (downward by the depression), across, along."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    cd, sd = np.cos(depression), np.sin(depression)
    forward = np.stack([cd * c, cd * s, np.full_like(c, -sd)], axis=1)
    across = np.stack([-s, c, np.zeros_like(c)], axis=1)
    return np.stack([forward, across, np.cross(forward, across)], axis=2)
