"""Detections of a radar as ROS 2 messages: all their numbers, and a cloud for viewers."""

from collections.abc import Iterator

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


def radar_messages(source: Source, seen: RadarTargets) -> Iterator[Sent]:
    """swath_msgs/RadarTargets, and sensor_msgs/PointCloud2 beside it."""
    yield from own_messages(source, seen)
    columns = {name: getattr(seen, quantity) for name, quantity in FIELDS.items()}
    cloud = cloud_message(source, seen.t, source.frame_of(type(seen)), seen.points(), columns)
    yield Sent(f"{source.topic}_points", cloud)
