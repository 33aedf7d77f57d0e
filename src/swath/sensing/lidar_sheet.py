"""LiDAR data sheets: `data/sensors/*.yaml` as validated objects in SI."""

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from swath.core import portable
from swath.core.units import MM, MRAD
from swath.documents.data_sheets import Sheet, read_sheet
from swath.documents.sheet_fields import Key, Quantity, Section
from swath.sensing.beam import Beam, Contour, Convention, Profile, full_angle
from swath.signals import F64

Pairs = list[tuple[float, Annotated[float, Field(ge=0)]]]


@dataclass(frozen=True, kw_only=True)
class BeamSection:
    """The beam as the data sheet states it: exit and divergence, each across and along.

    convention: what these numbers are, see `sensing/beam.py`
    """

    profile: Profile
    convention: Convention
    contour: Contour
    exit_mm: Annotated[tuple[float, float], Quantity("", 0, 200)]
    divergence_mrad: Annotated[tuple[float, float], Quantity("", 0, 100)]

    def pair(self, values: tuple[float, float], unit: float) -> tuple[float, float]:
        """Diameters or angles across and along, in SI, as full ones of the contour inside swath."""
        across, along = (full_angle(v, self.convention, self.contour, self.profile) * unit for v in values)
        return across, along


@dataclass(frozen=True, kw_only=True)
class LidarSheet:
    """What the maker says about a scanner.

    device_ident: what it answers to sRN DeviceIdent, empty where that is not known
    fov: (first, last) azimuth [rad]
    step: azimuth between beams [rad]
    rates_hz: the first is the default
    elevations: of the lines [rad], (0,) for a 2-D scanner
    delays: how long after the first of its firing a line fires [s], () = all at once
    turns: where it sweeps to, seen from above range_min, range_max [m]
    range_10: reach on a 10 % diffuse target [m]; reach_klx: light in which it holds [klx],
        0 = dark
    noise_mm: rows (range [m], one-sigma [mm])
    systematic: half width of the constant error band [m]
    resolution: step of the reported range [m]; wavelength [m]
    echo_count: most echoes per beam
    pulse: length [s]
    angle_noise: one sigma in the scan plane [rad]
    noise_by_signal_mm: rows (signal to noise ratio, one-sigma [mm]), rising ratio, none for most
    signal_at_reach: signal to noise ratio of the weakest echo that is still detected
    """

    format: str
    kind: Literal["lidar"] = "lidar"
    name: str
    note: str = ""
    device_ident: Annotated[str, Key("device_ident")] = ""
    wavelength: Annotated[float, Quantity("nm", 300, 2000)]
    spot: Annotated[BeamSection, Section("beam.")]
    fov: Annotated[tuple[float, float], Quantity("deg", -360, 360, key="scan.field_of_view")]
    step: Annotated[float, Quantity("deg", 1e-3, 10, key="scan.step")]
    rates_hz: Annotated[tuple[float, ...], Quantity("", 0.01, 10_000, key="scan.rates_hz")]
    elevations: Annotated[tuple[float, ...], Quantity("deg", -90, 90, key="scan.line_elevation")]
    delays: Annotated[tuple[float, ...], Quantity("us", 0, 10_000, key="scan.line_delay")] = ()
    turns: Annotated[Literal["left", "right"], Key("scan.turns")] = "left"
    angle_noise: Annotated[float, Quantity("deg", 0, 5, key="scan.angle_noise")] = 0.0
    range_min: Annotated[float, Quantity("m", 0, 10, key="range.min")]
    range_max: Annotated[float, Quantity("m", 1, 1000, key="range.max")]
    range_10: Annotated[float, Quantity("m", 1, 1000, key="range.reach_10_percent")]
    reach_klx: Annotated[float, Quantity("", 0, 150, key="range.reach_klx")] = 0.0
    noise_mm: Annotated[Pairs, Key("range.noise_mm")]
    noise_by_signal_mm: Annotated[Pairs, Key("range.noise_by_signal_mm")] = field(default_factory=list)
    signal_at_reach: Annotated[float, Quantity("", 1e-3, 1e6, key="range.signal_at_reach")] = 1.0
    systematic: Annotated[float, Quantity("mm", 0, 1000, key="range.systematic")]
    resolution: Annotated[float, Quantity("mm", 0, 100, key="range.resolution")]
    echo_count: Annotated[int, Quantity("", 1, 16, key="echo.count")] = 1
    pulse: Annotated[float, Quantity("ns", 0.01, 1000, key="echo.pulse")] = 5e-9

    @cached_property
    def beam(self) -> Beam:
        """The spot."""
        s = self.spot
        return Beam(s.pair(s.exit_mm, MM), s.pair(s.divergence_mrad, MRAD), s.profile)

    @cached_property
    def line_elevation(self) -> F64:
        """Elevation of each line [rad], shape (line_count,)."""
        return np.array(self.elevations)

    @cached_property
    def line_delay(self) -> F64:
        """When each line fires, after the first of its firing [s], shape (line_count,)."""
        return np.array(self.delays) if self.delays else np.zeros(len(self.elevations))

    @cached_property
    def noise(self) -> F64:
        """Rows (range [m], one-sigma [m])."""
        return _in_metres(self.noise_mm)

    @cached_property
    def signal_noise(self) -> F64:
        """Rows (signal to noise ratio, one-sigma [m])."""
        return _in_metres(self.noise_by_signal_mm)

    def noise_sigma(self, distance: F64, signal: F64 | None = None) -> F64:
        """One-sigma range noise [m] at distances [m]: linear between the data sheet's points.

        signal: received energy over the least detectable. Where the sheet gives noise by signal to noise
        ratio, the larger of both holds (straight lines in logarithms, held outside).
        """
        sigma = np.asarray(np.interp(distance, self.noise[:, 0], self.noise[:, 1]), dtype=np.float64)
        if signal is None or len(self.signal_noise) == 0:
            return sigma
        ratio = portable.log(np.maximum(signal, 1e-9) * self.signal_at_reach)
        rows = portable.log(self.signal_noise)
        by_signal = portable.exp(np.interp(ratio, rows[:, 0], rows[:, 1]))
        return np.asarray(np.maximum(sigma, by_signal), dtype=np.float64)

    def instance(self, *, spot: float, noise: float) -> "LidarSheet":
        """The same with a spot so many times as wide and range noise so many times as large."""
        if spot == noise == 1.0:
            return self
        (across, along), (exit_across, exit_along) = self.spot.divergence_mrad, self.spot.exit_mm
        wide = replace(
            self.spot,
            divergence_mrad=(spot * across, spot * along),
            exit_mm=(spot * exit_across, spot * exit_along),
        )
        by_range, by_signal = (
            [(at, noise * sigma) for at, sigma in rows] for rows in (self.noise_mm, self.noise_by_signal_mm)
        )
        return replace(self, spot=wide, noise_mm=by_range, noise_by_signal_mm=by_signal)

    def azimuths(self, first: float, last: float, step: float) -> F64:
        """Beam azimuths [rad] from first to last inclusive, centred in the sector when step does not fit."""
        count = int(np.floor((last - first) / step + 1e-6)) + 1
        span = (count - 1) * step
        return np.asarray(0.5 * (first + last) - 0.5 * span + step * np.arange(count), dtype=np.float64)


def _in_metres(pairs: Pairs) -> F64:
    """Rows whose second number is in mm, in metres."""
    return np.asarray(
        np.array(pairs, dtype=np.float64).reshape(-1, 2) * np.array([1.0, MM]), dtype=np.float64
    )


def load_lidar(name: str, base: Path | None = None) -> LidarSheet:
    """A bundled scanner by name, or the user's own YAML file. InputError names key and file."""
    return _read(read_sheet("sensors", name, base)) if name.endswith((".yaml", ".yml")) else _bundled(name)


@cache
def _bundled(name: str) -> LidarSheet:
    return _read(read_sheet("sensors", name))


def _read(sheet: Sheet) -> LidarSheet:
    made = sheet.read(LidarSheet)
    if len(made.line_delay) != len(made.line_elevation):
        raise sheet.error("scan.line_delay_us", f"expected one for each of {len(made.line_elevation)} lines")
    for key, rows, low in (
        ("range.noise_mm", made.noise, 0.0),
        ("range.noise_by_signal_mm", made.signal_noise, 1e-3),
    ):
        if np.any(np.diff(rows[:, 0]) <= 0) or np.any(rows[:, 0] < low):
            raise sheet.error(key, f"expected pairs whose first numbers rise, all >= {low:g}")
    return made
