import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.judge.evaluator import SETTLING_M, EvaluatorSetup
from swath.judge.evaluators.grain_quality import GrainQuality
from swath.signals import MachineLoad, MachineState, OrganLoads
from tests.fake_run import machine
from tests.machine.machine_fakes import site
from tests.machine.process_rig import GRAIN, STRAW, Rig, Row

ZEROS = dict.fromkeys(("lost_grain", "dropped_straw", "held_grain", "held_straw", "straw_flow"), 0.0)


def watch():
    return GrainQuality(EvaluatorSetup(None, {"combine": machine()}, "combine", SETTLING_M))


def test_quality_and_losses_by_organ():
    judge = watch()
    for k in range(1, 11):
        lost = {"threshing_loss": 0.01, "separation_loss": 0.2, "cleaning_loss": 0.04, "loss_share": 0.0125}
        flows = {"drum_flow": 30.0, "straw_flow": 12.0 if k > 3 else 0.0}  # nothing has left before that
        load = MachineLoad(k * NS, tank_grain=19.75 * k, grain_flow=19.75, **lost, **{**ZEROS, **flows})
        judge.see("combine.process", k * NS, {"load": load})
        assert judge.metrics() == {}
    judge.see("combine.process", NS, {"organs": OrganLoads(NS, tank_broken=1.975, tank_mog=0.79)})
    found = judge.metrics()
    assert found["broken_percent"] == pytest.approx(1.0)
    assert found["tank_mog_percent"] == pytest.approx(0.4)
    losses = [found[f"{organ}_loss_percent"] for organ in ("threshing", "separation", "cleaning")]
    assert losses == pytest.approx([0.05, 1.0, 0.2])
    assert set(found) == {metric.name for metric in GrainQuality.METRICS}


def test_a_dense_patch_blocks_once():
    """Three times the crop from 20 to 30 m, more than 2.5 times the drum's nominal straw."""
    judge = watch()
    crop = lambda x: [m * (3.2 if 20.0 < x < 30.0 else 1.0) for m in (GRAIN, STRAW)]  # noqa: E731
    rig = Rig(engine=False, crop=crop, process=Row(site(period=0.1)))
    for _ in range(250):
        rig.step(2.0)
        here = MachineState(rig.t, Pose.identity(), 2.0, 0.0, 0.0, 0.0, rig.x)
        judge.see("combine.motion", rig.t, {"state": here})
        judge.see("combine.process", rig.t, {"load": rig.load, "organs": rig.organs})
    (event,) = judge.events()
    assert event.kind == "blockage"
    assert 20.0 < event.distance < 30.0
    assert "combine blocks at" in event.text
