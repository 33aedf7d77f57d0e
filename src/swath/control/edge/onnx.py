"""Edge level `onnx`: a network of the user's from scans or pictures to the edge.

    edge:
      level: onnx
      file: my_edge.onnx
      inputs: {ranges: {field: scan.ranges, mean: 8, sd: 4}}
      outputs:
        offset: {tensor: line, index: 0}
        offset_sd: {tensor: line, index: 1, law: exp}
        heading: 0
        reference_x: 9

It answers to every new scan or picture; until the next one its answer is held, as it was. Nothing is
smoothed.
"""

from dataclasses import dataclass
from math import erf, isfinite, sqrt
from typing import Annotated

from annotated_types import Gt, Le

from swath.control.edge.profile import TOLERANCE
from swath.control.network import PORTS, Into, Network, Told
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import CropEdge
from swath.signals.setup import ControlSetup

NAN = float("nan")
USUAL = {
    "curvature": 0.0,
    "confidence": NAN,
    "crop_height": NAN,
    "stubble_height": NAN,
    "offset_sd": NAN,
    "heading_sd": NAN,
    "seen_to": NAN,
}
NEEDED = "offset", "heading", "reference_x"


@dataclass(frozen=True)
class Params:
    """A network that finds the edge.

    file: the network, ONNX
    inputs: input of the network -> what it is given
    outputs: field of a CropEdge, in SI -> what tells it, or a number; offset, heading, reference_x, and
        confidence or offset_sd are needed
    keep_s: time after the last scan or picture for which its answer is held
    """

    file: str
    inputs: dict[str, Into]
    outputs: Told
    keep_s: Annotated[float, Gt(0), Le(10)] = 0.5

    @property
    def foreign_code(self) -> tuple[str, ...]:
        """The network: what it makes the processor do is not checked."""
        return (self.file,)


class OnnxEdge(KeepsState):
    """Samples as the network's inputs say, crop edge out."""

    kept = ("_network", "_told", "_at")
    inputs: tuple[Port, ...] = tuple(PORTS.values())
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        known = (*NEEDED, *USUAL)
        for name in params.outputs:
            if name not in known:
                raise InputError(f"outputs.{name}", None, f"expected some of {', '.join(known)}")
        missing = [name for name in NEEDED if name not in params.outputs]
        if missing or not {"confidence", "offset_sd"} & params.outputs.keys():
            missing += ["confidence or offset_sd"] * (not {"confidence", "offset_sd"} & params.outputs.keys())
            raise InputError("outputs", ", ".join(params.outputs) or "none", f"expected also {missing[0]}")
        self._network = Network(params.file, params.inputs, params.outputs, setup.mountings)
        self.inputs, self._keep = self._network.ports, params.keep_s
        self._told: dict[str, float] | None = None
        self._at = 0

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._network.forget()
        self._told, self._at = None, 0
        return {"edge": self._edge(0, is_held=False)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The network's answer to what is new, else that of before."""
        is_new = self._network.take(inputs)
        if is_new:
            self._told, self._at = {}, t + dt
            for name, values in self._network.answer().items():
                if len(values) != 1:
                    expected = f"expected one number, the network gives {len(values)}: index?"
                    raise InputError(f"outputs.{name}", None, expected)
                self._told[name] = float(values[0])
        return {"edge": self._edge(t + dt, is_held=not is_new)}

    def _edge(self, t: int, *, is_held: bool) -> CropEdge:
        told = self._told
        if told is None or not isfinite(told["offset"]) or (t - self._at) / NS > self._keep:
            reference = 0.0 if told is None else told["reference_x"]
            return CropEdge(t, NAN, NAN, 0.0, reference, 0.0, NAN, NAN)
        numbers = {**USUAL, **told}
        if not isfinite(numbers["confidence"]):
            sd = numbers["offset_sd"]
            numbers["confidence"] = erf(TOLERANCE / (sd * sqrt(2.0))) if sd > 0.0 else 0.0
        return CropEdge(t, **numbers, is_held=is_held)


LEVEL = Level(
    OnnxEdge,
    Params,
    summary="a network of yours (ONNX) from scans or pictures",
    cost="that of the network, on one thread",
    tolerance="that of the network: see docs/tutorials/my-network.md",
)
