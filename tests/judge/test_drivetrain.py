import pytest

from swath.core.frames import Pose
from swath.judge.evaluator import SETTLING_M, EvaluatorSetup
from swath.judge.evaluators.drivetrain import Drivetrain
from swath.signals import EngineState, MachineLoad, MachineState
from tests.fake_run import machine


class Watch(Drivetrain):
    """Drivetrain of one machine, told the distance with each sample."""

    def __init__(self, settling=SETTLING_M):
        super().__init__(EvaluatorSetup(None, {"combine": machine()}, "combine", settling))

    def at(self, signal, distance):
        state = MachineState(signal.t, Pose.identity(), 1.0, 0.0, 0.0, 0.0, distance)
        self.see("combine.motion", signal.t, {"state": state})
        self.see("combine.slot", signal.t, {"signal": signal})


def load(t, tank, drum=40.0, loss=0.01, feeder=39.0):
    zeros = {"lost_grain": 0.0, "dropped_straw": 0.0, "held_grain": 0.0, "held_straw": 0.0, "straw_flow": 0.0}
    return MachineLoad(
        round(t * 1e9),
        tank_grain=tank,
        grain_flow=0.0,
        drum_flow=drum,
        feeder_flow=feeder,
        loss_share=loss,
        **zeros,
    )


def engine(t, share, speed=199.0, used=0.0):
    return EngineState(round(t * 1e9), speed, speed / 199.0, share, 0.0, 0.0, used, *[0.0] * 9)


def test_throughput_and_losses_count_after_settling():
    watch = Watch()
    for i in range(200):
        share = 0.05 if i in (150, 151) else 0.01
        watch.at(load(0.1 * i, 2.4 * i, loss=0.5 if i < 50 else share), 0.2 * i)
    m = watch.metrics()
    assert m["mean_throughput_t_h"] == pytest.approx(2.4 / 0.1 * 3.6)
    assert m["peak_loss_percent"] == pytest.approx(100 * (2 * 0.05 + 18 * 0.01) / 20)
    assert m["mean_loss_percent"] == pytest.approx(100 * (148 * 0.01 + 2 * 0.05) / 150)
    assert m["feed_cv_percent"] == pytest.approx(0.0, abs=1e-5)
    assert set(m) <= {metric.name for metric in Drivetrain.METRICS}


def test_engine_metrics():
    watch = Watch()
    watch.at(engine(0.0, 9.0), 0.0)
    watch.at(load(0.0, 0.0), 0.0)
    watch.at(load(1.0, 500.0), SETTLING_M)
    for i, share in enumerate((0.7, 1.1, 0.9)):
        watch.at(engine(2.0 + i, share, speed=199.0 - 20.0 * (i == 1), used=0.42), 20.0)
    watch.at(load(9.0, 1000.0), 30.0)
    m = watch.metrics()
    assert m["peak_engine_load"] == 1.1
    assert m["mean_engine_load"] == pytest.approx(0.9)
    assert m["lowest_engine_rpm"] == pytest.approx(179.0 * 9.5493, rel=1e-5)
    assert m["fuel_l_t"] == pytest.approx(0.42 / 0.84 / 1.0)
    assert set(m) <= {metric.name for metric in Drivetrain.METRICS}


def test_without_samples_there_is_nothing_to_say():
    watch = Watch()
    assert watch.metrics() == {}
    watch.at(load(1.0, 0.0, drum=0.0), 50.0)
    assert watch.metrics() == {}


def test_in_a_window_fuel_and_grain_count_from_its_begin():
    watch = Watch(settling=0.0)
    watch.at(load(10.0, 1000.0), 50.0)
    watch.at(engine(10.0, 0.5, used=5.0), 50.0)
    watch.at(engine(20.0, 0.5, used=5.84), 60.0)
    watch.at(load(20.0, 1500.0), 60.0)
    assert watch.metrics()["fuel_l_t"] == pytest.approx(2.0)
