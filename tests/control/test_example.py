"""The template for a user's own detector loads the way a scenario loads it, and finds the edge."""

from pathlib import Path

import numpy as np
import pytest

from swath.core.component import Component
from swath.core.random import Stream
from swath.core.registry import Registry
from swath.signals import CropEdge, Odometry
from tests.control.closed_loop import setup_of
from tests.control.synthetic_edge import Scanner, Stand, mounting

pytestmark = pytest.mark.usefixtures("code_allowed")

EXAMPLES = Path(__file__).parents[2] / "examples"
REGISTRY = Registry({"edge": ["swath.control.edge"], "steer": ["swath.control.steer"]})


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_the_template_finds_a_straight_edge(side, sign):
    level = REGISTRY.get("edge", "my_edge_detector.py:MyEdgeDetector", base=EXAMPLES)
    mount = mounting(side)
    detector = level.component(level.params(), setup_of(side, 0.04, mount))
    assert isinstance(detector, Component)
    assert not detector.reset(Stream(1, "edge"))["edge"].is_found
    scanner, rng = Scanner(Stand(lambda x, y: 6.0 - sign * y), mount), np.random.default_rng(1)
    for i in range(40):
        scan = scanner.scan((i + 1) * 40_000_000, (0.08 * i, 0.1 * sign, 0.0), rng)
        inputs = {"scan": scan, "odometry": Odometry(0, 2.0, 0.0, 0.0)}
        edge = detector.step(i * 40_000_000, 40_000_000, inputs)["edge"]
    assert edge.is_found
    assert edge.offset == pytest.approx(5.9 * sign, abs=0.15)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_template_of_a_law_steers_the_header_end_to_the_edge(side):
    level = REGISTRY.get("steer", "my_steering_law.py:MySteeringLaw", base=EXAMPLES)
    setup = setup_of(side, 0.02, mounting(side))
    law, outward = level.component(level.params(), setup), 1.0 if side == "left" else -1.0
    assert isinstance(law, Component)
    assert not law.reset(Stream(1, "steer"))["command"].is_engaged
    end_y = setup.machine.header_end(side)[1] - 0.1 * outward

    def command(offset, curvature=0.0):
        edge = CropEdge(0, offset, 0.0, curvature, 0.0, 1.0, 0.8, 0.1)
        return law.step(0, 20_000_000, {"edge": edge, "odometry": Odometry(0, 2.0, 0.0, 0.0)})["command"]

    assert command(end_y).curvature == 0.0
    assert command(end_y + 0.5).curvature == pytest.approx(2 * 0.5 / (10.0**2 + 0.5**2))  # to the left
    assert command(end_y, curvature=0.02).curvature == pytest.approx(0.02, rel=0.02)  # along the bend
    assert not command(np.nan).is_engaged


def test_built_in_levels_are_found_by_file_name():
    assert {"joined", "likelihood_ratio", "otsu"} <= set(REGISTRY.names("edge"))
    assert {"constant", "path", "preview", "pure_pursuit", "stanley"} <= set(REGISTRY.names("steer"))
    for name in REGISTRY.names("edge"):
        if name == "onnx":  # that needs a network
            continue
        level = REGISTRY.get("edge", name)
        assert isinstance(level.component(level.params(), setup_of("left", 0.04, mounting())), Component)
