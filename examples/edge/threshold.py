"""Fixed height threshold: what is higher is crop, what is lower stubble.

    edge: {level: examples/edge/threshold.py:Threshold, threshold_m: 0.4}

The plainest rule, and the one that Zhao et al. 2016 (IJABE 9(2):21) replace by a threshold of every profile's
own (`otsu`): it needs a driver who sets it between stubble and crop. Heights count from the machine's ground.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.edge.detector import EdgeDetector, EdgeParams
from swath.control.edge.otsu import split_at
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class ThresholdParams(EdgeParams):
    """threshold_m: height above the machine's ground plane that parts stubble and crop

    Those of the chain: see `max_likelihood`.
    """

    threshold_m: Annotated[float, Gt(0), Le(4)] = 0.4


class Threshold(EdgeDetector):
    """Step at a fixed height, robust parabola over several scans."""

    Params = ThresholdParams

    def __init__(self, params: ThresholdParams, setup: ControlSetup) -> None:
        super().__init__(params, setup)
        self.split = partial(split_at, params.threshold_m)
