"""Passes beside each other against the overlap that they were laid with."""

from dataclasses import replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.judge.evaluators.pass_to_pass import PassToPass
from swath.signals import CropFlow, GuidanceState, MachineState
from tests.evaluated import evaluation_of
from tests.fake_run import GEOMETRY, ArcEdge, GridField, machine

WIDTH = 2.0 * GEOMETRY.header_end("left")[1]


def driven(lines, *, side="left", has_path=True, has_header=True):
    """Metrics of passes along lines (n, 2), of the machine's origin, cut one after the other."""
    outputs = {"motion.state": MachineState}
    outputs |= {"steer.guidance": GuidanceState} if has_path else {}
    outputs |= {"header.flow": CropFlow} if has_header else {}
    evaluation = evaluation_of(GridField(ArcEdge()), replace(machine(side), outputs=outputs))
    way = 0.0
    for line in lines:
        for cuts in (True, False):
            for k, (x, y) in enumerate(line if cuts else [*line[-1:], *[[0.0, 9.0]] * 40]):
                t = round(1e9 * way)
                ahead = line[min(k + 1, len(line) - 1)] - line[min(k, len(line) - 2)]
                if has_header:
                    flow = CropFlow(t, 0.0, 0.0, float(cuts), 0, 0.0, 0.1)
                    evaluation("combine.header", t, {"flow": flow})
                pose = Pose.from_euler([x, y, 0.0], yaw=float(np.arctan2(ahead[1], ahead[0])))
                evaluation("combine.motion", t, {"state": MachineState(t, pose, 1.0, 0.0, 0.0, 0.0, way)})
                way += 0.1
    return evaluation.metrics("combine")


def straight(y, *, back=False, wave=0.0):
    x = np.arange(0.0, 40.0, 0.1)
    line = np.stack([x, y + wave * np.sin(0.1 * x)], axis=1)
    return line[::-1] if back else line


@pytest.mark.parametrize(("side", "step"), [("left", -1.0), ("right", 1.0)])
def test_the_overlap_of_two_passes_is_that_they_were_laid_with(side, step):
    m = driven([straight(0.0), straight(step * (WIDTH - 0.12))], side=side)
    assert m["pass_overlap_m"] == pytest.approx(0.12, abs=1e-9)
    assert m["pass_gap_max_m"] == 0.0


def test_a_strip_that_is_left_has_the_width_of_the_gap():
    m = driven([straight(0.0), straight(-WIDTH - 0.05)])
    assert m["pass_overlap_m"] == pytest.approx(-0.05, abs=1e-9)
    assert m["pass_gap_max_m"] == pytest.approx(0.05, abs=1e-9)


def test_a_waving_pass_shows_its_amplitude():
    """The header end lies ahead of the axle: a sqrt(1 + (knife / 10 m)^2) at most."""
    m = driven([straight(0.0), straight(-WIDTH, wave=0.1)])
    assert 0.1 < m["pass_to_pass_p95_m"] < 0.1 * np.hypot(1.0, 0.1 * GEOMETRY.knife_x) + 0.005


def test_only_passes_that_were_driven_the_same_way_count():
    m = driven([straight(0.0), straight(-WIDTH, back=True)])
    assert np.isnan(m["pass_overlap_m"])


def test_of_three_passes_the_neighbour_counts():
    m = driven([straight(0.0), straight(-WIDTH + 0.1), straight(-2.0 * WIDTH + 0.2)])
    assert m["pass_overlap_m"] == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("lacks", ["has_path", "has_header"])
def test_a_machine_without_a_path_or_a_header_has_no_such_metric(lacks):
    names = {metric.name for metric in PassToPass.METRICS}
    assert not names & driven([straight(0.0), straight(-WIDTH)], **{lacks: False}).keys()


def test_one_pass_has_no_such_metric():
    names = {metric.name for metric in PassToPass.METRICS}
    assert not names & driven([straight(0.0)]).keys()
