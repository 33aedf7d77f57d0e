"""The functions of `my_box.py` as levels of swath: `edge: in_memory.py:Edge`, `steer: in_memory.py:Steer`."""

import math
import sys
from pathlib import Path

import numpy as np

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.signals import CropEdge, Scan, SteerCommand
from swath.signals.setup import ControlSetup

sys.path.insert(0, str(Path(__file__).parent))
import my_box


class Edge:
    """The edge of each scan; no scan, no edge."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)),)
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: None, setup: ControlSetup) -> None:
        self.mounting = setup.mounting

    def reset(self, stream: Stream) -> Outputs:
        return {"edge": self.told(0, None)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        scan = inputs["scan"]
        ranges = np.nan_to_num(scan.ranges[:, 0].astype(float))
        return {"edge": self.told(t + dt, my_box.crop_edge(scan.azimuth, ranges))}

    def told(self, t: int, edge: tuple[float, float] | None) -> CropEdge:
        nan = float("nan")
        if edge is None:
            return CropEdge(t, nan, nan, nan, self.mounting.position[0] + 8.0, 0.0, nan, nan)
        x, y, _ = self.mounting.position
        return CropEdge(t, y + edge[1], 0.0, 0.0, x + edge[0], 0.5, nan, nan)

    def save(self) -> State:
        return None

    def load(self, state: State) -> None:
        pass


class Steer:
    """The angle for each new edge."""

    inputs = (Port("edge", CropEdge),)
    outputs = (Port("command", SteerCommand),)
    overlap = my_box.OVERLAP

    def __init__(self, params: None, setup: ControlSetup) -> None:
        self.x = setup.machine.header_end(setup.edge_side)[0]
        self.y = setup.machine.header_end(setup.edge_side)[1]
        self.wheelbase = setup.machine.wheelbase

    def reset(self, stream: Stream) -> Outputs:
        self.smooth, self.seen = my_box.Smooth(), -1
        self.command = SteerCommand(0, 0.0, False)
        return {"command": self.command}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        edge = inputs["edge"]
        if edge.t != self.seen and edge.is_found:
            self.seen = edge.t
            angle = self.smooth((edge.reference_x - self.x, edge.offset - self.y))
            if angle is not None:
                self.command = SteerCommand(t + dt, math.tan(angle) / self.wheelbase, True)
        return {"command": self.command}

    def save(self) -> State:
        return {"angle": self.smooth.angle, "seen": self.seen, "command": self.command}

    def load(self, state: State) -> None:
        self.smooth.angle, self.seen, self.command = state["angle"], state["seen"], state["command"]
