"""Scans and images as ROS 2 messages: LaserScan and PointCloud2; Image of each channel and its CameraInfo.

Of an image nothing is rounded or renamed: the arrays come back bit for bit, so there are no exact samples
beside them. The colours are there a second time as JPEG, as drivers of cameras send them (topic of
image_transport).
"""

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.schedule import NS
from swath.record.message_factory import Sent, Source, own_messages
from swath.signals import Image, Scan, ScanTruth, WindowState
from swath.signals.scan import WINDOW_STATES

JPEG_QUALITY = 90
MODELS = {0: "plumb_bob", 5: "plumb_bob", 8: "rational_polynomial", 4: "equidistant"}  # by coefficients


def image_messages(source: Source, image: Image) -> Iterator[Sent]:
    """Every channel the image has, then its CameraInfo; in the optical frame (REP 103)."""
    channels = (
        ("", "rgb8", image.colour),
        ("_depth", "32FC1", image.depth),
        ("_label", "mono8", image.label),
        ("_instance", "mono16", image.instance),
        ("_raw", "rgb16" if image.raw.shape[2] == 3 else "mono16", image.raw),
    )
    for suffix, encoding, pixels in channels:
        if pixels.size:
            yield Sent(source.topic + suffix, _picture(source, image.t, encoding, pixels))
    if image.colour.size:
        yield Sent(f"{source.topic}/compressed", _jpeg(source, image))
    yield Sent(f"{source.slot_topic}/camera_info", _camera_info(source, image))


def _picture(source: Source, t: int, encoding: str, pixels: NDArray[Any]) -> Any:
    little = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("<"))
    return source.make(
        "sensor_msgs/msg/Image",
        header=source.make.header(t, source.frame_of(Image)),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        step=little.nbytes // pixels.shape[0],
        data=np.frombuffer(little.tobytes(), dtype=np.uint8),
    )


def encoded(pixels: NDArray[Any], kind: str, **options: Any) -> bytes:
    """Pixels as a file of a kind, `PNG` or `JPEG`. options: of Pillow's."""
    from PIL import Image as Picture

    held = io.BytesIO()
    Picture.fromarray(pixels).save(held, format=kind, **options)
    return held.getvalue()


def _jpeg(source: Source, image: Image) -> Any:
    return source.make(
        "sensor_msgs/msg/CompressedImage",
        header=source.make.header(image.t, source.frame_of(Image)),
        format="rgb8; jpeg compressed rgb8",
        data=np.frombuffer(encoded(image.colour, "JPEG", quality=JPEG_QUALITY), dtype=np.uint8),
    )


def _camera_info(source: Source, image: Image) -> Any:
    """CameraInfo: D is the lens's distortion; P is K beside a column of zeros and holds without it."""
    k = np.array([[image.focal, 0.0, image.centre_x], [0.0, image.focal, image.centre_y], [0.0, 0.0, 1.0]])
    return source.make(
        "sensor_msgs/msg/CameraInfo",
        header=source.make.header(image.t, source.frame_of(Image)),
        height=image.height,
        width=image.width,
        distortion_model=MODELS.get(len(image.distortion), ""),
        d=np.zeros(5) if len(image.distortion) == 0 else image.distortion,
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([k, np.zeros(3)]).ravel(),
    )


POINT_FIELDS = (("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"))
# As the drivers of rotating scanners name and type them (velodyne_pointcloud: `ring`, `time`), then our own.
BEAM_FIELDS = (("time", "<f4"), ("beam", "<u4"), ("ring", "<u2"), ("echo", "<u2"))
ROS_KINDS = {"<f4": 7, "<u2": 4, "<u4": 6}  # sensor_msgs/PointField FLOAT32, UINT16, UINT32


def scan_messages(source: Source, scan: Scan) -> Iterator[Sent]:
    """LaserScan where it can say it, PointCloud2 where it cannot or there are several echoes."""
    is_plane = is_laser_scan(scan)
    if is_plane:
        yield Sent(source.topic, _laser_scan(source, scan))
    if not is_plane or scan.ranges.shape[1] > 1:
        points, beam, echo = _flatten(scan.points())
        columns = {"intensity": scan.intensity[beam, echo], "time": scan.beam_t[beam]}
        columns |= {"ring": rings(scan)[beam], "beam": beam, "echo": echo}
        cloud = cloud_message(source, scan.t, source.frame, points, columns)
        yield Sent(f"{source.topic}_points", cloud)


def truth_messages(source: Source, truth: ScanTruth) -> Iterator[Sent]:
    """PointCloud2 in the world."""
    points, beam, echo = _flatten(truth.points)
    yield Sent(source.topic, cloud_message(source, truth.t, "map", points, {"beam": beam, "echo": echo}))


def window_messages(source: Source, window: WindowState) -> Iterator[Sent]:
    """swath_msgs/WindowState, and what diagnostics show of it."""
    yield from own_messages(source, window)
    status = source.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=min(window.state, 2),  # OK, WARN, ERROR
        name=f"{source.slot_topic}: window",
        message=WINDOW_STATES[window.state],
        values=[
            source.make("diagnostic_msgs/msg/KeyValue", key=key, value=f"{value:g}")
            for key, value in (("transmission", window.transmission), ("sector", window.sector))
        ],
    )
    header = source.make.header(window.t, source.frame)
    yield Sent(
        "/diagnostics", source.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])
    )


def is_laser_scan(scan: Scan) -> bool:
    """True when the beams lie in the sensor's x-y plane at even angles: what a LaserScan can say."""
    if len(scan.azimuth) < 2 or np.any(np.abs(scan.elevation) > 1e-9):
        return False
    steps = np.diff(scan.azimuth)
    return bool(np.all(np.abs(steps - steps.mean()) < 1e-3 * abs(steps.mean()) + 1e-12))


def rings(scan: Scan) -> NDArray[np.int64]:
    """The layer that each beam belongs to, 0 = the lowest, (beam_count,); all 0 for a single plane."""
    _, layer = np.unique(np.round(scan.elevation, 6), return_inverse=True)
    return np.asarray(layer, dtype=np.int64).reshape(-1)


def _flatten(points: NDArray[np.float64]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Echoes that exist, shape (n, 3), with the beam and echo number of each."""
    beam, echo = np.nonzero(np.isfinite(points[:, :, 0]))
    return points[beam, echo], beam, echo


def _laser_scan(source: Source, scan: Scan) -> Any:
    """sensor_msgs/LaserScan of the first echoes; no echo is +inf (REP 117)."""
    period, least, greatest = source.machine.scanners.get(source.slot, (0.0, 0.0, 1000.0))
    count = len(scan.azimuth)
    span = float(scan.beam_t[-1] - scan.beam_t[0])
    ranges = np.ascontiguousarray(scan.ranges[:, 0], dtype=np.float32)
    return source.make(
        "sensor_msgs/msg/LaserScan",
        header=source.make.header(scan.t + round(float(scan.beam_t[0]) * NS), source.frame),
        angle_min=float(scan.azimuth[0]),
        angle_max=float(scan.azimuth[-1]),
        angle_increment=float(scan.azimuth[-1] - scan.azimuth[0]) / max(count - 1, 1),
        time_increment=span / max(count - 1, 1),
        scan_time=period or span,
        range_min=least,
        range_max=greatest,
        ranges=np.where(np.isnan(ranges), np.float32(np.inf), ranges),
        intensities=np.nan_to_num(np.ascontiguousarray(scan.intensity[:, 0], dtype=np.float32)),
    )


def cloud_message(
    source: Source, t: int, frame: str, points: NDArray[Any], more: Mapping[str, NDArray[Any]]
) -> Any:
    """sensor_msgs/PointCloud2 of points (n, 3) and further columns (n,); what no scanner has is FLOAT32."""
    columns = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], **more}
    layout = [(name, kind) for name, kind in (*POINT_FIELDS, *BEAM_FIELDS) if name in columns]
    layout += [(name, "<f4") for name in columns if name not in dict(layout)]
    table = np.zeros(len(points), dtype=np.dtype(layout, align=True))
    described = []
    for name, kind in layout:
        table[name] = columns[name]
        offset = int(table.dtype.fields[name][1])  # type: ignore[index]
        described.append(
            source.make(
                "sensor_msgs/msg/PointField", name=name, offset=offset, datatype=ROS_KINDS[kind], count=1
            )
        )
    return source.make(
        "sensor_msgs/msg/PointCloud2",
        header=source.make.header(t, frame),
        height=1,
        width=len(table),
        fields=described,
        point_step=table.dtype.itemsize,
        row_step=table.nbytes,
        data=np.frombuffer(table.tobytes(), dtype=np.uint8),
        is_dense=True,
    )
