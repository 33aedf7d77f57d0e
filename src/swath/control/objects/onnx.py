"""Objects level `onnx`: a network of the user's from scans or pictures to things, which are followed.

    objects:
      level: onnx
      file: my_people.onnx
      inputs: {points: {field: scan.points}}
      outputs: {x: {tensor: boxes, index: 0}, y: {tensor: boxes, index: 1}, confidence: {tensor: scores}}

A row of the network's tensors is a thing, in the machine's frame on the ground: no network's pixels are
taken to the ground here. Those that are not sure enough, beside the strip or behind the knife do not count.
"""

from dataclasses import dataclass
from math import log
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from swath.control.network import PORTS, SEEN, Into, Network, Told
from swath.control.objects.following import FREE, Following, on_ground
from swath.control.objects.track import Heap
from swath.core.component import Inputs, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import Objects, Odometry
from swath.signals.setup import ControlSetup

NEEDED, SIZES = ("x", "y", "confidence"), {"length": 0.5, "width": 0.5, "top": float("nan")}
FIELDS = "x", "y", "length", "width", "top", "confidence"
SURE = 1e-9  # a network is never surer than so far from 0 and 1


@dataclass(frozen=True)
class Params:
    """A network that finds things.

    file: the network, ONNX
    inputs: input of the network -> what it is given
    outputs: field of Objects, in SI -> what tells it, a number for each thing, or one number for all; x, y
        and confidence are needed, length, width and top may be told
    least_confidence: of a thing that counts
    side_m: farthest thing beside the ends of the header
    confirm: answers that must show a thing before it is reported
    keep_s: time for which a thing is kept without being seen
    """

    file: str
    inputs: dict[str, Into]
    outputs: Told
    least_confidence: Annotated[float, Gt(0), Lt(1)] = 0.5
    side_m: Annotated[float, Ge(0), Le(50)] = 8.0
    confirm: Annotated[int, Ge(1), Le(20)] = 2
    keep_s: Annotated[float, Ge(0), Le(10)] = 1.0

    @property
    def foreign_code(self) -> tuple[str, ...]:
        """The network: what it makes the processor do is not checked."""
        return (self.file,)


class OnnxObjects(Following):
    """Samples as the network's inputs say, things out."""

    kept = (*Following.kept, "_network")
    inputs: tuple[Port, ...] = tuple(PORTS.values())
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        for name in params.outputs:
            if name not in (*NEEDED, *SIZES):
                raise InputError(f"outputs.{name}", None, f"expected some of {', '.join((*NEEDED, *SIZES))}")
        if missing := [name for name in NEEDED if name not in params.outputs]:
            raise InputError("outputs", ", ".join(params.outputs) or "none", f"expected also {missing[0]}")
        self._network, self._p = Network(params.file, params.inputs, params.outputs, setup.mountings), params
        ports = self._network.ports
        seen = next((port.name for port in ports if port.name.partition("_")[0] in SEEN), None)
        if seen is None:
            raise InputError("inputs", ", ".join(params.inputs), "expected a field of a scan or an image")
        super().__init__(setup, seen, params.side_m, params.confirm, params.keep_s)
        held = [port for port in ports if port.name != "odometry"]
        self.inputs = (*held, Port("odometry", Odometry, optional=True))

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._network.forget()
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The things at t + dt."""
        now = t + dt
        self._go(inputs["odometry"], dt / NS)
        if self._network.take(inputs):
            self._tracks.update(now / NS, self._heaps(), lambda track: False)
        return {"objects": self._sample(now)}

    def _heaps(self) -> list[Heap]:
        """What the network is sure enough of, over the ground."""
        answer = {**{name: np.array([size]) for name, size in SIZES.items()}, **self._network.answer()}
        counts = {name: len(values) for name, values in answer.items() if len(values) != 1}
        if len(set(counts.values())) > 1:
            said = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError("outputs", said, "expected as many numbers of each field: index?")
        columns = np.broadcast_arrays(*(answer[name] for name in FIELDS))
        heaps = []
        for x, y, length, width, top, sure in np.column_stack(columns).tolist():
            is_ahead = x - self._knife > FREE and self._strip[0] < y < self._strip[1]
            if is_ahead and sure >= self._p.least_confidence:
                sure = min(max(sure, SURE), 1.0 - SURE)
                heaps.append(Heap(*on_ground(x, y, self._pose), length, width, top, log(sure / (1.0 - sure))))
        return heaps


LEVEL = Level(
    OnnxObjects,
    Params,
    summary="a network of yours (ONNX) from scans or pictures, what it finds is followed",
    cost="that of the network, on one thread",
    tolerance="that of the network",
)
