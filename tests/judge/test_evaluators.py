"""The evaluators against a run whose every error is prescribed."""

from pathlib import Path

import numpy as np
import pytest

from swath.judge.catalogue import load_evaluators
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.judge.evaluators.mass_balance import MassBalance
from swath.signals import CropFlow, MachineLoad
from tests.evaluated import evaluation_of, metrics_of
from tests.fake_run import ArcEdge, GridField, drive, machine


def judged(side="left", radius=0.0, overlap=0.2, **run):
    gap = run.pop("gap", (1e9, 1e9))
    ground = GridField(ArcEdge(radius, crop_on_right=side == "left"), gap)
    evaluation = evaluation_of(ground, machine(side, ground.nominal_edge), overlap=overlap)
    drive([evaluation], ground, side=side, hz=50, **run)
    return ground, evaluation


@pytest.mark.parametrize(("side", "radius"), [("left", 0.0), ("right", 40.0)])
def test_prescribed_errors_are_measured_with_their_sign(side, radius):
    """Header end 0.1 m into the crop, meant to be 0.2 m out of it: +0.3 m. Edge seen 0.02 m into the crop."""
    _, evaluation = judged(side, radius)
    m = metrics_of(evaluation)
    assert m["lateral_bias_m"] == pytest.approx(0.3, abs=1e-6)
    assert m["lateral_rms_m"] == pytest.approx(0.3, abs=1e-6)
    assert m["edge_bias_m"] == pytest.approx(0.02, abs=0.02)
    assert m["edge_rmse_m"] < 0.05
    assert m["detection_availability"] == 1.0
    assert set(m) <= set(load_evaluators().metrics)


def test_errors_have_one_sign_everywhere():
    """Towards the standing crop is positive: in the table of signs, the definitions, metrics and columns."""
    docs = Path(__file__).parents[2] / "docs"
    signs = (docs / "reference" / "nomenclature.md").read_text(encoding="utf-8").partition("## Signs")[2]
    (row,) = [line for line in signs.splitlines() if "lateral error" in line]
    definition = (docs / "reference" / "metrics.md").read_text(encoding="utf-8").partition("**Sign.**")[2]
    said = [row, definition.replace("\n", " ").partition(" and negative")[0]]
    metrics = load_evaluators().metrics
    said += [metrics[name].meaning for name in ("lateral_bias_m", "edge_bias_m")]
    columns = evaluation_of(GridField(ArcEdge()), machine()).columns("combine")
    said += [c.meaning for c in columns if c.name == "lateral_error_m"]
    assert len(said) == 5
    assert all("towards the standing crop" in text for text in said)
    assert not any("cut side" in text for text in said)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_strip_left_standing_is_counted(side):
    """0.25 m into the crop over 24 m of driving leaves 6 m2."""
    _, evaluation = judged(side, lateral=0.25)
    assert metrics_of(evaluation)["uncut_area_m2"] == pytest.approx(24 * 0.25, abs=0.15)


def test_header_use_is_the_share_in_the_crop_and_out_of_it_no_strip_is_left():
    metrics = metrics_of(judged(lateral=-0.7)[1])
    assert metrics["header_use"] == pytest.approx(0.9, abs=0.01)
    assert metrics["uncut_area_m2"] == 0.0


def test_masses_balance_also_with_crop_in_transit():
    ground, evaluation = judged()
    m = metrics_of(evaluation)
    assert m["mass_balance_error"] < 1e-12
    assert m["grain_cut_kg"] == pytest.approx(0.8 * m["area_cut_m2"])
    assert m["area_cut_m2"] == pytest.approx(24 * 7.0, rel=0.01)
    cut = ground.cut([(60.0, -5.0), (61.0, -5.0), (61.0, -4.0), (60.0, -4.0)])
    assert metrics_of(evaluation)["mass_balance_error"] > 1e-3
    flow = CropFlow(0, cut.grain, cut.straw, cut.area, 0, 1.0, 0.01)
    evaluation("combine.header", 0, {"flow": flow})
    assert metrics_of(evaluation)["mass_balance_error"] < 1e-12
    load = MachineLoad(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    evaluation("combine.process", 0, {"load": load})
    assert metrics_of(evaluation)["mass_balance_error"] == pytest.approx(1.0)


def test_a_gap_has_no_true_edge_and_no_duty_to_detect():
    """10 m without crop: nothing is true there, nothing is demanded there."""
    _, evaluation = judged(gap=(16.0, 26.0))
    s = evaluation.find("combine", EdgeDetection).series()
    share = 1.0 - np.mean(np.isfinite(s.true))
    assert share == pytest.approx(10 / 24, abs=0.02)
    m = metrics_of(evaluation)
    assert m["detection_availability"] > 0.98
    assert m["false_edge_share"] < 0.05


def test_other_machines_are_not_its_business():
    ground = GridField(ArcEdge())
    evaluation = evaluation_of(ground, machine(), machine(name="cart"))
    flow = CropFlow(0, 1.0, 1.0, 1.0, 1, 1.0, 0.1)
    evaluation("cart.header", 0, {"flow": flow})
    assert evaluation.find("field", MassBalance).accounted("combine") == (0.0, 0.0)
    assert evaluation.metrics("cart")["grain_cut_kg"] == 1.0
    assert "grain_cut_kg" not in evaluation.metrics("combine")


def test_the_masses_of_two_machines_and_of_what_lies_on_the_ground_balance():
    ground = GridField(ArcEdge())
    evaluation = evaluation_of(ground, machine(), machine(name="other"))
    for name, corner in (("combine", 10.0), ("other", 20.0)):
        cut = ground.cut([(corner, -2.0), (corner + 1.0, -2.0), (corner + 1.0, -1.0), (corner, -1.0)])
        flow = CropFlow(0, cut.grain, cut.straw, cut.area, 0, 1.0, 0.01)
        evaluation(f"{name}.header", 0, {"flow": flow})
    assert cut.grain > 0.5
    assert metrics_of(evaluation)["mass_balance_error"] < 1e-12
    zeros = [0.0] * 6
    load = MachineLoad(0, 0.0, 0.0, cut.straw, *zeros[:4], unloaded_grain=cut.grain)
    evaluation("other.process", 0, {"load": load})
    assert metrics_of(evaluation)["mass_balance_error"] == pytest.approx(0.5)
    ground.ground_grain_kg = cut.grain
    assert metrics_of(evaluation)["mass_balance_error"] < 1e-12
