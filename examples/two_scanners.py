"""A crop-edge detector of one's own that joins two scanners, one at each end of the header.

    lidar_left: {level: plants, mount: {at: left_end}}
    lidar_right: {level: plants, mount: {at: right_end, z_m: 3.0, pitch_deg: 14, yaw_deg: -30}}
    edge: {level: two_scanners.py:TwoScanners, wires: {left: lidar_left.scan, right: lidar_right.scan}}

Each scan goes through a built-in detector of its own, which is told where its scanner sits. Where both report
an edge, the offsets are averaged by their variances; where they lie further apart than that explains, the
deviation told is the difference and the edge is not sure. Both see the same tops: what leans over the edge
misleads both alike, and stays in the deviation that they tell. Level `joined` also asks which way stems lean.
"""

from dataclasses import dataclass, replace
from math import hypot
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.edge.likelihood_ratio import LikelihoodRatio
from swath.control.edge.likelihood_ratio import Params as ScannerParams
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry, Scan
from swath.signals.setup import ControlSetup

SIDES = ("left", "right")


class TwoScanners(KeepsState):
    """Scans of two scanners and odometry in, one crop edge out."""

    kept = ("detectors",)
    inputs = (
        Port("left", Scan, unit="m", shape=(None,)),
        Port("right", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
    )
    outputs = (Port("edge", CropEdge),)

    @dataclass(frozen=True)
    class Params:
        """agree: offsets further apart than so many standard deviations contradict each other."""

        agree: Annotated[float, Gt(0), Le(10)] = 2.5

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self.params = params
        own = {side: replace(setup, mountings={"scan": setup.mountings[side]}) for side in SIDES}
        self.detectors = {side: LikelihoodRatio(ScannerParams(), own[side]) for side in SIDES}

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0."""
        edges = [self.detectors[side].reset(stream)["edge"] for side in SIDES]
        return {"edge": edges[0]}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The joined edge, valid at t + dt."""
        edges = []
        for side in SIDES:
            own = {"scan": inputs[side], "odometry": inputs["odometry"]}
            edge = self.detectors[side].step(t, dt, own)["edge"]
            assert isinstance(edge, CropEdge)
            edges.append(edge)
        return {"edge": self._joined(*edges)}

    def _joined(self, a: CropEdge, b: CropEdge) -> CropEdge:
        if not (a.is_found and b.is_found):
            return b if b.is_found else a
        better, other = sorted((a, b), key=lambda edge: edge.offset_sd)
        apart = other.offset - better.offset
        if abs(apart) > self.params.agree * hypot(a.offset_sd, b.offset_sd):
            sure = min(0.3, better.confidence)
            return replace(better, confidence=sure, offset_sd=hypot(better.offset_sd, apart))
        share = better.offset_sd**2 / (better.offset_sd**2 + other.offset_sd**2)
        return replace(better, offset=better.offset + share * apart)
