"""Scans of uniform stands by the LiDAR level `plants`, to which a spread table is fitted.

Spots are as wide at the canopy as the design says, with parallel sub-rays; the ground is level. A scan line
is a row of beams with gaps from 1 to 64 cm, at a random place and azimuth.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.crop import Crop
from swath.field.memory_layout import Organ, PlantLibrary
from swath.field.plants import make_plants
from swath.field.prototypes import make_library
from swath.rays.engine import RayCaster
from swath.rays.hits import Spots
from swath.sensing.beam import Beam, Profile, offsets_of, spot_pattern
from swath.sensing.echo import Bundle, Receiver, least_energy, merging_gap, receive
from swath.sensing.lidar_sheet import LidarSheet, load_lidar
from swath.signals import F64, Mask
from swath.tools.calibrate.overhang import overhang
from swath.tools.level_stand import level_stand

LINE = 24  # beams of a scan line
GAPS = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64])  # between neighbouring beams [m]
HALF_AREA = 24.0  # beams enter the crop within this of the middle of the stand [m]
HALF_AREA_CUT = 12.0  # beams enter stubble within this [m]
NEAREST = 0.5  # the scanner is no nearer to the top of the crop than this [m]
THIN = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # of the usual density
VIEWS = (
    3.0,
    5.0,
    8.0,
    12.0,
    18.0,
    27.0,
    40.0,
    55.0,
    75.0,
)  # depressions at which silhouettes are taken [deg]
DEPTHS = (0.4, 3.5)  # -log(share of thin rays that reach the ground) of stands that show them, about
PLANTS = 500  # that show how far plants reach aside
SPOT_AT = 0.9  # share of the crop's height where the spot is taken, as in rays/kernel/bodies.py


@dataclass(frozen=True)
class Place:
    """Where a cell of the design lies: stems/m2, height of crop or stubble [m], depression [rad], spot
    diameter [m].
    """

    density: float
    height: float
    depression: float
    spot: float


@dataclass(frozen=True)
class Returns:
    """Beams of one place, in scan lines of equal length (line_count, beams).

    height: measured along the middle of the beam, above the ground [m]
    is_ground: the echo came from it
    gap: to the beam before [m]
    albedo: reflectance * |cos| that came back, of all sub-rays
    """

    height: F64
    is_ground: Mask
    gap: F64
    albedo: F64


@dataclass(frozen=True)
class EchoSettings:
    """What makes an echo of a spot: sub_rays, profile of the spot, rule and percentile as in `echo.py`.

    sensor: whose receiver it is. Spots as wide as a place says lie where that scanner's are, and what of a
        spot comes back too far from the rest and too weakly to be detected there is lost
    sees_weakest: nothing is lost.
    """

    sub_rays: int = 37
    profile: Profile = "gaussian"
    rule: Any = "percentile"
    percentile: float = 50.0
    sensor: str = "sick-lms111"
    sees_weakest: bool = False

    @cached_property
    def sheet(self) -> LidarSheet:
        """The scanner."""
        return load_lidar(self.sensor)

    def receiver(self) -> Receiver:
        """Receiver that the level `plants` has with this scanner."""
        weakest = 0.0 if self.sees_weakest else least_energy(self.sheet.range_10)
        gap = merging_gap(self.sheet.pulse)
        return Receiver(rule=self.rule, percentile=self.percentile, gap=gap, least_energy=weakest)

    def distance(self, spot: float) -> float:
        """Distance from which a spot is this wide [m]."""
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

    def scan(
        self,
        place: Place,
        lines: int,
        settings: EchoSettings,
        stream: Stream,
        *,
        begin: float | None = None,
    ) -> Returns:
        """Beams into the stand of a place. begin: relative height at which they begin, None = above it."""
        rng = stream.at()
        caster = self.caster(place.density, place.height)
        tallest = 1.0 if self.is_cut else self.library(place.density).height_max / self.crop.stand.height
        top = tallest * place.height + 0.05 if begin is None else begin * place.height
        azimuth = np.repeat(rng.uniform(-np.pi, np.pi, lines), LINE)
        gap = rng.choice(GAPS, (lines, LINE))
        aside = np.cumsum(gap, axis=1).ravel()
        start = np.repeat(rng.uniform(-self._half_area, self._half_area, (lines, 2)), LINE, axis=0)
        axes = _frames(azimuth, place.depression)
        width = 0.5 * place.spot * np.cos(place.depression) if begin is None else 0.0
        origin = np.c_[start, np.full(lines * LINE, top + width)] + aside[:, None] * axes[:, :, 1]
        beam = Beam((place.spot, place.spot), (0.0, 0.0), settings.profile)
        pattern = spot_pattern(settings.sub_rays, settings.profile)
        rays = Spots(origin, axes, offsets_of(beam, pattern.position[None]))
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

    def silhouette(self, stream: Stream, *, relative_max: float, fine: float, rays: int = 12_000) -> F64:
        """What a plant stops of thin rays above equal steps of the relative height [m2], (VIEWS, steps).

        -log(share of rays that get below z) = n A(z) cot(depression), at those heights that at least 5 % of
        the rays reach. A depends on the depression: what lies flat (ears that nod, leaves, branches) shows
        less of itself to a flat ray than upright stems do, and more of it stands behind the rest of its own
        plant. Stands are thin enough that rays get down to the ground. Falls strictly, so that it can be
        turned around.
        """
        edges: F64 = fine * np.arange(round(relative_max / fine) + 1, dtype=np.float64)
        total, weight = np.zeros((len(VIEWS), len(edges))), np.zeros((len(VIEWS), len(edges)))
        usual = self.crop.stand.density
        steepest = self._area_above(usual * THIN[0], VIEWS[-1], edges, rays, stream.child("steepest"))[0]
        for part in THIN:
            for k, degrees in enumerate(VIEWS):
                depth = part * usual * float(steepest.max()) / np.tan(degrees * DEG)
                if not (DEPTHS[0] < depth <= DEPTHS[1] or (part == THIN[0] and depth > DEPTHS[1])):
                    continue
                child = stream.child(f"thin{part:g} {degrees:g}")
                area, is_known = self._area_above(part * usual, degrees, edges, rays, child)
                total[k] += np.where(is_known, area, 0.0)
                weight[k] += is_known
        area = np.where(weight > 0, total / np.maximum(weight, 1), 0.0)
        for row, known in zip(area, weight > 0, strict=True):
            first = int(np.argmax(known))
            row[:first] = row[first]
        falling = np.maximum.accumulate(area[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(falling + 1e-7 * (edges[-1] - edges) / fine)

    def _area_above(
        self, density: float, degrees: float, edges: F64, rays: int, stream: Stream
    ) -> tuple[F64, Mask]:
        """What a plant stops above relative heights [m2], and where enough rays show it."""
        full = self.crop.stand.height
        place = Place(density, full, degrees * DEG, 1e-4)
        seen = self.scan(place, rays // LINE, EchoSettings(sub_rays=1, sees_weakest=True), stream)
        relative = np.where(seen.is_ground, -1.0, seen.height / full).ravel()
        share = np.searchsorted(np.sort(relative), edges, side="left") / len(relative)
        area = -np.log(np.maximum(share, 1e-9)) * np.tan(degrees * DEG) / density
        return area, share > 0.05

    def overhang(self, stream: Stream) -> F64:
        """How far plants reach aside of their feet, see `overhang.py`."""
        return overhang(make_plants(self.crop, PLANTS, stream.at()), self.crop.stand.height)


def _frames(azimuth: F64, depression: float) -> F64:
    """Beam frames in the world, (n, 3, 3): columns forward (downward by the depression), across, along."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    cd, sd = np.cos(depression), np.sin(depression)
    forward = np.stack([cd * c, cd * s, np.full_like(c, -sd)], axis=1)
    across = np.stack([-s, c, np.zeros_like(c)], axis=1)
    return np.stack([forward, across, np.cross(forward, across)], axis=2)
