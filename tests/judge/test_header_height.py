import numpy as np
import pytest

from swath.core.frames import Pose
from swath.judge.evaluator import SETTLING_M, EvaluatorSetup
from swath.judge.evaluators.header_height import HeaderHeight
from swath.signals import CropFlow, HeaderState, MachineState
from tests.fake_run import machine


class Watch(HeaderHeight):
    """Header of one machine, told the distance with each sample."""

    def __init__(self):
        super().__init__(EvaluatorSetup(None, {"combine": machine()}, "combine"))

    def at(self, signal, distance):
        state = MachineState(0, Pose.identity(), 1.0, 0.0, 0.0, 0.0, distance)
        self.see("combine.motion", 0, {"state": state})
        self.see("combine.header", 0, {"signal": signal})


def height(*errors):
    heights = 0.15 + np.array(errors)
    return HeaderState(0, heights, np.full(2, 0.15), 0.15, 0.05, 0.0, 0.0, 0.0)


def test_heights_count_after_settling_and_by_place():
    """One sample in four has one end of three 0.14 m too high: its mean is 4.7 cm off, within the band."""
    watch = Watch()
    watch.at(height(9.0, 9.0, 9.0), SETTLING_M - 0.1)
    for i in range(400):
        watch.at(height(0.0, 0.0, 0.14) if i % 4 == 0 else height(0.0, 0.0, 0.01), SETTLING_M + i)
    watch.at(CropFlow(0, 997.0, 1.0, 1.0, 1, 1.0, 0.1, lost_grain=2.0, left_grain=1.0), 20.0)
    m = watch.metrics()
    assert m["header_in_band"] == 1.0
    assert m["header_knife_in_band"] == pytest.approx(11 / 12)
    assert m["header_height_p95_error_m"] == pytest.approx(0.14)
    assert m["header_loss_percent"] == pytest.approx(0.3)
    assert set(m) == {metric.name for metric in HeaderHeight.METRICS}


def test_a_mean_outside_of_the_band_is_out_on_either_side():
    watch = Watch()
    for error in (0.06, -0.06, 0.04, -0.04):
        watch.at(height(error, error), SETTLING_M)
    assert watch.metrics()["header_in_band"] == 0.5


def test_a_header_that_tells_no_height_tells_what_it_left():
    watch = Watch()
    assert watch.metrics() == {}
    watch.at(CropFlow(0, 3.0, 1.0, 1.0, 1, 1.0, 0.1, left_grain=1.0), 20.0)
    assert watch.metrics() == {"header_left_kg": 1.0, "header_loss_percent": 25.0}
