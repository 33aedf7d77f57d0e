"""What OSI says of one sensor: its detections of a sweep or look, and how it sits and looks.

Positions are spherical in the sensor's frame, as in swath. A radial velocity of OSI is positive towards the
sensor, swath's away from it.
"""

from dataclasses import fields
from math import isnan
from typing import Any

import numpy as np

from swath.signals import Scan
from swath.signals.radar import RadarTargets

Sample = Scan | RadarTargets


def sensor_view(view: Any, sample: Sample) -> Any:
    """A new LidarSensorView or RadarSensorView in a SensorView; its configuration, still to be placed."""
    if isinstance(sample, RadarTargets):
        return view.radar_sensor_view.add().view_configuration
    rays = view.lidar_sensor_view.add().view_configuration
    rays.field_of_view_horizontal = float(np.ptp(sample.azimuth))
    rays.field_of_view_vertical = float(np.ptp(sample.elevation))
    rays.max_number_of_interactions = sample.ranges.shape[1]
    cos = np.cos(sample.elevation)
    ways = (cos * np.cos(sample.azimuth), cos * np.sin(sample.azimuth), np.sin(sample.elevation))
    for x, y, z in zip(*(axis.tolist() for axis in ways), strict=True):
        rays.directions.add(x=x, y=y, z=z)
    return rays


def add_detections(features: Any, sample: Sample) -> Any:
    """The detections of a sample into a FeatureData; their header, still to be filled."""
    if isinstance(sample, RadarTargets):
        found = features.radar_sensor.add()
        _radar(found, sample)
    else:
        found = features.lidar_sensor.add()
        _lidar(found, sample)
    found.header.number_of_valid_detections = len(found.detection)
    return found.header


def _lidar(sensor: Any, scan: Scan) -> None:
    """One for each echo."""
    beams, echoes = np.nonzero(np.isfinite(scan.ranges))
    per_echo = (scan.ranges[beams, echoes], scan.intensity[beams, echoes])
    columns = (beams, scan.azimuth[beams], scan.elevation[beams], *per_echo)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for beam, azimuth, elevation, distance, intensity in rows:
        found = sensor.detection.add(existence_probability=1.0)
        found.position.distance, found.position.azimuth = distance, azimuth
        found.position.elevation = elevation
        if not isnan(intensity):
            found.intensity = 100.0 * intensity
        if hasattr(found, "beam_id"):
            found.beam_id.value = beam


def _radar(sensor: Any, seen: RadarTargets) -> None:
    """One for each; what the radar does not know stays away, an elevation that it does not measure is 0."""
    names = [f.name for f in fields(seen) if f.name != "t"]
    for row in zip(*(getattr(seen, name).tolist() for name in names), strict=True):
        distance, azimuth, elevation, speed, rcs, snr, distance_sd, azimuth_sd, speed_sd = row
        found = sensor.detection.add()
        found.position.distance, found.position.azimuth = distance, azimuth
        found.position.elevation = 0.0 if isnan(elevation) else elevation
        found.radial_velocity, found.rcs = -speed, rcs
        for target, name, value in (
            (found, "snr", snr),
            (found.position_rmse, "distance", distance_sd),
            (found.position_rmse, "azimuth", azimuth_sd),
            (found, "radial_velocity_rmse", speed_sd),
        ):
            if not isnan(value):
                setattr(target, name, value)
