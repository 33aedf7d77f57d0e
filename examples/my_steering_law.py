"""A steering law of your own, in one file: copy it, change it, name it in a scenario.

    machines:
      combine:
        steer: {level: examples/my_steering_law.py:MySteeringLaw, preview_m: 8}

The detected edge and the odometry go in, the wanted path curvature comes out. This one is pure pursuit: the
machine drives the circle through a point of the edge line `preview_m` ahead of the fixed axle,
kappa = 2 y / (x^2 + y^2), with y how far the header end is from where it should be there. The built-in
`preview` knows the delays of the steering and the side slip; this one does not. `swath levels steer` lists
what a law may see and what it must give; `docs/reference/nomenclature.md` has frames and signs.
"""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry, SteerCommand
from swath.signals.setup import ControlSetup


class MySteeringLaw:
    """Pure pursuit of the crop edge."""

    inputs = (Port("edge", CropEdge), Port("odometry", Odometry))
    outputs = (Port("command", SteerCommand),)

    @dataclass(frozen=True)
    class Params:
        """Keys of the scenario file: how far ahead it aims; how far the header end keeps out of the crop."""

        preview_m: Annotated[float, Gt(0), Le(50)] = 10.0
        overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.1

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self.params = params
        _, end_y = setup.machine.header_end(setup.edge_side)
        outward = 1.0 if setup.edge_side == "left" else -1.0
        self.wanted_y = end_y - outward * params.overlap_m  # where the edge should lie [m], y to the left

    def reset(self, stream: Stream) -> Outputs:
        return {"command": SteerCommand(0, 0.0, False)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        edge = inputs["edge"]
        if not edge.is_found:
            return {"command": SteerCommand(t + dt, 0.0, False)}  # straight on, and a person must steer
        x = self.params.preview_m
        ahead = x - edge.reference_x
        y = edge.offset + edge.heading * ahead + 0.5 * edge.curvature * ahead**2 - self.wanted_y
        return {"command": SteerCommand(t + dt, 2.0 * y / (x * x + y * y), True)}

    def save(self) -> State:
        return {}

    def load(self, state: State) -> None:
        pass
