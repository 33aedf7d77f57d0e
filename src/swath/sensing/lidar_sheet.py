"""LiDAR data sheets: `data/sensors/*.yaml` as validated objects in SI."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from swath.core.units import DEG, MM, MRAD
from swath.documents.data_sheets import Card, find_card
from swath.sensing.beam import Beam, Contour, Convention, Profile, full_angle
from swath.signals import F64


@dataclass(frozen=True)
class LidarCard:
    """What the maker says about a scanner.

    beam: spot, by the convention of sensing/beam.py; line_elevation [rad], (line_count,), 0 for a 2-D scanner
    fov: (first, last) azimuth [rad]; step: azimuth between beams [rad]; rate_hz: default scan rate
    range_min, range_max [m]; range_10: reach on a 10 % diffuse target [m]
    noise: rows (range [m], one-sigma [m]); systematic: half width of the constant error band [m]
    resolution: step of the reported range [m]; wavelength [m]
    echo_count: most echoes per beam; pulse: length [s]; angle_noise: one sigma in the scan plane [rad]
    signal_noise: rows (signal to noise ratio, one-sigma [m]), rising ratio, none for most
    signal_at_reach: signal to noise ratio of the weakest echo that is still detected
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
    echo_count: int
    pulse: float
    angle_noise: float
    signal_noise: F64
    signal_at_reach: float

    def noise_sigma(self, distance: F64, signal: F64 | None = None) -> F64:
        """One-sigma range noise [m] at distances [m]: linear between the data sheet's points.

        signal: received energy over the least detectable. Where the sheet gives noise by signal to noise
        ratio, the larger of both holds (straight lines in logarithms, held outside).
        """
        sigma = np.asarray(np.interp(distance, self.noise[:, 0], self.noise[:, 1]), dtype=np.float64)
        if signal is None or len(self.signal_noise) == 0:
            return sigma
        ratio = np.log(np.maximum(signal, 1e-9) * self.signal_at_reach)
        rows = np.log(self.signal_noise)
        by_signal = np.exp(np.interp(ratio, rows[:, 0], rows[:, 1]))
        return np.asarray(np.maximum(sigma, by_signal), dtype=np.float64)

    def azimuths(self, first: float, last: float, step: float) -> F64:
        """Beam azimuths [rad] from first to last inclusive, centred in the sector when step does not fit."""
        count = int(np.floor((last - first) / step + 1e-6)) + 1
        span = (count - 1) * step
        return np.asarray(0.5 * (first + last) - 0.5 * span + step * np.arange(count), dtype=np.float64)


def load_lidar(name: str, base: Path | None = None) -> LidarCard:
    """A bundled scanner by name, or the user's own YAML file. InputError names key and file."""
    path = find_card("sensors", name, base)
    card = Card(path)
    noise = _rows(card, "range.noise_mm", "[[range_m, sigma_mm], ...]")
    by_signal = np.zeros((0, 2))
    if card.has("range.noise_by_signal"):
        by_signal = _rows(card, "range.noise_by_signal", "[[signal_to_noise, sigma_mm], ...]", low=1e-3)
    fov = card.numbers("scan.field_of_view_deg")
    if card.data.get("kind", "lidar") != "lidar":
        raise card.error("kind", card.data["kind"], "expected lidar")
    made = LidarCard(
        name=card.text("name"),
        beam=_beam(card),
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
        echo_count=int(_optional(card, "echo.count", 1.0, low=1, high=16)),
        pulse=_optional(card, "echo.pulse_ns", 5.0, low=0.01, high=1000) * 1e-9,
        angle_noise=_optional(card, "scan.angle_noise_deg", 0.0, low=0, high=5) * DEG,
        signal_noise=by_signal * np.array([1.0, MM]),
        signal_at_reach=_optional(card, "range.signal_at_reach", 1.0, low=1e-3, high=1e6),
    )
    card.refuse_unknown("kind", "note")
    return made


def _beam(card: Card) -> Beam:
    profile: Profile = _choice(card, "beam.profile", get_args(Profile))
    convention: Convention = _choice(card, "beam.convention", get_args(Convention))
    contour: Contour = _choice(card, "beam.contour", get_args(Contour))

    def pair(key: str, unit: float, most: float) -> tuple[float, float]:
        across, along = (full_angle(v, convention, contour, profile) * unit for v in _pair(card, key, most))
        return across, along

    return Beam(pair("beam.exit_mm", MM, 200.0), pair("beam.divergence_mrad", MRAD, 100.0), profile)


def _choice(card: Card, key: str, allowed: tuple[str, ...]) -> Any:
    value = card.text(key)
    if value not in allowed:
        raise card.error(key, value, f"expected {', '.join(allowed)}")
    return value


def _optional(card: Card, key: str, default: float, *, low: float, high: float) -> float:
    return card.number(key, low=low, high=high) if card.has(key) else default


def _rows(card: Card, key: str, form: str, *, low: float = 0.0) -> F64:
    """Rows of two numbers, the first rising, the second >= low."""
    try:
        rows = np.asarray(card.numbers(key), dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    good = rows.ndim == 2 and rows.shape[1] == 2 and bool(np.isfinite(rows).all())
    if not good or np.any(np.diff(rows[:, 0]) <= 0) or np.any(rows < low):
        raise card.error(key, card.value(key), f"expected {form}, the first rising")
    return rows


def _pair(card: Card, key: str, most: float) -> tuple[float, float]:
    values = card.numbers(key)
    if len(values) != 2 or any(not isinstance(v, int | float) or not 0 <= v <= most for v in values):
        raise card.error(key, values, f"expected [across, along], both 0 to {most:g}")
    return float(values[0]), float(values[1])
