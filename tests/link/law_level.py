"""The law of examples/ros2/steering_node.py in process: what its node must equal to the last bit."""

import importlib.util
from pathlib import Path

from swath.core.component import Port
from swath.core.schedule import NS
from swath.core.signals import CropEdge, SteerCommand

FILE = Path(__file__).parents[2] / "examples" / "ros2" / "steering_node.py"


def law_of_the_node():
    spec = importlib.util.spec_from_file_location("steering_node", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Law()


class LawInProcess:
    """The same numbers in, the same numbers out, without ROS."""

    inputs = (Port("edge", CropEdge),)
    outputs = (Port("command", SteerCommand),)
    Params = None

    def __init__(self, params, setup):
        self.law, self.setup = law_of_the_node(), setup

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
