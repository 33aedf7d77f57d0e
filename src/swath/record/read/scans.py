"""Scans from sensor_msgs/LaserScan and sensor_msgs/PointCloud2."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.schedule import NS
from swath.record.read.fields import Context, Makers
from swath.signals import F64, Scan, ScanTruth

POINT_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # PointField
# Names that drivers give to the time of a point -> whether it counts from the stamp of the cloud. Floats are
# seconds and whole numbers nanoseconds; where that cannot be, `point_times` finds what can.
POINT_TIMES = {
    "time": True,
    "t": True,
    "offset_time": True,
    "timestamp": False,
    "time_stamp": True,
    "time_offset_ns": True,
    "point_time_offset": True,
    "time_offset": True,
    "ts": True,
}
UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
LONGEST_SWEEP_S = 5.0  # a 2D scanner that is tilted takes as long
FASTEST_POINTS_S = 1e7  # points that a scanner measures in a second at most; the fastest sold: 7e6
STAMP_NEAR_S = 10.0  # a point measured further from the stamp of its cloud is on another clock
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


@dataclass(frozen=True)
class CloudPoints:
    """The points of a cloud that are any. points [m], (n, 3), sensor frame; far: their range [m], (n,).

    late: when they were measured, after the stamp [s], (n,); intensity (n,), nan = not known
    table: all columns, (n,)
    left_out: points at 0 or nan
    """

    points: F64
    far: F64
    late: F64
    intensity: F64
    table: NDArray[np.void]
    left_out: int


def real_points(message: Any) -> tuple[NDArray[np.void], F64, F64, int]:
    """Rows of a sensor_msgs/PointCloud2, their points (n, 3) and ranges (n,) [m], without those at 0 or nan,
    and how many these are.
    """
    table = cloud_table(message)
    points = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    far = np.linalg.norm(points, axis=1)
    good = np.isfinite(far) & (far > 0.0)
    return table[good], points[good], far[good], int((~good).sum())


def cloud_points(message: Any, note: Callable[[str], None]) -> CloudPoints:
    """What a sensor_msgs/PointCloud2 holds. note: takes what had to be assumed."""
    stamp = int(message.header.stamp.sec) * NS + int(message.header.stamp.nanosec)
    table, points, far, left_out = real_points(message)
    bright = next((n for n in BRIGHTNESS if n in (table.dtype.names or ())), None)
    intensity = np.full(len(far), np.nan) if bright is None else table[bright].astype(np.float64)
    return CloudPoints(points, far, point_times(table, stamp, note), intensity, table, left_out)


def point_times(table: NDArray[np.void], stamp: int, note: Callable[[str], None]) -> F64:
    """Time of each point after the stamp [s], 0 where the cloud does not say.

    Unit and begin are the usual ones, if that gives a sweep that a scanner can make near the stamp; else
    those that do, also of columns of other names that are times on the clock of the stamp. Numbers on another
    clock count from their first.
    """
    names = table.dtype.names or ()
    known = [name for name in POINT_TIMES if name in names]
    if len(table) < 2:
        return _late(table[known[0]], stamp, *_usual(table, known[0])) if known else np.zeros(len(table))
    for name in known:
        usual = _usual(table, name)
        for unit, is_relative in (usual, *product(UNITS, (False, True))):
            late = _late(table[name], stamp, unit, is_relative)
            if _is_sweep(late) and np.abs(late).max() <= STAMP_NEAR_S:
                if (unit, is_relative) != usual:
                    unit_said = f"{UNITS[unit]} {'after the stamp' if is_relative else 'of the clock'}"
                    note(f"clock: times of points ({name}) are {unit_said}, as far as they can be reported")
                return late
    for name, unit in product([n for n in names if n not in (*POINT_TIMES, *"xyz", *BRIGHTNESS)], UNITS):
        late = _late(table[name], stamp, unit, False)
        if _is_sweep(late) and np.abs(late).max() <= STAMP_NEAR_S:
            note(f"clock: times of points are taken to be {name}, {UNITS[unit]} of the clock")
            return late
    for name in known:
        for unit in (_usual(table, name)[0], *UNITS):
            late = (table[name].astype(np.float64) - float(table[name].min())) * unit
            if _is_sweep(late):
                note(f"clock: times of points ({name}) are on another clock, the first counts as the stamp")
                return np.asarray(late)
    what = f"times of points ({', '.join(known)}) are those of no sweep" if known else "no times of points"
    note(f"clock: {what}, all are at the stamp of their cloud")
    return np.zeros(len(table))


def _usual(table: NDArray[np.void], name: str) -> tuple[float, bool]:
    """Unit [s] of a column by its kind, and whether it counts from the stamp by its name."""
    return (1.0 if table.dtype[name].kind == "f" else 1e-9), POINT_TIMES[name]


def _late(value: NDArray[Any], stamp: int, unit: float, is_relative: bool) -> F64:
    late = value.astype(np.float64) * unit
    return np.asarray(late if is_relative else late - stamp / NS)


def _is_sweep(late: F64) -> bool:
    """Whether a scanner can measure so many points in that time."""
    span = float(np.ptp(late))
    return len(late) / FASTEST_POINTS_S <= span <= LONGEST_SWEEP_S


def beam_times(message: Any, note: Callable[[str], None]) -> F64:
    """Time of each beam of a sensor_msgs/LaserScan after its stamp [s], (n,)."""
    if len(message.ranges) > 1 and not message.time_increment:
        note("clock: scans without time_increment, all beams are at the stamp")
    return np.asarray(np.arange(len(message.ranges)) * float(message.time_increment), dtype=np.float64)


def _scan_of_laser(context: Context, message: Any, t: int) -> Scan:
    """Stamp of the first beam; ranges outside its limits, inf and 0 are no echo."""
    count = len(message.ranges)
    first = context.stamp(message, t)
    beam, late = np.arange(count), beam_times(message, context.note)
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


def _scan_of_cloud(context: Context, message: Any, t: int) -> Scan:
    """A beam per point, or per `beam` where there are several echoes; points at 0 or nan are left out."""
    stamp, cloud = context.stamp(message, t), cloud_points(message, context.note)
    table, points, far = cloud.table, cloud.points, cloud.far
    names = table.dtype.names or ()
    if "beam" in names and "echo" in names:
        beams, beam = np.unique(table["beam"], return_inverse=True)
        echo = table["echo"].astype(int)
    else:
        beams, beam, echo = np.arange(len(far)), np.arange(len(far)), np.zeros(len(far), dtype=int)
    shape = (len(beams), int(echo.max(initial=0)) + 1)
    ranges, light = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    ranges[beam, echo], light[beam, echo] = far, cloud.intensity
    azimuth, elevation, after = (np.zeros(len(beams)) for _ in range(3))
    azimuth[beam] = portable.arctan2(points[:, 1], points[:, 0])
    elevation[beam] = portable.arcsin(np.clip(points[:, 2] / far, -1.0, 1.0))
    after[beam] = cloud.late
    last = float(after.max(initial=-np.inf)) if len(beams) else 0.0
    end = stamp + round(last * NS)
    return Scan(min(end, t), after - last, azimuth, elevation, ranges, light)


def _truth_of_cloud(context: Context, message: Any, t: int) -> ScanTruth:
    """Points as rounded to float32; where the sensor was is not in it: nan."""
    table = cloud_table(message)
    beam, echo = table["beam"].astype(int), table["echo"].astype(int)
    points = np.full((int(beam.max(initial=-1)) + 1, int(echo.max(initial=0)) + 1, 3), np.nan)
    points[beam, echo] = np.stack([table[n].astype(np.float64) for n in "xyz"], axis=1)
    return ScanTruth(context.stamp(message, t), points, np.full((len(points), 3), np.nan))


MAKERS: Makers = {
    (Scan, "LaserScan"): lambda context: partial(_scan_of_laser, context),
    (Scan, "PointCloud2"): lambda context: partial(_scan_of_cloud, context),
    (ScanTruth, "PointCloud2"): lambda context: partial(_truth_of_cloud, context),
}
