"""Point clouds for other programs: PLY by an own small writer, LAS and LAZ by laspy."""

from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath import __version__
from swath.core.errors import Extra
from swath.core.files.whole_file import new_file, write_whole
from swath.core.frames import Pose
from swath.field.maps.projection import Origin, known_crs
from swath.signals import U8, Scan, ScanTruth, beam_directions

NAMES = ("x", "y", "z", "intensity", "time", "azimuth", "beam", "echo", "echo_count")
RECORD = np.dtype({"names": NAMES, "formats": ("<f8",) * 3 + ("<f4", "<f8", "<f4", "<u4", "<u2", "<u2")})
"""Of an echo: x, y, z in the world [m], intensity (1 = white target that fills the spot), time since the
start of the run [s], azimuth in the sensor frame [rad], beam, echo (0 = nearest) of echo_count."""
PLY_TYPES = {"<f8": "double", "<f4": "float", "<u4": "uint", "<u2": "ushort"}
CREATED = date(2024, 1, 1)  # the same cloud gives the same file, whenever it is written
LOCAL_WKT = (
    'LOCAL_CS["swath field",LOCAL_DATUM["origin of the field",0],UNIT["metre",1.0],'
    'AXIS["east",EAST],AXIS["north",NORTH],AXIS["up",UP]]'
)
"""Metres of a field without a place on Earth (OGC 01-009, local coordinate system)."""
LAS_STEP = 0.0005  # resolution of LAS coordinates [m]
LAS_ANGLE = 0.006  # unit of the scan angle in LAS 1.4 [deg]


Cloud = NDArray[np.void]  # records of RECORD, (n,)


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
    return points


def write_ply(path: Path, cloud: Cloud) -> Path:
    """PLY 1.0, binary little endian, vertices only."""
    lines = ["ply", "format binary_little_endian 1.0", f"comment swath {__version__}"]
    lines += ["comment metres, x east, y north, z up", f"element vertex {len(cloud)}"]
    for name in RECORD.names or ():
        lines.append(f"property {PLY_TYPES[RECORD[name].str]} {name}")
    lines.append("end_header\n")
    return write_whole(path, "\n".join(lines).encode("ascii") + cloud.tobytes())


def need_las() -> Any:
    """The module laspy. MissingExtra when it or its compression is not installed."""
    with Extra("las", "writing LAS and LAZ"):
        import laspy
        import lazrs  # noqa: F401
    return laspy


def write_las(path: Path, cloud: Cloud, origin: Origin | None = None, *, classes: U8 | None = None) -> Path:
    """LAS 1.4, point format 6, compressed where the name ends in `.laz`; the beam's number as an extra.

    origin: of a field on Earth: points are in its projected system, else in the field's own metres; the file
    says which as WKT. Times are seconds of the run, intensity 65535 = 1 and cut off there; classes: of ASPRS,
    (n,). MissingExtra without laspy.
    """
    laspy = need_las()
    if origin is not None:
        cloud = cloud.copy()
        for axis, shift in zip("xyz", (origin.easting, origin.northing, origin.height), strict=True):
            cloud[axis] += shift
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, LAS_STEP)
    header.offsets = [np.floor(cloud[axis].min()) if len(cloud) else 0.0 for axis in "xyz"]
    header.generating_software = f"swath {__version__}"
    header.creation_date = CREATED
    wkt = LOCAL_WKT if origin is None else known_crs(f"EPSG:{origin.epsg}").to_wkt("WKT1_GDAL")
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    header.global_encoding.wkt = True
    header.add_extra_dim(laspy.ExtraBytesParams("beam", "uint32", "number of the beam in the sweep"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (cloud[axis] for axis in "xyz")
    las.intensity = np.round(65535 * np.clip(cloud["intensity"], 0.0, 1.0)).astype(np.uint16)
    las.gps_time = cloud["time"]
    las.return_number = np.minimum(cloud["echo"] + 1, 15).astype(np.uint8)
    las.number_of_returns = np.minimum(cloud["echo_count"], 15).astype(np.uint8)
    las.scan_angle = np.round(np.degrees(cloud["azimuth"]) / LAS_ANGLE).astype(np.int16)
    las.beam = cloud["beam"]
    if classes is not None:
        las.classification = classes
    with new_file(path) as file:
        las.write(file, do_compress=path.suffix == ".laz")
    return path
