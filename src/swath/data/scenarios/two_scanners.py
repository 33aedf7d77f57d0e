"""A crop-edge detector that joins two scanners, one at each end of the header.

    lidar_left: {level: plants, mount: {at: left_end}}
    lidar_right: {level: plants, mount: {at: right_end, z_m: 3.0, pitch_deg: 14, yaw_deg: -30}}
    edge: {level: two_scanners.py:TwoScanners, wires: {left: lidar_left.scan, right: lidar_right.scan}}

Each scan goes through a built-in detector of its own, which is told where its scanner sits. Where both report
an edge, the offsets are averaged by confidence over squared distance, as beams spread with distance; where
they contradict each other, the one with more weight counts, at half its confidence.
"""

from dataclasses import dataclass, replace
from math import hypot, isfinite, tan
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.edge.detector import EdgeParams
from swath.control.edge.max_likelihood import MaxLikelihood
from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry, Scan
from swath.signals.setup import ControlSetup

SIDES = ("left", "right")


class TwoScanners:
    """Scans of two scanners and odometry in, one crop edge out."""

    inputs = (
        Port("left", Scan, unit="m", shape=(None,)),
        Port("right", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
    )
    outputs = (Port("edge", CropEdge),)

    @dataclass(frozen=True)
    class Params:
        """agree_m: offsets further apart than this contradict each other."""

        agree_m: Annotated[float, Gt(0), Le(2)] = 0.3

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self.params = params
        self.places = {side: setup.mountings[side].position for side in SIDES}
        self.detectors = {side: self._detector(setup, side) for side in SIDES}

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0."""
        edges = [self.detectors[side].reset(stream)["edge"] for side in SIDES]
        return {"edge": edges[0]}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The joined edge, valid at t + dt."""
        edges = {}
        for side in SIDES:
            own = {"scan": inputs[side], "odometry": inputs["odometry"]}
            edge = self.detectors[side].step(t, dt, own)["edge"]
            assert isinstance(edge, CropEdge)
            edges[side] = edge
        return {"edge": self._joined(edges["left"], edges["right"])}

    def _weight(self, side: str, edge: CropEdge) -> float:
        x, y, z = self.places[side]
        distance = hypot(edge.reference_x - float(x), edge.offset - float(y), float(z))
        return edge.confidence / distance**2

    def save(self) -> State:
        """What both detectors remember."""
        return {side: detector.save() for side, detector in self.detectors.items()}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        for side, detector in self.detectors.items():
            detector.load(state[side])

    def _detector(self, setup: ControlSetup, side: str) -> MaxLikelihood:
        return MaxLikelihood(EdgeParams(), replace(setup, mountings={"scan": setup.mountings[side]}))

    def _joined(self, a: CropEdge, b: CropEdge) -> CropEdge:
        if not (a.is_found and b.is_found):
            return b if b.is_found else a
        weighted = zip((self._weight("left", a), self._weight("right", b)), (a, b), strict=True)
        (low, other), (high, main) = sorted(weighted, key=lambda pair: pair[0])
        ahead = main.reference_x - other.reference_x  # both offsets at the place of the weightier one
        offset = other.offset + ahead * (tan(other.heading) if isfinite(other.heading) else 0.0)
        if abs(offset - main.offset) > self.params.agree_m:
            return replace(main, confidence=0.5 * main.confidence)
        return replace(main, offset=main.offset + low / (low + high) * (offset - main.offset))
