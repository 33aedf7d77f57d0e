"""Detections of a radar from sensor_msgs/PointCloud2 or radar_msgs/RadarScan of the usual drivers."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.record.read.fields import Context, Makers
from swath.record.read.scans import real_points
from swath.signals import F64
from swath.signals.radar import RadarTargets, radar_targets_of

# Names that drivers give to what a cloud holds beside x, y, z; speeds in m/s, > 0 goes away.
SPEEDS = ("radial_speed", "radial_velocity", "doppler", "velocity", "v_doppler_mps", "doppler_velocity")
SECTIONS = ("rcs", "radar_cross_section", "RCS")
STRENGTHS = ("snr", "snr_db", "SNR", "signal_to_noise_ratio")


def _targets_of_cloud(context: Context, message: Any, t: int) -> RadarTargets:
    """A detection per point; points at 0 or nan are left out, and what the cloud does not say is nan."""
    table, points, far, _ = real_points(message)
    azimuth = portable.arctan2(points[:, 1], points[:, 0])
    elevation = portable.arcsin(np.clip(points[:, 2] / far, -1.0, 1.0))
    names = table.dtype.names or ()
    if "elevation_angle" in names:
        elevation = np.where(np.isnan(table["elevation_angle"]), np.nan, elevation)
    found = [_first(table, which) for which in (SPEEDS, SECTIONS, STRENGTHS)]
    unknown = np.full((3, len(far)), np.nan)
    rows = np.vstack([far, azimuth, elevation, *found, unknown]).T
    return radar_targets_of(context.stamp(message, t), rows.tolist())


def _first(table: NDArray[np.void], names: tuple[str, ...]) -> F64:
    """The first of these columns that is there, else nan."""
    name = next((n for n in names if n in (table.dtype.names or ())), None)
    return np.full(len(table), np.nan) if name is None else table[name].astype(np.float64)


def _targets_of_returns(context: Context, message: Any, t: int) -> RadarTargets:
    """A detection per radar_msgs/RadarReturn with a finite distance; no cross sections.

    Amplitudes are taken for signal to noise. Where all elevations are 0 the radar measures none.
    """
    rows = [[r.range, r.azimuth, r.elevation, r.doppler_velocity, r.amplitude] for r in message.returns]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    far, azimuth, elevation, speed, snr = table[np.isfinite(table[:, 0]) & (table[:, 0] > 0.0)].T
    unknown = np.full(len(far), np.nan)
    columns = np.vstack(
        [far, azimuth, elevation if elevation.any() else unknown, speed, unknown, snr, *[unknown] * 3]
    )
    return radar_targets_of(context.stamp(message, t), columns.T.tolist())


MAKERS: Makers = {
    (RadarTargets, "PointCloud2"): lambda context: partial(_targets_of_cloud, context),
    (RadarTargets, "RadarScan"): lambda context: partial(_targets_of_returns, context),
}
