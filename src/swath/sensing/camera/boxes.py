"""Boxes around the things in a picture, of the pixels that show them."""

import numpy as np
from numpy.typing import NDArray

from swath.sensing.camera.instances import Instances
from swath.signals import OBSTACLE_KINDS
from swath.signals.image import ImageBoxes


def boxes_of(
    t: int, instance: NDArray[np.uint16], depth: NDArray[np.float32], things: Instances
) -> ImageBoxes:
    """Of every thing that at least one pixel (height, width) shows."""
    v, u = np.nonzero(instance)
    if len(v) == 0:
        return no_boxes(t)
    number = instance[v, u].astype(np.int64)
    size = len(things.names) + 1
    low, high = (np.full((2, size), end) for end in (np.inf, -np.inf))
    near = np.full(size, np.inf)
    for axis, at in enumerate((u, v)):
        np.minimum.at(low[axis], number, at)
        np.maximum.at(high[axis], number, at)
    np.minimum.at(near, number, depth[v, u])
    area = np.bincount(number, minlength=size)
    seen = np.flatnonzero(area)
    kind = [OBSTACLE_KINDS.index(things.kinds[k - 1]) for k in seen.tolist()]
    edges = low[0, seen] - 0.5, low[1, seen] - 0.5, high[0, seen] + 0.5, high[1, seen] + 0.5
    columns = (seen.astype(np.float64), np.array(kind, np.uint8), *edges, area[seen].astype(np.float64))
    return ImageBoxes(t, *columns, near[seen])


def no_boxes(t: int) -> ImageBoxes:
    """Of a picture without things."""
    nothing = np.zeros(0)
    return ImageBoxes(t, nothing, np.zeros(0, np.uint8), *[nothing] * 6)
