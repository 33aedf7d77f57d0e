"""An image as ROS 2 messages: sensor_msgs/Image of each channel, and the sensor_msgs/CameraInfo to them.

Nothing is rounded or renamed: the arrays come back bit for bit, so there are no exact samples beside them.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.record.messages import Sent, Source
from swath.signals import Image


def image_messages(source: Source, image: Image) -> Iterator[Sent]:
    """Every channel the image has, then its CameraInfo; in the optical frame (REP 103)."""
    depth, label = ("_depth", "32FC1", image.depth), ("_label", "mono8", image.label)
    for suffix, encoding, pixels in (("", "rgb8", image.colour), depth, label):
        if pixels.size:
            yield Sent(source.topic + suffix, _picture(source, image.t, encoding, pixels))
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


def _camera_info(source: Source, image: Image) -> Any:
    """Of a rectified camera without distortion: P is K beside a column of zeros."""
    k = np.array([[image.focal, 0.0, image.centre_x], [0.0, image.focal, image.centre_y], [0.0, 0.0, 1.0]])
    return source.make(
        "sensor_msgs/msg/CameraInfo",
        header=source.make.header(image.t, source.frame_of(Image)),
        height=image.height,
        width=image.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([k, np.zeros(3)]).ravel(),
    )
