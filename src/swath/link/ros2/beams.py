"""A scan as it is, beam by beam: sensor_msgs/PointCloud2, one row per beam and one column per echo.

LaserScan and a cloud of echoes, which the recording holds, are what ROS users know, but they round the angles
and leave out beams without an echo. This cloud keeps everything to the last bit: the fields `x`, `y`, `z`,
`intensity` (float32, what a viewer looks for), `range` (float32) and `azimuth`, `elevation`, `time` (float64)
of every beam; no echo is nan. The stamp is the end of the sweep.
"""

from typing import Any

import numpy as np

from swath.core.errors import SwathError
from swath.signals import Scan

LAYOUT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "intensity", "range")),
        ("pad", "<f4"),
        *((name, "<f8") for name in ("azimuth", "elevation", "time")),
    ]
)
FLOAT32, FLOAT64 = 7, 8  # sensor_msgs/PointField
NEEDED = ("range", "azimuth", "elevation", "time")


def table_of(scan: Scan) -> np.ndarray[Any, Any]:
    """The cloud's data, shape (beam_count, echo_count)."""
    table = np.zeros(scan.ranges.shape, dtype=LAYOUT)
    points = scan.points()
    for axis, name in enumerate("xyz"):
        table[name] = points[:, :, axis]
    table["intensity"], table["range"] = scan.intensity, scan.ranges
    for name, column in (("azimuth", scan.azimuth), ("elevation", scan.elevation), ("time", scan.beam_t)):
        table[name] = column[:, None]
    return table


def fill_cloud(message: Any, scan: Scan, make_field: Any) -> Any:
    """Fill a PointCloud2 but for its header. make_field: the class sensor_msgs.msg.PointField."""
    table = table_of(scan)
    message.height, message.width = table.shape
    message.fields = [
        make_field(
            name=name, offset=int(offset), datatype=FLOAT32 if kind.itemsize == 4 else FLOAT64, count=1
        )
        for name, (kind, offset, *_) in (LAYOUT.fields or {}).items()
        if name != "pad"
    ]
    message.is_bigendian, message.is_dense = False, False
    message.point_step, message.row_step = LAYOUT.itemsize, LAYOUT.itemsize * table.shape[1]
    message.data = table.tobytes()
    return message


def scan_of(message: Any, t: int) -> Scan:
    """The scan of such a cloud; fields may lie in any order and be float32 or float64.

    `intensity` may be missing (then nan). SwathError for a cloud that lacks another field.
    """
    kinds = {FLOAT32: "f4", FLOAT64: "f8"}
    order = ">" if message.is_bigendian else "<"
    fields = {f.name: (order + kinds[f.datatype], f.offset) for f in message.fields if f.datatype in kinds}
    if missing := [name for name in NEEDED if name not in fields]:
        raise SwathError(f"a scan's cloud has no field {missing[0]} of float32 or float64")
    formats, offsets = zip(*fields.values(), strict=True)
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": list(formats),
            "offsets": list(offsets),
            "itemsize": message.point_step,
        }
    )
    table = np.frombuffer(bytes(message.data), dtype=layout).reshape(message.height, message.width)
    ranges = np.array(table["range"], dtype=np.float32)
    bright = table["intensity"] if "intensity" in fields else np.full(ranges.shape, np.nan)
    beam_t, azimuth, elevation = (
        np.array(table[name][:, 0], dtype=np.float64) for name in ("time", "azimuth", "elevation")
    )
    return Scan(t, beam_t, azimuth, elevation, ranges, np.array(bright, dtype=np.float32))
