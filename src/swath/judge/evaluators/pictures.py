"""What the pictures of a camera show: how far things stand out in them, and how they were exposed.

The contrast of a thing is its contrast-to-noise ratio: how far the mean of its pixels is from that of the
pixels around it, over the standard deviation of those. Around it is what neither shows a thing nor touches a
pixel that does, in a frame about its box that is as wide as the larger side of the box. It takes the channel
`instance`, which is the truth, and `raw` or else `colour`, of which it takes the mean of all three.
"""

from collections.abc import Mapping
from math import sqrt
from typing import Any

import numpy as np

from swath.core.blocks import samples_of
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Metric, mean
from swath.signals import Image, Signal

LEAST_PX = 4  # of a thing: fewer pixels show no more than a speck; estimated


class Pictures:
    """Looks at the pictures of all cameras of a machine."""

    SIGNALS = (Image,)
    METRICS = (
        Metric(
            "thing_contrast_true", "",
            f"largest contrast-to-noise ratio of a thing of {LEAST_PX} pixels or more, by its true mask: "
            "no detector runs", "Pictures", "higher", "contrast of things by true masks",
        ),
        Metric("exposure_mean_s", "s", "exposure time times gain of the pictures, mean", "Pictures"),
    )  # fmt: skip
    OF_FIELD = False

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._is_asked, self._contrast = False, float("nan")
        self._exposures: list[float] = []

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look at a picture."""
        for image in samples_of(outputs, Image):
            self._is_asked |= t > 0
            if image.exposure > 0.0:
                self._exposures.append(image.exposure * image.gain)
            light = image.raw if image.raw.size else image.colour
            if light.size and image.instance.size:
                found = [contrast(light.sum(axis=2, dtype=np.int64), image.instance, number)
                         for number in np.unique(image.instance[image.instance > 0])]  # fmt: skip
                self._contrast = float(np.fmax.reduce([self._contrast, *found]))

    def metrics(self) -> dict[str, float]:
        """None without a camera."""
        found = {"thing_contrast_true": self._contrast, "exposure_mean_s": mean(self._exposures)}
        return found if self._is_asked else {}


def contrast(light: Any, instance: Any, number: int) -> float:
    """Contrast-to-noise ratio of a thing. light: whole numbers (height, width); nan: none to be told."""
    own = instance == number
    if np.count_nonzero(own) < LEAST_PX:
        return float("nan")
    rows, columns = np.nonzero(own.any(axis=1))[0], np.nonzero(own.any(axis=0))[0]
    wide = max(np.ptp(rows), np.ptp(columns)) + 1
    frame = tuple(slice(max(at[0] - wide, 0), at[-1] + wide + 1) for at in (rows, columns))
    beside = np.pad(instance[frame] > 0, 1)  # a pixel that touches one of a thing shows it in part
    beside = beside[:-2] | beside[1:-1] | beside[2:]
    around = light[frame][~(beside[:, :-2] | beside[:, 1:-1] | beside[:, 2:])]
    count, total, squares = len(around), int(around.sum()), int((around * around).sum())  # exact
    varies = count * squares - total * total
    if varies <= 0:
        return float("nan")
    return abs(float(light[own].mean()) - total / count) / (sqrt(varies) / count)


LEVEL = Level(Pictures, None, summary="contrast of things in pictures, and their exposure")
