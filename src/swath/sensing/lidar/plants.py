"""LiDAR level `plants`: bundles of rays against every stem, ear and leaf.

A beam is a bundle of sub-rays over its spot; each finds the first surface it hits; the echo rule picks one
distance of the bundle. Phenomenological, as in the paper's third approach: no pulse shape, no waveform.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.signals import F64, MachineState, Scan, ScanTruth, beam_directions
from swath.core.units import DEG
from swath.field.site import SiteSetup
from swath.rays.engine import RayCaster
from swath.sensing.beam import echo_index, spot_pattern, sub_rays
from swath.sensing.card import load_lidar
from swath.sensing.mount import Mount, poses_at


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
        self.card = load_lidar(params.sensor, setup.base)
        self.mounting = params.mount.pose(setup.machine, setup.edge_side)
        self.ray_count = 0
        first, last = _sector(params, self.card.fov)
        step = self.card.step if params.step_deg is None else params.step_deg * DEG
        azimuth = self.card.azimuths(first, last, step)
        lines = self.card.line_elevation
        self.azimuth = np.repeat(azimuth, len(lines))
        self.elevation = np.tile(lines, len(azimuth))
        if len(self.azimuth) * params.sub_rays > 4_000_000:
            raise InputError("sub_rays", params.sub_rays, "expected at most 4 million rays per scan")
        self.beam_t = (self.azimuth - azimuth[-1]) / (2 * np.pi) * setup.period
        self.pattern = spot_pattern(params.sub_rays, self.card.beam.profile)
        self.axes = _beam_axes(self.azimuth, self.elevation)
        self.caster = RayCaster(setup.field)
        self._last: MachineState | None = None
        shape = (len(self.azimuth),)
        self.inputs = (Port("state", MachineState, history=True),)
        self.outputs = (Port("scan", Scan, unit="m", shape=shape), Port("truth", ScanTruth))
        if self.mounting.position[2] <= 0:
            raise InputError("mount.z_m", params.mount.z_m, "expected a sensor above the ground")

    def reset(self, stream: Stream) -> Outputs:
        """An empty scan; draws the constant range bias of this instance, uniform in the data sheet's band."""
        self._stream = stream
        self._last = None
        self.ray_count = 0
        band = self.card.systematic if self.params.noise == "data_sheet" else 0.0
        self._bias = float(stream.at(0).uniform(-band, band))
        nothing = np.full((len(self.azimuth), 1), np.nan, np.float32)
        empty = np.full((len(self.azimuth), 1, 3), np.nan)
        return {
            "scan": Scan(0, self.beam_t, self.azimuth, self.elevation, nothing, nothing),
            "truth": ScanTruth(0, empty, empty[:, 0]),
        }

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The sweep that ends at t + dt, every beam from where the sensor was at its own time."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        end = t + dt
        position, rotation = poses_at(known, end + self.beam_t * 1e9)
        return self.scan_from(end, *mounted(position, rotation, self.mounting))

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""
        beams, subs = len(origins), len(self.pattern)
        rng = self._stream.at(t)
        middle = origins[beams // 2]
        self.setup.field.ensure(middle[0], middle[1], self.params.reach_m)
        pattern = self.pattern[None]
        if self.params.spot == "random":
            pattern = _turned(self.pattern, rng.uniform(0, 2 * np.pi, beams))
        starts, directions = sub_rays(origins, rotations @ self.axes, self.card.beam, pattern)
        hits = self.caster.cast(
            starts.reshape(-1, 3),
            directions.reshape(-1, 3),
            range_max=min(self.params.reach_m, self.card.range_max),
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
        with np.errstate(invalid="ignore"):
            is_seen = intensity / 0.1 * (self.card.range_10 / true_range) ** 2 >= 1.0
        measured = np.where(is_seen, self._measure(true_range, rng), np.nan)
        points = starts[row, chosen] + true_range[:, None] * directions[row, chosen]
        points[~is_seen] = np.nan
        echo = np.where(np.isnan(measured), np.nan, intensity)
        return {
            "scan": Scan(
                t,
                self.beam_t,
                self.azimuth,
                self.elevation,
                measured[:, None].astype(np.float32),
                echo[:, None].astype(np.float32),
            ),
            "truth": ScanTruth(t, points[:, None, :], origins),
        }

    def save(self) -> State:
        """The last pose and the ray counter; constants follow from the stream."""
        return {"last": self._last, "ray_count": self.ray_count}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._last = state["last"]
        self.ray_count = state["ray_count"]

    def _measure(self, true_range: F64, rng: np.random.Generator) -> F64:
        if self.params.noise == "none":
            return true_range
        sigma = self.card.noise_sigma(np.nan_to_num(true_range))
        noisy = true_range + self._bias + sigma * rng.standard_normal(len(true_range))
        step = self.card.resolution
        return np.round(noisy / step) * step if step > 0 else noisy


def mounted(position: F64, rotation: F64, mounting: Pose) -> tuple[F64, F64]:
    """Sensor origins (n, 3) and rotations (n, 3, 3) in the world from machine poses and the mounting."""
    return position + rotation @ mounting.position, rotation @ mounting.rotation


def _sector(params: Params, fov: tuple[float, float]) -> tuple[float, float]:
    if params.sector_deg is None:
        return fov
    first, last = (a * DEG for a in params.sector_deg)
    if not fov[0] - 1e-9 <= first < last <= fov[1] + 1e-9:
        wide = f"[{fov[0] / DEG:g}, {fov[1] / DEG:g}]"
        raise InputError("sector_deg", list(params.sector_deg), f"expected [first, last] within {wide}")
    return first, last


def _beam_axes(azimuth: F64, elevation: F64) -> F64:
    """Beam frames in the sensor frame, shape (n, 3, 3): columns beam direction, across (left), along (up)."""
    forward = beam_directions(azimuth, elevation)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    return np.stack([forward, across, np.cross(forward, across)], axis=2)


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
