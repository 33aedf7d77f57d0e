"""Scans from sensor_msgs/LaserScan and sensor_msgs/PointCloud2."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.schedule import NS
from swath.record.read.fields import Makers, stamp_of
from swath.signals import F64, Scan, ScanTruth

POINT_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # PointField
# Names that drivers give to the time of a point: -> its unit [s], and whether it counts from the stamp.
POINT_TIMES = {
    "time": (1.0, True),
    "t": (1e-9, True),
    "offset_time": (1e-9, True),
    "timestamp": (1.0, False),
    "time_stamp": (1.0, True),
}
BRIGHTNESS = ("intensity", "reflectivity", "i")


def cloud_table(message: Any) -> NDArray[np.void]:
    """sensor_msgs/PointCloud2 as a table with a column per field. ValueError where it is too short."""
    names = {f.name: f for f in message.fields}
    order = ">" if message.is_bigendian else "<"
    layout = np.dtype(
        {
            "names": list(names),
            "formats": [order + POINT_KINDS[f.datatype] for f in names.values()],
            "offsets": [f.offset for f in names.values()],
            "itemsize": message.point_step,
        }
    )
    count = message.width * message.height
    return np.frombuffer(np.asarray(message.data).tobytes(), dtype=layout, count=count)


def _scan_of_laser(message: Any, t: int) -> Scan:
    """Stamp of the first beam; ranges outside its limits, inf and 0 are no echo."""
    count = len(message.ranges)
    first = stamp_of(message, t)
    beam = np.arange(count)
    late = np.asarray(beam * float(message.time_increment), dtype=np.float64)
    end = min(first + round(float(late[-1]) * NS), t) if count else first
    ranges = np.array(message.ranges, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)
    intensity = np.array(message.intensities, dtype=np.float32)
    if len(intensity) != count:
        intensity = np.full(count, np.nan, dtype=np.float32)
    ranges[~good], intensity[~good] = np.nan, np.nan
    azimuth = np.asarray(float(message.angle_min) + beam * float(message.angle_increment), np.float64)
    return Scan(
        end,
        late - (late[-1] if count else 0.0),
        azimuth,
        np.zeros(count),
        ranges[:, None],
        intensity[:, None],
    )


def _scan_of_cloud(message: Any, t: int) -> Scan:
    """A beam per point, or per `beam` where there are several echoes; points at 0 or nan are left out."""
    table = cloud_table(message)
    names = table.dtype.names or ()
    points = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    far = np.linalg.norm(points, axis=1)
    good = np.isfinite(far) & (far > 0.0)
    table, points, far = table[good], points[good], far[good]
    late = _point_times(table, stamp_of(message, t))
    bright = next((n for n in BRIGHTNESS if n in names), None)
    intensity = np.full(len(far), np.nan) if bright is None else table[bright].astype(np.float64)
    if "beam" in names and "echo" in names:
        beams, beam = np.unique(table["beam"], return_inverse=True)
        echo = table["echo"].astype(int)
    else:
        beams, beam, echo = np.arange(len(far)), np.arange(len(far)), np.zeros(len(far), dtype=int)
    shape = (len(beams), int(echo.max(initial=0)) + 1)
    ranges, light = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    ranges[beam, echo], light[beam, echo] = far, intensity
    azimuth, elevation, after = (np.zeros(len(beams)) for _ in range(3))
    azimuth[beam] = portable.arctan2(points[:, 1], points[:, 0])
    elevation[beam] = portable.arcsin(np.clip(points[:, 2] / far, -1.0, 1.0))
    after[beam] = late
    last = float(after.max(initial=-np.inf)) if len(beams) else 0.0
    end = stamp_of(message, t) + round(last * NS)
    return Scan(min(end, t), after - last, azimuth, elevation, ranges, light)


def _point_times(table: NDArray[np.void], stamp: int) -> F64:
    """Time of each point after the stamp [s]; 0 where the cloud does not say."""
    for name, (unit, is_relative) in POINT_TIMES.items():
        if name in (table.dtype.names or ()):
            value = table[name].astype(np.float64) * unit
            late = value if is_relative else value - stamp / NS
            return np.asarray(np.where(np.abs(late) < 10.0, late, 0.0))  # else it is on another clock
    return np.zeros(len(table))


def _truth_of_cloud(message: Any, t: int) -> ScanTruth:
    """Points as rounded to float32; where the sensor was is not in it: nan."""
    table = cloud_table(message)
    beam, echo = table["beam"].astype(int), table["echo"].astype(int)
    points = np.full((int(beam.max(initial=-1)) + 1, int(echo.max(initial=0)) + 1, 3), np.nan)
    points[beam, echo] = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    return ScanTruth(stamp_of(message, t), points, np.full((len(points), 3), np.nan))


MAKERS: Makers = {
    (Scan, "LaserScan"): lambda context: _scan_of_laser,
    (Scan, "PointCloud2"): lambda context: _scan_of_cloud,
    (ScanTruth, "PointCloud2"): lambda context: _truth_of_cloud,
}
