"""Pictures of a camera."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal
from swath.signals.arrays import F32, U8

_IMAGE = (
    Message("sensor_msgs/Image", "colour, rgb8"),
    Message("sensor_msgs/Image", "depth, 32FC1 [m]", "/machine/slot/output_depth"),
    Message("sensor_msgs/Image", "label, mono8", "/machine/slot/output_label"),
    Message("sensor_msgs/CameraInfo", "", "/machine/slot/camera_info"),
)


@frozen
class Image(Signal, about=About("optical", _IMAGE, samples="messages")):
    """One picture of a camera, all pixels at the time t. A channel that was not asked for has no pixels.

    Optical frame: x right, y down, z forward; the middle of the upper left pixel is (0, 0).
    """

    width: Annotated[int, Quantity("", "of the image [px]")]
    height: Annotated[int, Quantity("", "of the image [px]")]
    focal: Annotated[float, Quantity("", "focal length [px]")]
    centre_x: Annotated[float, Quantity("", "principal point [px]")]
    centre_y: Annotated[float, Quantity("", "principal point [px]")]
    depth: Annotated[
        F32, Quantity("m", "along the optical axis", ("height", "width"), "nothing within reach")
    ]
    colour: Annotated[U8, Quantity("", "sRGB", ("height", "width", 3))]
    label: Annotated[U8, Quantity("", "`field.layout.Organ` that was hit, 0 = none", ("height", "width"))]
