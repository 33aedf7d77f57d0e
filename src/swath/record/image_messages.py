"""An image as ROS 2 messages: sensor_msgs/Image of each channel, and the sensor_msgs/CameraInfo to them.

Nothing is rounded or renamed: the arrays come back bit for bit, so there are no exact samples beside them.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.record.mcap_file import McapFile
from swath.signals import Image

ENCODINGS = {"colour": "rgb8", "depth": "32FC1", "label": "mono8"}
SUFFIXES = {"colour": "", "depth": "_depth", "label": "_label"}  # after the topic of the output


def picture_messages(file: McapFile, topic: str, image: Image, frame: str) -> Iterator[tuple[str, Any]]:
    """(topic, message) of every channel the image has, then its CameraInfo beside them.

    frame: the optical one, x right, y down, z forward (REP 103)
    """
    for channel, encoding in ENCODINGS.items():
        pixels = getattr(image, channel)
        if pixels.size:
            yield topic + SUFFIXES[channel], _picture(file, image.t, frame, encoding, pixels)
    yield f"{topic.rpartition('/')[0]}/camera_info", _camera_info(file, image, frame)


def _picture(file: McapFile, t: int, frame: str, encoding: str, pixels: NDArray[Any]) -> Any:
    little = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder("<"))
    return file.make(
        "sensor_msgs/msg/Image",
        header=file.header(t, frame),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=little.nbytes // pixels.shape[0],
        data=np.frombuffer(little.tobytes(), dtype=np.uint8),
    )


def _camera_info(file: McapFile, image: Image, frame: str) -> Any:
    """Of a rectified camera without distortion: P is K beside a column of zeros."""
    k = np.array([[image.focal, 0.0, image.centre_x], [0.0, image.focal, image.centre_y], [0.0, 0.0, 1.0]])
    whole = file.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return file.make(
        "sensor_msgs/msg/CameraInfo",
        header=file.header(image.t, frame),
        height=image.height,
        width=image.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([k, np.zeros(3)]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=whole,
    )
