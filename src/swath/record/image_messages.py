"""An image as ROS 2 messages: sensor_msgs/Image of each channel, and the sensor_msgs/CameraInfo to them.

Nothing is rounded or renamed: the arrays come back bit for bit, so there are no exact samples beside them.
The colours are there a second time as JPEG, as drivers of cameras send them (topic of image_transport).
"""

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.record.messages import Sent, Source
from swath.signals import Image

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


def _jpeg(source: Source, image: Image) -> Any:
    from PIL import Image as Picture

    held = io.BytesIO()
    Picture.fromarray(image.colour).save(held, format="JPEG", quality=JPEG_QUALITY)
    return source.make(
        "sensor_msgs/msg/CompressedImage",
        header=source.make.header(image.t, source.frame_of(Image)),
        format="rgb8; jpeg compressed rgb8",
        data=np.frombuffer(held.getvalue(), dtype=np.uint8),
    )


def _camera_info(source: Source, image: Image) -> Any:
    """With the lens's distortion in D; P is K beside a column of zeros: it holds after undistortion."""
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
