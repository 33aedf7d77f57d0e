"""Detections of a radar as ROS 2 messages: all their numbers, and a cloud for viewers."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from swath.record.messages import Sent, Source
from swath.record.own_messages import own_messages
from swath.record.scan_messages import cloud_message
from swath.signals.radar import RadarTargets

# Fields of clouds as smartmicro's driver names them, and the quantities that they hold.
FIELDS = {
    "radial_speed": "radial_speed",
    "rcs": "rcs",
    "snr": "snr",
    "azimuth_angle": "azimuth",
    "elevation_angle": "elevation",
    "range": "range",
}
RETURN = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")  # of radar_msgs/RadarReturn


def radar_messages(source: Source, seen: RadarTargets) -> Iterator[Sent]:
    """swath_msgs/RadarTargets, and beside it sensor_msgs/PointCloud2 and radar_msgs/RadarScan."""
    yield from own_messages(source, seen)
    columns = {name: getattr(seen, quantity) for name, quantity in FIELDS.items()}
    cloud = cloud_message(source, seen.t, source.frame_of(type(seen)), seen.points(), columns)
    yield Sent(f"{source.topic}_points", cloud)
    yield Sent(f"{source.topic}_returns", _returns(source, seen))


def _returns(source: Source, seen: RadarTargets) -> Any:
    """radar_msgs/RadarScan: an elevation that is not measured is 0, amplitude is signal to noise [dB]."""
    columns = (seen.range, seen.azimuth, np.nan_to_num(seen.elevation), seen.radial_speed, seen.snr)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    returns = [
        source.make("radar_msgs/msg/RadarReturn", **dict(zip(RETURN, row, strict=True))) for row in rows
    ]
    header = source.make.header(seen.t, source.frame_of(type(seen)))
    return source.make("radar_msgs/msg/RadarScan", header=header, returns=returns)
