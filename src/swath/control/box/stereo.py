"""Box level `stereo`: rim and grain of the box of the machine beside, in the pictures of two cameras.

The rim is a rectangle of known size through the edges of the one picture, the grain lies where both pictures
show the same. Both cameras look down into the box, one beside the other along it, and take their pictures at
the same time. Size and height of the box are those of its data sheet: from the message of the other machine,
or set. What stands out of neither picture's noise is not seen: dusk, dense dust.

Heights beside each other err alike, so that they tell no slope: at a wall grain counts as high as where it is
seen next to it, never lower.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from swath.control.box.finder import BoxFinder, FinderParams, Size, sample
from swath.control.box.grain_profile import BoxLook
from swath.control.box.picture_edges import edges_of
from swath.control.box.picture_rim import on_plane, rim_in
from swath.control.box.plane_sweep import ALIKE, grain_points
from swath.control.box.view import View
from swath.core.component import Inputs, Port
from swath.core.errors import InputError
from swath.core.registry import Level
from swath.signals import F64, BoxSeen, Image, PeerState, box_unseen
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(FinderParams):
    """Those that every level has that looks for a rim; keep_s is longer, since pictures come seldom."""

    keep_s: Annotated[float, Ge(0), Le(10)] = 1.5


class StereoBox(BoxFinder):
    """Of two cameras: `image` shows the rim, `other` is compared with it."""

    inputs = (Port("image", Image), Port("other", Image), Port("peer", PeerState, optional=True))
    outputs = (Port("box", BoxSeen),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params)
        if not {"image", "other"} <= setup.mountings.keys():
            expected = "expected two cameras, such as {image: camera_left.image, other: camera_right.image}"
            raise InputError("wires", ", ".join(setup.mountings) or "none", expected)
        self._mountings = setup.mountings["image"], setup.mountings["other"]

    def taken(self, inputs: Inputs) -> int | None:
        """Of the newest pair of pictures with colours."""
        image: Image | None = inputs["image"]
        other: Image | None = inputs["other"]
        if image is None or other is None or image.t != other.t or not image.colour.size * other.colour.size:
            return None
        return image.t

    def look(self, t: int, inputs: Mapping[str, Any], size: Size) -> BoxSeen:
        """Rectangle through the edges of the one, height of the grain from both."""
        images = inputs["image"], inputs["other"]
        length, width, height = size
        views = (View.of(images[0], self._mountings[0]), View.of(images[1], self._mountings[1]))
        found = on_plane(edges_of(images[0].colour), views[0], height, self._p.reach_m)
        rim = rim_in(found, length, width, height)
        if rim is None or abs(rim.height - height) > self._p.band_m or not self.is_sure(rim):
            return box_unseen(t)
        greys = (grey(images[0]), grey(images[1]))
        points = grain_points(greys, views, rim, length, width)
        box = BoxLook(length, width, rim.height, rim.height_sd, steepest=0.0, alike=ALIKE)
        return sample(t, rim, points, box)


def grey(image: Image) -> F64:
    """Mean of the three colours (height, width)."""
    return np.asarray(image.colour.astype(np.float64).mean(axis=2))


LEVEL = Level(
    StereoBox,
    Params,
    summary="rectangle through the rim in a picture, height of the grain from the pictures of two cameras",
    cost="1.3 s of one core per pair of 612 x 512",
    tolerance="rim within 0.10 m and 1 deg, grain within 0.10 m, or not seen",
)
