"""LiDAR level `plants`: bundles of rays against every stem, ear and leaf.

A beam is a bundle of sub-rays over its spot; each finds the first surface it hits; the echo rule makes echoes
of the bundle. Phenomenological, as in the paper's third approach: no pulse shape, no waveform.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Outputs
from swath.core.errors import InputError
from swath.core.portable import product
from swath.core.registry import OWN_LAW, Checked, Level
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.wetness import darkened
from swath.rays.engine import RayCaster
from swath.rays.hits import Spots
from swath.sensing import AIR, RANGES, STEMS_SEEN
from swath.sensing.beam import offsets_of, random_pattern, spot_pattern, turned_pattern
from swath.sensing.echo import Bundle, EchoRule, Receiver, Within, merging_gap, receive
from swath.sensing.labels import OF_ORGAN, Label, changed, of_echoes, tell_own
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.scanner import OutdoorParams, ScanningLidar
from swath.signals import F64, U8

WIDE_ENOUGH = 0.9  # sub-rays that reach as far out, in radii of the spot, stand for the whole of it


@dataclass(frozen=True)
class Params(OutdoorParams):
    """Beams and echoes, beside the keys of the scanner.

    sub_rays: rays per beam over the spot (1, 7, 19, 37, 61 form nested rings)
    spot: `fixed` pattern, `turned` by a random angle for every beam, or `random` places for every beam
    echo: `nearest` hit, the `percentile` or `mean` of the hits, or their `leading_edge`, all as one echo; or
        `first`, `last`, `strongest` or `all` of the echoes into which the pulse separates the hits
    within: where in such an echo its range lies
    percentile: percentile of the beam's energy that hits something
    threshold_percent: share of an echo's received energy at which `leading_edge` triggers
    echoes: largest number of echoes per beam with `all`; none = the sensor's
    """

    sub_rays: Annotated[int, Ge(1), Le(217)] = 19
    spot: Literal["fixed", "turned", "random"] = "fixed"
    echo: EchoRule = "percentile"
    within: Within = "percentile"
    percentile: Annotated[float, Ge(0), Le(100)] = 50.0
    threshold_percent: Annotated[float, Ge(0), Le(100)] = 10.0
    echoes: Annotated[int, Ge(1), Le(16)] | None = None


class PlantsLidar(ScanningLidar):
    """Scans the field's stems with a moving scanner."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params = params
        sheet = load_lidar(params.sensor, setup.base)
        self.receiver = Receiver(
            rule=params.echo,
            within=params.within,
            percentile=params.percentile,
            threshold=0.01 * params.threshold_percent,
            gap=merging_gap(sheet.pulse),
            count=params.echoes or sheet.echo_count,
        )
        super().__init__(params, setup, echo_count=self.receiver.echo_count)
        if len(self.azimuth) * params.sub_rays > 4_000_000:
            raise InputError("sub_rays", params.sub_rays, "expected at most 4 million rays per scan")
        self.pattern = spot_pattern(params.sub_rays, self.sheet.beam.profile)
        self._offsets = offsets_of(self.sheet.beam, self.pattern.position[None])
        self.caster, self.sight = RayCaster(setup.field), self.scanner.sight()
        self._newest: tuple[Spots, U8, F64, F64, F64] | None = None

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world.

        Crop that sways in wind stands still for the scan, as it is at t, the end of it.
        """
        beams, subs = len(origins), self.params.sub_rays
        rng = self._stream.at(t)
        offsets, weight = self._sub_rays(rng, beams)
        axes = product(rotations, self.scanner.axes_at(t))
        self.sight.ensure(np.ascontiguousarray(origins), np.ascontiguousarray(axes[:, :, 0]))
        rays = Spots(origins, axes, offsets)
        hits = self.caster.cast_bundles(rays, range_max=self.scanner.reach, solids=self.setup.solids(), t=t)
        self.ray_count += beams * subs
        distance = hits.distance.astype(np.float64)
        distance[distance < self.sheet.range_min] = np.nan
        reflectance = hits.reflectance
        if (film := self.setup.field.film(t)) > 0.0:
            wet = darkened(reflectance, film)
            reflectance = np.where(hits.organ == Organ.SOLID, reflectance, wet)
        albedo = (reflectance * hits.cosine).astype(np.float64)
        air, met = self.air(t, origins, axes[:, :, 0], distance), distance
        receiver = replace(self.receiver, least_energy=self.scanner.least_energy)
        if air is not None:
            distance, albedo = air.between(Bundle(distance, weight, albedo), receiver)
        echoes = receive(Bundle(distance, weight, albedo), receiver)
        measured = self.scanner.noise.measure(echoes.distance, rng, echoes.signal)
        points = echoes.places(rays, distance)
        self._newest = rays, hits.organ, met, distance, echoes.share
        return self.scanner.outputs_of(t, measured, echoes.intensity, points, origins)

    def labels(self) -> U8:
        """Of the echoes of the newest scan."""
        if self._newest is None:
            return np.zeros((len(self.azimuth), self.scanner.echo_count), np.uint8)
        rays, organ, met, distance, share = self._newest
        found, echoed = OF_ORGAN[organ], np.nonzero(share.any(axis=1))
        own, (origins, directions) = found[echoed], rays.rays()
        tell_own(own, origins[echoed], directions[echoed], met[echoed], self.setup)
        found[echoed] = own
        found[changed(met, distance)] = Label.DUST
        return of_echoes(found, share)

    @property
    def notes(self) -> list[str]:
        """What the user of a run should know of the scanner, of its rays and of their pattern."""
        found, seen = [*self.scanner.notes, *self.caster.notes], self.pattern.outermost
        if self.params.echo == "nearest" and self.params.spot != "random" and seen < WIDE_ENOUGH:
            rays = f"lidar plants: with {self.params.sub_rays} sub-rays"
            found.append(f"{rays} the spot of echo nearest is {seen:.2f} times as wide as the data sheet's")
        return found

    def _sub_rays(self, rng: np.random.Generator, beams: int) -> tuple[F64, F64]:
        """Of one sweep: offsets (beams or 1, count, 5) as in `Spots`, and shares of the energy (count,)."""
        if self.params.spot == "fixed":
            return self._offsets, self.pattern.weight
        if self.params.spot == "turned":
            pattern = turned_pattern(rng, beams, self.pattern)
        else:
            pattern = random_pattern(rng, beams, self.params.sub_rays, self.sheet.beam.profile)
        return offsets_of(self.sheet.beam, pattern.position), pattern.weight


LEVEL = Level(
    PlantsLidar,
    Params,
    "ray bundles against every stem, ear and leaf",
    cost="about 0.35 s of one core per million rays",
    tolerance="dearest level; rays within 1 mm of Embree, first returns within 1 cm of the closed form",
    checked=(
        *STEMS_SEEN,
        *AIR,
        Checked("straw_moisture_percent", 0.0, 80.0, RANGES, OWN_LAW),
    ),
)
