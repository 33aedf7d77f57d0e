"""Pictures of a camera, where things are in them, and how much of each pixel they fill."""

from collections.abc import Sequence
from math import nan
from typing import Annotated, Any, Protocol

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal, TrackColumn
from swath.signals.arrays import F32, F64, U8, U16
from swath.signals.obstacles import KIND
from swath.signals.ranges import (
    CODE8,
    CODE16,
    COEFFICIENT,
    EXPOSURE,
    GAIN,
    KELVIN,
    PIXEL,
    PIXELS,
    SHARE,
    SIGHT,
)

_IMAGE = (
    Message("sensor_msgs/Image", "colour, rgb8"),
    Message("sensor_msgs/CompressedImage", "colour, jpeg", "/machine/slot/output/compressed"),
    Message("sensor_msgs/Image", "depth, 32FC1 [m]", "/machine/slot/output_depth"),
    Message("sensor_msgs/Image", "label, mono8", "/machine/slot/output_label"),
    Message("sensor_msgs/Image", "instance, mono16", "/machine/slot/output_instance"),
    Message("sensor_msgs/Image", "raw, mono16 or rgb16", "/machine/slot/output_raw"),
    Message("sensor_msgs/CameraInfo", "", "/machine/slot/camera_info"),
)
_SEEN = "figure `Pictures` of the report"
_N = ("box_count",)
_NO_HEAT = "colour is light"
_COUNT = (TrackColumn("box_count", "-", "things in the picture", lambda x: float(len(x))),)


@frozen
class Image(Signal, about=About("optical", _IMAGE, samples="messages", seen_as=_SEEN)):
    """One picture of a camera. A channel that was not asked for has no pixels.

    Optical frame: x right, y down, z forward; the middle of the upper left pixel is (0, 0). t: when the
    exposure of the last row ends.
    """

    width: Annotated[int, Quantity("", "of the image [px]", span=CODE16)]
    height: Annotated[int, Quantity("", "of the image [px]", span=CODE16)]
    focal: Annotated[float, Quantity("", "focal length [px]", span=PIXELS)]
    centre_x: Annotated[float, Quantity("", "principal point [px]", span=PIXEL)]
    centre_y: Annotated[float, Quantity("", "principal point [px]", span=PIXEL)]
    depth: Annotated[
        F32, Quantity("m", "along the optical axis", ("height", "width"), "nothing within reach", span=SIGHT)
    ]
    colour: Annotated[U8, Quantity("", "sRGB", ("height", "width", 3), span=CODE8)]
    label: Annotated[
        U8, Quantity("", "`field.layout.Organ` that was hit, 0 = none", ("height", "width"), span=CODE8)
    ]
    instance: Annotated[
        U16, Quantity("", "thing that was hit, from 1 on, 0 = none", ("height", "width"), span=CODE16)
    ]
    raw: Annotated[
        U16, Quantity("", "digital numbers of the image sensor", ("height", "width", "channels"), span=CODE16)
    ]
    distortion: Annotated[
        F64,
        Quantity(
            "",
            "of the lens: none, 5 or 8 of Brown-Conrady, 4 of a fisheye",
            ("coefficients",),
            span=COEFFICIENT,
        ),
    ]
    exposure: Annotated[float, Quantity("s", "exposure time, 0 = no light was counted", span=EXPOSURE)] = 0.0
    gain: Annotated[float, Quantity("", "of the image sensor over its least one", span=GAIN)] = 1.0
    black: Annotated[
        float, Quantity("K", "apparent temperature that is black in colour", nan=_NO_HEAT, span=KELVIN)
    ] = nan
    white: Annotated[
        float, Quantity("K", "apparent temperature that is white in colour", nan=_NO_HEAT, span=KELVIN)
    ] = nan


@frozen
class ImageBoxes(Signal, about=About("optical", seen_as=_SEEN)):
    """Boxes around the things of a picture [px]: the truth of what is seen of them, hidden parts left out.

    Outer edges of the outermost pixels of which a sample shows it: a thing of one pixel (3, 4) spans 2.5 to
    3.5 and 3.5 to 4.5. Kinds by number, as in `OBSTACLE_KINDS`.
    """

    instance: Annotated[
        F64, Quantity("", "its number in the channel `instance`", _N, columns=_COUNT, span=CODE16)
    ]
    kind: Annotated[U8, Quantity("", "what it is", _N, span=KIND)]
    left: Annotated[F64, Quantity("", "edge of its box [px]", _N, span=PIXEL)]
    top: Annotated[F64, Quantity("", "edge of its box [px]", _N, span=PIXEL)]
    right: Annotated[F64, Quantity("", "edge of its box [px]", _N, span=PIXEL)]
    bottom: Annotated[F64, Quantity("", "edge of its box [px]", _N, span=PIXEL)]
    area: Annotated[F64, Quantity("", "pixels that show it, in parts", _N, span=PIXELS)]
    distance: Annotated[F64, Quantity("m", "of its nearest sample, along the optical axis", _N, span=SIGHT)]


@frozen
class ImageShares(
    Signal, about=About("optical", samples="full", seen_as="file `scan.camera.npz` of `swath scan`")
):
    """What share of the light of each pixel comes from each thing of a picture: the truth, as soft masks.

    Of the samples that the picture is made of, and through the same lens: over all pixels the shares of a
    thing add up to its `area`, but for what the lens takes across the border. The channel `instance` follows
    from the samples by a vote: of a pixel it is what most of them show, of equals the nearest.
    """

    width: Annotated[int, Quantity("", "of the image [px]", span=CODE16)]
    height: Annotated[int, Quantity("", "of the image [px]", span=CODE16)]
    instance: Annotated[F64, Quantity("", "its number in the channel `instance`", ("things",), span=CODE16)]
    share: Annotated[F32, Quantity("1", "of the light of a pixel", ("height", "width", "things"), span=SHARE)]


class Intrinsics(Protocol):
    """What an image says of its camera's geometry."""

    @property
    def width(self) -> int:
        """Width of the image [px]."""

    @property
    def height(self) -> int:
        """Height of the image [px]."""

    @property
    def focal(self) -> float:
        """Focal length [px]."""

    @property
    def centre_x(self) -> float:
        """Optical centre from the left edge [px]."""

    @property
    def centre_y(self) -> float:
        """Optical centre from the upper edge [px]."""

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients of the distortion."""


def empty_image(
    t: int,
    camera: Intrinsics,
    channels: Sequence[str],
    *,
    exposure: float = 0.0,
    gain: float = 1.0,
    black: float = nan,
    white: float = nan,
    **filled: Any,
) -> Image:
    """An image with the channels in `filled`; those in `channels` are black and show nothing; read-only."""
    size = (camera.height, camera.width)
    made: dict[str, Any] = {
        "depth": np.full(size, np.nan, np.float32) if "depth" in channels else np.zeros((0, 0), np.float32),
        "colour": np.zeros((*size, 3) if "colour" in channels else (0, 0, 3), np.uint8),
        "label": np.zeros(size if "label" in channels else (0, 0), np.uint8),
        "instance": np.zeros(size if "instance" in channels else (0, 0), np.uint16),
        "raw": np.zeros((*size, 1) if "raw" in channels else (0, 0, 1), np.uint16),
        **filled,
        "distortion": np.array(camera.coefficients, dtype=np.float64),
    }
    for array in made.values():
        array.setflags(write=False)
    geometry = camera.width, camera.height, camera.focal, camera.centre_x, camera.centre_y
    return Image(t, *geometry, **made, exposure=exposure, gain=gain, black=black, white=white)
