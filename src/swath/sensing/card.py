"""LiDAR data sheets: `data/sensors/*.yaml` as validated objects in SI."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.signals import F64
from swath.core.units import DEG, MM, MRAD
from swath.data.cards import Card, find_card
from swath.sensing.beam import Beam, Profile


@dataclass(frozen=True)
class LidarCard:
    """What the maker says about a scanner.

    beam: spot; line_elevation [rad], shape (line_count,), 0 for a 2-D scanner
    fov: (first, last) azimuth [rad]; step: azimuth between beams [rad]; rate_hz: default scan rate
    range_min, range_max [m]; range_10: reach on a 10 % diffuse target [m]
    noise: rows (range [m], one-sigma [m]); systematic: half width of the constant error band [m]
    resolution: step of the reported range [m]; wavelength [m]
    """

    name: str
    beam: Beam
    line_elevation: F64
    fov: tuple[float, float]
    step: float
    rates_hz: tuple[float, ...]
    range_min: float
    range_max: float
    range_10: float
    noise: F64
    systematic: float
    resolution: float
    wavelength: float

    def noise_sigma(self, distance: F64) -> F64:
        """One-sigma range noise [m] at distances [m]: linear between the data sheet's points."""
        return np.asarray(np.interp(distance, self.noise[:, 0], self.noise[:, 1]), dtype=np.float64)

    def azimuths(self, first: float, last: float, step: float) -> F64:
        """Beam azimuths [rad] from first to last inclusive, centred in the sector when step does not fit."""
        count = int(np.floor((last - first) / step + 1e-6)) + 1
        span = (count - 1) * step
        return 0.5 * (first + last) - 0.5 * span + step * np.arange(count)


def load_lidar(name: str, base: Path | None = None) -> LidarCard:
    """A bundled scanner by name, or the user's own YAML file. InputError names key and file."""
    path = find_card("sensors", name, base)
    card = Card(path)
    profile = card.text("beam.profile")
    if profile not in ("uniform", "gaussian"):
        raise InputError("beam.profile", profile, "expected uniform or gaussian", file=path)
    kind: Profile = "gaussian" if profile == "gaussian" else "uniform"
    exit_mm = _pair(card, "beam.exit_mm")
    divergence = _pair(card, "beam.divergence_mrad")
    noise = np.asarray(card.numbers("range.noise_mm"), dtype=float)
    if noise.ndim != 2 or noise.shape[1] != 2 or np.any(np.diff(noise[:, 0]) <= 0) or np.any(noise < 0):
        raise InputError("range.noise_mm", noise.tolist(), "expected [[range_m, sigma_mm], ...]", file=path)
    fov = card.numbers("scan.field_of_view_deg")
    return LidarCard(
        name=card.text("name"),
        beam=Beam((exit_mm[0] * MM, exit_mm[1] * MM), (divergence[0] * MRAD, divergence[1] * MRAD), kind),
        line_elevation=np.asarray(card.numbers("scan.line_elevation_deg"), dtype=float) * DEG,
        fov=(float(fov[0]) * DEG, float(fov[1]) * DEG),
        step=card.number("scan.step_deg", low=1e-3, high=10) * DEG,
        rates_hz=tuple(float(r) for r in card.numbers("scan.rates_hz")),
        range_min=card.number("range.min_m", low=0, high=10),
        range_max=card.number("range.max_m", low=1, high=1000),
        range_10=card.number("range.reach_10_percent_m", low=1, high=1000),
        noise=noise * np.array([1.0, MM]),
        systematic=card.number("range.systematic_mm", low=0, high=1000) * MM,
        resolution=card.number("range.resolution_mm", low=0, high=100) * MM,
        wavelength=card.number("wavelength_nm", low=300, high=2000) * 1e-9,
    )


def _pair(card: Card, key: str) -> tuple[float, float]:
    values = card.numbers(key)
    if len(values) != 2 or any(not isinstance(v, int | float) or v < 0 for v in values):
        raise InputError(key, values, "expected [across, along], both >= 0", file=card.path)
    return float(values[0]), float(values[1])
