"""Fixed height threshold: what is higher is crop, what is lower stubble.

The plainest rule, and the one that Zhao et al. 2016 (IJABE 9(2):21) replace by a threshold of every profile's
own (`otsu`): it needs a driver who sets it between stubble and crop. Heights count from the machine's ground.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.edge.detector import EdgeDetector, EdgeParams
from swath.control.edge.otsu import split_at
from swath.core.registry import Level
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class ThresholdParams(EdgeParams):
    """threshold_m: height above the machine's ground plane that parts stubble and crop

    Those of the chain: see `max_likelihood`.
    """

    threshold_m: Annotated[float, Gt(0), Le(4)] = 0.4


class Threshold(EdgeDetector):
    """The same threshold for every scan, robust parabola over several scans."""

    def __init__(self, params: ThresholdParams, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        self.split = partial(split_at, params.threshold_m)


LEVEL = Level(
    Threshold,
    ThresholdParams,
    summary="step at a fixed height, tracked over several scans",
    cost="under 1 ms per scan",
    tolerance="offset within 0.05 m RMS of the true edge at 500 stems/m2, with stubble below the threshold",
)
