"""LiDAR level `plants`: bundles of rays against every stem, ear and leaf.

A beam is a bundle of sub-rays over its spot; each finds the first surface it hits; the echo rule picks one
distance of the bundle. Phenomenological, as in the paper's third approach: no pulse shape, no waveform.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.signals import F64, MachineState
from swath.field.site import SiteSetup
from swath.rays.engine import RayCaster
from swath.sensing.beam import echo_index, spot_pattern, sub_rays
from swath.sensing.mount import Mount
from swath.sensing.scanner import Scanner


@dataclass(frozen=True)
class Params:
    """sensor: name in data/sensors, or the user's own YAML; mount: where it sits.

    sector_deg: first and last azimuth used; none = the sensor's whole field of view
    step_deg: angle between beams; none = the data sheet's
    sub_rays: rays per beam over the spot (1, 7, 19, 37, 61 form rings); spot: `fixed` pattern, or turned
    by a random angle for every beam
    echo: `nearest` sub-ray, or the given `percentile` of the sub-rays that hit something
    reach_m: rays are not followed further than this
    noise: range noise and constant bias as in the data sheet, or none
    """

    sensor: str = "sick-lms511-hr"
    mount: Mount = field(default_factory=Mount)
    sector_deg: tuple[float, float] | None = None
    step_deg: Annotated[float, Gt(0), Le(10)] | None = None
    sub_rays: Annotated[int, Ge(1), Le(217)] = 19
    spot: Literal["fixed", "random"] = "fixed"
    echo: Literal["nearest", "percentile"] = "percentile"
    percentile: Annotated[float, Ge(0), Le(100)] = 50.0
    reach_m: Annotated[float, Gt(0), Le(200)] = 40.0
    noise: Literal["data_sheet", "none"] = "data_sheet"


class PlantsLidar:
    """Scans the field's stems with a moving scanner."""

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.params = params
        self.setup = setup
        self.scanner = Scanner(params, setup)
        self.card, self.mounting = self.scanner.card, self.scanner.mounting
        self.azimuth, self.elevation = self.scanner.azimuth, self.scanner.elevation
        self.ray_count = 0
        if len(self.azimuth) * params.sub_rays > 4_000_000:
            raise InputError("sub_rays", params.sub_rays, "expected at most 4 million rays per scan")
        self.pattern = spot_pattern(params.sub_rays, self.card.beam.profile)
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
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""
        beams, subs = len(origins), len(self.pattern)
        rng = self._stream.at(t)
        middle = origins[beams // 2]
        self.setup.field.ensure(middle[0], middle[1], self.params.reach_m)
        pattern = self.pattern[None]
        if self.params.spot == "random":
            pattern = _turned(self.pattern, rng.uniform(0, 2 * np.pi, beams))
        starts, directions = sub_rays(origins, rotations @ self.scanner.axes, self.card.beam, pattern)
        hits = self.caster.cast(
            starts.reshape(-1, 3),
            directions.reshape(-1, 3),
            range_max=self.scanner.reach,
            solids=self.setup.solids(),
        )
        self.ray_count += beams * subs
        distance = hits.distance.reshape(beams, subs).astype(np.float64)
        distance[distance < self.card.range_min] = np.nan
        chosen = echo_index(distance, self.params.echo, self.params.percentile)
        row = np.arange(beams)
        true_range = np.where(chosen >= 0, distance[row, chosen], np.nan)
        energy = np.where(np.isnan(distance), 0.0, (hits.reflectance * hits.cosine).reshape(beams, subs))
        intensity = energy.mean(axis=1)
        is_seen = self.scanner.is_seen(true_range, intensity)
        measured = np.where(is_seen, self.scanner.measure(true_range, rng), np.nan)
        points = starts[row, chosen] + true_range[:, None] * directions[row, chosen]
        points[~is_seen] = np.nan
        echo = np.where(np.isnan(measured), np.nan, intensity)
        return self.scanner.outputs_of(t, measured, echo, points, origins)

    def save(self) -> State:
        """The last pose and the ray counter; constants follow from the stream."""
        return {"last": self._last, "ray_count": self.ray_count}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._last = state["last"]
        self.ray_count = state["ray_count"]


def _turned(pattern: F64, angle: F64) -> F64:
    """The pattern (n, 2) turned by an angle [rad] per beam, shape (beam_count, n, 2)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = pattern[:, 0], pattern[:, 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=2)


LEVEL = Level(
    PlantsLidar,
    Params,
    "ray bundles against every stem, ear and leaf",
    cost="about 1 s of one core per million rays",
    tolerance="dearest level; rays within 1 mm of Embree, first returns within 1 cm of the closed form",
)
