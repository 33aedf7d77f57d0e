"""The referee against a run whose every error is prescribed."""

import numpy as np
import pytest
from swath.judge.metrics import METRICS
from swath.judge.referee import Referee

from swath.signals import CropFlow, MachineLoad
from tests.fake_run import ArcEdge, GridField, drive, machine


def judged(side="left", radius=0.0, overlap=0.2, **run):
    gap = run.pop("gap", (1e9, 1e9))
    ground = GridField(ArcEdge(radius, crop_on_right=side == "left"), gap)
    referee = Referee(ground, machine(side), overlap=overlap)
    drive([referee], ground, side=side, **run)
    return ground, referee


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("radius", [0.0, 40.0])
def test_prescribed_errors_are_measured_with_their_sign(side, radius):
    """Header end 0.1 m into the crop, meant to be 0.2 m out of it: +0.3 m. Edge seen 0.02 m into the crop."""
    _, referee = judged(side, radius)
    m = referee.metrics()
    assert m["lateral_bias_m"] == pytest.approx(0.3, abs=1e-6)
    assert m["lateral_rms_m"] == pytest.approx(0.3, abs=1e-6)
    assert m["edge_bias_m"] == pytest.approx(0.02, abs=0.02)
    assert m["edge_rmse_m"] < 0.05
    assert m["detection_availability"] == 1.0
    assert set(m) <= set(METRICS)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_strip_left_standing_is_counted(side):
    """0.25 m into the crop over 24 m of driving leaves 6 m2; 0.25 m out of it leaves nothing."""
    _, referee = judged(side, lateral=0.25)
    assert referee.metrics()["uncut_area_m2"] == pytest.approx(24 * 0.25, abs=0.15)
    _, referee = judged(side, lateral=-0.25)
    assert referee.metrics()["uncut_area_m2"] == 0.0


def test_header_use_is_the_share_in_the_crop():
    _, referee = judged(lateral=-0.7)
    assert referee.metrics()["header_use"] == pytest.approx(0.9, abs=0.01)


def test_masses_balance_also_with_crop_in_transit():
    ground, referee = judged()
    m = referee.metrics()
    assert m["mass_balance_error"] < 1e-12
    assert m["grain_cut_kg"] == pytest.approx(0.8 * m["area_cut_m2"])
    assert m["area_cut_m2"] == pytest.approx(24 * 7.0, rel=0.01)
    cut = ground.cut([(60.0, -5.0), (61.0, -5.0), (61.0, -4.0), (60.0, -4.0)])
    assert referee.metrics()["mass_balance_error"] > 1e-3
    flow = CropFlow(0, cut.grain, cut.straw, cut.area, 0, 1.0, 0.01)
    referee("combine.header", 0, {"flow": flow})
    assert referee.metrics()["mass_balance_error"] < 1e-12
    load = MachineLoad(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    referee("combine.process", 0, {"load": load})
    assert referee.metrics()["mass_balance_error"] == pytest.approx(1.0)


def test_a_gap_has_no_true_edge_and_no_duty_to_detect():
    """10 m without crop: nothing is true there, nothing is demanded there."""
    _, referee = judged(gap=(16.0, 26.0))
    s = referee.series()
    share = 1.0 - np.mean(np.isfinite(s.edge_true))
    assert share == pytest.approx(10 / 24, abs=0.02)
    m = referee.metrics()
    assert m["detection_availability"] > 0.98
    assert m["false_edge_share"] < 0.05


def test_other_machines_are_not_its_business():
    referee = Referee(GridField(ArcEdge()), machine(), overlap=0.0)
    referee("cart.header", 0, {"flow": CropFlow(0, 1.0, 1.0, 1.0, 1, 1.0, 0.1)})
    assert referee.accounted() == (0.0, 0.0)
    assert np.isnan(referee.metrics()["lateral_rms_m"])
