"""Point clouds for other programs: PLY by an own small writer, LAS and LAZ by laspy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath import __version__
from swath.core.errors import MissingExtra
from swath.core.frames import Pose
from swath.signals import F64, Scan, ScanTruth, beam_directions

RECORD = np.dtype(
    [
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("intensity", "<f4"),
        ("time", "<f8"),
        ("azimuth", "<f4"),
        ("beam", "<u4"),
        ("echo", "<u2"),
        ("echo_count", "<u2"),
    ]
)
PLY_TYPES = {"<f8": "double", "<f4": "float", "<u4": "uint", "<u2": "ushort"}
LAS_STEP = 0.0005  # resolution of LAS coordinates [m]
LAS_ANGLE = 0.006  # unit of the scan angle in LAS 1.4 [deg]


@dataclass(frozen=True)
class Cloud:
    """Echoes in the world frame, one record each.

    points: records of RECORD: x, y, z [m], intensity (1 = white target that fills the spot), time since the
    start of the run [s], azimuth in the sensor frame [rad], beam, echo (0 = nearest) of echo_count
    """

    points: NDArray[np.void]

    @property
    def xyz(self) -> F64:
        """Places [m], (n, 3)."""
        return np.stack([self.points["x"], self.points["y"], self.points["z"]], axis=1)


def make_cloud(scan: Scan, truth: ScanTruth, pose: Pose) -> Cloud:
    """Measured echoes in the world, each from where the sensor was at its beam's time.

    pose: pose_world_sensor at the end of the sweep, whose rotation is taken for the whole sweep
    """
    beam, echo = np.nonzero(np.isfinite(scan.ranges))
    aim = beam_directions(scan.azimuth, scan.elevation)[beam] @ pose.rotation.T
    known = np.isfinite(truth.sensor_position)  # not so in a scan from a log
    sensor = np.where(known, truth.sensor_position, pose.position)
    places = sensor[beam] + scan.ranges[beam, echo, None].astype(np.float64) * aim
    points = np.zeros(len(beam), RECORD)
    for k, axis in enumerate("xyz"):
        points[axis] = places[:, k]
    points["intensity"] = scan.intensity[beam, echo]
    points["time"] = scan.t * 1e-9 + scan.beam_t[beam]
    points["azimuth"] = scan.azimuth[beam]
    points["beam"], points["echo"] = beam, echo
    points["echo_count"] = np.isfinite(scan.ranges).sum(axis=1)[beam]
    return Cloud(points)


def write_ply(path: Path, cloud: Cloud) -> Path:
    """PLY 1.0, binary little endian, vertices only."""
    lines = ["ply", "format binary_little_endian 1.0", f"comment swath {__version__}"]
    lines += ["comment metres, x east, y north, z up", f"element vertex {len(cloud.points)}"]
    for name in RECORD.names or ():
        lines.append(f"property {PLY_TYPES[RECORD[name].str]} {name}")
    lines.append("end_header\n")
    path.write_bytes("\n".join(lines).encode("ascii") + cloud.points.tobytes())
    return path


def need_las() -> Any:
    """The module laspy. MissingExtra when it or its compression is not installed."""
    try:
        import laspy
        import lazrs  # noqa: F401
    except ImportError as error:
        raise MissingExtra("las", "writing LAS and LAZ") from error
    return laspy


def write_las(path: Path, cloud: Cloud) -> Path:
    """LAS 1.4, point format 6, compressed where the name ends in `.laz`; the beam's number as an extra.

    Times are seconds of the run, intensity 65535 = 1 and cut off there. MissingExtra without laspy.
    """
    laspy = need_las()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, LAS_STEP)
    header.offsets = np.floor(cloud.xyz.min(axis=0)) if len(cloud.points) else np.zeros(3)
    header.generating_software = f"swath {__version__}"
    header.creation_date = None  # the same cloud gives the same file
    header.add_extra_dim(laspy.ExtraBytesParams("beam", "uint32", "number of the beam in the sweep"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T
    las.intensity = np.round(65535 * np.clip(cloud.points["intensity"], 0.0, 1.0)).astype(np.uint16)
    las.gps_time = cloud.points["time"]
    las.return_number = np.minimum(cloud.points["echo"] + 1, 15).astype(np.uint8)
    las.number_of_returns = np.minimum(cloud.points["echo_count"], 15).astype(np.uint8)
    las.scan_angle = np.round(np.degrees(cloud.points["azimuth"]) / LAS_ANGLE).astype(np.int16)
    las.beam = cloud.points["beam"]
    las.write(str(path), do_compress=path.suffix == ".laz")
    return path
