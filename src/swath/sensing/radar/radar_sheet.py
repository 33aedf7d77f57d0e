"""Data sheets of radars: `data/sensors/radar-*.yaml`, and the radar equation of one."""

from dataclasses import dataclass
from math import log10
from pathlib import Path
from typing import Annotated, Any, Literal

from swath.documents.data_sheets import read_sheet
from swath.documents.sheet_fields import Quantity

LIGHT = 299_792_458.0  # m/s


@dataclass(frozen=True, kw_only=True)
class RadarSheet:
    """frequency [Hz]; polarisation: of sent and received waves, V or H against the ground.

    range_min, range_max [m]; azimuth_fov, elevation_fov: whole field of view [rad]
    azimuth_beam_width, elevation_beam_width: one way at half power [rad]
    range_resolution [m], azimuth_resolution [rad], speed_resolution [m/s]: of a resolution cell;
    elevation_resolution: 0 = the radar measures none [rad]
    range_floor, azimuth_floor, speed_floor: standard deviations that stay however strong an echo is
    speed_max: to both sides of what stands [m/s]
    reference_snr: of one look at a target of reference_rcs [dBsm] at reference_range [m] on the axis [dB]
    false_alarm_lg: lg of the false alarm probability per resolution cell and look
    target_max: detections of one look; latency: from the look to the sample [s]
    """

    format: str
    kind: Literal["radar"] = "radar"
    name: str
    note: str = ""
    polarisation: Literal["V", "H"] = "V"
    frequency: Annotated[float, Quantity("ghz", 1, 200)]
    range_min: Annotated[float, Quantity("m", 0, 50)]
    range_max: Annotated[float, Quantity("m", 1, 500)]
    azimuth_fov: Annotated[float, Quantity("deg", 1, 180)]
    elevation_fov: Annotated[float, Quantity("deg", 1, 180)]
    azimuth_beam_width: Annotated[float, Quantity("deg", 1, 180)]
    elevation_beam_width: Annotated[float, Quantity("deg", 1, 180)]
    range_resolution: Annotated[float, Quantity("m", 0.01, 50)]
    azimuth_resolution: Annotated[float, Quantity("deg", 0.1, 90)]
    speed_resolution: Annotated[float, Quantity("m_s", 0.005, 10)]
    elevation_resolution: Annotated[float, Quantity("deg", 0, 90)]
    range_floor: Annotated[float, Quantity("m", 0, 10)]
    azimuth_floor: Annotated[float, Quantity("deg", 0, 20)]
    speed_floor: Annotated[float, Quantity("m_s", 0, 5)]
    speed_max: Annotated[float, Quantity("m_s", 1, 100)]
    reference_snr: Annotated[float, Quantity("", -20, 80, key="reference_snr_db")]
    reference_range: Annotated[float, Quantity("m", 1, 500)]
    reference_rcs: Annotated[float, Quantity("", -60, 60, key="reference_rcs_dbsm")]
    false_alarm_lg: Annotated[float, Quantity("", -12, -1)]
    target_max: Annotated[int, Quantity("", 1, 5000)]
    latency: Annotated[float, Quantity("s", 0, 1)]

    @property
    def wavelength(self) -> float:
        """[m]."""
        return LIGHT / self.frequency

    @property
    def cells(self) -> float:
        """Resolution cells of a look."""
        ranges = (self.range_max - self.range_min) / self.range_resolution
        return (
            ranges
            * (self.azimuth_fov / self.azimuth_resolution)
            * (2.0 * self.speed_max / self.speed_resolution)
        )

    def snr(self, rcs: float, distance: float) -> float:
        """Signal to noise [dB] of a cross section [dBsm] on the axis at a distance [m]."""
        return self.reference_snr + rcs - self.reference_rcs - 40.0 * log10(distance / self.reference_range)

    def gain(self, azimuth: float, elevation: float) -> float:
        """Antenna against its axis [dB], one way: a Gaussian beam."""
        return float(self.gains(azimuth, elevation))

    def gains(self, azimuth: Any, elevation: Any) -> Any:
        """Gains as of `gain` for arrays of angles."""
        a, e = azimuth / self.azimuth_beam_width, elevation / self.elevation_beam_width
        return -12.0412 * (a * a + e * e)  # 40 lg 2: -3.01 at half the width


def load_radar(name: str, base: Path | None = None) -> RadarSheet:
    """A bundled radar by name, or the user's own YAML file."""
    sheet = read_sheet("sensors", name, base)
    made = sheet.read(RadarSheet)
    if made.range_max < made.range_min + made.range_resolution:
        raise sheet.error("range_max_m", "expected at least range_min_m and range_resolution_m together")
    if made.azimuth_fov < made.azimuth_resolution:
        raise sheet.error("azimuth_fov_deg", "expected at least azimuth_resolution_deg")
    return made
