"""LiDAR level `plants`: bundles of rays against every stem, ear and leaf.

A beam is a bundle of sub-rays over its spot; each finds the first surface it hits; the echo rule makes echoes
of the bundle. Phenomenological, as in the paper's third approach: no pulse shape, no waveform.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.site_setup import SiteSetup
from swath.rays.engine import RayCaster
from swath.sensing.beam import Pattern, random_pattern, spot_pattern, spots, turned_pattern
from swath.sensing.echo import Bundle, EchoRule, Receiver, Within, least_energy, merging_gap, receive
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.mount import Mount
from swath.sensing.scanner import Scanner
from swath.sensing.weather import Weather, disturb
from swath.signals import F64, MachineState


@dataclass(frozen=True)
class Params:
    """sensor: name in data/sensors, or the user's own YAML; mount: where it sits.

    sector_deg: first and last azimuth used; none = the sensor's whole field of view
    step_deg: angle between beams; none = the data sheet's
    sub_rays: rays per beam over the spot (1, 7, 19, 37, 61 form nested rings); spot: `fixed` pattern,
    `turned` by a random angle for every beam, or `random` places for every beam
    echo: `nearest` hit, the `percentile` or `mean` of the hits, or their `leading_edge`, all as one echo; or
    `first`, `last`, `strongest` or `all` of the echoes into which the pulse separates the hits
    within: where in such an echo its range lies; percentile: of the beam's energy that hits something
    threshold_percent: of an echo's received energy, where `leading_edge` triggers
    echoes: most per beam with `all`; none = the sensor's
    reach_m: rays are not followed further than this
    noise: range noise and constant bias as in the data sheet, or none
    angle_noise_deg: one sigma of the beams' direction; none = the data sheet's; drop_out_percent: beams lost
    weather: dust, chaff and rain in the air
    """

    sensor: str = "sick-lms511-hr"
    mount: Mount = field(default_factory=Mount)
    sector_deg: tuple[float, float] | None = None
    step_deg: Annotated[float, Gt(0), Le(10)] | None = None
    sub_rays: Annotated[int, Ge(1), Le(217)] = 19
    spot: Literal["fixed", "turned", "random"] = "fixed"
    echo: EchoRule = "percentile"
    within: Within = "percentile"
    percentile: Annotated[float, Ge(0), Le(100)] = 50.0
    threshold_percent: Annotated[float, Ge(0), Le(100)] = 10.0
    echoes: Annotated[int, Ge(1), Le(16)] | None = None
    reach_m: Annotated[float, Gt(0), Le(200)] = 40.0
    noise: Literal["data_sheet", "none"] = "data_sheet"
    angle_noise_deg: Annotated[float, Ge(0), Le(5)] | None = None
    drop_out_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    weather: Weather = field(default_factory=Weather)


class PlantsLidar:
    """Scans the field's stems with a moving scanner."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params = params
        self.setup = setup
        sheet = load_lidar(params.sensor, setup.base)
        self.receiver = Receiver(
            rule=params.echo,
            within=params.within,
            percentile=params.percentile,
            threshold=0.01 * params.threshold_percent,
            gap=merging_gap(sheet.pulse),
            count=params.echoes or sheet.echo_count,
            least_energy=least_energy(sheet.range_10),
        )
        self.scanner = Scanner(
            params,
            setup,
            echo_count=self.receiver.echo_count,
            angle_noise=None if params.angle_noise_deg is None else params.angle_noise_deg * DEG,
            drop_out=0.01 * params.drop_out_percent,
        )
        self.sheet, self.mounting = self.scanner.sheet, self.scanner.mounting
        self.azimuth, self.elevation = self.scanner.azimuth, self.scanner.elevation
        self.ray_count = 0
        if len(self.azimuth) * params.sub_rays > 4_000_000:
            raise InputError("sub_rays", params.sub_rays, "expected at most 4 million rays per scan")
        self.pattern = spot_pattern(params.sub_rays, self.sheet.beam.profile)
        self.caster = RayCaster(setup.field)
        self._last: MachineState | None = None
        self.inputs, self.outputs = self.scanner.inputs, self.scanner.outputs

    def reset(self, stream: Stream) -> Outputs:
        """An empty scan; draws the constant range bias of this instance, uniform in the data sheet's band."""
        self._stream = stream
        self._last = None
        self.ray_count = 0
        return self.scanner.reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The sweep that ends at t + dt, every beam from where the sensor was at its own time."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        end = t + dt
        return self.scan_from(end, *self.scanner.sweep(known, end))

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world.

        Crop that sways in wind stands still for the scan, as it is at t, the end of it.
        """
        beams, subs = len(origins), self.params.sub_rays
        rng = self._stream.at(t)
        middle = origins[beams // 2]
        self.setup.field.ensure(middle[0], middle[1], self.params.reach_m)
        pattern = self._pattern(rng, beams)
        axes = rotations @ self.scanner.axes_at(t)
        rays = spots(origins, axes, self.sheet.beam, pattern.position)
        hits = self.caster.cast_spots(rays, range_max=self.scanner.reach, solids=self.setup.solids(), t=t)
        self.ray_count += beams * subs
        distance = hits.distance.astype(np.float64)
        distance[distance < self.sheet.range_min] = np.nan
        albedo = (hits.reflectance * hits.cosine).astype(np.float64)
        if not self.params.weather.is_clear:
            air = self._stream.child("weather").at(t)
            distance, albedo = disturb(self.params.weather, distance, albedo, self.sheet.range_min, air)
        echoes = receive(Bundle(distance, pattern.weight, albedo), self.receiver)
        measured = self.scanner.measure(echoes.distance, rng, echoes.signal)
        points = echoes.places(rays, distance)
        return self.scanner.outputs_of(t, measured, echoes.intensity, points, origins)

    @property
    def notes(self) -> list[str]:
        """What a run should be told of the scanner."""
        return self.scanner.notes

    def save(self) -> State:
        """The last pose and the ray counter; constants follow from the stream."""
        return {"last": self._last, "ray_count": self.ray_count}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._last = state["last"]
        self.ray_count = state["ray_count"]

    def _pattern(self, rng: np.random.Generator, beams: int) -> Pattern:
        """Sub-rays of one sweep, position (beams or 1, count, 2)."""
        if self.params.spot == "turned":
            return turned_pattern(rng, beams, self.pattern)
        if self.params.spot == "random":
            return random_pattern(rng, beams, self.params.sub_rays, self.sheet.beam.profile)
        return Pattern(self.pattern.position[None], self.pattern.weight)


LEVEL = Level(
    PlantsLidar,
    Params,
    "ray bundles against every stem, ear and leaf",
    cost="about 0.35 s of one core per million rays",
    tolerance="dearest level; rays within 1 mm of Embree, first returns within 1 cm of the closed form",
)
