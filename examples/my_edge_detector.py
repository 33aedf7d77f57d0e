"""A crop-edge detector of your own, in one file: copy it, change it, name it in a scenario.

    machines:
      combine:
        edge: {level: examples/my_edge_detector.py:MyEdgeDetector, threshold_m: 0.45}

A scan goes in, the edge comes out, in the machine frame: x forward, y left, z up from the ground, origin
under the middle of the fixed axle. This one takes every echo above a fixed height for crop. It is simple on
purpose: every scan stands alone but for some smoothing, and a machine that rolls by 2 degrees moves its edge.
The built-in `likelihood_ratio` does better; yours may do better still.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry, Scan
from swath.signals.setup import ControlSetup


class MyEdgeDetector:
    """A fixed height threshold, scan by scan."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)), Port("odometry", Odometry))
    outputs = (Port("edge", CropEdge),)

    @dataclass(frozen=True)
    class Params:
        """Keys of the scenario file: the height above which an echo is crop; smoothing over time."""

        threshold_m: Annotated[float, Gt(0), Le(3)] = 0.45
        smoothing: Annotated[float, Gt(0), Le(1)] = 0.2

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self.params, self.mounting = params, setup.mounting
        self.crop_left = setup.edge_side == "right"  # the crop lies on the machine's side of the edge
        self.offset = np.nan

    def reset(self, stream: Stream) -> Outputs:
        self.offset = np.nan
        return {"edge": self.edge(0, 8.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        scan = inputs["scan"]
        x, y, z = self.mounting.apply(scan.points()[:, 0]).T
        is_crop = z > self.params.threshold_m  # nan (no echo) is neither
        is_low = z <= self.params.threshold_m
        if is_crop.sum() < 5 or is_low.sum() < 5:
            self.offset = np.nan
            return {"edge": self.edge(t + dt, 8.0)}
        places = np.sort(y[is_crop | is_low])
        places = 0.5 * (places[1:] + places[:-1])
        left, right = (is_crop, is_low) if self.crop_left else (is_low, is_crop)
        wrong = (y[left, None] < places).sum(axis=0) + (y[right, None] > places).sum(axis=0)
        new = float(places[np.argmin(wrong)])
        self.offset = (
            new if np.isnan(self.offset) else self.offset + self.params.smoothing * (new - self.offset)
        )
        return {"edge": self.edge(t + dt, float(np.median(x[is_crop | is_low])))}

    def edge(self, t: int, reference_x: float) -> CropEdge:
        found = bool(np.isfinite(self.offset))
        heading = 0.0 if found else np.nan
        return CropEdge(t, self.offset, heading, 0.0, reference_x, 0.5 if found else 0.0, np.nan, np.nan)

    def save(self) -> State:
        return {"offset": self.offset}

    def load(self, state: State) -> None:
        self.offset = state["offset"]
