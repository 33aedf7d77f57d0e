"""Texture: soil and straw are not of one colour, nor are plants.

The colour of what is seen is multiplied by noise that hangs on the place in the world alone, so that it stays
there while the camera moves: clods of 2.5 cm to 3 m on soil, stalks of 15 x 0.7 cm across each other on
straw, kernels, chaff and ripples of 8 mm to 0.3 m on grain in a box (there the place is that in the box),
plants a little different from each other and from patch to patch. What is finer than a pixel is left out, as
the mean of many would. Sizes and strengths are our own choice, by eye: nothing was measured.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.device import ThreadPool, start_warp
from swath.signals import F64

GRAIN = 64  # what a point is made of, beside the organs: grain in an open box
CHUNK_MIN = 4096  # fewer points than this are not worth another thread


def brightness(
    points: F64, organ: NDArray[np.uint8], pixel: NDArray[np.float32], seed: int, pool: ThreadPool
) -> NDArray[np.float32]:
    """Factor on the colour at points (n, 3) of the world with organs (n,), or GRAIN.

    pixel: its size there [m]
    """
    wp = start_warp()
    from swath.sensing.camera.texture_kernel import brightness as kernel

    wp.load_module(kernel.module, device="cpu")  # once, before threads would each do it
    factor = np.empty(len(points), np.float32)
    arrays = [
        _shared(wp, np.ascontiguousarray(a), kind)
        for a, kind in ((points, wp.vec3d), (organ, wp.uint8), (pixel, wp.float32), (factor, wp.float32))
    ]

    def run(first: int, count: int) -> None:
        inputs = [*arrays[:3], wp.uint32(seed & 0x7FFFFFFF), first, arrays[3]]
        wp.launch(kernel, dim=count, inputs=inputs, device="cpu")

    pool.split(len(points), CHUNK_MIN, run)
    return factor


def _shared(wp: Any, array: NDArray[Any], kind: Any) -> Any:
    return wp.array(array, dtype=kind, device="cpu", copy=False)
