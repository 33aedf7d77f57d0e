"""The algorithms of the nodes in examples/ros2 in process: what the nodes must equal to the last bit."""

import importlib.util
from pathlib import Path

from swath.core.component import Port
from swath.core.schedule import NS
from swath.link.ros2.slotnode import table_of
from swath.signals import CropEdge, Scan, SteerCommand

EXAMPLES = Path(__file__).parents[2] / "examples" / "ros2"


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class LawInProcess:
    """The same numbers in, the same numbers out, without ROS."""

    inputs = (Port("edge", CropEdge),)
    outputs = (Port("command", SteerCommand),)
    Params = None

    def __init__(self, params, setup):
        self.law, self.setup = example("steering_node").Law(), setup

    def reset(self, stream):
        machine = self.setup.machine
        told = {"setup.edge_is_left": self.setup.edge_side == "left", "setup.header_y": machine.header_y}
        self.law.reset(told | {"setup.header_width": machine.header_width})
        return {"command": SteerCommand(0, 0.0, False)}

    def step(self, t, dt, inputs):
        edge, numbers = inputs["edge"], {"step.dt": dt / NS}
        if edge is not None:
            for name in ("offset", "heading", "reference_x", "confidence"):
                numbers[f"edge.{name}"] = float(getattr(edge, name))
        return {"command": SteerCommand(t + dt, *self.law.step(numbers))}

    def save(self):
        return {"curvature": self.law.curvature}

    def load(self, state):
        self.law.curvature = state["curvature"]


class DetectorInProcess:
    """The detector on the scan itself."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)),)
    outputs = (Port("edge", CropEdge),)
    Params = None

    def __init__(self, params, setup):
        self.detector, self.setup = example("edge_detector_node").Detector(), setup

    def reset(self, stream):
        mounting = self.setup.mounting
        told = dict(zip(("x", "y", "z"), mounting.position, strict=True))
        told |= dict(zip(("roll", "pitch", "yaw"), mounting.euler(), strict=True))
        numbers = {f"setup.mounting.{name}": float(value) for name, value in told.items()}
        self.detector.reset(numbers | {"setup.edge_is_left": self.setup.edge_side == "left"})
        return {"edge": self.edge(0)}

    def step(self, t, dt, inputs):
        self.detector.step(table_of(inputs["scan"]))
        return {"edge": self.edge(t + dt)}

    def edge(self, t):
        return CropEdge(t, **{k.partition(".")[2]: v for k, v in self.detector.edge().items()})

    def save(self):
        return {}

    def load(self, state):
        pass
